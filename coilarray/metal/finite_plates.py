"""Eddy currents in flat finite plates and their inductance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
import shapely
from scipy.linalg import lu_factor, lu_solve
from shapely.affinity import translate
from shapely.geometry.base import BaseGeometry

from coilarray.compute.arrays import ComplexArray, FloatArray, NumberArray
from coilarray.compute.threads import Progress, ranges, run_blocks
from coilarray.constants import MU_0
from coilarray.electromagnetics.field import Source, as_conductors
from coilarray.errors import GeometryError
from coilarray.geometry import Conductor, Sheet
from coilarray.geometry.bodies import TOUCHING, FinitePlate, Plate
from coilarray.metal.coupled_plates import (
    EddyCurrents,
    LayeredAir,
    PlatesInAir,
    PosedPlate,
    SolvedPlates,
    linked_fluxes,
)
from coilarray.metal.frequencies import checked_frequencies
from coilarray.metal.half_body import EddyBody, face_impedances, model_error, surface_impedance
from coilarray.metal.magnetic_plates import magnetic_changes, magnetic_currents, require_skin
from coilarray.metal.plate_mesh import Footprint, inscribed_radius, plate_meshes

AnyPlates: TypeAlias = Sequence[Plate | FinitePlate]

LARGEST_ERROR = 0.1  # relative error of ΔL by the model beyond which a plate is refused
_OF_SPREAD = 0.5  # share of the impedance's error at twice the chosen wavenumber that all waves together make
_BY_LOSSES = 0.65  # over the distance of a turn: mean wavenumber of its field, weighted by losses in thick metal
# Of discs of copper within a loop, by finite elements. For ΔL the error is of half the thickness, or of the skin depth
# if that is less, over the radius.
_RIM_INDUCTANCE, _RIM_RESISTANCE = 0.5, 0.13
_THIN = 2.0  # skin depths
_OF_SECOND_ORDER = 3.0  # of the change between meshes of the lengths 2h and h: the error at h by the second order
_OF_CORRECTION = 1.0  # remaining error, of the correction at h, which covers orders from 1.3 upwards
_LEAST_SHARE = 0.5  # least relative correction of a part, of the correction of both, as a part may be small by chance
_OF_INTEGRALS = 3e-4  # of the change: error of the integrals over pairs of triangles
_WHERE = 0.1  # of the largest change at a frequency: smaller changes do not count for the relative error
_NOTHING = 1e-12  # of the change: least size of its real or imaginary part against which errors are taken
_ALONE = 1.4  # of the fineness, if currents are taken from one mesh without extrapolation
_AT_ONCE = 2048  # fluxes solved for together


@dataclass(frozen=True, eq=False)
class PlateError:
    """Errors of a plate's change, by mesh and model.

    `absolute` and its part `mesh` are in H, of the shape of the `change`. Their real parts cover
    the deviation of ΔL, their imaginary parts the deviation of ΔR/ω. `depths` is the thickness in
    skin depths, 0 for a perfect conductor.
    """

    change: ComplexArray
    absolute: ComplexArray
    mesh: ComplexArray
    depths: float

    @property
    def inductance(self) -> float:
        """Largest relative error of ΔL, from a tenth of its maximum."""
        return self._share(self.absolute.real, self.change.real)

    @property
    def resistance(self) -> float:
        """Largest relative error of ΔR, computed as for ΔL."""
        return self._share(self.absolute.imag, self.change.imag)

    def _share(self, error: FloatArray, values: FloatArray) -> float:
        of_error, of_value, size = (np.linalg.norm(part, axis=(-2, -1)) for part in (error, values, self.change))
        counted = (size >= _WHERE * size.max(axis=0)) & (of_error > 0)
        return float((of_error[counted] / np.maximum(of_value[counted], _NOTHING * size[counted])).max(initial=0.0))


def worst_attributes(errors: Sequence[PlateError]) -> dict[str, float]:
    """Return attributes with the largest errors of any plate.

    ``plate_skin_depths`` is the thickness of the plate with the largest error of ΔR. Without plates
    there are no attributes.
    """
    if not errors:
        return {}
    return {
        "plate_error_inductance": max(error.inductance for error in errors),
        "plate_error_resistance": max(error.resistance for error in errors),
        "plate_skin_depths": max(errors, key=lambda error: error.resistance).depths,
    }


def moving_plate(
    source: Source,
    plate: FinitePlate,
    positions: npt.ArrayLike,
    frequencies: npt.ArrayLike,
    sheets: Sequence[Sheet] = (),
    beside: AnyPlates = (),
    *,
    fineness: float = 1.0,
    progress: Progress | None = None,
) -> PlateError:
    """Change of the inductance matrix by a plate, with errors.

    The change (positions, frequencies, paths, paths) is ΔZ/jω = ΔL − jΔR/ω in H relative to the
    same without the plate. In air and over sheets −Im is positive semidefinite. Beside other metal
    only the sum over all metal is. The plate's centre moves to the `positions` (positions, 3) in m,
    entirely above or below the copper, with its own tilt. Each segment of the `source` acts as a
    thin filament on its centre line. The flat `sheets` are laterally large against coils and
    plates, which lie above the magnetic sheets or below the copper. `beside` is fixed metal,
    `fineness` 2 halves the element lengths.

    The currents on the faces and the rim follow from a stream function, with an impedance for any
    ratio of thickness to skin depth (`coilarray.metal.half_body`), if either is small compared with
    the plate's width and the distances to coils and other metal. A magnetic plate has its own
    equations (`coilarray.metal.magnetic_plates`), which hold from three skin depths of thickness.
    Sheets and infinite plates reflect the fields of coils and currents
    (`coilarray.metal.coupled_plates`), and fixed finite plates are solved together with the plate,
    at every position. Every result is extrapolated from two meshes. Its error is this correction
    and the error of the model: the impedance is taken at one wavenumber for all patterns of the
    current, and the rim is approximate.

    >>> from coilarray.geometry.bodies import MATERIALS, Disc
    >>> angle = np.linspace(0, 2 * np.pi, 49)
    >>> loop = np.column_stack((8e-3 * np.cos(angle), 8e-3 * np.sin(angle), 0 * angle))
    >>> coin = FinitePlate("coin", Disc(5e-3), (0, 0, 3e-3), 0.5e-3, MATERIALS["aluminium"])
    >>> change = moving_plate([loop], coin, [[0, 0, 3e-3], [8e-3, 0, 3e-3]], [1e6]).change
    >>> bool((change.real < 0).all() and (change.imag < 0).all())
    True
    """
    paths = as_conductors(source)
    where = np.asarray(positions, dtype=np.float64)
    if where.ndim != 2 or where.shape[1] != 3 or not len(where) or not np.isfinite(where).all():
        raise GeometryError(
            f"positions of a plate must be finite, of shape (n, 3) in m, at least one; got shape {where.shape}."
        )
    f = checked_frequencies(frequencies, positive=True)
    _require_free(plate, where, beside)
    around = PlatesInAir(paths, LayeredAir.between([one for one in beside if isinstance(one, Plate)], sheets, f))
    magnetic = _magnetic_plate([plate, *beside], f) is not None
    (_, of_inductance, of_resistance), depths = _whole_model_error(paths, plate, where, f, sheets)
    posed = _posed(around, plate, where, sheets, fineness)
    edges = np.zeros((len(where), len(f), len(paths)))
    if magnetic:
        (coarse, _), (fine, edges) = (magnetic_changes(around, one) for one in posed)
    else:
        others = [one for one in beside if isinstance(one, FinitePlate)]
        fixed = [_posed(around, one, np.array([one.centre]), sheets, fineness) for one in others]
        coarse, fine = _changes(around, posed, fixed, progress)
    change, mesh = _extrapolated(coarse, fine)
    if not beside:
        change = np.asarray((change.real if magnetic else _negative(change.real)) + 1j * _negative(change.imag))
    # the contributions of iron and of its eddy currents may cancel in ΔL, so that its error is the
    # error of both together
    real, imaginary = (
        _entry_sizes(part) for part in ((np.abs(change),) * 2 if magnetic else (change.real, change.imag))
    )
    by_edges = np.sqrt(edges[..., :, None] * edges[..., None, :])
    by_model = real * of_inductance + by_edges + 1j * (imaginary * of_resistance + by_edges)
    return PlateError(change, mesh + by_model, mesh, depths)


def _extrapolated(coarse: ComplexArray, fine: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """Extrapolate values in H by the second order, with errors."""
    correction = (fine - coarse) / _OF_SECOND_ORDER
    change = fine + correction
    size = np.maximum(_entry_sizes(np.abs(change)), np.finfo(float).tiny)
    least = _LEAST_SHARE * _entry_sizes(np.abs(correction)) / size + _OF_INTEGRALS
    real, imaginary = (
        np.maximum(_OF_CORRECTION * np.abs(part), least * _entry_sizes(whole))
        for part, whole in ((correction.real, change.real), (correction.imag, change.imag))
    )
    return change, np.asarray(real + 1j * imaginary)


def _entry_sizes(values: FloatArray) -> FloatArray:
    """Products of the diagonals' roots, sizes of entries (…, n, n)."""
    root = np.sqrt(np.abs(np.diagonal(values, axis1=-2, axis2=-1)))
    return np.asarray(root[..., :, None] * root[..., None, :])


