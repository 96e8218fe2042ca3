"""Campaigns recorded with the emulator from known values return them within the stated errors.

Who checks whom: the emulator's own physics (a table of inductance changes, the whole circuit at every reading, noise of
the converter) against the fit; the errors of 12 fits against how far they are off.
"""

import json

import numpy as np
import pytest
from scipy.stats import chi2
from support.command_line import runner
from support.contacts import coarse_maps
from support.recorded_boards import configured, quick_board, session_of, two_coils_document

from coilarray import calibrate
from coilarray.compute.store import open_store
from coilarray.design.model import build_design
from coilarray.design.toml_file import TomlFiles
from coilarray.design.vary import vary
from coilarray.hardware.emulator.sensor_world import SensorWorld, response_table
from coilarray.hardware.record.campaign import Campaign, EmulatedStage, run_campaign
from coilarray.hardware.record.recorded_response import recorded_response
from coilarray.hardware.record.recorder import open_recorder
from coilarray.hardware.record.recording import open_recording
from coilarray.hardware.scan.settings import board_network
from coilarray.response.setup import DEFAULT_MESH
from coilarray.studies.calibrate import calibration
from coilarray.studies.calibrate.plan import evaluate_model

pytestmark = pytest.mark.slow

run, _ = runner("calibrate")

MU, STIFF, DRIFT = "elastomer.1.relative_permeability", "elastomer.1.youngs_modulus_kPa", "imperfections.drift"
TRUE = {MU: 2.9, STIFF: 190.0, DRIFT: 0.0}
BOUNDS = {MU: (2.7, 3.1), STIFF: (150.0, 230.0), DRIFT: (-2e-5, 2e-5)}
GRID = Campaign(x=(-6e-3, -3e-3, 0.0, 3e-3, 6e-3), y=(-4e-3, 0.0, 4e-3), depths=(1e-3,))
# Of a frequency: 2.8e-6 of δ. The table has more depths than the map, so that its contacts have other meshes, which is
# 1e-7 of δ. With 3e-6 the errors of permeability and modulus, which go together, are so long that their valley bends:
# each alone is still within its error, but both together are not what the linear covariance says (χ² twice its mean).
NOISE = 1e-6
CAMPAIGNS = 12
TABLE = (np.array([0.5e-3, 0.75e-3, 1e-3]), np.linspace(-4e-3, 4e-3, 5), np.array(GRID.x))  # has the grid's own places


def small_document():
    """The two coils under a sample on a seat that is just large enough."""
    document = two_coils_document()
    document["coils"]["hexagon"].update(turns_per_layer=30, gap_mm=0.1)  # for which the emulator's drives are
    seat = {"base": "seat", "seat_stiffness_kPa_per_mm": 5.3, "sample_x_mm": [-12, 12], "sample_y_mm": [-10, 10]}
    return {**document, "indentation": {**document["indentation"], **seat}}


@pytest.fixture(scope="module", autouse=True)
def _coarse():
    """A coarse mesh of the magnetic layer, the same for the board as it is and for the model that is fitted to it.

    That of contacts stays: on a coarse one the contact does not grow smoothly with the stiffness.
    """
    with coarse_maps(contact=DEFAULT_MESH):
        yield


@pytest.fixture(scope="module")
def emulated(tmp_path_factory):
    """The design of a small board as believed, and the emulated physics of the board as it is."""
    believed, store = build_design(small_document(), "two_coils"), open_store(tmp_path_factory.mktemp("store"))
    real = vary(believed, {key: value for key, value in TRUE.items() if key != DRIFT})
    return believed, SensorWorld(board_network(real), lambda: response_table(real, store, TABLE))


def record(path, emulated, seed):
    believed, world = emulated
    with open_recorder(path) as recorder, quick_board(world=world, noise=NOISE, seed=seed) as opened:
        recorder.start(session_of(opened, configured(opened), believed), GRID.to_json())
        run_campaign(GRID, opened.reader, EmulatedStage(opened.emulator), recorder, opened.emulator.clock)
    return path


def measured(path):
    with open_recording(path) as recording:
        return recorded_response(recording)


def point_of(item):
    magnetic = item["document"]["elastomer"][1]
    values = magnetic["relative_permeability"], magnetic["youngs_modulus_kPa"], item["imperfections"]["drift"]
    ranges = np.array([BOUNDS[key] for key in TRUE])
    return (np.array(values) - ranges.mean(axis=1)) / np.ptp(ranges, axis=1)


