"""Accuracy: the worst row of every reference table that the package reproduces."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from references import rows

from coilarray import (
    dc_resistance,
    inductance_matrix,
    mutual_inductance,
    rectangular_bars,
    straight_filaments,
)
from coilarray.geometry import Conductor, Spiral


@dataclass(frozen=True)
class Accuracy:
    """Largest relative deviation from one table."""

    quantity: str
    table: str
    rows: int
    worst: float


def _worst(pairs):
    return max(abs(value / reference - 1) for value, reference in pairs)


def _hexagon(radius, z=0.0, turn=0.0, centre=(0.0, 0.0)):
    angle = turn + np.pi / 3 * (np.arange(7) % 6)
    return np.column_stack((centre[0] + radius * np.cos(angle), centre[1] + radius * np.sin(angle), np.full(7, z)))


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
        second = _hexagon(v["R2_mm"] * 1e-3, v["z_mm"] * 1e-3, np.radians(v["rot_deg"]), centre)
        yield mutual_inductance([_hexagon(v["R1_mm"] * 1e-3)], [second])[0, 0] * 1e9, v["M_quad_nH"]


def _spirals():
    for row in rows("polygon_spirals_dc"):
        w, s, t = (float(row[key]) * 1e-3 for key in ("w_mm", "s_mm", "t_mm"))
        spiral = Spiral(int(row["N_sides"]), float(row["ap_edge_mm"]) * 1e-3, float(row["n_turns_per_layer"]), w, s)
        layers = []
        for k, z in enumerate(row["z_list_mm"].split(";")):
            line = spiral.centre_line(k)
            layers.append(Conductor(np.column_stack((line, np.full(len(line), float(z) * 1e-3))), w, t))
        yield row, layers


def measure() -> list[Accuracy]:
    """Compare with every table; seconds."""
    spirals = list(_spirals())
    inductances = [(inductance_matrix(layers).sum() * 1e6, float(row["L_own_uH"])) for row, layers in spirals]
    fast_henry = [(value, float(row["L_FH_uH"])) for (value, _), (row, _) in zip(inductances, spirals, strict=True)]
    resistances = [(dc_resistance(layers, 1 / 5.8e7).sum(), float(row["R_FH_ohm"])) for row, layers in spirals]
    checks = {
        "M of straight filaments": ("ref_straight_filaments", list(_straight())),
        "L, M of rectangular bars": ("ref_hoer_love_bars", list(_bars())),
        "M of hexagonal loops": ("ref_hexagon_loops", list(_hexagons())),
        "L of polygonal spirals, 1 to 4 layers": ("ref_polygon_spirals_dc", inductances),
        "the same against FastHenry, 5 filaments a trace or 1": ("ref_polygon_spirals_dc", fast_henry),
        "R of polygonal spirals": ("ref_polygon_spirals_dc", resistances),
    }
    return [Accuracy(what, table, len(pairs), float(_worst(pairs))) for what, (table, pairs) in checks.items()]
