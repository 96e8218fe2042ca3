"""The dented magnetic layer by a plain three-dimensional FEM: slow, and independent of `coilarray.elastomer`.

    python benchmarks/dented_layer_3d.py

H = H_s − ∇φ with H_s of the closed coils by Biot–Savart, so that only the layer carries sources:

    ∫ µ ∇φ·∇v dV = κ ∫_layer H_s·∇v dV,    κ = µ0 (µr − 1),    φ = 0 on the sides of a box about the dent
    ΔL_ij = κ ∫_layer (H_s,i − ∇φ_i)·H_s,j dV = κ ∫_layer H_s,i·H_s,j dV − φ_i·b_j

with b_j the right-hand side of coil j (reduced scalar potential: Simkin & Trowbridge, Int. J. Numer. Meth. Eng. 14,
423, 1979). The layer's share is computed with the dent and without it on meshes of one topology, whose errors cancel
in the difference. The hexahedra are triquadratic: φ·b is an energy, so its error falls with the fourth power of the
cell width (tests/elastomer/test_dented_layer_3d.py measures that). The main programme computes two neighbouring coils
of gast2020 as first assumed under one smooth dent at three places, on four meshes and in three boxes, and writes
benchmarks/dented_layer_3d.json; on one core it takes half an hour to an hour, and up to 9 GB.
"""

from __future__ import annotations

import json
import platform
import resource
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyamg
import skfem
from scipy.optimize import brentq
from scipy.sparse import csr_matrix
from scipy.sparse.linalg import cg
from skfem.helpers import dot, grad

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from support.first_assumed import first_assumed

from coilarray import magnetic_field
from coilarray.compute.arrays import FloatArray
from coilarray.constants import MU_0
from coilarray.errors import ElastomerError, GeometryError

Face = Callable[[FloatArray], FloatArray]

RESULTS = Path(__file__).with_suffix(".json")

_CELLS_AT_ONCE = 4000  # bounds the memory of the assembly to about 0.3 GB
_RESIDUAL = 1e-9  # relative; the inductance is an energy and keeps twice the digits
_MAX_ITERATIONS = 1000
_STEEPEST_FADE = 1.5  # largest slope of `_fade`


@dataclass(frozen=True)
class SmoothDent:
    """A dent with a raised ring and no net volume, of the kind a sphere leaves in a nearly incompressible layer.

    With s the width and w = 3.84 s, either face moves by −depth · (exp(−r²/2s²) − (s²/w²)(r²/2w²) exp(−r²/2w²)); the
    ring is s²/(e w²) = 2.5 % of the depth high, at r = √2 w. The lower face moves 0.64 times as far as the upper.

    Parameters
    ----------
    depth : float
        Of the upper face at r = 0, in m.
    width : float
        Standard deviation s of the dent in m.
    """

    depth: float = 1e-3
    width: float = 2e-3

    def top(self, r: npt.ArrayLike) -> FloatArray:
        """Rise of the upper face in m at the radius `r` in m (negative: the dent)."""
        return -self.depth * self._shape(r)

    def bottom(self, r: npt.ArrayLike) -> FloatArray:
        """Rise of the lower face in m at the radius `r` in m."""
        return -0.64 * self.depth * self._shape(r)

    def _shape(self, r: npt.ArrayLike) -> FloatArray:
        squared = np.asarray(r, dtype=np.float64) ** 2
        ring_width = 3.84 * self.width
        u = squared / (2 * ring_width**2)
        return np.exp(-squared / (2 * self.width**2)) - (self.width / ring_width) ** 2 * u * np.exp(-u)


