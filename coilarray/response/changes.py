"""Changes of all coils by dents, metal and targets.

Every change is ΔL − jΔR/ω in H over frequency, for all depths or distances and places in a row.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from coilarray.circuit.network import Network, Resonance, cases_at_once, changed_resonances
from coilarray.compute.arrays import ComplexArray, FloatArray
from coilarray.compute.store import Keep
from coilarray.compute.threads import Progress, part_of, ranges
from coilarray.elastomer.dented_layer import dent_inductance
from coilarray.elastomer.finite_sample import shift_inductance
from coilarray.elastomer.scattering import LayerMesh
from coilarray.electromagnetics.field import Source, as_conductors
from coilarray.electromagnetics.flat_stack import Backing
from coilarray.errors import ElastomerError
from coilarray.geometry import Ball, FinitePlate, Plate
from coilarray.metal.backing import backings_of
from coilarray.metal.ball import indenter_inductance
from coilarray.metal.frequencies import ChangeOverFrequency, FrequencyBand
from coilarray.response.setup import Experiment, Level, MapAxes, together

Variable = tuple[tuple[str, ...], Any, dict[str, str]]  # variable of a dataset: dimensions, values and attributes

_POSITIONS = 1000  # in a part of a map, which is kept and holds a single depth


def constant_change(values: FloatArray | ComplexArray) -> ChangeOverFrequency:
    """Return changes (cases, n, n) in H at all frequencies."""
    return ChangeOverFrequency(FrequencyBand(1.0, 1.0), values[:, None])


def plus(change: ChangeOverFrequency, by: FloatArray | ComplexArray) -> ChangeOverFrequency:
    """Add changes (cases, n, n) in H at all frequencies."""
    return replace(change, values=change.values + by[:, None])


def through_circuit(
    network: Network, flats: Sequence[Resonance], change: ChangeOverFrequency, *, at_own_frequency: bool = False
) -> dict[str, FloatArray]:
    """Solve every state with every change, from its resonance.

    The change is taken at the frequency of the network alone, or of each case. ``delta`` and the
    quantities of a `Resonance` have shape (cases, states).
    """
    L = network.inductance
    cases = len(change.values)
    by_state = []
    for flat in flats:
        changed = None if at_own_frequency else L + change.at(flat.frequency)
        parts = []
        for start, stop in ranges(cases, cases_at_once(network)):
            rows = slice(start, stop)

            # The network itself comes first, so an unchanged network gives zero to the last digit.
            def inductances(
                f: FloatArray, rows: slice = rows, fixed: FloatArray | ComplexArray | None = changed
            ) -> FloatArray | ComplexArray:
                there = L + change.of_each(f[1:], rows) if fixed is None else fixed[rows]
                return np.insert(there, 0, L, axis=0)

            f, Z, Y = changed_resonances(network, flat, inductances, stop - start + 1)
            parts.append(((f[0] / f[1:]) ** 2 - 1, f[1:], Z[1:], Y[1:]))
        by_state.append([np.concatenate(part) for part in zip(*parts, strict=True)])
    delta, f, Z, Y = (np.stack(part, axis=-1) for part in zip(*by_state, strict=True))
    with np.errstate(divide="ignore"):
        return {
            "delta": delta.real,
            "frequency": f.real,
            "effective_inductance": 1 / ((2 * np.pi * f.real) ** 2 * network.switches.tank_capacitance),
            "effective_resistance": Z.real,
            "quality_factor": Z.imag / Z.real,
            "parallel_resistance": 1 / Y.real,
        }


def dent_changes(
    source: Source,
    plates: Sequence[Plate | FinitePlate],
    pressed: Experiment,
    band: FrequencyBand,
    mesh: LayerMesh,
    keep: Keep,
    progress: Progress | None,
) -> ChangeOverFrequency:
    """Compute the changes by dents at all depths and places.

    Without plates below the paths the change is real and the same at all frequencies.
    """
    backings, _ = backings_of(source, plates, band.nodes.tolist(), pressed.sheets)
    if not backings:
        return constant_change(_over_backing(source, pressed, None, mesh, keep, progress))
    cases = [
        _over_backing(source, pressed, backing, mesh, keep, part_of(progress, k, len(backings)))
        for k, backing in enumerate(backings)
    ]
    return ChangeOverFrequency(band, np.asarray(np.stack(cases, axis=1), dtype=np.complex128))


def _over_backing(
    source: Source, pressed: Experiment, backing: Backing | None, mesh: LayerMesh, keep: Keep, progress: Progress | None
) -> FloatArray | ComplexArray:
    """Compute the changes (cases, n, n) in H over backing."""
    blocks = [slice(*block) for block in ranges(len(pressed.points), _POSITIONS)]
    parts = [(k, block) for k in range(len(pressed.axes.depth)) for block in blocks]
    paths = [conductor.vertices for conductor in as_conductors(source)]
    found = []
    for number, (k, block) in enumerate(parts):
        points, told = pressed.points[block], part_of(progress, number, len(parts))
        levels = [
            replace(level, dents=level.dents[k : k + 1], shares=level.shares[k : k + 1, block])
            for level in pressed.levels
        ]

        def compute(
            levels: list[Level] = levels, points: FloatArray = points, told: Progress | None = told
        ) -> xr.Dataset:
            groups = together(levels)
            change = sum(
                changes_by_levels(source, group, points, mesh, backing, part_of(told, k, len(groups)))[0]
                for k, group in enumerate(groups)
            )
            if not np.isfinite(change).all():
                raise ElastomerError("the dented sheets gave numbers that are not finite; please report the design.")
            dims = ("place", "coil", "other")
            part = xr.Dataset({"change": (dims, np.real(change))})
            return part if backing is None else part.assign(loss=(dims, -np.imag(change)))

        of_levels = [(level.shares, level.dents[0], level.coarse) for level in levels]
        # all that decides the numbers of a part
        part = keep(("dents", mesh, points, of_levels, paths, backing), compute)
        found.append(part.change.values - (1j * part.loss.values if "loss" in part else 0))
        if told is not None:
            told(1, 1)
    change = np.concatenate(found)
    if pressed.correction is None:
        return change
    shift = changes_by_bounds(pressed, source, mesh, backing)
    return np.asarray(change + np.reshape(shift if backing is not None else shift.real, change.shape))


def changes_by_bounds(
    pressed: Experiment, source: Source, mesh: LayerMesh, backing: Backing | None
) -> ComplexArray | complex:
    """Compute ΔL − jΔR/ω in H by a sample's bounds."""
    if pressed.correction is None:
        return 0j
    places = pressed.points - pressed.origin
    return shift_inductance(source, pressed.sheets, pressed.correction, places, pressed.origin, mesh, backing)


