"""Response of every scan state to a moving target.

A target is a body of metal or ferrite that is moved over the board.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.circuit.board_circuit import board_circuit
from coilarray.circuit.coupling import provenance
from coilarray.circuit.network import Network, Resonance, cases_at_once, changed_resonances, loaded_quality, resonate
from coilarray.circuit.noise_budget import budget_of
from coilarray.circuit.readability import readability
from coilarray.compute.arrays import ComplexArray, FloatArray
from coilarray.compute.memory import require_memory
from coilarray.compute.netcdf import variables
from coilarray.compute.store import Store, content_key
from coilarray.compute.threads import Progress, ranges
from coilarray.design.bundled import names_with
from coilarray.design.model import Design, DesignFile, design_of
from coilarray.electromagnetics.inductance import Accuracy
from coilarray.errors import MetalError, require_positive
from coilarray.geometry import FinitePlate, Plate, Target
from coilarray.metal.finite_plates import PlateError, worst_attributes
from coilarray.metal.frequencies import ChangeOverFrequency, FrequencyBand
from coilarray.metal.target import require_apart, target_inductance
from coilarray.response.coordinates import map_coordinates, origin_attributes
from coilarray.response.setup import MapAxes, checked_axis
from coilarray.response.target_range import ranges_of, require_noise

_MARGIN = (0.02, 0.2)  # margin of the band of log f: a minimum, and a part of its width
_MOST_NODES = 16  # of bands up to a factor of fifty
_BYTES_A_VALUE = 48.0  # a complex number as computed, in the store, and as the circuit takes it
_COARSE = 0.5  # fraction of the mesh fineness with which the band of the resonances is guessed
_LEFT_OUT = ("change of the losses in the copper by the target", "capacitance of the target")
_QUANTITIES = (
    ("frequency", "Hz", "resonance frequency"),
    ("effective_inductance", "H", "effective inductance"),
    ("effective_resistance", "ohm", "effective resistance"),
    ("quality_factor", "1", "quality factor"),
    ("parallel_resistance", "ohm", "parallel resistance"),
)


def target_of(design: Design) -> Target:
    """Return the target of a design.

    A design without a target raises a MetalError.
    """
    if design.target is None:
        bundled = ", ".join(names_with("target"))
        raise MetalError(
            f'the design {design.name} has no [target]: add one, for example with shape = "disc", diameter_mm = 12, '
            'thickness_mm = 1 and material = "aluminium"; bundled designs '
            f"that have one are {bundled}."
        )
    return design.target


def with_target_as_plate(design: Design, place: tuple[float, float], distance: float) -> Design:
    """Return a design with its target as a plate.

    The target lies over a place on the board at a distance, all in m. A sphere is no plate and raises a MetalError.
    """
    target = target_of(design)
    height = target.height(design.top, distance)
    if isinstance(target.body, Plate):
        body: Plate | FinitePlate = replace(target.body, z=height)
    elif isinstance(target.body, FinitePlate):
        body = replace(target.body, centre=(*place, height))
    else:
        raise MetalError(f"B beside a sphere is not computed; the target of {design.name} is one: leave it out.")
    require_apart(body, design.plates)
    return replace(design, plates=(*design.plates, body), target=None)


def target_map(
    design: Design | DesignFile,
    *,
    distances: npt.ArrayLike | None = None,
    x: npt.ArrayLike | None = None,
    y: npt.ArrayLike | None = None,
    noise: float | None = None,
    network: Network | None = None,
    ideal: bool = False,
    fineness: float = 1.0,
    accuracy: Accuracy = "full",
    parts: str | Path | None = None,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Compute the response of the coils to a target.

    It is computed at every distance and place.

    Parameters
    ----------
    design : Design or DesignFile
        Design with a target.
    distances, x, y : array_like, shape (n,), optional
        Distances of the target's nearest point from the upper face of the sheets or the board, and places of its
        centre, in m, places from the map's origin. By default those in the design.
    noise : float, optional
        Standard deviation of δ in a reading, for range and resolution. By default from the noise budget of the design,
        `coilarray.circuit.noise_budget.NoiseBudget.largest`. The attribute ``sigma`` holds it. The attribute ``noise``
        holds the part that is independent from state to state, and ``common_noise`` the rest.
    network : Network, optional
        Coils, switches and strays of this design without the target. By default
        `coilarray.circuit.coupling.design_circuit`.
    ideal : bool
        Leave AC resistance of the copper and all strays out of the circuit, unless `network` is given.
    fineness : float
        Fineness of the mesh of a plate with an outline. The value 2 halves the lengths of 1 and takes eight times as
        long.
    accuracy : {"full", "screen"}
        Accuracy of the target's changes and of the network, see `coilarray.inductance_matrix`. A given network keeps
        its own.
    parts : str or Path, optional
        Folder for finished distances, so that an interrupted map goes on from there. They are kept individually for a
        plate with an outline over magnetic sheets or beside plates, else all at once.
    progress : callable, optional
        Called with (done, total) as the work goes on.

    Returns
    -------
    xarray.Dataset
        Dimensions ``distance``, ``y``, ``x``, ``state``, ``coil`` and ``other``. Over (distance, y, x, state), each at
        the resonance with the target:

        - ``delta``: (L − L_0)/L_0 as the converter sees it, with L = 1/((2πf)² C),
        - ``frequency`` in Hz, ``effective_inductance`` in H, ``effective_resistance`` and ``parallel_resistance`` in Ω,
        - ``quality_factor`` of the coils without the tank.

        Over (state), ``base_inductance`` and the others whose names begin with ``base_``: the same without the target.
        Over (distance, y, x, coil, other), at ``matrix_frequency`` (distance, y, x), the mean of the states' resonances
        there:

        - ``inductance_change`` in H and ``resistance_change`` in Ω of the matrix of the coils,
        - ``coupling``, the coupling coefficients with the target.

        Unless `ideal`, and for a design with a converter, ``readable`` and the others of
        `coilarray.circuit.readability.readability` give the states that it can read, and the drive current.

        ``inductance`` (coil, other) is the matrix in H without the target. The ranges and resolutions are from
        `coilarray.response.target_range.ranges_of`. ``coil_x`` and ``coil_y`` are the centres in m from the map's
        origin, which the attributes ``origin_x`` and ``origin_y`` place on the board.

        With plates that have an outline

        - the attributes ``plate_error_inductance`` and ``plate_error_resistance`` are the relative errors of ΔL and ΔR
          by mesh and model, the largest of the target and of the fixed plates. ``plate_skin_depths`` is the thickness
          of that plate in skin depths.
        - for a target with an outline, ``delta_error`` (distance, y, x, state) is the error of δ due to the errors of
          ΔL
          and ΔR, see `coilarray.metal.finite_plates.moving_plate_error`.

    Raises
    ------
    MetalError
        A design without a target, axes that are not finite and rising, a distance that is not positive, and the errors
        of `coilarray.metal.target.target_inductance`.
    NetworkError
        A state without a resonance, also with the target.
    MemoryLimitError
        More values than fit into memory.
    OutputError
        A part that cannot be written.

    Notes
    -----
    ΔL − jΔR/ω of the target is computed at a few frequencies of the band in which all resonances lie. This band follows
    from the least distance. Every place and distance is solved in the whole circuit at its own resonance. The losses in
    the copper of the coils are computed without the target, and the target has no capacitance to the coils. The
    attribute ``left_out`` lists these effects and the effects that the network lacks.
    """
    design = design_of(design)
    target = target_of(design)
    if noise is not None:
        require_noise(noise)
    require_positive("fineness of a mesh", fineness, "")
    require_apart(target.body, design.plates)
    given = (("distances", distances, target.distances), ("x", x, target.x), ("y", y, target.y))
    axes = MapAxes(*(checked_axis(name, own if values is None else values, MetalError) for name, values, own in given))
    if axes.depth[0] <= 0:
        raise MetalError(f"distances of a target must be above zero; got {axes.depth[0] * 1e3:g} mm.")
    coils, cases = len(design.array.names), int(np.prod(axes.shape))
    what = f"{len(axes.depth)} distances at {len(axes.x) * len(axes.y)} places with {coils} coils"
    require_memory(_BYTES_A_VALUE * cases * _MOST_NODES * coils**2, f"a target map of {what}", "compute it in pieces")
    circuit = board_circuit(design, accuracy=accuracy)
    if network is None:
        network = circuit.ideal if ideal else circuit.network
    alone = [resonate(network, state) for state in design.plan]
    resonances = np.array([one.frequency for one in alone])
    middle = float(np.exp(np.log(resonances).mean()))
    nearest = replace(axes, depth=axes.depth[:1])
    at_middle = FrequencyBand(middle, middle)
    first = _changes(design, nearest, at_middle.nodes, parts, None, _COARSE * fineness, "screen")[0]
    _require_passive(network, first, nearest)
    guess = _cases(at_middle, first)
    moved = np.array([_through_circuit(network, one, guess, nearest)["frequency"] for one in alone])
    for _ in range(2):  # the guess holds for a single frequency
        band = _around(np.append(moved, resonances))
        changes, *errors = _changes(design, axes, band.nodes, parts, progress, fineness, accuracy)
        _require_passive(network, changes, axes)
        near, network = _cases(band, changes), circuit.widened(network, band.low, band.high)
        solved = [_through_circuit(network, one, near, axes) for one in alone]
        by_state = {name: np.stack([one[name] for one in solved], axis=-1) for name, _, _ in _QUANTITIES}
        moved = by_state["frequency"]
        if band.holds(moved):
            break
    else:
        raise MetalError(
            f"a target at {axes.depth[0] * 1e3:g} mm moves a resonance to {moved.min():.6g} to {moved.max():.6g} Hz; "
            f"it is computed from {band.low:.6g} to {band.high:.6g} Hz. Begin at a greater distance."
        )
    base = {name: np.array([getattr(one, name) for one in alone]) for name, _, _ in _QUANTITIES}
    mean = moved.mean(axis=-1)
    budget = budget_of(design, base["frequency"], [loaded_quality(network, one) for one in alone])
    result = _dataset(design, target, axes, network, by_state, base, mean, near.of_each(mean))
    if noise is None:
        result = result.assign(budget.variables())
    if not ideal:
        at = {name: values.reshape(*axes.shape, -1) for name, values in by_state.items()}
        result = result.assign(readability(design, ("distance", "y", "x", "state"), at, base))
    own, sigma = (float(budget.independent.max()), budget.largest) if noise is None else (noise, noise)
    result = result.assign_attrs(noise=own).merge(ranges_of(result, sigma), combine_attrs="no_conflicts")
    stated = list(circuit.plate_errors(float(mean.mean())).values())
    if isinstance(target.body, FinitePlate):
        depths = target.body.thickness / target.body.material.skin_depth(float(band.nodes.max()))
        in_a_row = [part.reshape(-1, *part.shape[2:]) for part in (changes, *errors)]
        stated.append(PlateError(in_a_row[0], in_a_row[1], in_a_row[2], depths))
        of_L = sum(
            np.abs(by_state["effective_inductance"] - _moved(network, alone, _cases(band, changes + step), axes))
            for step in (np.copysign(errors[0].real, changes.real), 1j * np.copysign(errors[0].imag, changes.imag))
        )
        values = (of_L / base["effective_inductance"]).reshape(*axes.shape, -1)
        row = ("delta_error", ("distance", "y", "x", "state"), values, "1", "± δ by the plate's mesh and model")
        result = result.assign(variables(row))
    return result.assign_attrs(worst_attributes(stated))