@dataclass(frozen=True)
class Box:
    """Tensor-product mesh of a box about the dent, graded like sinh from the dent and from the layer outwards.

    Parameters
    ----------
    half_width : float
        From the dent to either side of the box in m.
    air : float
        Height of the air below and above the layer in m.
    cell : float
        Width of the cells at the dent in m.
    side_cells, layer_cells, air_cells : int
        Numbers of cells from the dent to a side, through the layer, and through the air below or above.
    fade : float
        Height in m, off the layer, over which the mesh of the air follows the dent.
    """

    half_width: float = 80e-3
    air: float = 80e-3
    cell: float = 1.6e-3
    side_cells: int = 10
    layer_cells: int = 2
    air_cells: int = 8
    fade: float = 12e-3

    def __post_init__(self) -> None:
        for name in ("half_width", "air", "cell", "fade"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise GeometryError(f"{name} of the mesh must be positive and finite; got {getattr(self, name)!r}.")
        for name in ("side_cells", "layer_cells", "air_cells"):
            if getattr(self, name) != int(getattr(self, name)) or getattr(self, name) < 1:
                raise GeometryError(f"{name} must be a positive integer; got {getattr(self, name)!r}.")
        if self.fade > self.air:
            raise GeometryError(f"the fade must end within the air, {self.air} m; got {self.fade} m.")

    def refined(self, factor: float) -> Box:
        """Each cell divided by `factor`; the numbers of cells must stay whole (nested where `factor` is whole)."""
        counts = {name: factor * getattr(self, name) for name in ("side_cells", "layer_cells", "air_cells")}
        whole = {name: int(count) if count == int(count) else count for name, count in counts.items()}
        return replace(self, cell=self.cell / factor, **whole)

    def widened(self, cells: int) -> Box:
        """`cells` more outside the box on every side; what lies inside stays the same up to the change of `air`."""
        factor = graded_reach(self.half_width, self.side_cells, self.cell, self.side_cells + cells) / self.half_width
        return replace(
            self,
            half_width=self.half_width * factor,
            side_cells=self.side_cells + cells,
            air=self.air * factor,
            air_cells=self.air_cells + cells,
        )

    def axes(self, z_bottom: float, z_top: float) -> tuple[FloatArray, FloatArray]:
        """Node positions in m along x (and y), centred at the dent, and along z."""
        side = graded(self.half_width, self.side_cells, self.cell)
        air = graded(self.air, self.air_cells, (z_top - z_bottom) / self.layer_cells)
        layer = np.linspace(z_bottom, z_top, self.layer_cells + 1)
        return np.concatenate((-side[:0:-1], side)), np.concatenate((z_bottom - air[:0:-1], layer, z_top + air[1:]))


def _stretch(length: float, cells: int, first: float) -> float:
    """Return the b of x(t) = length · sinh(b t)/sinh(b) with x'(0)/cells = first."""
    if not cells * first < length:
        raise GeometryError(f"{cells} cells of {first} m must be fewer than fill {length} m, so that they can grow.")
    return float(brentq(lambda b: b / np.sinh(b) - cells * first / length, 1e-9, 50))


def graded(length: float, cells: int, first: float) -> FloatArray:
    """Nodes x(t) = length · sinh(b t)/sinh(b) at t = 0, 1/cells, … 1, in m, with b such that x'(0)/cells is `first`."""
    b = _stretch(length, cells, first)
    nodes: FloatArray = length * np.sinh(b * np.arange(cells + 1) / cells) / np.sinh(b)
    return nodes


def graded_reach(length: float, cells: int, first: float, more: int) -> float:
    """Length in m of the same row of cells continued to `more` cells."""
    b = _stretch(length, cells, first)
    return float(length * np.sinh(b * more / cells) / np.sinh(b))


def dent_inductance_change(
    paths: Sequence[npt.ArrayLike],
    z_bottom: float,
    z_top: float,
    relative_permeability: float,
    bottom: Face,
    top: Face,
    centre: npt.ArrayLike,
    mesh: Box | None = None,
) -> FloatArray:
    """Change of the inductance matrix by an axisymmetric dent in a wide magnetic layer.

    Parameters
    ----------
    paths : sequence of array_like, shape (n + 1, 3)
        Closed polylines below the layer in m, the last vertex equal to the first.
    z_bottom, z_top : float
        Heights of the faces of the flat layer in m.
    relative_permeability : float
        Of the layer, at least 1.
    bottom, top : callable
        Rise of the lower and the upper face in m at radii about the dent in m.
    centre : array_like, shape (2,)
        x and y of the dent in m.
    mesh : Box, optional
        `Box().refined(1.5)` if not given.

    Returns
    -------
    ndarray, shape (paths, paths)
        Inductance with the dent minus inductance with the flat layer, in H.

    Raises
    ------
    GeometryError
        A path that is not closed or not below the layer; faces that cross; numbers that are not finite; a dent too
        deep for the fade of the mesh.
    ElastomerError
        A relative permeability below 1; a potential that does not converge.
    """
    box = Box().refined(1.5) if mesh is None else mesh
    loops = _checked(paths, z_bottom, z_top, relative_permeability, centre)
    cells, in_layer = flat_mesh(box, z_bottom, z_top)
    dented = _moved(cells, box, z_bottom, z_top, bottom, top)
    below = float(np.min(dented.doflocs[2][dented.t[:, in_layer]]))
    if max(loop[:, 2].max() for loop in loops) >= below:
        raise GeometryError(f"paths must lie below the dented layer, which reaches down to {below} m.")
    flat_inductance, potential = solve(loops, cells, in_layer, relative_permeability, None)
    inductance, _ = solve(loops, dented, in_layer, relative_permeability, potential)
    return inductance - flat_inductance


def _checked(
    paths: Sequence[npt.ArrayLike], z_bottom: float, z_top: float, relative_permeability: float, centre: npt.ArrayLike
) -> list[FloatArray]:
    """Shift the paths to put the dent at the origin, or refuse them."""
    if not (np.isfinite([z_bottom, z_top]).all() and z_top > z_bottom):
        raise GeometryError(f"the top of the layer must lie above its bottom; got {z_bottom} m and {z_top} m.")
    if not (np.isfinite(relative_permeability) and relative_permeability >= 1):
        raise ElastomerError(f"the relative permeability must be finite and at least 1; got {relative_permeability}.")
    place = np.asarray(centre, dtype=np.float64)
    if place.shape != (2,) or not np.isfinite(place).all():
        raise GeometryError(f"the centre of the dent must be two finite numbers; got {centre!r}.")
    loops = [np.asarray(path, dtype=np.float64) for path in paths]
    if not loops:
        raise GeometryError("paths must be at least one closed polyline; got none.")
    for k, loop in enumerate(loops):
        if loop.ndim != 2 or loop.shape[1] != 3 or len(loop) < 3 or not np.isfinite(loop).all():
            raise GeometryError(f"path {k} must be finite vertices of shape (n + 1, 3); got shape {loop.shape}.")
        if (loop[0] != loop[-1]).any():
            raise GeometryError(f"path {k} must be closed: its last vertex must equal its first.")
    return [loop - [*place, 0.0] for loop in loops]


def flat_mesh(box: Box, z_bottom: float, z_top: float) -> tuple[Any, npt.NDArray[np.bool_]]:
    """Mesh of the box about the flat layer, and which cells are in it."""
    x, z = box.axes(z_bottom, z_top)
    cells = skfem.MeshHex.init_tensor(x, x, z)
    middle = cells.p[2][cells.t].mean(axis=0)
    return skfem.MeshHex2.from_mesh(cells), (middle > z_bottom) & (middle < z_top)


def _fade(t: FloatArray) -> FloatArray:
    """One at t ≤ 0 and zero from t = 1 on, with a continuous slope."""
    t = np.clip(t, 0, 1)
    return (1 - t) ** 2 * (1 + 2 * t)


def _moved(cells: Any, box: Box, z_bottom: float, z_top: float, bottom: Face, top: Face) -> Any:
    """Move the nodes up or down by faces about an axis."""
    r = np.hypot(*cells.doflocs[:2])
    lower, upper = (np.asarray(face(r), dtype=np.float64) for face in (bottom, top))
    if lower.shape != r.shape or upper.shape != r.shape or not np.isfinite([lower, upper]).all():
        raise GeometryError("bottom and top must give one finite rise for every radius.")
    return moved_mesh(cells, box, z_bottom, z_top, lower, upper)


def moved_mesh(cells: Any, box: Box, z_bottom: float, z_top: float, lower: FloatArray, upper: FloatArray) -> Any:
    """Move the nodes up or down: with the faces in the layer, less and less in the air.

    `lower` and `upper` are the rise of the faces in m above or below every node.
    """
    x, y, z = cells.doflocs
    thinnest = z_top - z_bottom + float(np.min(upper - lower))
    if thinnest <= 0:
        raise GeometryError(f"the dented faces must not touch; the layer would be {thinnest} m thick.")
    largest = float(np.max(np.abs([lower, upper])))
    if _STEEPEST_FADE * largest >= box.fade:
        raise GeometryError(f"faces must move by less than {box.fade / _STEEPEST_FADE} m on this mesh; got {largest}.")
    t = np.clip((z - z_bottom) / (z_top - z_bottom), 0, 1)
    rise = (1 - t) * lower * _fade((z_bottom - z) / box.fade) + t * upper * _fade((z - z_top) / box.fade)
    return replace(cells, doflocs=np.array([x, y, z + rise]))


def solve(
    loops: list[FloatArray],
    cells: Any,
    in_layer: npt.NDArray[np.bool_],
    relative_permeability: float,
    start: FloatArray | None,
) -> tuple[FloatArray, FloatArray]:
    """Return what the layer adds to the inductances in H, and the potentials in A, shape (paths, unknowns)."""
    stiffness, load, incident = _equations(loops, cells, in_layer, relative_permeability)
    potential = _potential(stiffness, load, start)
    return incident - potential @ load.T, potential


def _equations(
    loops: list[FloatArray], cells: Any, in_layer: npt.NDArray[np.bool_], relative_permeability: float
) -> tuple[csr_matrix, FloatArray, FloatArray]:
    """Return the stiffness and the loads (paths, unknowns) off the box's sides, and κ ∫ H_s,i·H_s,j dV in H."""
    element = skfem.ElementHex2()
    dofs = skfem.Dofs(cells, element)
    kappa = MU_0 * (relative_permeability - 1)
    load = np.zeros((len(loops), dofs.N))
    incident = np.zeros((len(loops), len(loops)))
    stiffness = csr_matrix((dofs.N, dofs.N))
    for some in _pieces(in_layer):
        # order 5: three Gauss points a direction
        basis = skfem.Basis(cells, element, intorder=5, elements=some, dofs=dofs, disable_doflocs=True)
        if in_layer[some[0]]:
            stiffness += skfem.BilinearForm(_laplace).assemble(basis, mu=MU_0 * relative_permeability)
            points = np.moveaxis(np.asarray(basis.global_coordinates()), 0, -1)
            H = [np.moveaxis(magnetic_field([loop], points), -1, 0) / MU_0 for loop in loops]
            load += kappa * np.array([skfem.LinearForm(_source).assemble(basis, H=field) for field in H])
            incident += kappa * np.einsum("icep,jcep,ep->ij", H, H, basis.dx)
        else:
            stiffness += skfem.BilinearForm(_laplace).assemble(basis, mu=MU_0)
    free = np.setdiff1d(np.arange(dofs.N), dofs.get_facet_dofs(cells.boundary_facets()).flatten())
    return stiffness[free][:, free], load[:, free], incident


def _pieces(in_layer: npt.NDArray[np.bool_]) -> list[npt.NDArray[np.int64]]:
    """Cell numbers in pieces that lie all in the layer or all in the air."""
    pieces = []
    for cells in (np.flatnonzero(~in_layer), np.flatnonzero(in_layer)):
        pieces += [cells[k : k + _CELLS_AT_ONCE] for k in range(0, len(cells), _CELLS_AT_ONCE)]
    return pieces


def _laplace(u: Any, v: Any, w: Any) -> Any:
    return w["mu"] * dot(grad(u), grad(v))


def _source(v: Any, w: Any) -> Any:
    return dot(w["H"], grad(v))


def _potential(stiffness: csr_matrix, load: FloatArray, start: FloatArray | None) -> FloatArray:
    """Conjugate gradients preconditioned by smoothed aggregation, one right-hand side after the other."""
    levels = pyamg.smoothed_aggregation_solver(
        stiffness, symmetry="symmetric", strength=("symmetric", {"theta": 0.05}), smooth="energy"
    )
    preconditioner = levels.aspreconditioner()
    potential = np.zeros_like(load)
    for k, right in enumerate(load):
        potential[k], failed = cg(
            stiffness,
            right,
            x0=None if start is None else start[k],
            rtol=_RESIDUAL,
            maxiter=_MAX_ITERATIONS,
            M=preconditioner,
        )
        if failed:
            raise ElastomerError(f"the potential of path {k} must converge in {_MAX_ITERATIONS} steps; it did not.")
    return potential


# -- the kept results -----------------------------------------------------------------------------------------------

LAYER = {"z_bottom": 6e-3, "z_top": 8e-3, "relative_permeability": 2.7}
DENT = SmoothDent()
PLACES = {"centre": (0.0, 0.0), "flank": (8e-3, 0.0), "outside": (16e-3, 3e-3)}  # from the centre of coil 2, in m
LEVELS = (1.0, 1.5, 2.0, 3.0)
ORDER = 4  # of the inductance: twice that of the gradient of second-order elements
WIDER = (-2, 2)  # cells outside, for the effect of the box's size, on the coarsest mesh


def board_coils() -> tuple[list[str], list[FloatArray], FloatArray]:
    """Names of coils 2 and 3 of gast2020 as first assumed, their closed paths in m, and the centre of coil 2 in m."""
    array = first_assumed().array
    paths = [np.vstack((c.vertices, c.vertices[:1])) for c in array.conductors()[1:3]]
    placements = array.placements[1:3]
    return [p.name for p in placements], paths, np.array([placements[0].x, placements[0].y])


def _unknowns(box: Box) -> int:
    """Nodes of the second-order mesh that are not on the box's sides."""
    return int((4 * box.side_cells - 1) ** 2 * (2 * (box.layer_cells + 2 * box.air_cells) - 1))


def _one(paths: list[FloatArray], centre: FloatArray, box: Box) -> dict[str, Any]:
    start = time.perf_counter()
    change = dent_inductance_change(paths, **LAYER, bottom=DENT.bottom, top=DENT.top, centre=centre, mesh=box)
    seconds = time.perf_counter() - start
    entries = " ".join(f"{value * 1e9:12.6f}" for value in change.ravel())
    print(f"  {box.half_width * 1e3:6.1f} mm {_unknowns(box):9d} unknowns {seconds:7.1f} s  {entries} nH", flush=True)
    return {"mesh": asdict(box), "unknowns": _unknowns(box), "seconds": seconds, "inductance_change": change.tolist()}


def richardson(values: Sequence[FloatArray], levels: Sequence[float]) -> FloatArray:
    """Limit of the values on two meshes, coarser first, by the error's predicted order."""
    return values[1] + (values[1] - values[0]) / ((levels[1] / levels[0]) ** ORDER - 1)


def _place(name: str, paths: list[FloatArray], centre: FloatArray) -> dict[str, Any]:
    """All meshes of one place, the extrapolated value and its estimated error."""
    print(f"{name}: x {centre[0] * 1e3:.3f} mm, y {centre[1] * 1e3:.3f} mm", flush=True)
    levels = [_one(paths, centre, Box().refined(factor)) for factor in LEVELS]
    boxes = [_one(paths, centre, Box().widened(cells)) for cells in WIDER]
    values = [np.array(level["inductance_change"]) for level in levels]
    coarser, limit = (richardson(values[k : k + 2], LEVELS[k : k + 2]) for k in (1, 2))
    by_box = np.abs(np.array(boxes[-1]["inductance_change"]) - values[0])
    error = np.abs(limit - values[-1]) + by_box
    print(f"  extrapolated {limit.ravel() * 1e9} nH, relative error {(error / np.abs(limit)).ravel()}")
    return {
        "place": name,
        "x": centre[0],
        "y": centre[1],
        "levels": levels,
        "boxes": boxes,
        "extrapolated": limit.tolist(),
        "extrapolated_from_coarser": coarser.tolist(),
        "estimated_error": error.tolist(),
        "relative_error": (error / np.abs(limit)).tolist(),
    }


def main() -> None:
    """Compute, print, keep."""
    names, paths, middle = board_coils()
    places = [_place(name, paths, middle + offset) for name, offset in PLACES.items()]
    results = {
        "units": "m, H, s",
        "design": "gast2020",
        "coils": names,
        "layer": LAYER,
        "dent": asdict(DENT),
        "places": places,
        "python": platform.python_version(),
        "memory_bytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
    }
    RESULTS.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
