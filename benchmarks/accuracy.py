"""Accuracy: the worst row of every reference table that the package reproduces."""

from __future__ import annotations

import itertools
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import brentq

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from support.parallel_traces import interlayer_capacitance, parallel_traces
from support.references import DECOUPLING_SHIFTS, circle, polygon, rows, spiral_layers

from coilarray import dc_resistance, inductance_matrix, mutual_inductance
from coilarray.electromagnetics.inductance import rectangular_bars, straight_filaments
from coilarray.electromagnetics.resistance import cross_section, skin_depth


@dataclass(frozen=True)
class Accuracy:
    """Largest relative deviation from one table."""

    quantity: str
    table: str
    rows: int
    worst: float
    limit: float

    @property
    def kept(self) -> bool:
        """True where the deviation is within the limit."""
        return self.worst <= self.limit


def _worst(pairs):
    return max(abs(value / reference - 1) for value, reference in pairs)


def _straight():
    for row in rows("straight_filaments"):
        ends = ([float(part) for part in row[key].split(";")] for key in ("p1", "p2", "q1", "q2"))
        yield straight_filaments(*ends) * 1e9, float(row["M_quad_nH"])


def _bars():
    for row in rows("hoer_love_bars"):
        v = {key: float(value) for key, value in row.items() if key != "case"}
        first, second = (v["l1"], v["w1"], v["t1"]), (v["l2"], v["w2"], v["t2"])
        yield rectangular_bars(first, second, (v["dl"], v["dw"], v["dt"])) * 1e9, v["M_nH"]


def _hexagons():
    for row in rows("hexagon_loops"):
        v = {key: float(value) for key, value in row.items()}
        centre = (v["dx_mm"] * 1e-3, v["dy_mm"] * 1e-3)
        second = polygon(6, v["R2_mm"] * 1e-3, v["z_mm"] * 1e-3, np.radians(v["rot_deg"]), centre)
        yield mutual_inductance([polygon(6, v["R1_mm"] * 1e-3)], [second])[0, 0] * 1e9, v["M_quad_nH"]


def _circles():
    """Polygons of n, 2n and 4n sides, extrapolated in 1/n²."""
    for row in rows("circular_filaments"):
        a, b = float(row["a_m"]), float(row["b_m"])
        centre, normal = [float(row[f"c{k}_m"]) for k in "xyz"], [float(row[f"n{k}"]) for k in "xyz"]
        wires = circle(400, a), circle(400, b, centre, normal)
        distance = np.linalg.norm(wires[0][:, None] - wires[1][None], axis=2).min()
        n = 2 ** int(np.ceil(np.log2(max(64, 4 * np.pi * max(a, b) / distance))))
        M = [mutual_inductance([circle(k, a)], [circle(k, b, centre, normal)])[0, 0] for k in (n, 2 * n, 4 * n)]
        first = [(4 * fine - coarse) / 3 for coarse, fine in itertools.pairwise(M)]
        yield (16 * first[1] - first[0]) / 15 * 1e9, float(row["M_nH"])


def _zero_coupling():
    """Centre distances of polygons at which M vanishes; circles stand in tests/electromagnetics/test_references.py."""
    for row in rows("geometric_decoupling_loops"):
        if row["shape_direction"] not in DECOUPLING_SHIFTS:
            continue
        sides, direction, unit, scale = DECOUPLING_SHIFTS[row["shape_direction"]]
        first, z = circle(sides, 1.0), float(row["h_over_R"]) * scale
        along = unit * np.array([np.cos(direction), np.sin(direction), 0.0])

        def mutual(d, first=first, z=z, along=along):
            return mutual_inductance([first], [first + d * along + np.array([0, 0, z])])[0, 0]

        expected = float(row["d_crit_normalised"])
        yield brentq(mutual, expected - 0.05, expected + 0.05, xtol=1e-12), expected


