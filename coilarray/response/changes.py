"""Changes of all coils by dents, by the metal of an indenter and by a target, and their way through the circuit.

Every change is ΔL − jΔR/ω in H over frequency, for all depths or distances and places in a row. Dents also change the
capacitance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from coilarray.circuit.network import Network, Resonance, cases_at_once, changed_resonances
from coilarray.compute.arrays import ComplexArray, FloatArray
from coilarray.compute.netcdf import variables
from coilarray.compute.threads import Progress, part_of, ranges
from coilarray.design.model import Design
from coilarray.elastomer.dented_layer import dent_inductance
from coilarray.elastomer.dielectric import dent_capacitance
from coilarray.elastomer.face_shift import shift_inductance
from coilarray.elastomer.scattering import LayerMesh
from coilarray.electromagnetics.flat_stack import Backing
from coilarray.electromagnetics.inductance import Accuracy
from coilarray.electromagnetics.source import Source
from coilarray.errors import ElastomerError, MetalError
from coilarray.geometry import Ball, FinitePlate
from coilarray.metal.backing import backings_of, outlined_below
from coilarray.metal.frequencies import ChangeOverFrequency, FrequencyBand
from coilarray.metal.indenter import indenter_inductance
from coilarray.metal.target import target_inductance
from coilarray.response.setup import Experiment, Level, MapAxes, indentation_of, target_of, together

if TYPE_CHECKING:
    from coilarray.compute.store import Keep

Variable = tuple[tuple[str, ...], Any, dict[str, str]]
"""Variable of a dataset: dimensions, values and attributes."""

_POSITIONS = 1000  # in a part of a map that is kept, which holds a single depth


def constant_change(values: FloatArray | ComplexArray) -> ChangeOverFrequency:
    """Return changes (cases, n, n) in H that are the same at all frequencies."""
    return ChangeOverFrequency(FrequencyBand(1.0, 1.0), values[:, None])


def plus(change: ChangeOverFrequency, by: FloatArray | ComplexArray) -> ChangeOverFrequency:
    """Add the same changes (cases, n, n) in H at all frequencies."""
    return replace(change, values=change.values + by[:, None])


def through_circuit(
    network: Network,
    flats: Sequence[Resonance],
    change: ChangeOverFrequency,
    capacitance_change: FloatArray | None = None,
    *,
    at_own_frequency: bool = False,
) -> dict[str, FloatArray]:
    """Solve every state with every change, from its resonance in the network alone.

    The change is taken at the frequency of the network alone, or of each case. `capacitance_change` (cases, coils) is
    in F. The quantities have shape (cases, states): ``delta``, and the quantities of a `Resonance` by name.
    """
    L, winding = network.inductance, network.winding_capacitance
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

            C = (
                None
                if capacitance_change is None
                else np.insert(winding + capacitance_change[rows], 0, winding, axis=0)
            )
            f, Z, Y = changed_resonances(network, flat, inductances, stop - start + 1, C)
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
    pressed: Experiment,
    band: FrequencyBand,
    permittivity: float | None,
    mesh: LayerMesh,
    keep: Keep,
    progress: Progress | None,
) -> tuple[ChangeOverFrequency, FloatArray]:
    """Compute the changes of all coils by dents.

    These are ΔL − jΔR/ω in H of all depths and places in a row, and ΔC (cases, coils) in F. Without plates below the
    coils the change is real and the same at all frequencies.
    """
    design = pressed.design
    backings: list[Backing | None] = [*backings_of(design.array, design.plates, band.nodes.tolist(), design.sheets)]
    if not backings:
        change, capacitance = _dent_changes(pressed, permittivity, mesh, None, keep, progress)
        return constant_change(change), capacitance
    cases = [
        _dent_changes(pressed, permittivity, mesh, one, keep, part_of(progress, k, len(backings)))
        for k, one in enumerate(backings)
    ]
    return ChangeOverFrequency(
        band, np.asarray(np.stack([change for change, _ in cases], axis=1), dtype=np.complex128)
    ), cases[0][1]


def _dent_changes(
    pressed: Experiment,
    permittivity: float | None,
    mesh: LayerMesh,
    backing: Backing | None,
    keep: Keep,
    progress: Progress | None,
) -> tuple[FloatArray | ComplexArray, FloatArray]:
    """Compute the changes (cases, coils, coils) in H over one backing, and ΔC (cases, coils) in F."""
    design, levels, points = pressed.design, pressed.levels, pressed.points
    paths = [conductor.vertices for conductor in design.array.conductors()]
    depths, blocks = len(pressed.axes.depth), ranges(len(points), _POSITIONS)
    steps = _Steps(progress, depths * len(blocks) * len(together(levels)))
    parts = []
    for k in range(depths):
        for start, stop in blocks:
            block = [
                replace(level, dents=level.dents[k : k + 1], shares=level.shares[k : k + 1, start:stop])
                for level in levels
            ]
            on_board = points[start:stop]
            # all inputs that decide the numbers of a part
            of_levels = [(level.shares, level.dents[0], level.coarse) for level in block]
            inputs = ("dents", permittivity, mesh, on_board, of_levels, paths, backing)
            parts.append(
                keep(inputs, partial(_compute_part, design, block, on_board, permittivity, mesh, backing, steps))
            )
            steps.reach(len(parts) * len(together(levels)))
    change = np.concatenate([part.change.values - (1j * part.loss.values if "loss" in part else 0) for part in parts])
    shift = changes_by_bounds(pressed, design.array, mesh, backing)
    if pressed.correction is not None:
        change = change + np.reshape(shift if backing is not None else shift.real, change.shape)
    return change, np.concatenate([part.capacitance_change.values for part in parts])


def changes_by_bounds(
    pressed: Experiment, source: Source, mesh: LayerMesh, backing: Backing | None
) -> ComplexArray | complex:
    """Inductance changes ΔL − jΔR/ω in H by a sample's sides and seat, 0 for a wide sample."""
    if pressed.correction is None:
        return 0j
    origin = indentation_of(pressed.design).origin_point
    places = pressed.points - origin
    return shift_inductance(source, pressed.design.sheets, pressed.correction, places, origin, mesh, backing)


