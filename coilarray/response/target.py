"""Response of all states to a moving target, and range."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
import numpy.typing as npt
import xarray as xr
from scipy.interpolate import make_interp_spline

from coilarray.circuit.board_circuit import board_circuit
from coilarray.circuit.converter_limits import readability, readable_of
from coilarray.circuit.coupling import provenance
from coilarray.circuit.network import Network, loaded_quality, resonate
from coilarray.circuit.noise_budget import budget_of
from coilarray.compute.arrays import ComplexArray, FloatArray
from coilarray.compute.memory import require_memory
from coilarray.compute.netcdf import variables
from coilarray.compute.store import Keep, not_kept
from coilarray.compute.threads import Progress, part_of
from coilarray.design.model import Design, DesignFile, design_of
from coilarray.electromagnetics.field import Source, as_conductors
from coilarray.electromagnetics.inductance import Accuracy
from coilarray.errors import MetalError, require_positive
from coilarray.geometry import Ball, FinitePlate, Plate, Sheet, Target
from coilarray.metal.backing import require_below
from coilarray.metal.ball import target_inductance
from coilarray.metal.finite_plates import PlateError, worst_attributes
from coilarray.metal.frequencies import ChangeOverFrequency, FrequencyBand
from coilarray.response.changes import through_circuit
from coilarray.response.dataset import map_coordinates, origin_attributes
from coilarray.response.setup import MapAxes, checked_axis, target_of

_MARGIN = (0.02, 0.2)  # margin of the band of log f: a minimum, and a part of its width
_MOST_NODES = 16  # of bands up to a factor of fifty
_BYTES_A_VALUE = 48.0  # a complex number as computed, and as the circuit takes it
_COARSE = 0.5  # fraction of the mesh fineness with which the band of the resonances is guessed
_LEFT_OUT = ("change of the losses in the copper by the target", "capacitance of the target")
_QUANTITIES = (
    ("frequency", "Hz", "resonance frequency"),
    ("effective_inductance", "H", "effective inductance"),
    ("effective_resistance", "ohm", "effective resistance"),
    ("quality_factor", "1", "quality factor"),
    ("parallel_resistance", "ohm", "parallel resistance"),
)
STEPS = (1e-6, 1e-5, 1e-4)
"""Changes of distance in m for which the farthest distance is given at which they are resolved."""
FACTOR = 3.0  # fewest standard deviations of a single reading in |δ| for a target's detection
_FINE = 4001  # distances between the first and the last


def with_target_as_plate(design: Design, place: tuple[float, float], distance: float) -> Design:
    """Return a design with its target as a plate."""
    target = target_of(design)
    height = target.height(design.top, distance)
    if isinstance(target.body, Plate):
        body: Plate | FinitePlate = replace(target.body, z=height)
    elif isinstance(target.body, FinitePlate):
        body = replace(target.body, centre=(*place, height))
    else:
        raise MetalError(f"B beside a sphere is not computed; the target of {design.name} is one: leave it out.")
    return replace(design, plates=(*design.plates, body), target=None)


def target_map(
    design: Design | DesignFile,
    *,
    distances: npt.ArrayLike | None = None,
    x: npt.ArrayLike | None = None,
    y: npt.ArrayLike | None = None,
    noise: float | None = None,
    network: Network | Literal["ideal"] | None = None,
    accuracy: Accuracy | float = "full",
    keep: Keep = not_kept,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Compute the response of the coils to a target.

    Parameters
    ----------
    design : Design or DesignFile
        Design with a target.
    distances, x, y : array_like, shape (n,), optional
        Distances of the target's nearest point from the upper face of the sheets or the board, and
        places of its centre, in m, places from the map's origin. By default given in the design.
    noise : float, optional
        Standard deviation of δ in a reading, for range and resolution, by default from the noise
        budget, `coilarray.circuit.noise_budget.NoiseBudget.largest`. It is the attribute ``sigma``,
        ``noise`` is the part that is independent from state to state, ``common_noise`` the rest.
    network : Network or "ideal", optional
        Coils, switches and strays without the target, by default of the design. "ideal" leaves AC
        resistance of the copper and all strays out.
    accuracy : {"full", "screen"} or float
        Accuracy of the target's changes and of the network, see `coilarray.inductance_matrix`. A
        given network keeps its own. A number is the fineness of the mesh of a plate with an
        outline: 2 halves the lengths of 1 and takes eight times as long.
    keep : callable
        Keeps finished distances for a map that goes on, for example
        ``coilarray.compute.store.Store(folder).dataset``: each one for a plate with an outline over
        magnetic sheets or beside plates, else all at once.
    progress : callable, optional
        Called with (done, total) as the work goes on.

    Returns
    -------
    xarray.Dataset
        Dimensions ``distance``, ``y``, ``x``, ``state``, ``coil`` and ``other``. Over (distance, y,
        x, state), each at the resonance with the target:

        - ``delta``: (L − L_0)/L_0 as the converter sees it, with L = 1/((2πf)² C),
        - ``frequency`` in Hz, ``effective_inductance`` in H, ``effective_resistance`` and
          ``parallel_resistance`` in Ω,
        - ``quality_factor`` of the coils without the tank.

        Over (state), the variables that begin with ``base_``: the same without the target. Over
        (distance, y, x, coil, other), at ``matrix_frequency`` (distance, y, x), the mean of the
        states' resonances there: ``inductance_change`` in H and ``resistance_change`` in Ω of the
        matrix of the coils, and ``coupling``, the coupling coefficients with the target.

        Unless `network` is "ideal", and for a design with a converter, ``readable`` and the others
        of `coilarray.circuit.converter_limits.readability` give the states that it can read, and the
        drive current.

        ``inductance`` (coil, other) is the matrix in H without the target. The ranges and
        resolutions are from `ranges_of`. ``coil_x`` and ``coil_y`` are the centres in m from the
        map's origin, which the attributes ``origin_x`` and ``origin_y`` place on the board.

        With plates that have an outline, the attributes ``plate_error_inductance`` and
        ``plate_error_resistance`` are the relative errors of ΔL and ΔR by mesh and model, the
        largest of all plates, and ``plate_skin_depths`` is the thickness of that plate in skin
        depths. For a target with an outline, ``delta_error`` (distance, y, x, state) is the error
        of δ due to them, see `coilarray.metal.finite_plates.moving_plate`.

    Raises
    ------
    MetalError
        A design without a target, axes that are not finite and rising, or a distance that is not
        positive or too small.
    NetworkError
        A state without a resonance, also with the target.

    Notes
    -----
    ΔL − jΔR/ω of the target is computed at a few frequencies of the band in which all resonances
    lie. Every place and distance is solved in the whole circuit at its own resonance. The losses in
    the copper are computed without the target, and the target has no capacitance to the coils. The
    attribute ``left_out`` lists these effects and the effects that the network lacks.
    """
    design = design_of(design)
    target = target_of(design)
    if noise is not None:
        require_positive("noise", noise, "", MetalError)
    fineness, rule = (1.0, accuracy) if isinstance(accuracy, str) else (accuracy, "full")
    require_positive("fineness of a mesh", fineness, "")
    if isinstance(target.body, Ball):
        require_below(design.plates, "a sphere")
    given = (("distances", distances, target.distances), ("x", x, target.x), ("y", y, target.y))
    axes = MapAxes(*(checked_axis(name, own if values is None else values, MetalError) for name, values, own in given))
    if axes.depth[0] <= 0:
        raise MetalError(f"distances of a target must be above zero; got {axes.depth[0] * 1e3:g} mm.")
    coils, cases = len(design.coil_names), int(np.prod(axes.shape))
    what = f"{len(axes.depth)} distances at {len(axes.x) * len(axes.y)} places with {coils} coils"
    require_memory(_BYTES_A_VALUE * cases * _MOST_NODES * coils**2, f"a target map of {what}", "compute it in pieces")
    circuit, ideal = board_circuit(design, accuracy=rule), network == "ideal"
    if not isinstance(network, Network):
        network = circuit.ideal if ideal else circuit.network
    bodies = design.paths, target, design.sheets, design.plates
    alone = [resonate(network, state) for state in design.plan]
    base = {name: np.array([getattr(one, name) for one in alone]) for name, _, _ in _QUANTITIES}
    resonances = base["frequency"]
    nearest, middle = replace(axes, depth=axes.depth[:1]), float(np.exp(np.log(resonances).mean()))
    at_middle = FrequencyBand(middle, middle)
    first = target_changes(*bodies, nearest, at_middle.nodes, "screen", _COARSE * fineness, keep)[0]
    _require_passive(network, first, nearest)
    guess = through_circuit(network, alone, _in_a_row(at_middle, first), at_own_frequency=True)
    moved = guess["frequency"]
    for _ in range(2):  # the guess holds for a single frequency
        known = np.append(moved, resonances)
        low, high = float(known.min()), float(known.max())
        margin = max(_MARGIN[0], _MARGIN[1] * math.log(high / low))
        band = FrequencyBand(low * math.exp(-margin), high * math.exp(margin))
        changes, *errors = target_changes(*bodies, axes, band.nodes, rule, fineness, keep, progress)
        _require_passive(network, changes, axes)
        change, network = _in_a_row(band, changes), circuit.widened(network, band.low, band.high)
        answers = through_circuit(network, alone, change, at_own_frequency=True)
        moved = answers["frequency"]
        if band.holds(moved):
            break
    else:
        raise MetalError(
            f"a target at {axes.depth[0] * 1e3:g} mm moves a resonance to {moved.min():.6g} to {moved.max():.6g} Hz; "
            f"it is computed from {band.low:.6g} to {band.high:.6g} Hz. Begin at a greater distance."
        )
    mean = moved.mean(axis=-1)
    result = _dataset(design, target, axes, network, answers, base, mean, change.of_each(mean))
    budget = budget_of(design, resonances, [loaded_quality(network, one) for one in alone])
    over = ("distance", "y", "x", "state")
    if noise is None:
        result = result.assign(budget.variables())
    if not ideal:
        at = {name: values.reshape(*axes.shape, -1) for name, values in answers.items()}
        result = result.assign(readability(design, over, at, base))
    own, sigma = (float(budget.independent.max()), budget.largest) if noise is None else (noise, noise)
    result = result.assign_attrs(noise=own).merge(ranges_of(result, sigma), combine_attrs="no_conflicts")
    stated = list(circuit.plate_errors(float(mean.mean())).values())
    if isinstance(target.body, FinitePlate):
        depths = target.body.thickness / target.body.material.skin_depth(float(band.nodes.max()))
        flat = [part.reshape(-1, *part.shape[2:]) for part in (changes, *errors)]
        stated.append(PlateError(flat[0], flat[1], flat[2], depths))
        steps = (np.copysign(errors[0].real, changes.real), 1j * np.copysign(errors[0].imag, changes.imag))
        of_L = np.zeros_like(moved)
        for step in steps:
            wrong = through_circuit(network, alone, _in_a_row(band, changes + step), at_own_frequency=True)
            of_L += np.abs(answers["effective_inductance"] - wrong["effective_inductance"])
        values = (of_L / base["effective_inductance"]).reshape(*axes.shape, -1)
        result = result.assign(variables(("delta_error", over, values, "1", "± δ by the plate's mesh and model")))
    return result.assign_attrs(worst_attributes(stated))