def _negative(matrices: FloatArray) -> FloatArray:
    """Remove the positive part of nearly negative semidefinite matrices."""
    values, vectors = np.linalg.eigh(matrices)
    if values.max() <= 0:
        return matrices
    found = (vectors * np.minimum(values, 0.0)[..., None, :]) @ vectors.swapaxes(-1, -2)
    return np.asarray((found + found.swapaxes(-1, -2)) / 2)


def _changes(
    around: PlatesInAir, meshes: Sequence[PosedPlate], fixed: Sequence[Sequence[PosedPlate]], progress: Progress | None
) -> list[ComplexArray]:
    """ΔZ/jω in H by a non-magnetic plate beside `fixed`, by mesh."""
    where, count = meshes[0].where, len(around.air.frequencies)
    shape = (len(where), count, len(around.paths), len(around.paths))
    found = [np.zeros(shape, dtype=np.complex128) for _ in meshes]
    if not around.air.layers and not fixed:
        both = linked_fluxes(meshes, around.paths)
        tasks = [(m, k, parity) for m in range(len(meshes)) for k in range(count) for parity in (0, 1)]

        def solve(task: tuple[int, int, int]) -> ComplexArray:
            m, k, parity = task
            return _coupled(meshes[m].body.parities[parity].matrix(meshes[m].impedances[k]), both[m][parity][0])

        for (m, k, _), part in zip(tasks, run_blocks(solve, tasks, progress=progress), strict=True):
            found[m][:, k] += part
        return found
    still = [around.solved([one[m] for one in fixed]) if fixed else None for m in range(len(meshes))]
    groups = [np.array([k]) for k in range(len(where))] if fixed else around.groups(where)
    for done, group in enumerate(groups):
        posed = [replace(one, where=where[group]) for one in meshes]
        for m, (one, b) in enumerate(zip(posed, around.linked(posed), strict=True)):
            matrices, solved, rest = around.matrices(one), still[m], b
            if solved is not None:
                cross, rest = np.concatenate([around.mutual(other[m], one) for other in fixed], axis=1), b.copy()
                for k, factors in enumerate(solved.factors):
                    answer = lu_solve(factors, cross[k], check_finite=False)
                    matrices[k] = matrices[k] - cross[k].T @ answer
                    rest[k] = b[k] - np.tensordot(answer.T, solved.b[k], axes=1)

            def at(k: int, matrices: ComplexArray = matrices, b: ComplexArray = rest) -> ComplexArray:
                return _coupled(matrices[k], b[k])

            found[m][group] = np.moveaxis(np.array(run_blocks(at, range(count))), 0, 1)
        if progress is not None:
            progress(done + 1, len(groups))
    return found


