"""The independent numbers of tests/reference and the shapes they speak of: one reader for tests and benchmarks.

Each file's header says where its numbers are from.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from coilarray.geometry import Conductor, Spiral

FOLDER = Path(__file__).parents[1] / "reference"


def rows(name: str) -> list[dict[str, str]]:
    """Rows of tests/reference/ref_NAME.csv as mappings from column to text."""
    return rows_of(f"ref_{name}.csv")


def rows_of(file: str) -> list[dict[str, str]]:
    """Rows of a file of tests/reference as mappings from column to text."""
    with (FOLDER / file).open(encoding="utf-8", newline="") as lines:
        return list(csv.DictReader(line for line in lines if not line.startswith("#")))


def polygon(sides, radius, z=0.0, turn=0.0, centre=(0.0, 0.0)):
    """Closed regular polygon by its circumradius, first corner at the angle `turn`, shape (sides + 1, 3)."""
    angle = turn + 2 * np.pi * np.arange(sides + 1) / sides
    angle[-1] = angle[0]  # closed to the last bit
    x, y = radius * np.cos(angle) + centre[0], radius * np.sin(angle) + centre[1]
    return np.column_stack((x, y, np.full(sides + 1, z)))


def circle(sides, radius, centre=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0)):
    """Inscribed polygon of a circle about `normal`."""
    n = np.array(normal) / np.linalg.norm(normal)
    u = np.cross([0, 1, 0] if abs(n[1]) < 0.9 else [1, 0, 0], n)
    u /= np.linalg.norm(u)
    flat = polygon(sides, radius)
    return np.array(centre) + flat[:, :1] * u + flat[:, 1:2] * np.cross(n, u)


def spiral_layers(row):
    """Layers of a row of ref_polygon_spirals_dc.csv as conductors, their junctions left out."""
    w, s, t = (float(row[key]) * 1e-3 for key in ("w_mm", "s_mm", "t_mm"))
    sizes = 2e-3 * float(row["ap_edge_mm"]), float(row["n_turns_per_layer"]), w, s
    spiral = Spiral(int(row["N_sides"]), *sizes, winding_rule="corner")
    layers = []
    for k, z in enumerate(row["z_list_mm"].split(";")):
        line = spiral.centre_line(k)
        layers.append(Conductor(np.column_stack((line, np.full(len(line), float(z) * 1e-3))), w, t))
    return layers


DECOUPLING_SHIFTS = {
    # sides, direction of the shift from a corner, normalising length over the circumradius, R of h_over_R over it
    "hexagon_across_flats": (6, np.pi / 6, np.sqrt(3), 1.0),
    "hexagon_across_corners": (6, 0.0, 2.0, 1.0),
    "square_along_side": (4, np.pi / 4, np.sqrt(2), np.sqrt(0.5)),
    "square_along_diagonal": (4, 0.0, 2.0, np.sqrt(0.5)),
}