def _single_trace(*, wide: bool):
    for row in rows("ac_single_trace"):
        w, t, f = float(row["w_mm"]) * 1e-3, float(row["t_mm"]) * 1e-3, float(row["f_MHz"]) * 1e6
        if (w > 2 * float(skin_depth(f))) == wide:
            yield float(cross_section(w, t, f).resistance_ratio), float(row["ratio_extrap"])


def _bundle(*, wide: bool):
    for row in rows("ac_parallel_traces"):
        w, t, pitch = (float(row[key]) * 1e-3 for key in ("w_mm", "t_mm", "pitch_mm"))
        n, f = int(row["n_traces"]), float(row["f_MHz"]) * 1e6
        if (w > 2 * float(skin_depth(f))) != wide:
            continue
        layers = [float(z) * 1e-3 for z in row["z_list_mm"].split(";")]
        x = np.tile(pitch * np.arange(n), len(layers))
        z = np.repeat(layers, n)
        losses = parallel_traces(np.full(x.size, w), np.full(x.size, t), x, z, np.ones(x.size), f)
        yield float(losses.resistance_ratio.mean()), float(row["ratio_fine"])


def _interlayer():
    for row in rows("capacitance_interlayer"):
        w, s, t, h = (float(row[key]) * 1e-3 for key in ("w_mm", "s_mm", "t_mm", "h_mm"))
        yield interlayer_capacitance(w, s, h, float(row["eps_r"]), t) * 1e12, float(row["C_pF_per_m"])


def measure() -> list[Accuracy]:
    """Compare with every table; seconds."""
    spirals = [(row, spiral_layers(row)) for row in rows("polygon_spirals_dc")]
    inductances = [(inductance_matrix(layers).sum() * 1e6, float(row["L_own_uH"])) for row, layers in spirals]
    fast_henry = [(value, float(row["L_FH_uH"])) for (value, _), (row, _) in zip(inductances, spirals, strict=True)]
    resistances = [(dc_resistance(layers, 1 / 5.8e7).sum(), float(row["R_FH_ohm"])) for row, layers in spirals]
    checks = {
        "M of straight filaments": (1e-9, "ref_straight_filaments.csv", list(_straight())),
        "L, M of rectangular bars": (1e-9, "ref_hoer_love_bars.csv", list(_bars())),
        "M of circles, from polygons": (1e-8, "ref_circular_filaments.csv", list(_circles())),
        "M of hexagonal loops": (1e-9, "ref_hexagon_loops.csv", list(_hexagons())),
        "distance of zero coupling, polygons": (
            1e-6,
            "ref_geometric_decoupling_loops.csv",
            list(_zero_coupling()),
        ),
        "L of polygonal spirals, 1 to 4 layers": (1e-4, "ref_polygon_spirals_dc.csv", inductances),
        "the same against FastHenry, 5 filaments a trace or 1": (1e-3, "ref_polygon_spirals_dc.csv", fast_henry),
        "AC resistance of one trace, w ≤ 2 skin depths": (
            1e-2,
            "ref_ac_single_trace.csv",
            list(_single_trace(wide=False)),
        ),
        "AC resistance of one trace, wider": (3e-2, "ref_ac_single_trace.csv", list(_single_trace(wide=True))),
        "AC resistance of a bundle, w ≤ 2 skin depths": (1e-2, "ref_ac_parallel_traces.csv", list(_bundle(wide=False))),
        "AC resistance of a bundle, wider": (3e-2, "ref_ac_parallel_traces.csv", list(_bundle(wide=True))),
        "capacitance between two layers": (5e-2, "ref_capacitance_interlayer.csv", list(_interlayer())),
        "R of polygonal spirals": (2e-5, "ref_polygon_spirals_dc.csv", resistances),
    }
    return [
        Accuracy(what, table, len(pairs), float(_worst(pairs)), limit) for what, (limit, table, pairs) in checks.items()
    ]
