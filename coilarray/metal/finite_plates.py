"""Flat pieces of metal near the coils: what their eddy currents do to the inductance matrix, and the currents."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import shapely
from scipy.linalg import lu_factor, lu_solve
from shapely.affinity import translate
from shapely.geometry.base import BaseGeometry

from coilarray.compute.arrays import ComplexArray, FloatArray, IntArray
from coilarray.compute.threads import Progress, ranges, run_blocks
from coilarray.electromagnetics.source import Source, as_conductors
from coilarray.errors import GeometryError
from coilarray.geometry import Conductor, Sheet
from coilarray.geometry.plate import TOUCHING, FinitePlate, Plate
from coilarray.metal.coupled_plates import PlatesInAir, PosedPlate, SolvedPlates, linked_fluxes
from coilarray.metal.half_body import EddyBody
from coilarray.metal.layered_air import LayeredAir
from coilarray.metal.magnetic_plates import magnetic_changes, magnetic_currents, require_skin
from coilarray.metal.plate_mesh import Footprint, inscribed_radius, plate_mesh
from coilarray.metal.surface_impedance import ModelError, SurfaceImpedance, model_error, surface_impedance, with_rim

LARGEST_ERROR = 0.1
"""Estimated error of the model, of ΔL, beyond which a plate is refused."""
_AT_ONCE = 2048  # fluxes solved for together
_LOOPS_AT_ONCE = 64  # places of dipoles
# loops of two by two about x, y and z
_SQUARES = np.array([np.roll([[x, y, 0.0] for x, y in ((1, 1), (-1, 1), (-1, -1), (1, -1), (1, 1))], k, axis=1)
                     for k in (1, 2, 0)])  # fmt: skip


@dataclass(frozen=True, eq=False)
class EddyCurrents:
    """Currents on the faces and the rim of a plate.

    `corners`, shape (k, 3, 3), are those of the triangles in m on the board; `density`, shape (coils, k, 3), is their
    current in A/m for 1 A in each coil, complex for e^{jωt}. Both faces carry one each, so that the current of a thin
    plate is their sum. That of a magnetic plate is the current in its skin, n × H.
    """

    corners: FloatArray
    density: ComplexArray


def moving_plate(
    source: Source,
    plate: FinitePlate,
    positions: npt.ArrayLike,
    frequencies: npt.ArrayLike,
    sheets: Sequence[Sheet] = (),
    beside: Sequence[Plate | FinitePlate] = (),
    *,
    fineness: float = 1.0,
    progress: Progress | None = None,
) -> ComplexArray:
    """Change of the inductance matrix by a finite plate at many places.

    Parameters
    ----------
    source : CoilArray, Conductor, polyline or sequence of them
        See `coilarray.electromagnetics.source.as_conductors`. Each segment acts as a thin filament on its centre line.
    plate : FinitePlate
        Plate, tilted as it says; its own centre is not used.
    positions : array_like, shape (positions, 3)
        Centres of the plate in m; all of it above or all of it below the copper.
    frequencies : array_like, shape (frequencies,)
        Frequencies in Hz, positive.
    sheets : sequence of Sheet
        Flat sheets upwards from z = 0, wide against coils and plates; these lie above the magnetic ones or below the
        copper.
    beside : sequence of Plate or FinitePlate
        Metal that stays where it is: infinite plates, magnetic or not, and others with an outline.
    fineness : float
        Fineness of the mesh: 2 has half the lengths of 1, which errs by some 0.2 % of ΔL (see Notes).
    progress : callable, optional
        Called with (done, total) as the work goes on.

    Returns
    -------
    ndarray, shape (positions, frequencies, paths, paths)
        ΔZ/jω = ΔL − jΔR/ω in H by the plate, against the same without it; symmetric. In air and over sheets −Im is
        positive semidefinite; beside other metal only that of all metal together is.

    Raises
    ------
    GeometryError
        Positions or frequencies of a wrong shape or none, a fineness that is not positive, a plate that reaches into
        copper, sheets or other plates, one too thick for its size where the field enters deeply (the text has the
        number), or an outline too narrow.
    MetalError
        A plate or a coil in an infinite layer; a magnetic plate less than three skin depths thick, with a hole, or
        beside others with an outline.
    MemoryLimitError
        Too many positions or triangles for `coilarray.compute.memory.allowed_memory`.

    Notes
    -----
    Currents on the faces and the rim, with the impedance of a plate of any thickness against its skin depth
    (`coilarray.metal.surface_impedance`), by a stream function (`coilarray.metal.half_body`). One matrix serves every
    place, and is factorised once a frequency. Sheets and infinite plates reflect the fields of coils and currents
    (`coilarray.metal.layered_air`), and there it is made once a height. All plates with an outline are solved together;
    beside others that stay, it is made at every place. The impedance holds where skin depth or thickness is small
    against the plate's width and the distances to coils and other metal.

    A magnetic plate has its own condition on the surface and its own equations (`coilarray.metal.magnetic_plates`),
    which hold where it is at least three skin depths thick.

    Against a mesh of the fineness 2, one of 1 errs in ΔL by 0.1 % for the staggered target of the bundled
    ``linear_position`` at 2 mm and by 0.01 % for discs before the coil of ``proximity``; one of 0.5 by 0.7 % and 0.3 %.

    Examples
    --------
    >>> from coilarray.geometry.material import MATERIALS
    >>> from coilarray.geometry.plate import Disc
    >>> angle = np.linspace(0, 2 * np.pi, 49)
    >>> loop = np.column_stack((8e-3 * np.cos(angle), 8e-3 * np.sin(angle), 0 * angle))
    >>> coin = FinitePlate("coin", Disc(5e-3), (0, 0, 3e-3), 0.5e-3, MATERIALS["aluminium"])
    >>> change = moving_plate([loop], coin, [[0, 0, 3e-3], [8e-3, 0, 3e-3]], [1e6])
    >>> bool((change.real < 0).all() and (change.imag < 0).all())
    True
    """
    paths = as_conductors(source)
    where, f = _checked_positions(positions), _checked_frequencies(frequencies)
    _require_free(plate, where, beside)
    around = PlatesInAir(paths, LayeredAir.between([one for one in beside if isinstance(one, Plate)], sheets, f))
    change = np.zeros((len(where), len(f), len(paths), len(paths)), dtype=np.complex128)
    if _magnetic_plate([plate, *beside], f) is not None:
        body = _meshed(paths, plate, where, f, sheets, fineness)
        groups = _same_heights(where[:, 2]) if around.air.layers else [np.arange(len(where))]
        for done, group in enumerate(groups):
            change[group] = magnetic_changes(around, PosedPlate(body, plate, where[group], ()))
            if progress is not None:
                progress(done + 1, len(groups))
        return change
    body, impedances = _prepared(paths, plate, where, f, sheets, fineness)
    others = [one for one in beside if isinstance(one, FinitePlate)]
    if not around.air.layers and not others:
        both = [b[0] for b in linked_fluxes(body, paths, plate, where)]
        tasks = [(k, parity) for k in range(len(f)) for parity in (0, 1)]

        def solve(task: tuple[int, int]) -> ComplexArray:
            return _coupled(body.parities[task[1]].matrix(impedances[task[0]]), both[task[1]])

        for (k, _), part in zip(tasks, run_blocks(solve, tasks, progress=progress), strict=True):
            change[:, k] += part
        return change
    fixed = [_posed(paths, one, f, sheets, fineness) for one in others]
    still = around.solved(fixed) if fixed else None
    groups = _same_heights(where[:, 2]) if still is None else [np.array([k]) for k in range(len(where))]
    for done, group in enumerate(groups):
        posed = PosedPlate(body, plate, where[group], impedances)
        matrices, b = around.matrices(posed), around.linked(posed)
        if still is not None:
            cross, b = np.concatenate([around.mutual(one, posed) for one in fixed], axis=1), b.copy()
            for k, factors in enumerate(still.factors):
                answer = lu_solve(factors, cross[k], check_finite=False)
                matrices[k] = matrices[k] - cross[k].T @ answer
                b[k] = b[k] - np.tensordot(answer.T, still.b[k], axes=1)

        def at(k: int, matrices: ComplexArray = matrices, b: ComplexArray = b) -> ComplexArray:
            return _coupled(matrices[k], b[k])

        change[group] = np.moveaxis(np.array(run_blocks(at, range(len(f)))), 0, 1)
        if progress is not None:
            progress(done + 1, len(groups))
    return change


def outlined_inductance(
    source: Source,
    plates: Sequence[Plate | FinitePlate],
    frequencies: npt.ArrayLike,
    sheets: Sequence[Sheet] = (),
    *,
    fineness: float = 1.0,
) -> ComplexArray:
    """Change of the inductance matrix by all plates with an outline among `plates`, against the others alone.

    Shape (frequencies, paths, paths) in H, with the other arguments and the errors of `moving_plate`. Infinite plates
    are in `coilarray.metal.flat_plates.plate_inductance`.
    """
    paths = as_conductors(source)
    f = _checked_frequencies(frequencies)
    magnetic = _magnetic_plate(plates, f)
    if magnetic is not None:
        beside = [one for one in plates if one is not magnetic]
        return np.asarray(moving_plate(paths, magnetic, [magnetic.centre], f, sheets, beside, fineness=fineness)[0])
    around, posed = _all_posed(paths, plates, f, sheets, fineness)
    solved = around.solved(posed)
    change = [
        -np.tensordot(b[:, 0].T, lu_solve(factors, b[:, 0], check_finite=False), axes=1)
        for factors, b in zip(solved.factors, solved.b, strict=True)
    ]
    both = np.array(change)
    return np.asarray((both + both.swapaxes(-1, -2)) / 2)


def eddy_currents(
    source: Source,
    plates: Sequence[Plate | FinitePlate],
    frequency: float,
    sheets: Sequence[Sheet] = (),
    *,
    fineness: float = 1.0,
) -> list[EddyCurrents]:
    """Compute the eddy currents in all plates with an outline, at their own centres, for 1 A in each path.

    Arguments and errors are those of `outlined_inductance`, the frequency in Hz.
    """
    return eddy_currents_over(source, plates, [frequency], sheets, fineness=fineness)[0]


def eddy_currents_over(
    source: Source,
    plates: Sequence[Plate | FinitePlate],
    frequencies: npt.ArrayLike,
    sheets: Sequence[Sheet] = (),
    *,
    fineness: float = 1.0,
) -> list[list[EddyCurrents]]:
    """`eddy_currents` at each of the frequencies (f,) in Hz."""
    return _currents(source, plates, frequencies, sheets, fineness)


def currents_alone(
    source: Source,
    plates: Sequence[Plate | FinitePlate],
    frequencies: npt.ArrayLike,
    sheets: Sequence[Sheet] = (),
    *,
    fineness: float = 1.0,
) -> list[list[EddyCurrents]]:
    """Return the currents that alone make the field of all plates with an outline, outside them.

    For plates that are not magnetic they are the eddy currents; in the place of magnetic charges there are others.
    Arguments and errors are those of `eddy_currents_over`.
    """
    return _currents(source, plates, frequencies, sheets, fineness, alone=True)


def _currents(
    source: Source,
    plates: Sequence[Plate | FinitePlate],
    frequencies: npt.ArrayLike,
    sheets: Sequence[Sheet],
    fineness: float,
    *,
    alone: bool = False,
) -> list[list[EddyCurrents]]:
    """Currents on plates with an outline, or on the only one, which is magnetic."""
    paths, f = as_conductors(source), _checked_frequencies(frequencies)
    if _magnetic_plate(plates, f) is None:
        return solve_outlined(paths, plates, f, sheets, fineness=fineness).eddy_currents()
    endless = [one for one in plates if isinstance(one, Plate)]
    (magnetic,) = (one for one in plates if isinstance(one, FinitePlate))
    where = np.array([magnetic.centre])
    _require_free(magnetic, where, endless)
    around = PlatesInAir(paths, LayeredAir.between(endless, sheets, f))
    posed = PosedPlate(_meshed(paths, magnetic, where, f, sheets, fineness), magnetic, where, ())
    return [[EddyCurrents(posed.corners, density)] for density in magnetic_currents(around, posed, alone=alone)]


@dataclass(frozen=True, eq=False)
class OutlinedPlates:
    """Plates with an outline, none of them magnetic, solved together for coils at the frequencies of the air."""

    around: PlatesInAir
    plates: Sequence[PosedPlate]
    solved: SolvedPlates

    def eddy_currents(self) -> list[list[EddyCurrents]]:
        """Return the currents in all plates for 1 A in each coil, at every frequency."""
        starts = np.cumsum([0, *(one.currents[0].shape[1] for one in self.plates)]).tolist()
        found = []
        for factors, b in zip(self.solved.factors, self.solved.b, strict=True):
            potentials = -lu_solve(factors, b[:, 0], check_finite=False)
            found.append([
                EddyCurrents(one.corners, np.stack([(K @ potentials[start:stop]).T for K in one.currents], axis=-1))
                for one, (start, stop) in zip(self.plates, pairwise(starts), strict=True)
            ])  # fmt: skip
        return found

    def returned(self, places: FloatArray, size: float) -> ComplexArray:
        """Return the field in T that the plates reflect to a dipole of 1 A·m² at places (n, 3) in m, at one height.

        Shape (n, f, 3, 3), for dipoles along the axes of the board; they are square loops of a `size` in m.
        """
        found = []
        for start, stop in ranges(len(places), _LOOPS_AT_ONCE):
            loops = [place + size / 2 * square for place in places[start:stop] for square in _SQUARES]
            around = replace(self.around, paths=as_conductors(loops))
            b = np.concatenate([around.linked(one)[:, :, 0] for one in self.plates], axis=1) / size**2
            b = b.reshape(*b.shape[:2], -1, 3)
            parts = [
                -np.einsum("upa,upb->pab", own, lu_solve(factors, own.reshape(len(own), -1)).reshape(own.shape))
                for factors, own in zip(self.solved.factors, b, strict=True)
            ]
            found.append(np.stack(parts, axis=1))
        return np.concatenate(found)


def solve_outlined(
    source: Source,
    plates: Sequence[Plate | FinitePlate],
    frequencies: npt.ArrayLike,
    sheets: Sequence[Sheet] = (),
    *,
    fineness: float = 1.0,
) -> OutlinedPlates:
    """Solve all plates with an outline, which must not be magnetic; the rest is as in `eddy_currents_over`."""
    paths = as_conductors(source)
    around, posed = _all_posed(paths, plates, _checked_frequencies(frequencies), sheets, fineness)
    return OutlinedPlates(around, posed, around.solved(posed))


def moving_plate_error(
    source: Source,
    plate: FinitePlate,
    positions: npt.ArrayLike,
    frequencies: npt.ArrayLike,
    sheets: Sequence[Sheet] = (),
) -> ModelError:
    """Estimate the largest errors of the model in `moving_plate`, whose arguments and errors these are.

    That of the impedance, which is taken at one wavenumber for all patterns of the current, and that of the rim
    (`coilarray.metal.surface_impedance.with_rim`), where a plate within the coils has most of its losses. The mesh errs
    besides. Measured against finite elements: discs of copper at 2 MHz within a loop were up to 0.5 % off in ΔL and
    13 % in ΔR, where this says 0.7 and 14 %; one of 1 mm that goes 1 mm beyond the loop, 1.5 mm away, 0.1 and 3.8 %,
    where this says 0.2 and 6.4 %.
    """
    paths = as_conductors(source)
    where, f = _checked_positions(positions), _checked_frequencies(frequencies)
    nearest = _distance(paths, plate, where, sheets)
    error = _model_error(plate, f, nearest, _least_radius(paths))
    if plate.material.relative_permeability != 1 or not error.depths:
        return error  # that of magnetic edges is in it
    ground = _ground(replace(plate, centre=(0.0, 0.0, 0.0)))
    covers = [translate(ground, x, y) for x, y in where[:, :2].tolist()]
    margins = [
        cover.boundary.distance(hull) if cover.contains(hull) else 0.0 for hull in _hulls(paths) for cover in covers
    ]
    skin = plate.thickness / error.depths / inscribed_radius(plate.outline)
    return with_rim(error, skin, nearest, min(margins))


def _checked_positions(positions: npt.ArrayLike) -> FloatArray:
    where = np.asarray(positions, dtype=np.float64)
    if where.ndim != 2 or where.shape[1] != 3 or not len(where) or not np.isfinite(where).all():
        raise GeometryError(
            f"positions of a plate must be finite, of shape (n, 3) in m, at least one; got shape {where.shape}."
        )
    return where


def _checked_frequencies(frequencies: npt.ArrayLike) -> FloatArray:
    f = np.asarray(frequencies, dtype=np.float64)
    if f.ndim != 1 or not f.size or not (np.isfinite(f) & (f > 0)).all():
        raise GeometryError(f"frequencies must be positive and finite, of shape (n,) in Hz, at least one; got {f}.")
    return f


def _prepared(
    paths: Sequence[Conductor],
    plate: FinitePlate,
    where: FloatArray,
    frequencies: FloatArray,
    sheets: Sequence[Sheet],
    fineness: float,
) -> tuple[EddyBody, list[SurfaceImpedance]]:
    """Return the plate's matrices and impedances, or refuse it."""
    body = _meshed(paths, plate, where, frequencies, sheets, fineness)
    return body, [
        surface_impedance(plate.material, plate.thickness, f, body.mesh.inscribed) for f in frequencies.tolist()
    ]


