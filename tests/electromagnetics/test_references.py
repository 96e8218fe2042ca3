"""Every row of the reference tables that this package claims to reproduce.

Who checks whom: the tables come from mpmath, from an own double-precision code and from FastHenry (see their headers);
none of them shares code with this package.
"""

import itertools

import numpy as np
import pytest
from scipy.optimize import brentq
from support.references import DECOUPLING_SHIFTS, circle, polygon, rows, spiral_layers

from coilarray import dc_resistance, inductance_matrix, mutual_inductance
from coilarray.electromagnetics.inductance import rectangular_bars, straight_filaments


def _point(text):
    return [float(part) for part in text.split(";")]


@pytest.mark.nojit
@pytest.mark.parametrize("row", rows("straight_filaments"), ids=lambda row: row["case"])
def test_straight_filaments(row):
    M = straight_filaments(*(_point(row[key]) for key in ("p1", "p2", "q1", "q2")))
    # 1e-9: the closed form; the table's coordinates are rounded to 12 digits
    assert M * 1e9 == pytest.approx(float(row["M_quad_nH"]), rel=1e-9)


@pytest.mark.nojit
@pytest.mark.parametrize("row", rows("hoer_love_bars"), ids=lambda row: row["case"])
def test_rectangular_bars(row):
    size = {key: float(value) for key, value in row.items() if key != "case"}
    first = (size["l1"], size["w1"], size["t1"])
    M = rectangular_bars(first, (size["l2"], size["w2"], size["t2"]), (size["dl"], size["dw"], size["dt"]))
    # 1e-9: exact to the quadrature, which is converged to 1e-11
    assert M * 1e9 == pytest.approx(float(row["M_nH"]), rel=1e-9)
    if row["case"].startswith("self"):
        assert rectangular_bars(first) * 1e9 == pytest.approx(float(row["M_nH"]), rel=1e-9)


@pytest.mark.parametrize("row", rows("hexagon_loops"), ids=lambda row: "-".join(list(row.values())[:6]))
def test_hexagon_loops(row):
    v = {key: float(value) for key, value in row.items()}
    first, centre = polygon(6, v["R1_mm"] * 1e-3), (v["dx_mm"] * 1e-3, v["dy_mm"] * 1e-3)
    second = polygon(6, v["R2_mm"] * 1e-3, v["z_mm"] * 1e-3, np.radians(v["rot_deg"]), centre)
    # 1e-9: 36 closed forms, none of which dominates
    assert mutual_inductance([first], [second])[0, 0] * 1e9 == pytest.approx(float(row["M_quad_nH"]), rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("row", rows("circular_filaments"), ids=lambda row: "-".join(list(row.values())[:6]))
def test_circular_filaments(row):
    a, b = float(row["a_m"]), float(row["b_m"])
    centre = [float(row[f"c{axis}_m"]) for axis in "xyz"]
    normal = [float(row[f"n{axis}"]) for axis in "xyz"]
    # the error of inscribed polygons is a series in 1/n² once their sides are shorter than the distance of the wires
    wires = circle(400, a, [0, 0, 0], [0, 0, 1]), circle(400, b, centre, normal)
    distance = np.linalg.norm(wires[0][:, None] - wires[1][None], axis=2).min()
    start = 2 ** int(np.ceil(np.log2(max(64, 4 * np.pi * max(a, b) / distance))))
    sides = [start, 2 * start, 4 * start]
    M = []
    for n in sides:
        first, second = circle(n, a, [0, 0, 0], [0, 0, 1]), circle(n, b, centre, normal)
        alike = n if centre[:2] == [0, 0] and normal[:2] == [0, 0] else 1  # on one axis all sides of the first are
        M.append(alike * mutual_inductance([first[:2] if alike > 1 else first], [second])[0, 0])
    order = np.log2(abs((M[1] - M[0]) / (M[2] - M[1])))
    assert order == pytest.approx(2, abs=0.1)  # second order; the next term of the series moves it by less
    first = [(4 * fine - coarse) / 3 for coarse, fine in itertools.pairwise(M)]
    # 1e-8: the third term of the series, with sides half as long as the distance of the wires; what the table gives
    # for inclined circles has 13 digits
    assert (16 * first[1] - first[0]) / 15 * 1e9 == pytest.approx(float(row["M_nH"]), rel=1e-8)


@pytest.mark.parametrize("row", rows("polygon_spirals_dc"), ids=lambda row: "-".join(list(row.values())[:8]))
def test_polygon_spirals(row):
    layers = spiral_layers(row)
    # layers in series, their junctions without length: the sum of all entries of the layers' matrix
    # 1e-4: the table is converged to about 1e-5
    assert inductance_matrix(layers).sum() * 1e6 == pytest.approx(float(row["L_own_uH"]), rel=1e-4)
    # 2e-5: the table has six digits, of the length seven
    assert pytest.approx(float(row["R_FH_ohm"]), rel=2e-5) == dc_resistance(layers, resistivity=1 / 5.8e7).sum()
    assert sum(layer.lengths.sum() for layer in layers) * 1e3 == pytest.approx(float(row["length_mm"]), rel=1e-5)


def _zero_coupling(sides, direction, height, unit, guess):
    """Shift over `unit` at which two equal polygons of circumradius one do not couple."""
    first = polygon(sides, 1.0)

    def mutual(d):
        centre = (d * unit * np.cos(direction), d * unit * np.sin(direction))
        return mutual_inductance([first], [polygon(sides, 1.0, height, centre=centre)])[0, 0]

    return brentq(mutual, guess - 0.05, guess + 0.05, xtol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("row", rows("geometric_decoupling_loops"), ids=lambda row: "-".join(list(row.values())[:2]))
def test_zero_coupling_distance(row):
    expected, h = float(row["d_crit_normalised"]), float(row["h_over_R"])
    if row["shape_direction"] == "circle":
        # Polygons of n sides, extrapolated in 1/n². Where the loops cross in one plane the error depends on where in
        # the sides they do, which the extrapolation does not remove: more sides there.
        n = 512 if h < 0.003 else 256
        coarse, fine = (_zero_coupling(sides, np.pi / sides, h, 2.0, expected) for sides in (n, 2 * n))
        root = (4 * fine - coarse) / 3
    else:
        sides, direction, unit, scale = DECOUPLING_SHIFTS[row["shape_direction"]]
        root = _zero_coupling(sides, direction, h * scale, unit, expected)
    # 1e-6 of the size; the table has ten digits
    assert root == pytest.approx(expected, abs=1e-6)
