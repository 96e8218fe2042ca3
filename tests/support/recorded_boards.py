"""Small boards for the tests of recordings: two coils, with physics that is quick or with all of it."""

import math
import sqlite3
from contextlib import closing

import pytest
import tomli_w

from coilarray.compute.files import unsealed
from coilarray.design.model import build_design
from coilarray.hardware.board.connect import Board
from coilarray.hardware.emulator import Conditions, EmulatedBoard, VirtualClock
from coilarray.hardware.record.calibration import BoardCalibration
from coilarray.hardware.record.recorder import begin_session
from coilarray.hardware.record.recording import sign_row
from coilarray.hardware.scan.wiring import parse_wiring
from support.emulated_reader import reader_of, settings_of
from support.first_assumed import first_assumed_document
from support.quick_coils import FixedCoils, series_tank


def take_back(connection, which):
    """Make positions of a recording, chosen in SQL, unmeasured again, with the checksums that they then have."""
    numbers = [row[0] for row in connection.execute(f"SELECT id FROM position WHERE {which}")]
    for number in numbers:
        connection.execute("UPDATE position SET finished = NULL WHERE id = ?", (number,))
        sign_row(connection, "position", number)
    connection.commit()


def changed(path, *statements):
    """Change a recording by statements of SQL."""
    with closing(sqlite3.connect(path)) as connection:
        connection.executescript("; ".join(statements))


def unsealed_text(path):
    """Text of a calibration as a person has it who changes it."""
    return 'checksum = "none"\n' + unsealed(path.read_bytes(), path).decode("utf-8")


_DEVICE = """
[[wiring.device]]
name = "U{k}"
part = "ADG739"

[wiring.device.switch]
S1A = {{ coil = "coil{k}", end = "a", net = "ground" }}
S2A = {{ coil = "coil{k}", end = "a", net = "INA" }}
S1B = {{ coil = "coil{k}", end = "b", net = "ground" }}
S2B = {{ coil = "coil{k}", end = "b", net = "INB" }}
"""
WIRING_TEXT = """
schema = 1

[wiring]
title = "Two coils"
coils = ["coil1", "coil2"]

[wiring.part.ADG739]
bits = ["S1A", "S2A", "S3A", "S4A", "S1B", "S2B", "S3B", "S4B"]
""" + "".join(_DEVICE.format(k=k) for k in (1, 2))


def two_coils_document():
    """The paper's board as first assumed with two of its coils, pressed over the first with small strain: quick."""
    document = first_assumed_document()
    document["array"] = {**document["array"], "columns": 2}
    own = {
        "x_mm": [-6, 6],
        "y_mm": [-4, 4],
        "origin": "coil1",
        "strain": "linear",
    }
    document["indentation"] = {**document["indentation"], **own}
    return {**document, "name": "two_coils"}


def two_coils():
    """The design of `two_coils_document`."""
    return build_design(two_coils_document(), "two_coils")


@pytest.fixture(scope="module")
def board(tmp_path_factory):
    """Arguments of a command for the small board."""
    folder = tmp_path_factory.mktemp("two_coils")
    design, wiring = folder / "two_coils.toml", folder / "wiring.toml"
    design.write_text(tomli_w.dumps(two_coils_document()))
    wiring.write_text(WIRING_TEXT)
    return (design, "--wiring", wiring)


def two_coil_wiring():
    return parse_wiring(WIRING_TEXT, "two_coils")


def dent(coil, x, y, depth):
    """δ of a coil of the quick board: a bell over its centre, in proportion to the depth."""
    centre = {"coil1": 0.0, "coil2": 13e-3}[coil]
    return 0.8 * depth * math.exp(-((x - centre) ** 2 + y**2) / (8e-3) ** 2)


class QuickWorld(FixedCoils):
    """Coils whose inductance follows `dent`."""

    def __init__(self):
        super().__init__(dict.fromkeys(("coil1", "coil2"), 52e-6))
        self.dead = set()

    def resonator(self, state, place, temperature):
        ((coil, _),) = state.measured
        if coil in self.dead:
            return None
        L = self.inductances[coil] * (1 + dent(coil, place.x, place.y, place.depth))
        return series_tank(L, self.capacitance, self.resistance)


def quick_board(*, noise=0.0, seed=0, drift=None, world=None, clock=None):
    """An emulated board of two coils with quick physics, as `open_board` returns one."""
    wiring = two_coil_wiring()
    conditions = Conditions(noise=noise) if drift is None else Conditions(noise=noise, drift=drift)
    world, clock = world or QuickWorld(), clock or VirtualClock()
    emulator = EmulatedBoard(wiring, world, clock=clock, conditions=conditions, seed=seed)
    return Board(reader_of(emulator, wiring=wiring), "emulator", wiring, emulator)


def configured(board, **options):
    """Configure a quick board and return its settings."""
    settings = settings_of(board.wiring, **{"quality": 40.0, "drives": 8, **options})
    board.reader.configure(settings)
    return settings


session_of = begin_session


def board_calibration(**changes):
    """Constants of a board with two tanks."""
    channels = [
        {"state": state, "capacitance_F": 120e-12, "standard_error_F": 1e-13, "inductance_H": 52e-6}
        for state in ("coil1", "coil2")
    ]
    keys = {
        "source": "by hand",
        "made": "2025-01-01",
        "board": "XMC 2Go",
        "emulated": False,
        "design_hash": "abc",
        "clock_Hz": 43.2e6,
        "clock_standard_error_Hz": 10.0,
        "clock_from": "known frequency",
        "capacitances_from": "known inductances",
        "channels": channels,
    }
    return BoardCalibration.model_validate(keys | changes)