def _moved(network: Network, alone: Sequence[Resonance], near: ChangeOverFrequency, axes: MapAxes) -> FloatArray:
    """Effective inductances of all states in H, (cases, states)."""
    return np.stack([_through_circuit(network, one, near, axes)["effective_inductance"] for one in alone], axis=-1)


def _around(frequencies: FloatArray) -> FrequencyBand:
    """Band of frequencies in Hz with a margin."""
    low, high = float(frequencies.min()), float(frequencies.max())
    margin = max(_MARGIN[0], _MARGIN[1] * math.log(high / low))
    return FrequencyBand(low * math.exp(-margin), high * math.exp(margin))


def _cases(band: FrequencyBand, values: ComplexArray) -> ChangeOverFrequency:
    """Take distances and places as cases.

    The shape is (…, …, nodes, n, n).
    """
    return ChangeOverFrequency(band, values.reshape(-1, *values.shape[2:]))


def _require_passive(network: Network, change: ComplexArray, axes: MapAxes) -> None:
    """Refuse changes that no passive body makes.

    The inductance matrix must stay positive definite.
    """
    least = np.linalg.eigvalsh(network.inductance + change.real)[..., 0]
    for distance, values in zip(axes.depth, least, strict=True):
        if not values.min() > 0:  # also rejects NaN
            raise MetalError(
                f"a target at {distance * 1e3:g} mm is too near for the model of its currents, which would make an "
                "inductance negative; begin at a greater distance."
            )