def outlined_inductance(
    source: Source,
    plates: AnyPlates,
    frequencies: npt.ArrayLike,
    sheets: Sequence[Sheet] = (),
    *,
    fineness: float = 1.0,
) -> ComplexArray:
    """Change of the inductance matrix in H by finite plates.

    It is relative to the other plates alone, of shape (frequencies, paths, paths). Arguments and
    errors are as in `moving_plate`.
    """
    paths = as_conductors(source)
    f = checked_frequencies(frequencies, positive=True)
    magnetic = _magnetic_plate(plates, f)
    if magnetic is not None:
        beside = [one for one in plates if one is not magnetic]
        moved = moving_plate(paths, magnetic, [magnetic.centre], f, sheets, beside, fineness=fineness)
        return np.asarray(moved.change[0])
    coarse, fine = (around.solved(posed).change() for around, posed in _all_posed(paths, plates, f, sheets, fineness))
    return _extrapolated(coarse, fine)[0]


def eddy_currents(
    source: Source,
    plates: AnyPlates,
    frequencies: npt.ArrayLike,
    sheets: Sequence[Sheet] = (),
    *,
    fineness: float = 1.0,
    alone: bool = False,
) -> list[list[EddyCurrents]]:
    """Compute the eddy currents in all finite plates, by frequency.

    Each path in turn carries 1 A. With `alone` they make the field outside the plates: in magnetic
    plates other currents then take the place of the magnetic charges.
    """
    paths, f = as_conductors(source), checked_frequencies(frequencies, positive=True)
    magnetic = _magnetic_plate(plates, f)
    if magnetic is None:
        return solve_outlined(paths, plates, f, sheets, fineness=fineness).eddy_currents()
    endless = [one for one in plates if isinstance(one, Plate)]
    where = np.array([magnetic.centre])
    _require_free(magnetic, where, endless)
    around = PlatesInAir(paths, LayeredAir.between(endless, sheets, f))
    posed = _posed(around, magnetic, where, sheets, _ALONE * fineness)[1]
    return [[EddyCurrents(posed.corners, density)] for density in magnetic_currents(around, posed, alone=alone)]