def changes_by_levels(
    source: Source,
    levels: Sequence[Level],
    points: FloatArray,
    mesh: LayerMesh,
    backing: Backing | None,
    progress: Progress | None,
) -> FloatArray | ComplexArray:
    """Compute the changes (depths, places, coils, coils) in H by level samples of the same sheets.

    The change is ΔL, or ΔL − jΔR/ω with a backing.
    """
    dents = [dent for level in levels for dent in level.dents]
    accuracy = mesh.coarser() if levels[0].coarse else mesh
    change = dent_inductance(source, dents, points, accuracy, backing=backing, progress=progress)
    parts = change.reshape(len(levels), -1, *change.shape[1:])
    return np.asarray(np.einsum("ldp,ldpij->dpij", [level.shares for level in levels], parts))


def _compute_part(
    design: Design,
    levels: Sequence[Level],
    points: FloatArray,
    permittivity: float | None,
    mesh: LayerMesh,
    backing: Backing | None,
    steps: _Steps,
) -> xr.Dataset:
    """Inductance and capacitance changes of one depth at some places, and beside plates ΔR/ω in H as ``loss``."""
    coils = len(design.array.names)
    change, capacitance_change = np.zeros((len(points), coils, coils)), np.zeros((len(points), coils))
    loss = np.zeros_like(change)
    for group in together(levels):
        dented = changes_by_levels(design.array, group, points, mesh, backing, steps.within)[0]
        change += dented.real
        loss -= dented.imag
        if permittivity is not None:
            dents = [level.dents[0] for level in group]
            parts = dent_capacitance(design.array, dents, points, permittivity, mesh)
            capacitance_change += np.einsum("lp,lpi->pi", [level.shares[0] for level in group], parts)
        steps.reach(steps.done + 1)
    if not (np.isfinite(change).all() and np.isfinite(capacitance_change).all()):
        raise ElastomerError("the dented sheets gave numbers that are not finite; please report the design.")
    dims = ("place", "coil", "other")
    part = xr.Dataset({"change": (dims, change), "capacitance_change": (dims[:2], capacitance_change)})
    return part if backing is None else part.assign(loss=(dims, loss))


