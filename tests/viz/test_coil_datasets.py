"""Arcs, currents, draped maps and ellipses: that each shows its numbers where they belong."""

import math

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import chdtr

from coilarray.viz.datasets import results

CENTRES = np.array([[-10e-3, 0.0], [0.0, 1e-3], [10e-3, 0.0], [3e-3, 15e-3]])
K = np.array([[1, -0.05, 0.001, 0.02], [-0.05, 1, -0.04, 0], [0.001, -0.04, 1, -0.01], [0.02, 0, -0.01, 1]])


def test_arcs_end_at_the_centres_of_their_coils_and_weak_ones_can_be_left_out():
    arcs = results.coupling_arcs(CENTRES, K, height=2e-3)
    assert arcs.n_lines == 6
    for n in range(6):
        points = np.asarray(arcs.get_cell(n).points)
        first, second = (int(arcs.cell_data[name][n]) for name in ("coil", "other"))
        np.testing.assert_allclose(points[0], [*CENTRES[first] * 1e3, 2.0], atol=1e-6)
        np.testing.assert_allclose(points[-1], [*CENTRES[second] * 1e3, 2.0], atol=1e-6)
        assert arcs.cell_data[results.COUPLING][n] == K[first, second]
        span = np.linalg.norm(CENTRES[first] - CENTRES[second]) * 1e3
        assert points[:, 2].max() == pytest.approx(2 + 0.3 * span)
        # upright: the middle of the arc is over the middle of its coils
        np.testing.assert_allclose(points[16, :2], (CENTRES[first] + CENTRES[second]) / 2 * 1e3, atol=1e-6)
    arcs = results.coupling_arcs(CENTRES, K, least=0.02)
    assert sorted(zip(arcs.cell_data["coil"].tolist(), arcs.cell_data["other"].tolist(), strict=True)) == [
        (0, 1), (0, 3), (1, 2),
    ]  # fmt: skip
    assert results.coupling_arcs(CENTRES, K, least=1).n_cells == 0
    assert results.arc_tubes(results.coupling_arcs(CENTRES, K, least=1), 1.0).n_cells == 0


def test_tubes_are_as_thick_as_the_coupling():
    arcs = results.coupling_arcs(CENTRES, K, least=0.01)
    tubes = results.arc_tubes(arcs, 0.5)
    k, points = tubes.point_data[results.COUPLING], np.asarray(tubes.points)
    assert set(k) == set(arcs.cell_data[results.COUPLING]) == {-0.05, -0.04, 0.02, -0.01}
    for n, one in enumerate(arcs.cell_data[results.COUPLING]):
        line = np.asarray(arcs.get_cell(n).points)
        nearest = np.linalg.norm(points[k == one][:, None] - line, axis=2).min(axis=1)
        assert nearest.max() == pytest.approx(0.5 * abs(one) / 0.05, rel=1e-3)


def hills(nan=False):
    x, y, h = np.linspace(-6e-3, 6e-3, 13), np.linspace(-4e-3, 4e-3, 5), np.array([0.5e-3, 1e-3])
    bell = np.exp(-((x - 1e-3) ** 2 + y[:, None] ** 2) / (4e-3) ** 2)
    delta = np.stack([h[:, None, None] * bell, -2 * h[:, None, None] * bell], axis=-1)
    if nan:
        delta[0, 0, 0] = np.nan
    coords = {"depth": h, "y": y, "x": x, "state": ["a", "b"]}
    return xr.Dataset({"delta": (("depth", "y", "x", "state"), delta)}, coords)