def changes_by_levels(
    source: Source,
    levels: Sequence[Level],
    points: FloatArray,
    mesh: LayerMesh,
    backing: Backing | None,
    progress: Progress | None,
) -> FloatArray | ComplexArray:
    """Compute the changes in H by level samples.

    All samples have the same sheets. The change (depths, places, coils, coils) is ΔL, or ΔL − jΔR/ω
    with a backing.
    """
    dents = [dent for level in levels for dent in level.dents]
    accuracy = mesh.coarser() if levels[0].coarse else mesh
    change = dent_inductance(source, dents, points, accuracy, backing=backing, progress=progress)
    parts = change.reshape(len(levels), -1, *change.shape[1:])
    return np.asarray(np.einsum("ldp,ldpij->dpij", [level.shares for level in levels], parts))


def check_metal(axes: MapAxes, ball: Ball | None) -> None:
    """Refuse depths below 0 of an indenter without a material."""
    if ball is None and axes.depth[0] < 0:
        raise ElastomerError(
            "depth of an indentation must be at least 0 unless the indenter has a material; got "
            f"{axes.depth[0] * 1e3:.4g} mm."
        )


def metal_share(
    source: Source,
    plates: Sequence[Plate | FinitePlate],
    pressed: Experiment,
    ball: Ball,
    frequency: float,
    rest: float,
    mesh: LayerMesh,
) -> ComplexArray:
    """Share of the indenter's material in the changes in H.

    The shape is (cases, coils, coils), relative to the indenter at rest. The dents are for wide
    sheets. The effect of a finite sample on the share is not known.
    """
    total: ComplexArray | float = 0.0
    backings, outlined = backings_of(source, plates, [frequency], pressed.sheets)
    backing = next(iter(backings), None)
    heights = [*pressed.above.tolist(), rest]
    for level in (level for level in pressed.levels if not level.coarse):
        first = level.dents[0]
        dents = [*level.dents, replace(first, displacement=np.zeros_like(first.displacement))]
        found = indenter_inductance(
            source, ball, dents, pressed.points, frequency, heights, backing, outlined, mesh=mesh
        )
        total = total + np.einsum("dp,dpij->dpij", level.shares, found[:-1] - found[-1])
    return np.asarray(total).reshape(-1, *found.shape[-2:])