class _Steps:
    """Counter of map parts for a progress bar, in hundredths."""

    def __init__(self, progress: Progress | None, parts: int) -> None:
        self._progress, self._total, self.done = progress, 100 * parts, 0

    def within(self, done: int, total: int) -> None:
        """Count within a part."""
        if self._progress is not None:
            self._progress(100 * self.done + 99 * done // total, self._total)

    def reach(self, parts: int) -> None:
        """Count whole parts up to a number."""
        if parts > self.done and self._progress is not None:
            self._progress(100 * parts, self._total)
        self.done = parts


def check_metal(axes: MapAxes, ball: Ball | None, rest: float) -> None:
    """Refuse a rest below the sheets, and depths below 0 of an indenter without a material."""
    if not rest >= 0:
        raise MetalError(f"rest must be at least 0; got {rest} m.")
    if ball is None and axes.depth[0] < 0:
        raise ElastomerError(
            "depth of an indentation must be at least 0 unless the indenter has a material; got "
            f"{axes.depth[0] * 1e3:.4g} mm."
        )


def metal_share(
    pressed: Experiment, source: Source, ball: Ball, frequency: float, rest: float, mesh: LayerMesh
) -> ComplexArray:
    """Share (cases, coils, coils) of the indenter's material in the changes in H, relative to the indenter at rest.

    The dents are for wide sheets. The contribution of a finite sample to them is left out, and its effect on the share
    is not known.
    """
    total: ComplexArray | float = 0.0
    plates, sheets = pressed.design.plates, pressed.design.sheets
    outlined = outlined_below(source, plates, [frequency], sheets)
    backing = next(iter(backings_of(source, plates, [frequency], sheets, outlined=outlined)), None)
    heights = [*pressed.above.tolist(), rest]
    for level in (level for level in pressed.levels if not level.coarse):
        first = level.dents[0]
        dents = [*level.dents, replace(first, displacement=np.zeros_like(first.displacement))]
        found = indenter_inductance(
            source, ball, dents, pressed.points, frequency, heights, backing, outlined, mesh=mesh
        )
        total = total + np.einsum("dp,dpij->dpij", level.shares, found[:-1] - found[-1])
    return np.asarray(total).reshape(-1, *found.shape[-2:])


def metal_variables(axes: MapAxes, delta: FloatArray, share: ComplexArray, frequency: float) -> dict[str, Variable]:
    """Return the variables of the material's share."""
    matrix = ("depth", "y", "x", "coil", "other")
    values = share.reshape(*axes.shape, *share.shape[1:])
    loss = -2 * np.pi * frequency * values.imag
    return variables(
        ("metal_delta", ("depth", "y", "x", "state"), delta.reshape(*axes.shape, -1), "1",
         "share of the indenter's material in delta"),
        ("metal_inductance_change", matrix, values.real, "H", "share of the indenter's material"),
        ("metal_resistance_change", matrix, loss, "ohm", "eddy-current loss in the indenter"),
    )  # fmt: skip


def metal_attributes(ball: Ball, frequency: float, rest: float) -> dict[str, object]:
    """Return the attributes of a share: its frequency, the indenter's material, and the height at rest in m."""
    return {"metal_frequency_Hz": frequency, "rest_m": rest, "indenter_material": ball.material.name}


def target_changes(
    design: Design,
    axes: MapAxes,
    frequencies: FloatArray,
    accuracy: Accuracy,
    fineness: float,
    keep: Keep,
    progress: Progress | None = None,
) -> ComplexArray:
    """ΔL − jΔR/ω in H of a target at all distances and places.

    The shape is (3, distances, places, frequencies, coils, coils). Along the first axis are the change, its error, and
    the part of the mesh in this error. The errors are 0 for bodies other than plates.
    """
    target = target_of(design)
    places = axes.places + target.origin_point
    paths = [conductor.vertices for conductor in design.array.conductors()]
    # A plate with an outline between layers is solved again at every distance. Otherwise the most costly part serves
    # all distances.
    magnetic = any(sheet.magnetic for sheet in design.sheets)
    apart = isinstance(target.body, FinitePlate) and (magnetic or bool(design.plates))
    distances = axes.depth.tolist()
    blocks = [[one] for one in distances] if apart else [distances]
    found = []
    for number, block in enumerate(blocks):

        def compute(number: int = number, block: list[float] = block) -> xr.Dataset:
            change, error = target_inductance(
                design.array, target, places, block, frequencies, design.sheets, design.plates,
                accuracy=accuracy, fineness=fineness, progress=part_of(progress, number, len(blocks)),
            )  # fmt: skip
            both = [np.zeros_like(change)] * 2 if error is None else [error.absolute, error.mesh]
            values = np.stack([change, *(part.reshape(change.shape) for part in both)])
            dims = ("value_or_error", "distance", "place", "frequency", "coil", "other")
            return xr.Dataset({"inductance": (dims, values.real), "loss": (dims, -values.imag)})

        inputs = (target.body, places, frequencies, design.sheets, design.plates, paths, accuracy, fineness, block)
        part = keep(("target", *inputs), compute)
        found.append(part.inductance.values - 1j * part.loss.values)
    return np.concatenate(found, axis=1)