def solve_outlined(
    source: Source,
    plates: AnyPlates,
    frequencies: npt.ArrayLike,
    sheets: Sequence[Sheet] = (),
    *,
    fineness: float = 1.0,
) -> SolvedPlates:
    """Solve all finite plates, none of them magnetic, for `eddy_currents`."""
    f = checked_frequencies(frequencies, positive=True)
    _, (around, posed) = _all_posed(as_conductors(source), plates, f, sheets, _ALONE * fineness)
    return around.solved(posed)


def _whole_model_error(
    paths: Sequence[Conductor], plate: FinitePlate, where: FloatArray, frequencies: FloatArray, sheets: Sequence[Sheet]
) -> tuple[FloatArray, float]:
    """Largest errors (3,) of the model with rim, within limits, and the thickness in skin depths.

    A non-magnetic plate has its errors by the sharp rim, of which the model includes only the mean
    current. With the distance d between the planes of plate and coils, and the extension m of the
    plate beyond the coils, the eddy currents that a coil induces there fall as d²/(d² + m²), and
    the losses as their square.
    """
    nearest, scale, spread = _extents(paths, plate, where, sheets)
    errors, depths = _model_error(plate, frequencies, scale, max(nearest, spread / 2))
    if plate.material.relative_permeability != 1 or not depths:
        return errors, depths  # the error by the edges of a magnetic plate comes with its solution
    ground = _ground(replace(plate, centre=(0.0, 0.0, 0.0)))
    covers = [translate(ground, x, y) for x, y in where[:, :2].tolist()]
    margin = min(
        cover.boundary.distance(hull) if cover.contains(hull) else 0.0 for hull in _hulls(paths) for cover in covers
    )
    of_L = _RIM_INDUCTANCE * plate.thickness / max(depths, 2.0) / inscribed_radius(plate.outline)
    of_R = _RIM_RESISTANCE * min((depths / _THIN) ** 2, 1.0)
    return errors + (1 + (margin / nearest) ** 2) ** -2 * np.array([0.0, of_L, of_R]), depths