def _meshed(
    paths: Sequence[Conductor],
    plate: FinitePlate,
    where: FloatArray,
    frequencies: FloatArray,
    sheets: Sequence[Sheet],
    fineness: float,
) -> EddyBody:
    """Return the plate's mesh for all its places, or refuse it."""
    nearest, radius = _distance(paths, plate, where, sheets), _least_radius(paths)
    _model_error(plate, frequencies, nearest, radius)
    area = shapely.union_all([translate(hull, -x, -y) for hull in _hulls(paths) for x, y in where[:, :2].tolist()])
    return EddyBody(plate_mesh(plate.outline, plate.thickness, fineness, Footprint(area, nearest, radius)))


def _magnetic_plate(plates: Sequence[Plate | FinitePlate], frequencies: FloatArray) -> FinitePlate | None:
    """Return the magnetic plate with an outline, None without; refuse one beside others with an outline, or thin."""
    outlined = [one for one in plates if isinstance(one, FinitePlate)]
    for one in outlined:
        if one.material.relative_permeability != 1:
            require_skin(one, frequencies, [other for other in outlined if other is not one])
            return one
    return None


def _hulls(paths: Sequence[Conductor]) -> list[BaseGeometry]:
    """Convex hulls of the paths in m, seen from above."""
    return [shapely.MultiPoint(path.vertices[:, :2]).convex_hull for path in paths]