def _in_a_row(band: FrequencyBand, values: ComplexArray) -> ChangeOverFrequency:
    return ChangeOverFrequency(band, values.reshape(-1, *values.shape[2:]))


def _require_passive(network: Network, change: ComplexArray, axes: MapAxes) -> None:
    """Refuse changes that leave no positive definite inductance matrix."""
    least = np.linalg.eigvalsh(network.inductance + change.real)[..., 0]
    for distance, values in zip(axes.depth, least, strict=True):
        if not values.min() > 0:  # also rejects NaN
            raise MetalError(
                f"a target at {distance * 1e3:g} mm is too near for the model of its currents, which would make an "
                "inductance negative; begin at a greater distance."
            )


def _dataset(
    design: Design,
    target: Target,
    axes: MapAxes,
    network: Network,
    answers: Mapping[str, FloatArray],
    base: Mapping[str, FloatArray],
    middle: FloatArray,
    matrix: ComplexArray,
) -> xr.Dataset:
    names = list(design.coil_names)
    place, pair = ("distance", "y", "x"), ("coil", "other")
    with_target = network.inductance + matrix.real
    root = np.sqrt(np.diagonal(with_target, axis1=-2, axis2=-1))
    coupling = with_target / (root[:, :, None] * root[:, None, :])
    omega = 2 * np.pi * middle[:, None, None]
    shape = (*axes.shape, len(names), len(names))
    beside_q = design.circuit.switches.beside_q
    quantities = [
        (name, unit, words + (beside_q if name == "quality_factor" else "")) for name, unit, words in _QUANTITIES
    ]
    rows = [
        ("delta", (*place, "state"), answers["delta"].reshape(*axes.shape, -1), "1", "δ"),
        ("base_inductance", ("state",), base["effective_inductance"], "H", "L_0 as the converter sees it"),
        *((name, (*place, "state"), answers[name].reshape(*axes.shape, -1), unit, words)
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
                target, axes.x, axes.y, [state.name for state in design.plan], names, design.centres[:, :2]
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


def ranges_of(response: xr.Dataset, noise: float) -> xr.Dataset:
    """Find range and resolution of every state.

    The place is where |δ| is the largest at the least distance. `noise` is the standard deviation σ
    of δ in a reading. ``distance_deviation`` (distance, state) is σ/|δ'| in m. ``range`` (state) is
    the distance in m at which |δ| has fallen to `FACTOR` σ, and ``resolved_distance`` (step, state)
    the distance up to which a ``step`` in m is no less than the standard deviation. Both are NaN if
    this holds nowhere, and the last distance if it holds everywhere.

    Distances that the converter cannot read at the place do not count. Between the distances ln |δ|
    is a cubic spline, as δ falls about exponentially. If δ changes its sign, δ itself is the
    spline.
    """
    require_positive("noise", noise, "", MetalError)
    distance = response.distance.values
    delta = response.delta.transpose("distance", "state", "y", "x").values
    seen = readable_of(response).transpose("distance", "state", "y", "x").values
    states = delta.shape[1]
    deviation = np.full((len(distance), states), np.nan)
    nearest = np.full(states, np.nan)
    found, least = np.full((1 + len(STEPS), states), np.nan), np.zeros((1 + len(STEPS), states), dtype=np.bool_)
    rows, columns = np.zeros((2, states), dtype=np.intp)
    for s in range(states):
        at, read = delta[:, s].reshape(len(distance), -1), seen[:, s].reshape(len(distance), -1)
        counted = read.any(axis=0) if read.any() else ~read.any(axis=0)
        best = int(np.where(counted, np.abs(at[read.any(axis=1).argmax()]), -1.0).argmax())
        rows[s], columns[s] = np.unravel_index(best, delta.shape[2:])
        if not read[:, best].any():
            continue
        first = int(read[:, best].argmax())
        last = first + int(np.append(~read[first:, best], True).argmax())
        d = distance[first:last]
        nearest[s] = d[0]
        fine = np.geomspace(d[0], d[-1], _FINE) if len(d) > 1 else d
        curve, slope = _curve(d, at[first:last, best], fine)
        margins = [np.abs(curve) / (FACTOR * noise)]
        if len(d) > 1:
            with np.errstate(divide="ignore"):
                deviation[first:last, s] = noise / np.abs(_curve(d, at[first:last, best], d)[1])
            margins += [np.abs(slope) * step / noise for step in STEPS]
        for k, margin in enumerate(margins):  # up to which it is 1 or more
            below = np.flatnonzero(margin < 1)
            if not len(below):
                found[k, s], least[k, s] = fine[-1], last == len(distance)
            elif (end := int(below[0])) > 0:
                share = (margin[end - 1] - 1) / (margin[end - 1] - margin[end])
                found[k, s] = fine[end - 1] + share * (fine[end] - fine[end - 1])
    rows_of = (
        ("best_x", ("state",), response.x.values[columns], "m", "x where |δ| is the largest"),
        ("best_y", ("state",), response.y.values[rows], "m", "y where |δ| is the largest"),
        ("distance_deviation", ("distance", "state"), deviation, "m", "± distance"),
        ("nearest_readable", ("state",), nearest, "m", "least distance that the converter reads"),
        ("range", ("state",), found[0], "m", f"distance at which |δ| is {FACTOR:g} times the noise"),
        ("range_is_least", ("state",), least[0], "", "whether the range is longer"),
        ("resolved_distance", ("step", "state"), found[1:], "m", "distance up to which a step is resolved"),
        ("resolved_is_least", ("step", "state"), least[1:], "", "whether it is longer"),
    )
    step = ("step", np.array(STEPS), {"units": "m", "long_name": "change of distance"})
    return xr.Dataset(variables(*rows_of), coords={"step": step}, attrs={"sigma": noise, "range_factor": FACTOR})


def _curve(distance: FloatArray, delta: FloatArray, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """δ and its slope at distances, from δ at some others."""
    degree = min(3, len(distance) - 1)
    one_sign = bool((delta > 0).all() or (delta < 0).all())
    spline = make_interp_spline(distance, np.log(np.abs(delta)) if one_sign else delta, k=degree)
    values, slopes = spline(at), spline.derivative()(at) if degree else np.zeros_like(at)
    if one_sign:
        values = np.sign(delta[0]) * np.exp(values)
        slopes = values * slopes
    return values, slopes


def target_changes(
    source: Source,
    target: Target,
    sheets: Sequence[Sheet],
    plates: Sequence[Plate | FinitePlate],
    axes: MapAxes,
    frequencies: FloatArray,
    accuracy: Accuracy,
    fineness: float,
    keep: Keep,
    progress: Progress | None = None,
) -> ComplexArray:
    """Compute ΔL − jΔR/ω in H of a target.

    The shape is (3, distances, places, frequencies, coils, coils): the change, its error, and the
    part of the mesh in this error. The errors are 0 for bodies other than plates.
    """
    places = axes.places + target.origin_point
    # Only a plate with an outline between layers is solved again at every distance.
    apart = isinstance(target.body, FinitePlate) and (bool(plates) or any(sheet.magnetic for sheet in sheets))
    distances = axes.depth.tolist()
    blocks = [[one] for one in distances] if apart else [distances]
    paths = [conductor.vertices for conductor in as_conductors(source)]
    found = []
    for number, block in enumerate(blocks):

        def compute(number: int = number, block: list[float] = block) -> xr.Dataset:
            change, error = target_inductance(
                source, target, places, block, frequencies, sheets, plates,
                accuracy=accuracy, fineness=fineness, progress=part_of(progress, number, len(blocks)),
            )  # fmt: skip
            errors = [np.zeros_like(change)] * 2 if error is None else [error.absolute, error.mesh]
            values = np.stack([change, *(part.reshape(change.shape) for part in errors)])
            dims = ("value_or_error", "distance", "place", "frequency", "coil", "other")
            return xr.Dataset({"inductance": (dims, values.real), "loss": (dims, -values.imag)})

        inputs = (target.body, places, frequencies, sheets, plates, paths, accuracy, fineness, block)
        part = keep(("target", *inputs), compute)
        found.append(part.inductance.values - 1j * part.loss.values)
    return np.concatenate(found, axis=1)
