"""What a finite sample on an uneven seat adds to the response, against a plain three-dimensional magnetic solution.

    python benchmarks/finite_sample_3d.py

Both faces of the magnetic sheet are moved as `coilarray.elastomer.finite_sample` says, and the inductances of two coils
of gast2020 as first assumed under them are computed by `benchmarks/dented_layer_3d.py`, less those under the dent in a
wide sample on the same mesh. The package has the same difference from dents at shifted depths and to first order in the
rest. Writes benchmarks/finite_sample_3d.json.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from dented_layer_3d import Box, board_coils, flat_mesh, moved_mesh, solve
from support.first_assumed import first_assumed

from coilarray.elastomer.dent import Dent
from coilarray.elastomer.finite_sample import SampleCorrection
from coilarray.geometry import Seat, Unevenness
from coilarray.response.map import inductance_changes
from coilarray.response.setup import contact_at, dents_of, experiment, map_axes

FloatArray = npt.NDArray[np.float64]

RESULTS = Path(__file__).with_suffix(".json")
DESIGN = first_assumed()
SEAT = Seat(stiffness=4.3e6)
SIDE = float(Box().axes(6e-3, 8e-3)[0][Box().side_cells + 4])
"""Distance in m of a side from the indenter: a plane of the mesh, so that the step of the faces there is symmetric."""
CASES: dict[str, dict[str, Any]] = {
    "a near side": {"bounds": (-40e-3, -40e-3, 40e-3, SIDE), "slope": (0.0, 0.0), "place": (0.0, 0.0)},
    "a seat that rises": {"bounds": (-40e-3, -40e-3, 40e-3, 40e-3), "slope": (20.0, 0.0), "place": (16e-3, 0.0)},
}
MESHES = (Box(), Box().refined(1.5))


def faces_of(
    dent: Dent, correction: SampleCorrection | None, place: FloatArray, x: FloatArray, y: FloatArray
) -> FloatArray:
    """Rise of the magnetic sheet's faces in m, shape (2, n), at points (n,) in m from the indenter."""
    rise = dent.faces(np.hypot(x, y)).T[1:]
    if correction is None:
        return rise
    x, y = x + place[0], y + place[1]
    inside = np.ones(len(x), dtype=bool)
    for axis, at in ((correction.x, x), (correction.y, y)):
        inside &= (at > axis.edges[0] - 1e-9) & (at < axis.edges[-1] + 1e-9)
    shapes = correction.x.basis(x[inside]), correction.y.basis(y[inside])
    rise[:, ~inside] = 0.0
    rise[:, inside] += np.einsum("lxy,nx,ny->ln", correction.moved[0, 0, 1:], *shapes, optimize=True)
    rise[:, np.abs(y - correction.y.edges[-1]) < 1e-9] /= 2
    return rise


def compare(case: dict[str, Any]) -> dict[str, Any]:
    """Corrections of one case in H: by the package, and on each mesh of the three-dimensional solution."""
    assert DESIGN.indentation is not None
    setup = replace(DESIGN.indentation, base=SEAT, strain="linear")
    uneven = replace(setup, sample_bounds=case["bounds"], unevenness=Unevenness(stiffness_slope=case["slope"]))
    place = np.array(case["place"])
    wide, finite = (replace(DESIGN, indentation=one) for one in (setup, uneven))
    axes = map_axes(finite, x=place[:1], y=place[1:])
    changes = [inductance_changes(design, axes)[0, 0, 0, 1:3, 1:3] for design in (wide, finite)]
    correction = experiment(finite, axes).correction
    assert correction is not None
    depths = axes.depth + np.array([0.0, correction.depth[0, 0]])
    dents = [dents_of(contact_at(setup, DESIGN.sheets, depth), DESIGN.sheets)[0] for depth in depths]
    _, paths, centre = board_coils()
    loops = [path - [*(centre + place), 0.0] for path in paths]
    package = changes[1] - changes[0]
    print(f"  depth shift {correction.depth[0, 0] * 1e6:.1f} um, wide {changes[0].ravel() * 1e9} nH")
    print(f"  package {package.ravel() * 1e9} nH", flush=True)
    solved = []
    for box in MESHES:
        cells, in_layer = flat_mesh(box, 6e-3, 8e-3)
        x, y, _ = cells.doflocs
        values, start = [], None
        for dent, more in ((dents[0], None), (dents[1], correction)):
            lower, upper = faces_of(dent, more, place, x, y)
            moved = moved_mesh(cells, box, 6e-3, 8e-3, lower, upper)
            value, start = solve(loops, moved, in_layer, 2.7, start)
            values.append(value)
        solved.append((values[1] - values[0]).tolist())
        print(f"  three dimensions {np.ravel(solved[-1]) * 1e9} nH", flush=True)
    return {**case, "package": package.tolist(), "three_dimensions": solved, "wide": changes[0].tolist()}


def main() -> None:
    """Compute, print, keep."""
    results = {}
    for name, case in CASES.items():
        print(name, flush=True)
        results[name] = compare(case)
    RESULTS.write_text(json.dumps({"units": "m, H", "design": DESIGN.name, "cases": results}, indent=1) + "\n")


if __name__ == "__main__":
    main()