def _least_radius(paths: Sequence[Conductor]) -> float:
    """Half the least extent in m of any path along x or y."""
    return min(float(np.ptp(path.vertices[:, :2], axis=0).min()) / 2 for path in paths)


def _distance(paths: Sequence[Conductor], plate: FinitePlate, where: FloatArray, sheets: Sequence[Sheet]) -> float:
    """Return the least distance in m across the plane of the plate from the copper; refuse one that is not computed."""
    corners = np.concatenate([path.vertices for path in paths])
    low, high = (np.array(plate.heights) - plate.centre[2])[:, None] + where[:, 2]
    top, bottom = float(corners[:, 2].max()), float(corners[:, 2].min())
    if any(sheet.magnetic for sheet in sheets):
        top = max(top, math.fsum(sheet.thickness for sheet in sheets))
    inside = (low <= top) & (high >= bottom)
    if inside.any():
        first = int(np.flatnonzero(inside)[0])
        raise GeometryError(
            f"a finite plate must lie above z = {top * 1e3:.4g} mm, the highest copper or sheet, "
            f"or below z = {bottom * 1e3:.4g} mm, the lowest copper; {plate.name!r} reaches "
            f"from {low[first] * 1e3:.4g} to {high[first] * 1e3:.4g} mm."
        )
    return float(np.where(low > top, low - float(corners[:, 2].max()), bottom - high).min())


