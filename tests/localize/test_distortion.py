"""The distortion of x0 and its causes.

Who checks whom: the effects of single neighbours add up to that of all; opened neighbours leave the geometric centre;
the published ellipses come back from a map made of them.
"""

from functools import partial

import numpy as np
import pytest
from support.contacts import coarse_maps, first_coils_design

import coilarray.localize.distortion as distortion_module
from coilarray import load_design
from coilarray.errors import LocalizeError
from coilarray.localize.distortion import EllipseCurves, distortion, ellipse_curves
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
        design = first_coils_design(3)
        return distortion(design, ("coil1", "coil2"), LEVELS, draws=[(design, Imperfections())] * 2)


def test_neighbours_move_x0_by_little(split):
    """The estimate of the physics notes: +0.05 mm for coil 1, nothing for coil 2; a little less without losses."""
    assert split.effect.sel(cause="all neighbours", state="coil1").values == pytest.approx(0.05e-3, abs=0.01e-3)
    assert np.abs(split.effect.sel(cause="all neighbours", state="coil2").values).max() < 0.01e-3
    single = split.effect.sel(cause=[f"neighbour coil{k}" for k in range(1, 4)])
    # first order in k²: the single effects add up to all of them, to a tenth of a step of the refinement (0.1 mm)
    assert single.sum("cause").values == pytest.approx(split.effect.sel(cause="all neighbours").values, abs=0.01e-3)


def test_equal_draws_are_the_design_without_error(split):
    for name in ("x0", "effect", "rms"):
        error = split[f"{name}_std"]
        assert float(error.max()) == 0
        assert np.isnan(error.sel(cause="window")).all() if "cause" in error.dims else np.isfinite(error).any()


def test_opened_neighbours_leave_the_centre(split):
    # 0.02 mm: the refined map's step of 0.1 mm, and one half turn of the winding
    assert (split.x0.sel(neighbours="open") - split.centre).values == pytest.approx(0, abs=0.02e-3)


def test_nothing_explains_the_published_x0(split):
    """The paper's x0 goes to −17.2 mm; no cause here is a tenth of that. An honest residual is the result."""
    assert float(split.rms_residual.sel(state="coil1")) > 0.8e-3
    assert float(split.rms.max()) < 0.2e-3
    assert split.published_x0.sel(state="coil1").values[0] == pytest.approx(-16.01e-3, abs=0.01e-3)


def test_draws_tell_the_error_of_the_neighbours_effect():
    """Draws whose x0 is known: two that differ by 2 µm have a standard deviation of √2 µm, equal ones none."""
    rows = np.ones((1, len(LEVELS)))
    result = distortion_module._dataset(
        PAPER,
        ("coil2",),
        LEVELS,
        EllipseCurves(rows, rows, rows, rows > 1),
        EllipseCurves(rows, rows, rows, rows > 1),
        {"all neighbours": rows, "window": rows},
    )
    drawn = np.array([[2e-6 * rows, 1e-6 * rows], [4e-6 * rows, 1e-6 * rows]])  # grounded and open
    errors = distortion_module._errors(result, drawn)
    assert errors["x0_std"].values[:, 0, 0] == pytest.approx([np.sqrt(2) * 1e-6, 0])
    assert errors["effect_std"].sel(cause="all neighbours").values == pytest.approx(np.sqrt(2) * 1e-6)
    assert errors["rms_std"].sel(cause="all neighbours").values == pytest.approx(np.sqrt(2) * 1e-6)
    assert np.isnan(errors["effect_std"].sel(cause="window").values).all()
    with pytest.raises(LocalizeError, match="draws must be at least 2"):
        distortion(PAPER, draws=[(PAPER, Imperfections())])


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


def test_unknown_states_are_refused():
    with pytest.raises(LocalizeError, match="got 'coil9'"):
        distortion(PAPER, ("coil9",))
