"""The distortion of x0 and its causes, and the calibration that never sees x0.

Who checks whom: the effects of single neighbours add up to that of all; opened neighbours leave the geometric centre;
the published ellipses come back from a map made of them; a calibration finds the values a map was made with.
"""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from support.contacts import coarse_maps, first_coils_design

import coilarray.localize.calibration as calibration_module
import coilarray.localize.distortion as distortion_module
from coilarray import load_design
from coilarray.errors import ElastomerError, LocalizeError
from coilarray.localize.calibration import UNKNOWNS, Unknown, apply, calibrate
from coilarray.localize.distortion import distortion, ellipse_curves
from coilarray.localize.published import published_map, published_model
from coilarray.response.map import Imperfections, inductance_changes, respond, response_map
from coilarray.response.setup import map_axes

pytestmark = pytest.mark.slow

PAPER = load_design("gast2020")
LEVELS = np.array([1e-4, 3e-4, 5e-4])


@pytest.fixture(scope="module")
def split():
    """On a coarse mesh in the ideal circuit, with a margin that is a few steps of the grid."""
    with coarse_maps(), pytest.MonkeyPatch.context() as patch:
        patch.setattr(distortion_module, "response_map", partial(response_map, ideal=True))
        patch.setattr(distortion_module, "respond", partial(respond, ideal=True))
        patch.setattr(distortion_module, "_WIDE", (6e-3, 4e-3))
        patch.setattr(distortion_module, "_SEEDS", 3)
        return distortion(first_coils_design(3), ("coil1", "coil2"), LEVELS)


def test_neighbours_move_x0_by_little(split):
    """The estimate of the physics notes: +0.05 mm for coil 1, nothing for coil 2; a little less without losses."""
    assert split.effect.sel(cause="all neighbours", state="coil1").values == pytest.approx(0.05e-3, abs=0.01e-3)
    assert np.abs(split.effect.sel(cause="all neighbours", state="coil2").values).max() < 0.01e-3
    single = split.effect.sel(cause=[f"neighbour coil{k}" for k in range(1, 4)])
    # first order in k²: the single effects add up to all of them, to a tenth of a step of the refinement (0.1 mm)
    assert single.sum("cause").values == pytest.approx(split.effect.sel(cause="all neighbours").values, abs=0.01e-3)


def test_opened_neighbours_leave_the_centre(split):
    # 0.02 mm: the refined map's step of 0.1 mm, and one half turn of the winding
    assert (split.x0.sel(neighbours="open") - split.centre).values == pytest.approx(0, abs=0.02e-3)


def test_nothing_explains_the_published_x0(split):
    """The paper's x0 goes to −17.2 mm; no cause here is a tenth of that. An honest residual is the result."""
    assert float(split.rms_residual.sel(state="coil1")) > 0.8e-3
    assert float(split.rms.max()) < 0.2e-3
    assert split.published_x0.sel(state="coil1").values[0] == pytest.approx(-16.01e-3, abs=0.01e-3)


def test_published_ellipses_come_back():
    curves = ellipse_curves(published_map(), ("coil2",), np.append(LEVELS, 9e-3))
    expected = np.polyval(published_model()["coil2"].x0, LEVELS)
    # 0.05 mm: the paper's levels are ±2e-5 wide and its grid 2 mm; the last level is above the peak
    assert curves.x0[0] == pytest.approx(np.append(expected, np.nan), abs=0.05e-3, nan_ok=True)


def test_other_paths_meet_the_same_tilted_sample():
    given = Imperfections(tilt=(0.001, 0.0), depth_error=0.05e-3, offset=(0.2e-3, 0.0))
    pair = first_coils_design(2)
    with coarse_maps():
        response = response_map(pair, x=[-5e-3, 3e-3], y=[0.0], imperfections=given, ideal=True)
        change = inductance_changes(pair, map_axes(pair, None, response.x, response.y), imperfections=given)
    assert change == pytest.approx(response.inductance_change.values, rel=1e-12)


def _fake_map(design, **_):
    """A published map whose hills widen with the modulus ratio and rise with the permeability: quick to compute."""
    ratio = design.sheets[1].youngs_modulus / design.sheets[0].youngs_modulus / 3
    gain = design.sheets[1].relative_permeability / 2.7
    response = published_map(np.arange(-26, 27, 2) * 1e-3 * ratio, np.arange(-6, 7, 2) * 1e-3 * ratio)
    return response.assign(delta=response.delta * gain).assign_coords(x=response.x / ratio, y=response.y / ratio)


def test_calibration_finds_what_a_map_was_made_with(monkeypatch):
    """Only A, B and peaks are compared; Table A1 itself stands at a ratio of 3 and 2.7."""
    monkeypatch.setattr(calibration_module, "response_map", _fake_map)
    wanted = (Unknown("modulus_ratio", "1", 2.6, 2.0, 4.5), Unknown("relative_permeability", "1", 2.4, 2.0, 3.5))
    found = calibrate(PAPER, ("coil2",), wanted)
    value = found.result["value"].values
    # 3 %: the pipeline's own error of A, 0.05 mm in 5 mm and more at the window's edge
    assert value == pytest.approx([3.0, 2.7], rel=0.03)
    assert float(found.result.misfit_after) < float(found.result.misfit_before)
    assert not found.result.at_bound.values.any()
    assert np.diag(found.result.correlation) == pytest.approx(np.ones(2))
    assert ((found.result.low.values < value) & (value < found.result.high.values)).all()
    assert found.design.sheets[1].relative_permeability == pytest.approx(value[1])


def test_calibration_marks_bounds(monkeypatch):
    monkeypatch.setattr(calibration_module, "response_map", _fake_map)
    found = calibrate(PAPER, ("coil2",), [Unknown("relative_permeability", "1", 2.0, 1.5, 2.2)])
    assert found.result.at_bound.values.all()


def test_values_enter_the_design():
    material = {"poissons_ratio": 0.45, "modulus_ratio": 2.0, "relative_permeability": 3.0}
    design, given = apply(PAPER, {**material, "depth_error": 1e-4, "tilt": 0.002}, "frictionless")
    assert [sheet.poissons_ratio for sheet in design.sheets] == [0.45, 0.45]
    assert design.sheets[1].youngs_modulus == 2 * design.sheets[0].youngs_modulus
    assert (design.sheets[0].relative_permeability, design.sheets[1].relative_permeability) == (1.0, 3.0)
    assert design.indentation.base == "frictionless"
    assert given == Imperfections(tilt=(0.002, 0.0), depth_error=1e-4)


@pytest.mark.parametrize(("arguments", "message"), [
    ({"unknowns": [Unknown("x0", "m", 0, -1, 1)]}, "one of depth_error"),
    ({"unknowns": [Unknown("tilt", "1", 2, -1, 1)]}, "between its bounds"),
    ({"unknowns": []}, "at least one unknown"),
    ({"states": ("coil5",)}, "published"),
    ({"base": "glued"}, "bonded or frictionless"),
    ({"design": replace(PAPER, indentation=None)}, r"no \[indenter\]"),
    ({"design": replace(PAPER, sheets=PAPER.sheets[:1])}, "exactly one magnetic sheet"),
])  # fmt: skip
def test_bad_input_of_the_calibration(arguments, message):
    with pytest.raises((LocalizeError, ElastomerError), match=message):
        calibrate(**{"design": PAPER, "states": ("coil2",), "unknowns": UNKNOWNS, **arguments})


def test_unknown_states_are_refused():
    with pytest.raises(LocalizeError, match="got 'coil9'"):
        distortion(PAPER, ("coil9",))