def _model_error(plate: FinitePlate, frequencies: FloatArray, nearest: float, radius: float) -> ModelError:
    """Largest errors of the model at a distance in m from coils of a radius in m; refuse those beyond the limit."""
    inscribed, scale = inscribed_radius(plate.outline), nearest + radius
    largest = ModelError()
    for f in frequencies.tolist():
        for kappa in (3 / inscribed, 2 / scale):
            largest = largest.or_worse(model_error(plate.material, plate.thickness, f, inscribed, kappa))
        if largest.whole > LARGEST_ERROR:
            raise GeometryError(
                "skin depth or thickness of a finite plate must be small compared with its inscribed radius of "
                f"{inscribed * 1e3:.3g} mm and the coils' radius and distance of {scale * 1e3:.3g} mm; "
                f"{plate.name!r}, {plate.thickness * 1e3:.3g} mm thick, has a skin depth of "
                f"{plate.material.skin_depth(f) * 1e3:.3g} mm at {f:.4g} Hz, so that its ΔL would have an error of "
                f"{largest.whole:.0%}."
            )
    return largest


def _posed(
    paths: Sequence[Conductor], plate: FinitePlate, frequencies: FloatArray, sheets: Sequence[Sheet], fineness: float
) -> PosedPlate:
    """Put a plate at its own centre."""
    where = np.array([plate.centre])
    body, impedances = _prepared(paths, plate, where, frequencies, sheets, fineness)
    return PosedPlate(body, plate, where, impedances)