def _posed(
    around: PlatesInAir, plate: FinitePlate, where: FloatArray, sheets: Sequence[Sheet], fineness: float
) -> list[PosedPlate]:
    """Place an allowed plate at centres (n, 3) in m, meshed twice."""
    paths, frequencies = around.paths, around.air.frequencies
    nearest, scale, spread = _extents(paths, plate, where, sheets)
    _model_error(plate, frequencies, scale, math.inf)
    area = shapely.union_all([translate(hull, -x, -y) for hull in _hulls(paths) for x, y in where[:, :2].tolist()])
    coarse, mesh = plate_meshes(plate.outline, plate.thickness, fineness, Footprint(area, nearest, spread))
    fine = EddyBody(mesh)
    impedances = [
        surface_impedance(plate.material, plate.thickness, f, 2 / scale)
        for f in frequencies.tolist()
        if plate.material.relative_permeability == 1  # magnetic plates have another condition
    ]
    return [PosedPlate(body, plate, where, impedances) for body in (EddyBody(coarse, fine), fine)]


def _magnetic_plate(plates: AnyPlates, frequencies: FloatArray) -> FinitePlate | None:
    """Return the allowed magnetic finite plate, or None."""
    outlined = [one for one in plates if isinstance(one, FinitePlate)]
    for one in outlined:
        if one.material.relative_permeability != 1:
            require_skin(one, frequencies, [other for other in outlined if other is not one])
            return one
    return None


def _hulls(paths: Sequence[Conductor]) -> list[BaseGeometry]:
    """Convex hulls of the paths in m, seen from above."""
    return [shapely.MultiPoint(path.vertices[:, :2]).convex_hull for path in paths]


def _extents(
    paths: Sequence[Conductor], plate: FinitePlate, where: FloatArray, sheets: Sequence[Sheet]
) -> tuple[float, float, float]:
    """Lengths in m: distance, scale of the field, width of a winding.

    They are the least distance from a plate to copper across, the least radius of a path plus its
    distance, and the least spread of the corners' distances from a path's mean.
    """
    corners = np.concatenate([path.vertices for path in paths])
    low, high = (np.array(plate.heights) - plate.centre[2])[:, None] + where[:, 2]
    copper, bottom = float(corners[:, 2].max()), float(corners[:, 2].min())
    top = copper
    if any(sheet.magnetic for sheet in sheets):
        top = max(top, math.fsum(sheet.thickness for sheet in sheets))
    inside = np.flatnonzero((low <= top) & (high >= bottom))
    if len(inside):
        raise GeometryError(
            f"a finite plate must lie above z = {top * 1e3:.4g} mm, the highest copper or sheet, "
            f"or below z = {bottom * 1e3:.4g} mm, the lowest copper; {plate.name!r} reaches "
            f"from {low[inside[0]] * 1e3:.4g} to {high[inside[0]] * 1e3:.4g} mm."
        )
    away = [np.linalg.norm(path.vertices - path.vertices.mean(axis=0), axis=1) for path in paths]
    radius = min(float(np.sqrt((one**2).mean())) for one in away)
    above = np.abs((corners @ plate.axes[2])[:, None] - where @ plate.axes[2]).min() - plate.thickness / 2
    nearest = float(np.where(low > top, low - copper, bottom - high).min())
    return nearest, radius + max(float(above), 0.0), min(float(np.ptp(one)) for one in away)