@pytest.mark.parametrize(("state", "depth"), [("a", -1), ("b", 0)])
def test_a_draped_map_has_the_values_of_its_dataset(state, depth):
    origin = (20e-3, -3e-3)
    data = hills().assign_attrs(origin_x=origin[0], origin_y=origin[1]).transpose("x", "state", "y", "depth")
    mesh, _ = results.response_surface(data, state, depth, height=2e-3, relief=1e-3)
    assert mesh.n_points == 13 * 5
    assert mesh.n_cells == 12 * 4
    one = data.delta.isel(depth=depth).sel(state=state)
    for (x, y, z), value in zip(np.asarray(mesh.points) * 1e-3, mesh.point_data[results.DELTA], strict=True):
        there = float(one.sel(x=x - origin[0], y=y - origin[1], method="nearest", tolerance=1e-8))
        assert value == there
        assert z == pytest.approx(2e-3 + 1e-3 * there / float(np.abs(one).max()), abs=1e-9)
    flat, _ = results.response_surface(data, state, depth)
    assert flat.area == pytest.approx(12 * 8)  # mm²: no hole and no overlap
    gap, _ = results.response_surface(hills(nan=True), "a", 0, relief=1e-3)
    assert np.isnan(gap.point_data[results.DELTA]).sum() == 1
    assert np.isfinite(gap.points).all()


def test_an_outline_lies_on_the_map():
    ring = 3e-3 * np.column_stack((np.cos(np.arange(0, 6.2, 0.1)), np.sin(np.arange(0, 6.2, 0.1))))
    outlines = [ring + np.array([x, 0]) for x in (20e-3, 26e-3, 60e-3)]  # inside, over the edge, beside it
    data = hills().assign_attrs(origin_x=20e-3)
    surface, lines = results.response_surface(data, "a", outlines=outlines, height=1e-3, relief=2e-3)
    assert lines.n_lines in (2, 3)  # the second may be cut in two where it begins
    x_min, x_max, *_ = lines.bounds
    assert (x_min, x_max) == (pytest.approx(17, abs=0.01), pytest.approx(26, abs=0.3))
    distance = np.abs(lines.compute_implicit_distance(surface).point_data["implicit_distance"])
    # a quadrilateral is drawn as two triangles: they differ from it by at most 1/8 of its twist
    assert distance.max() < 0.05
    _, above = results.response_surface(data, "a", outlines=outlines, height=1e-3, relief=2e-3, above=1e-3)
    np.testing.assert_allclose(above.points[:, 2] - lines.points[:, 2], 1.0, atol=1e-5)  # single precision


def test_what_cannot_be_drawn_over_a_board_is_refused():
    with pytest.raises(ValueError, match="state must be one of a, b; got 'c'"):
        results.response_surface(hills(), "c")
    with pytest.raises(ValueError, match="depth must be the position of one of 2 depths; got 2"):
        results.response_surface(hills(), "a", 2)
    with pytest.raises(ValueError, match="at least two positions along x and along y; got 13 and 1"):
        results.response_surface(hills().isel(y=[0]), "a")


@settings(max_examples=30)
@given(
    st.floats(1e-6, 1e-2), st.floats(1e-6, 1e-2), st.floats(-0.99, 0.99), st.floats(0.05, 0.999),
    st.sampled_from([1.0, 20.0]),
)  # fmt: skip
def test_an_ellipse_is_its_covariance(sx, sy, correlation, confidence, magnification):
    covariance = np.array([[sx**2, correlation * sx * sy], [correlation * sx * sy, sy**2]])
    centre = (3e-3, -7e-3)
    ellipse = results.uncertainty_ellipse(centre, covariance, confidence, magnification=magnification, height=1e-3)
    points = np.asarray(ellipse.points, dtype=float)
    assert (points[:, 2] == 1.0).all()
    away = (points[:-1, :2] * 1e-3 - centre) / magnification
    # every point has the Mahalanobis distance whose χ² with two degrees of freedom has the confidence
    distance = np.einsum("ni,ij,nj->n", away, np.linalg.inv(covariance), away)
    # single precision in mm, at worst 7e-3/1e-6 of the centre and 1/(1 − ρ²) of the inverse
    np.testing.assert_allclose(chdtr(2, distance), confidence, atol=0.05)
    # equal steps of the angle: the mean of r rᵀ is q/2 Σ
    q = -2 * math.log(1 - confidence)
    np.testing.assert_allclose(
        away.T @ away / len(away), q / 2 * covariance, rtol=2e-2, atol=2e-2 * q * covariance.max()
    )