class Surface:
    """The model for many fits of the same board: of second degree in the sheet's values, of first in the drift."""

    def __init__(self):
        self.coefficients = None

    @staticmethod
    def terms(point):
        mu, stiff, drift = point
        return np.array([1.0, mu, stiff, drift, mu * mu, mu * stiff, stiff * stiff])

    def fit(self, item, ranges):
        """Evaluate at the middle of the ranges, and around it."""
        mu, stiff, drift = 0.25 * np.eye(3)
        steps = [0 * mu, mu, -mu, stiff, -stiff, mu + stiff, drift]
        items = [changed(item, ranges.mean(axis=1) + step * np.ptp(ranges, axis=1)) for step in steps]
        values = np.array([list(evaluate_model(one).values()) for one in items])
        self.coefficients = np.linalg.solve([self.terms(step) for step in steps], values)

    def __call__(self, item):
        values = self.terms(point_of(item)) @ self.coefficients
        return {str(k): value for k, value in enumerate(values.tolist())}


def changed(item, values):
    sheets = list(item["document"]["elastomer"])
    mu, stiff, drift = map(float, values)
    sheets[1] = {**sheets[1], "relative_permeability": mu, "youngs_modulus_kPa": stiff}
    return {**item, "document": {**item["document"], "elastomer": sheets}, "imperfections": {"drift": drift}}


def test_errors_of_campaigns_are_as_stated(emulated, tmp_path, monkeypatch):
    surface, asked = Surface(), []

    def evaluate(item):
        if surface.coefficients is None:
            asked.append({**item, "parts": str(tmp_path / "parts")})  # the drift alone changes no part
            surface.fit(asked[0], np.array([BOUNDS[key] for key in TRUE]))
        return surface(item)

    monkeypatch.setattr(calibration, "evaluate_model", evaluate)
    off, squares, within = [], [], []
    for seed in range(CAMPAIGNS):
        data = measured(record(tmp_path / f"{seed}.sqlite", emulated, seed))
        found = calibrate(emulated[0], data, BOUNDS).dataset.isel(combination=0)
        assert bool(found.converged)
        apart = found["value"].values - np.array(list(TRUE.values()))
        covariance = found.correlation.values * np.outer(found["std"], found["std"])
        off.append(apart / found["std"].values)
        squares.append(apart @ np.linalg.solve(covariance, apart))
        within.append((found.low.values <= list(TRUE.values())) & (found.high.values >= list(TRUE.values())))
    # the model that was fitted is that of the package: in a far corner to a tenth of the noise of δ
    corner = changed(asked[0], [2.95, 175.0, 5e-6])
    exact = np.array(list(evaluate_model(corner).values()))
    np.testing.assert_allclose(list(surface(corner).values()), exact, atol=0.2e-6)
    # 3 unknowns of 12 campaigns: χ² with 36 degrees of freedom, at odds of 1 in 1000 on each side. The noise of each
    # campaign is known with 27 degrees of freedom by what remains and 19 by the baselines: Student's is 46/44 wider
    low, high = chi2.ppf([1e-3, 1 - 1e-3], 3 * CAMPAIGNS)
    assert low < sum(squares) < high * 46 / 44
    # no bias: 3.3 standard deviations of a mean
    assert np.abs(np.mean(off, axis=0)).max() < 3.3 / np.sqrt(CAMPAIGNS)
    # of 12 intervals of 95 % fewer than 9 hold the truth at odds of 1 in 500
    assert (np.sum(within, axis=0) >= 9).all()


def test_the_command_finds_what_was_recorded(emulated, tmp_path, capsys):
    import tomli_w

    path = record(tmp_path / "one.sqlite", emulated, seed=1000)
    design = tmp_path / "believed.toml"
    document = small_document()
    sheets = list(document["elastomer"])
    sheets[1] = {**sheets[1], "youngs_modulus_kPa": TRUE[STIFF]}
    design.write_text(tomli_w.dumps({**document, "elastomer": sheets}), encoding="utf-8")
    options = ("--unknown", f"{MU}=2.7:3.1", "--workers", "1", "--out", str(tmp_path / "out"), "--json")
    code, out, err = run(capsys, design, path, *options)
    assert code == 0, err
    answer = json.loads(out)
    (row,) = answer["unknowns"]
    assert row["value"] == pytest.approx(TRUE[MU], abs=3.5 * row["std"])
    assert row["std"] < 0.01
    assert answer["values"] == {MU: row["value"]}
    files = TomlFiles("design", ValueError)
    written = files.parse(files.text(tmp_path / "out" / "calibrated.toml"), "calibrated")
    assert written["elastomer"][1]["relative_permeability"] == pytest.approx(row["value"], rel=1e-9)
    assert "elastomer.1.relative_permeability" in (tmp_path / "out" / "calibration.html").read_text(encoding="utf-8")