def _changes(
    design: Design,
    axes: MapAxes,
    frequencies: FloatArray,
    parts: str | Path | None,
    progress: Progress | None,
    fineness: float,
    accuracy: Accuracy = "full",
) -> ComplexArray:
    """ΔL − jΔR/ω in H at all distances and places.

    The shape is (3, distances, places, frequencies, coils, coils). Along the first axis are the change, its error, and
    the part of the mesh in this error. The errors are 0 for bodies other than plates.
    """
    target = target_of(design)
    places = axes.places + target.origin_point
    paths = [conductor.vertices for conductor in design.array.conductors()]
    metal = (target.body, places, frequencies, design.sheets, design.plates, paths, accuracy, fineness)
    keys = [content_key(*metal, float(distance)) for distance in axes.depth]
    found: dict[int, ComplexArray] = {}
    if parts is not None:
        store = Store(Path(parts))
        for k, key in enumerate(keys):
            part = store.get_dataset(key)
            if part is not None:
                found[k] = part.inductance.values - 1j * part.loss.values
    missing = [k for k in range(len(keys)) if k not in found]
    # A plate with an outline between layers is solved again at every distance. Otherwise the most costly part serves
    # all distances.
    magnetic = any(sheet.magnetic for sheet in design.sheets)
    apart = isinstance(target.body, FinitePlate) and (magnetic or bool(design.plates))
    blocks = [[k] for k in missing] if apart or not missing else [missing]
    for done, block in enumerate(blocks):

        def counted(within: int, total: int, done: int = done) -> None:
            if progress is not None:
                progress(100 * done + 100 * within // total, 100 * len(blocks))

        change, error = target_inductance(
            design.array, target, places, axes.depth[block].tolist(), frequencies, design.sheets, design.plates,
            accuracy=accuracy, fineness=fineness, progress=counted,
        )  # fmt: skip
        both = [np.zeros_like(change)] * 2 if error is None else [error.absolute, error.mesh]
        together = np.stack([change, *(part.reshape(change.shape) for part in both)])
        for k, values in zip(block, np.moveaxis(together, 1, 0), strict=True):
            found[k] = values
            if parts is not None:
                dims = ("value_or_error", "place", "frequency", "coil", "other")
                part = xr.Dataset({"inductance": (dims, values.real), "loss": (dims, -values.imag)})
                store.put_dataset(keys[k], part)
    return np.stack([found[k] for k in range(len(keys))], axis=1)


def _through_circuit(
    network: Network, alone: Resonance, near: ChangeOverFrequency, axes: MapAxes
) -> Mapping[str, FloatArray]:
    """Quantities of one state at all distances and places.

    Each has shape (cases,).
    """
    cases = int(np.prod(axes.shape))
    parts = []
    for start, stop in ranges(cases, cases_at_once(network)):

        def inductances(frequencies: FloatArray, cases: slice = slice(start, stop)) -> ComplexArray:
            return network.inductance + near.of_each(frequencies, cases)

        parts.append(changed_resonances(network, alone, inductances, stop - start))
    frequency, impedance, admittance = (np.concatenate(part) for part in zip(*parts, strict=True))
    with np.errstate(divide="ignore"):
        return {
            "frequency": frequency,
            "effective_inductance": 1 / ((2 * np.pi * frequency) ** 2 * alone.tank_capacitance),
            "effective_resistance": impedance.real,
            "quality_factor": impedance.imag / impedance.real,
            "parallel_resistance": 1 / admittance.real,
        }


def _dataset(
    design: Design,
    target: Target,
    axes: MapAxes,
    network: Network,
    by_state: Mapping[str, FloatArray],
    base: Mapping[str, FloatArray],
    middle: FloatArray,
    matrix: ComplexArray,
) -> xr.Dataset:
    """Assemble the dataset of `target_map`."""
    names = list(design.array.names)
    place, pair = ("distance", "y", "x"), ("coil", "other")
    with_target = network.inductance + matrix.real
    root = np.sqrt(np.diagonal(with_target, axis1=-2, axis2=-1))
    coupling = with_target / (root[:, :, None] * root[:, None, :])
    omega = 2 * np.pi * middle[:, None, None]
    L, L_0 = by_state["effective_inductance"], base["effective_inductance"]
    shape = (*axes.shape, len(names), len(names))
    beside_q = design.circuit.switches.beside_q
    quantities = [
        (name, unit, words + (beside_q if name == "quality_factor" else "")) for name, unit, words in _QUANTITIES
    ]
    rows = [
        ("delta", (*place, "state"), (L / L_0 - 1).reshape(*axes.shape, -1), "1", "δ"),
        ("base_inductance", ("state",), L_0, "H", "L_0 as the converter sees it"),
        *((name, (*place, "state"), by_state[name].reshape(*axes.shape, -1), unit, words)
          for name, unit, words in quantities),
        *((f"base_{name}", ("state",), base[name], unit, f"{words} without the target")
          for name, unit, words in quantities if name != "effective_inductance"),
        ("inductance_change", (*place, *pair), matrix.real.reshape(shape), "H", "inductance matrix, with less without"),
        ("resistance_change", (*place, *pair), (-omega * matrix.imag).reshape(shape), "ohm",
         "resistance matrix, with less without"),
        ("coupling", (*place, *pair), coupling.reshape(shape), "1", "coupling coefficient"),
        ("matrix_frequency", place, middle.reshape(axes.shape), "Hz", "frequency of the matrices"),
        ("inductance", pair, network.inductance, "H", "inductance matrix without the target"),
    ]  # fmt: skip
    return xr.Dataset(
        variables(*rows),
        coords={
            "distance": ("distance", axes.depth, {"units": "m", "long_name": "distance"}),
            **map_coordinates(
                target, axes.x, axes.y, [state.name for state in design.plan], names, design.array.centres
            ),
        },
        attrs={
            **provenance(design),
            "left_out": "; ".join((*network.left_out, *_LEFT_OUT)),
            "target": target.kind,
            "material": target.body.material.name,
            **origin_attributes(target),
        },
    )
