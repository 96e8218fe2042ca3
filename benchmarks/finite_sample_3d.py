"""What a finite sample on an uneven seat adds to the response, against a plain three-dimensional magnetic solution.

    python benchmarks/finite_sample_3d.py

Both faces of the magnetic sheet are moved as `coilarray.elastomer.finite_sample` says, the dent turned with the slope
about the ball's centre, and the inductances of two coils of gast2020 as first assumed under them are computed by
`benchmarks/dented_layer_3d.py`, less those under the dent in a wide sample on the same mesh. The package has the same
difference from dents at shifted depths that are lifted and turned, and to first order in the rest. The error of the
three-dimensional solution itself is that of its extrapolation from three meshes. Compared are the entries of the
inductance matrix, and what the sensor sees of them: the effective inductance of each coil, the other one shorted.
Writes benchmarks/finite_sample_3d.json; takes about ten minutes and 5 GB.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from dented_layer_3d import Box, board_coils, flat_mesh, moved_mesh, richardson, solve
from support.first_assumed import first_assumed

from coilarray.circuit.coupling import design_inductance
from coilarray.compute.arrays import FloatArray
from coilarray.elastomer.dent import Dent
from coilarray.elastomer.finite_sample import SampleCorrection
from coilarray.geometry import Seat, Unevenness
from coilarray.response.map import inductance_changes
from coilarray.response.setup import contact_at, dents_of, experiment, indentation_of, map_axes

RESULTS = Path(__file__).with_suffix(".json")
DESIGN = first_assumed()
SEAT = Seat(stiffness=4.3e6)
SIDE = float(Box().axes(6e-3, 8e-3)[0][Box().side_cells + 4])
"""Distance in m of a side from the indenter: a plane of the mesh, so that the step of the faces there is symmetric."""
CASES: dict[str, dict[str, Any]] = {
    "a near side": {"bounds": (-40e-3, -40e-3, 40e-3, SIDE), "slope": (0.0, 0.0), "place": (0.0, 0.0)},
    "a seat that rises": {"bounds": (-40e-3, -40e-3, 40e-3, 40e-3), "slope": (20.0, 0.0), "place": (16e-3, 0.0)},
}
LEVELS = (1.0, 1.5, 2.0)


def faces_of(
    dent: Dent, correction: SampleCorrection | None, place: FloatArray, pivot: float, x: FloatArray, y: FloatArray
) -> FloatArray:
    """Rise of the magnetic sheet's faces in m, shape (2, n), at points (n,) in m from the indenter.

    The dent turns with the sample about a point of the indenter's axis at the height `pivot` in m.
    """
    rise = dent.faces(np.hypot(x, y)).T[1:]
    if correction is None:
        return rise
    along_x, along_y = correction.at_indenter(place[None], (1, 2))[1][0, 0]
    for face, height in enumerate(dent.heights[1:]):
        below = pivot - height - rise[face]
        rise[face] = dent.faces(np.hypot(x - along_x * below, y - along_y * below))[:, 1 + face]
    x, y = x + place[0], y + place[1]
    inside = np.ones(len(x), dtype=bool)
    for axis, at in ((correction.x, x), (correction.y, y)):
        inside &= (at > axis.edges[0] - 1e-9) & (at < axis.edges[-1] + 1e-9)
    shapes = correction.x.basis(x[inside]), correction.y.basis(y[inside])
    rise[:, ~inside] = 0.0
    rise[:, inside] += np.einsum("lxy,nx,ny->ln", correction.moved[0, 0, 1:], *shapes, optimize=True)
    rise[:, np.abs(y - correction.y.edges[-1]) < 1e-9] /= 2
    return rise


def effective(change: FloatArray, flat: FloatArray) -> FloatArray:
    """Change in H of the effective inductance of each of two coils, the other one shorted, to first order."""
    currents = np.array([[1.0, -flat[0, 1] / flat[1, 1]], [-flat[0, 1] / flat[0, 0], 1.0]])
    return np.asarray(np.einsum("ai,ij,aj->a", currents, change, currents))


def compare(case: dict[str, Any]) -> dict[str, Any]:
    """Corrections of one case in H: by the package, and on each mesh of the three-dimensional solution."""
    assert DESIGN.indentation is not None
    setup = replace(DESIGN.indentation, base=SEAT, strain="linear")
    uneven = replace(setup, sample_bounds=case["bounds"], unevenness=Unevenness(stiffness_slope=case["slope"]))
    place = np.array(case["place"])
    wide, finite = (replace(DESIGN, indentation=one) for one in (setup, uneven))
    axes = map_axes(finite, x=place[:1], y=place[1:])
    changes = [inductance_changes(design, axes)[0, 0, 0, 1:3, 1:3] for design in (wide, finite)]
    correction = experiment(indentation_of(finite), finite.sheets, axes).correction
    assert correction is not None
    depths = axes.depth + np.array([0.0, correction.depth[0, 0]])
    dents = [dents_of(contact_at(setup, DESIGN.sheets, depth), DESIGN.sheets)[0] for depth in depths]
    pivot = float(dents[0].heights[-1] - depths[0] + setup.indenter.largest_radius)
    _, paths, centre = board_coils()
    loops = [path - [*(centre + place), 0.0] for path in paths]
    package = changes[1] - changes[0]
    rise, slope = (values[0, 0] for values in correction.at_indenter(place[None], (1, 2)))
    print(f"  depth {correction.depth[0, 0] * 1e6:.1f} um, lift {rise * 1e6:.1f} um, slope {slope * 1e3} mrad")
    print(f"  package {package.ravel() * 1e9} nH, wide {changes[0].ravel() * 1e9} nH", flush=True)
    solved = []
    for box in (Box().refined(level) for level in LEVELS):
        cells, in_layer = flat_mesh(box, 6e-3, 8e-3)
        x, y, _ = cells.doflocs
        values, start = [], None
        for dent, more in ((dents[0], None), (dents[1], correction)):
            lower, upper = faces_of(dent, more, place, pivot, x, y)
            mesh = moved_mesh(cells, box, 6e-3, 8e-3, lower, upper)
            value, start = solve(loops, mesh, in_layer, 2.7, start)
            values.append(value)
        solved.append(values[1] - values[0])
        print(f"  three dimensions {solved[-1].ravel() * 1e9} nH", flush=True)
    limit = richardson(solved[-2:], LEVELS[-2:])
    flat = design_inductance(DESIGN)[0][1:3, 1:3]
    seen = [effective(change, flat) for change in (package, limit)]
    print(f"  extrapolated {limit.ravel() * 1e9} nH, effective {seen[0] * 1e9} and {seen[1] * 1e9} nH", flush=True)
    return {
        **case,
        "package": package.tolist(),
        "three_dimensions": [one.tolist() for one in solved],
        "extrapolated": limit.tolist(),
        "wide": changes[0].tolist(),
        "effective": {"package": seen[0].tolist(), "three_dimensions": seen[1].tolist()},
    }


def main() -> None:
    """Compute, print, keep."""
    results = {}
    for name, case in CASES.items():
        print(name, flush=True)
        results[name] = compare(case)
    RESULTS.write_text(json.dumps({"units": "m, H", "design": DESIGN.name, "cases": results}, indent=1) + "\n")


if __name__ == "__main__":
    main()
