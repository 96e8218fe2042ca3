"""Force and torque on current paths in the field of coils and magnets."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from coilarray.compute.arrays import FloatArray
from coilarray.electromagnetics.field import Source, as_conductors, magnetic_field
from coilarray.errors import GeometryError, require_finite

_COARSE, _FINE = np.polynomial.legendre.leggauss(3), np.polynomial.legendre.leggauss(5)
_TOLERANCE = 1e-7  # of the sum of all |dl| |B|; largest difference of the two rules over all pieces
_MOST_HALVINGS = 12  # of a segment; more are needed only where a path meets the source of the field


class Magnet(Protocol):
    """Source of a static field, as every source of magpylib is."""

    def getB(self, points: npt.NDArray[np.float64]) -> Any:  # noqa: N802 (of magpylib)
        """Return the flux density in T at points (n, 3) in m, shape (n, 3)."""


def forces(
    on: Source,
    of: Source | Magnet,
    currents: npt.ArrayLike = 1.0,
    source_currents: npt.ArrayLike = 1.0,
    *,
    about: npt.ArrayLike = (0.0, 0.0, 0.0),
) -> tuple[FloatArray, FloatArray]:
    """Compute the force in N and the torque in N·m on current paths.

    They act on the paths `on`, shape (paths, 3) each, in the field `of` other current paths (both
    as in `coilarray.electromagnetics.field.as_conductors`), or of a magnet of magpylib. The
    `currents` in A of the paths `on` and the `source_currents` in A of the paths `of`, one for each
    or one for all, have effect, for a magnet only the first. The torque is taken about a point
    `about`, shape (3,), in m. Raises GeometryError for a path that meets the source of the field,
    or currents of another shape or not finite.

    F = I ∫ dl × B along the centre lines. Segments are halved until two Gauss rules agree to 1e-7
    of the sum of dl times B, in magnitude. Thin filaments stand for both sides, so that the force
    between traces nearer than a few widths is approximate. With alternating currents of equal
    phase, effective values give the mean force.

    >>> loop = [[np.cos(t), np.sin(t), 0] for t in np.linspace(0, 2 * np.pi, 181)]
    >>> above = [[x, y, 0.5] for x, y, z in loop]
    >>> force, torque = forces([above], [loop])
    >>> round(float(force[0, 2]) * 1e6, 3)
    -2.069
    """
    paths = as_conductors(on)
    flowing = np.asarray(currents, dtype=np.float64)
    if flowing.shape not in ((), (len(paths),)):
        raise GeometryError(f"currents must be one number or {len(paths)}, one a path; got shape {flowing.shape}.")
    require_finite("currents", *flowing.ravel().tolist())
    centre = np.asarray(about, dtype=np.float64)
    if centre.shape != (3,) or not np.isfinite(centre).all():
        raise GeometryError(f"about must be a finite point x, y, z; got shape {centre.shape}.")
    start = np.vstack([path.vertices[:-1] for path in paths])
    step = np.vstack([np.diff(path.vertices, axis=0) for path in paths])
    path_of = np.repeat(np.arange(len(paths)), [len(path.lengths) for path in paths])

    def field(points: FloatArray) -> FloatArray:
        """Flux density in T at points (n, 3)."""
        if hasattr(of, "getB"):
            return np.asarray(of.getB(points), dtype=np.float64)
        return magnetic_field(of, points, source_currents)

    force, torque = np.zeros((len(paths), 3)), np.zeros((len(paths), 3))
    scale = 0.0
    for _ in range(_MOST_HALVINGS + 1):
        fine, moment, largest = _sums(field, start, step, _FINE, centre)
        coarse, _, _ = _sums(field, start, step, _COARSE, centre)
        scale = max(scale, largest)
        apart = np.linalg.norm(fine - coarse, axis=1)
        agree = apart <= _TOLERANCE * scale / len(start)
        np.add.at(force, path_of[agree], fine[agree])
        np.add.at(torque, path_of[agree], moment[agree])
        if agree.all():
            return force * np.reshape(flowing, (-1, 1)), torque * np.reshape(flowing, (-1, 1))
        start, step, path_of = start[~agree], step[~agree] / 2, path_of[~agree]
        start, step, path_of = np.vstack((start, start + step)), np.tile(step, (2, 1)), np.tile(path_of, 2)
    raise GeometryError(f"{paths[int(path_of[0])].name} meets the source of the field, where the force is infinite.")


def _sums(
    field: Any, start: FloatArray, step: FloatArray, rule: tuple[FloatArray, FloatArray], about: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """Integrate dl × B and r × (dl × B) over pieces by a Gauss rule, (n, 3) each, and |dl| |B| over all."""
    nodes, weights = rule
    points = start[:, None] + 0.5 * (1.0 + nodes)[:, None] * step[:, None]
    B = field(points.reshape(-1, 3))
    if B.shape != (points.size // 3, 3) or not np.isfinite(B).all():
        raise GeometryError(f"the field must be finite and of shape (n, 3) at n points; got shape {B.shape}.")
    density = np.cross(step[:, None], B.reshape(points.shape))
    density *= 0.5 * weights[:, None]
    sizes = np.linalg.norm(step, axis=1)[:, None] * np.linalg.norm(B.reshape(points.shape), axis=-1)
    return density.sum(axis=1), np.cross(points - about, density).sum(axis=1), float((sizes @ weights).sum() / 2)