def _model_error(
    plate: FinitePlate, frequencies: FloatArray, scale: float, shortest: float
) -> tuple[FloatArray, float]:
    """Largest errors (3,) of ΔL − jΔR/ω, ΔL and ΔR by the model over `scale` in m.

    Variation over a `shortest` length in m near a turn adds to the errors without refusal. The
    second result is the thickness in skin depths where ΔR errs most, 0 for a perfect conductor.
    """
    inscribed, material, thickness = inscribed_radius(plate.outline), plate.material, plate.thickness
    if thickness > 2 * inscribed:  # its currents are like the currents of a rod, for which no error is known
        raise GeometryError(
            f"a finite plate must be thinner than it is wide; {plate.name!r} is {thickness * 1e3:.3g} mm thick and "
            f"{2 * inscribed * 1e3:.3g} mm wide."
        )
    largest, depths, kappa = np.zeros(3), 0.0, 2 / scale
    for f in frequencies.tolist():
        of = partial(model_error, material, thickness, f)
        if material.relative_permeability != 1:
            errors = [of(0.0, 3 / inscribed), of(0.0, kappa)]
        else:
            share = 1.0  # of the currents' own field in their driving field
            if not math.isinf(material.conductivity):
                own, _ = face_impedances(material, thickness, f, 2 / inscribed)
                share = 1 / abs(1 + 4 / inscribed * own / (MU_0 * (1 + math.exp(-2 / inscribed * thickness))))
            errors = [
                _OF_SPREAD * of(kappa, 2 * kappa),  # the wavenumbers of the field scatter about κ by about κ
                of(kappa, max(_BY_LOSSES / shortest, kappa)) * [0.0, 1.0, 1.0],
                share * of(kappa, 2 / inscribed),
            ]
        worst = np.max(errors, axis=0)
        if worst[2] > largest[2]:
            depths = thickness / material.skin_depth(f)
        largest = np.maximum(largest, worst)
        if largest[0] > LARGEST_ERROR:
            raise GeometryError(
                "skin depth or thickness of a finite plate must be small compared with its inscribed radius of "
                f"{inscribed * 1e3:.3g} mm and the coils' radius and distance of {scale * 1e3:.3g} mm; "
                f"{plate.name!r}, {plate.thickness * 1e3:.3g} mm thick, has a skin depth of "
                f"{plate.material.skin_depth(f) * 1e3:.3g} mm at {f:.4g} Hz, so that its ΔL would have an error of "
                f"{largest[0]:.0%}."
            )
    return largest, depths


def _all_posed(
    paths: Sequence[Conductor], plates: AnyPlates, frequencies: FloatArray, sheets: Sequence[Sheet], fineness: float
) -> list[tuple[PlatesInAir, list[PosedPlate]]]:
    """Infinite layers, and plates with the coarse and fine mesh."""
    outlined = [one for one in plates if isinstance(one, FinitePlate)]
    for k, one in enumerate(outlined):
        _require_free(one, np.array([one.centre]), [*outlined[:k], *(p for p in plates if isinstance(p, Plate))])
    air = LayeredAir.between([one for one in plates if isinstance(one, Plate)], sheets, frequencies)
    around = PlatesInAir(paths, air)
    both = [_posed(around, one, np.array([one.centre]), sheets, fineness) for one in outlined]
    return [(around, [one[number] for one in both]) for number in (0, 1)]


def _require_free(plate: FinitePlate, where: FloatArray, beside: AnyPlates) -> None:
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
    """Return the area of the board that a plate covers."""
    outline = plate.outline
    return shapely.Polygon(plate.on_board(outline.exterior), [plate.on_board(hole) for hole in outline.holes])


def _coupled(matrix: ComplexArray, b: NumberArray) -> ComplexArray:
    """−bᵀ matrix⁻¹ b of each position for b (u, positions, paths)."""
    factors = lu_factor(matrix, overwrite_a=True, check_finite=False)
    parts = []
    for start, stop in ranges(b.shape[1], max(_AT_ONCE // b.shape[2], 1)):
        block = b[:, start:stop]
        x = lu_solve(factors, block.reshape(len(b), -1), check_finite=False).reshape(block.shape)
        parts.append(-np.einsum("upi,upj->pij", block, x, optimize=True))
    both = np.concatenate(parts)
    return np.asarray((both + both.transpose(0, 2, 1)) / 2, dtype=np.complex128)