def _all_posed(
    paths: Sequence[Conductor],
    plates: Sequence[Plate | FinitePlate],
    frequencies: FloatArray,
    sheets: Sequence[Sheet],
    fineness: float,
) -> tuple[PlatesInAir, list[PosedPlate]]:
    """Infinite layers, and the plates with an outline between them."""
    outlined = [one for one in plates if isinstance(one, FinitePlate)]
    for k, one in enumerate(outlined):
        _require_free(one, np.array([one.centre]), [*outlined[:k], *(p for p in plates if isinstance(p, Plate))])
    air = LayeredAir.between([one for one in plates if isinstance(one, Plate)], sheets, frequencies)
    return PlatesInAir(paths, air), [_posed(paths, one, frequencies, sheets, fineness) for one in outlined]


def _require_free(plate: FinitePlate, where: FloatArray, beside: Sequence[Plate | FinitePlate]) -> None:
    """Refuse places (n, 3) in m at which a plate reaches into another one."""
    bottom, top = np.array(plate.heights) - plate.centre[2]
    ground = _ground(replace(plate, centre=(0.0, 0.0, 0.0)))
    for other in beside:
        low, high = other.heights
        for x, y, z in where.tolist():
            if z + bottom >= high - TOUCHING or z + top <= low + TOUCHING:
                continue
            if isinstance(other, Plate) or shapely.intersects(translate(ground, x, y), _ground(other)):
                raise GeometryError(
                    f"a finite plate must not reach into another one; {plate.name!r} at ({x * 1e3:.4g}, {y * 1e3:.4g}, "
                    f"{z * 1e3:.4g}) mm reaches into {other.name!r}."
                )


def _ground(plate: FinitePlate) -> shapely.Polygon:
    """Return what a plate covers of the board."""
    outline = plate.outline
    return shapely.Polygon(plate.on_board(outline.exterior), [plate.on_board(hole) for hole in outline.holes])


def _coupled(matrix: ComplexArray, b: FloatArray | ComplexArray) -> ComplexArray:
    """−bᵀ matrix⁻¹ b of every position, (positions, paths, paths), for b (u, positions, paths)."""
    factors = lu_factor(matrix, overwrite_a=True, check_finite=False)
    parts = []
    for start, stop in ranges(b.shape[1], max(_AT_ONCE // b.shape[2], 1)):
        some = b[:, start:stop]
        x = lu_solve(factors, some.reshape(len(b), -1), check_finite=False).reshape(some.shape)
        parts.append(-np.einsum("upi,upj->pij", some, x, optimize=True))
    both = np.concatenate(parts)
    return np.asarray((both + both.transpose(0, 2, 1)) / 2, dtype=np.complex128)


def _same_heights(z: FloatArray) -> list[IntArray]:
    _, number = np.unique(np.round(z / (1e-9 * np.abs(z).max())), return_inverse=True)
    return [np.flatnonzero(number == k) for k in range(number.max() + 1)]
