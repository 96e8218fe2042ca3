"""Small boards for the tests of recordings: two coils, with physics that is quick or with all of it."""

import math
import sqlite3
from contextlib import closing, contextmanager

import numpy as np
import pytest
import tomli_w
import xarray as xr

from coilarray.compute.files import unsealed
from coilarray.design.model import build_design
from coilarray.hardware.board.connect import Board
from coilarray.hardware.emulator.board import Conditions, EmulatedBoard, VirtualClock
from coilarray.hardware.record.calibration import BoardCalibration
from coilarray.hardware.record.campaign import Campaign, EmulatedStage, run_campaign
from coilarray.hardware.record.recorder import begin_session, open_recorder, record_stream
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
    """The paper's board as first assumed with two coils of few turns, pressed with small strain: quick."""
    document = first_assumed_document()
    document["coils"]["hexagon"].update(turns_per_layer=10, gap_mm=0.5)  # as wide as with its own 30
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


def quick_board(*, noise=0.0, seed=0, drift=0.0, world=None, clock=None):
    """An emulated board of two coils with quick physics, as `open_board` returns one."""
    wiring = two_coil_wiring()
    conditions = Conditions(noise=noise, drift=drift)
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


DESIGN = two_coils()
GRID = Campaign(
    x=tuple(np.arange(-8e-3, 21.1e-3, 2e-3)), y=tuple(np.arange(-6e-3, 6.1e-3, 2e-3)), depths=(1e-3,)
)  # fmt: skip
"""Over both coils; the largest δ of each is well inside."""


@contextmanager
def _recorded(path, campaign, oscillator, settings, board):
    """A quick board and its recorder, which has begun."""
    with open_recorder(path) as recorder, quick_board(**board) as opened:
        if oscillator is not None:
            opened.emulator.conditions.oscillator = oscillator
        recorder.start(session_of(opened, configured(opened, **(settings or {})), DESIGN), *campaign)
        yield opened, recorder


def campaign_file(path, campaign=GRID, *, oscillator=None, settings=None, **board):
    """Record a campaign on a quick board."""
    with _recorded(path, [campaign.to_json()], oscillator, settings, board) as (opened, recorder):
        run_campaign(campaign, opened.reader, EmulatedStage(opened.emulator), recorder, opened.emulator.clock)
    return path


def stream_file(path, scans, *, oscillator=None, settings=None, path_of_finger=None, **board):
    """Record a stream of a quick board."""
    with _recorded(path, [], oscillator, settings, board) as (opened, recorder):
        if path_of_finger is not None:
            opened.emulator.indenter.follow(path_of_finger)
        record_stream(opened.reader, recorder, scans=scans)
    return path


def quick_map(x, y, depths=(1e-3,)):
    """Response of the quick board as a simulation would give it: (f_0/f)² − 1 of its lossy tanks."""
    world = QuickWorld()

    def frequency(change):
        return series_tank(52e-6 * (1 + change), world.capacitance, world.resistance).frequency

    flat = frequency(0.0)
    delta = [
        [[[(flat / frequency(dent(coil, a, b, h))) ** 2 - 1 for coil in ("coil1", "coil2")] for a in x] for b in y]
        for h in depths
    ]
    coords = {"depth": list(depths), "y": np.asarray(y), "x": np.asarray(x), "state": ["coil1", "coil2"]}
    return xr.Dataset({"delta": (("depth", "y", "x", "state"), np.array(delta))}, coords)
