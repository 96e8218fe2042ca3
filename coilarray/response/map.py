"""Response of every scan state to an indentation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.circuit.board_circuit import board_circuit
from coilarray.circuit.converter_limits import RESONATOR, readability
from coilarray.circuit.coupling import design_circuit, provenance
from coilarray.circuit.network import Network, Resonance, loaded_quality, resonate
from coilarray.circuit.noise_budget import NoiseBudget, budget_of
from coilarray.circuit.state_sensitivity import StateSensitivity, state_sensitivity
from coilarray.compute.arrays import FloatArray
from coilarray.compute.memory import require_memory
from coilarray.compute.netcdf import variables
from coilarray.compute.store import Keep, not_kept
from coilarray.compute.threads import Progress
from coilarray.design.model import Design, DesignFile, design_of
from coilarray.design.scan_states import ScanState
from coilarray.elastomer.finite_sample import shift_energy
from coilarray.elastomer.scattering import LayerMesh
from coilarray.electromagnetics.flat_stack import Backing
from coilarray.errors import ElastomerError, NetworkError
from coilarray.geometry import Conductor
from coilarray.metal.backing import backings_of
from coilarray.metal.frequencies import ChangeOverFrequency, FrequencyBand
from coilarray.response import changes
from coilarray.response.dataset import ELLIPSE_WINDOW, map_coordinates, origin_attributes
from coilarray.response.near import near_response
from coilarray.response.setup import (
    Experiment,
    Imperfections,
    MapAxes,
    experiment,
    indentation_of,
    map_axes,
    together,
    wedge_inductance,
)

__all__ = ["Imperfections", "MapAccuracy", "Reach", "inductance_changes", "respond", "response_dataset", "response_map"]

Reach = float | Literal["auto"] | None  # coils that count at a position, see `response_map`
_MOST_VALUES = 100_000_000  # of the inductance changes: 0.8 GB
_BYTES_A_VALUE = 24.0  # the change, the inductances for the circuit, and a copy on the way
_BYTES_OF_METAL = 80.0  # more with a metal indenter: complex changes, their copies, and two variables
_BYTES_OF_PLATES = 200.0  # more with plates: the same at some four frequencies
LEAST_ERROR, LARGEST_ERROR = 1e-4, 0.1
"""Errors of δ that may leave out far coils, relative to the peak. The linear model leaves out 4e-5."""
_AUTO_VALUES = 5_000_000  # of the inductance changes. Above, "auto" leaves far coils out
_AUTO_ERROR = 1e-3
_OVER_FREQUENCY = 1e-4  # error of the change by dents beside plates between the computed frequencies

_PLACES = ("depth", "y", "x")
_Solved = tuple[FloatArray, FloatArray, NoiseBudget, dict[str, changes.Variable], dict[str, object]]
"""δ of all states, L_0 (states,) in H, the noise budget, and more variables and attributes."""


@dataclass(frozen=True)
class MapAccuracy:
    """Accuracy of a map: coils that count, and the mesh."""

    reach: Reach = None
    mesh: LayerMesh | None = None


def response_map(
    design: Design | DesignFile,
    *,
    depths: npt.ArrayLike | None = None,
    x: npt.ArrayLike | None = None,
    y: npt.ArrayLike | None = None,
    imperfections: Imperfections | None = None,
    accuracy: MapAccuracy | Reach = None,
    keep: Keep = not_kept,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Compute the sensor response matrix of a design.

    Parameters
    ----------
    design : Design or DesignFile
        Design with an indentation. Its plates and the material of its indenter count.
    depths, x, y : array_like, shape (n,), optional
        Depths and positions in m from the map's origin, by default of the design. A depth below 0
        is a height above the sheets, where only the material of an indenter counts.
    imperfections : Imperfections, optional
        Deviations of the experiment from the design, its circuit included.
    accuracy : float, "auto", MapAccuracy or None
        Coils that count at a position. None: every coil, with the resonance of the whole circuit. A
        number from 1e-4 to 0.1: only the coils near the indenter, to a distance that keeps the
        error of δ below this part of its peak, so that the cost of a position does not grow with
        the array. "auto": None up to 5 million inductance changes (depths × positions × coils²),
        above that 1e-3, unless the indenter has a material or there are plates. A `MapAccuracy`
        holds such a value and the mesh of the magnetic problem.
    keep : callable
        Keeps the finished parts of a map of all coils for a run that goes on, for example
        ``coilarray.compute.store.Store(folder).dataset``.
    progress : callable, optional
        Called with (done, total) as the work goes on.

    Returns
    -------
    xarray.Dataset
        Dimensions ``depth``, ``y``, ``x``, ``state``, ``coil`` and ``other``. The variables are

        - ``delta`` (depth, y, x, state): (L_peak − L_0)/L_0 as the converter sees it, with L =
          1/((2πf)² C), and ``base_inductance`` (state): L_0 in H,
        - ``inductance`` (coil, other) in H with flat sheets and, with every coil,
          ``inductance_change`` (depth, y, x, coil, other) in H, dented minus flat,
        - ``force`` in N and ``contact_radius`` in m (depth),
        - ``coil_x`` and ``coil_y`` (coil): centres in m from the map's origin, which the attributes
          ``origin_x`` and ``origin_y`` place on the board (`coilarray.response.dataset.on_board`).

        Unless the circuit is ideal, and for a design with a converter, ``frequency`` in Hz,
        ``parallel_resistance`` in Ω and ``quality_factor`` (depth, y, x, state), and ``readable``
        and the others of `coilarray.circuit.converter_limits.readability`. With only near coils they
        hold for the flat board, over state.

        With an indenter whose material counts, ``delta`` and ``inductance_change`` include its
        effect. ``metal_delta``, ``metal_inductance_change`` in H and ``metal_resistance_change`` in
        Ω are its share relative to the indenter at rest. The attributes ``indenter_material``,
        ``metal_frequency_Hz`` and ``rest_m`` give material, frequency and height at rest.

        Beside plates ``resistance_change`` (depth, y, x, coil, other) in Ω is the change of their
        losses by the dent. It and ``inductance_change`` hold at the mean frequency of the states,
        ``plate_frequency_Hz``. ``plate_inductance_change`` and ``plate_resistance_change`` are the
        same over ``plate_frequency`` in Hz, of which ``delta`` uses the frequency of each state.

        Attributes: ``noise`` is the standard deviation of δ of a reading by the noise budget of the
        design, which is not in ``delta``. ``error_of_peak`` is the error that `accuracy` allows, 0
        with every coil. With only near coils ``delta`` is 0 for states beyond ``state_cutoff_m``,
        and currents in coils beyond ``coil_cutoff_m`` are left out. ``lifted_m`` is the largest
        height by which a sample rises off a seat that it can leave.

    Raises
    ------
    ElastomerError
        A design without an indentation, grids that are not finite and rising, a contact outside the
        sample or lost on a tilted sample, an `accuracy` outside its limits or a number with metal.
    MetalError
        Plates above the sheets.
    NetworkError
        A state without a resonance. With a number as `accuracy` also stray capacitances, and states
        and switches that `coilarray.circuit.state_sensitivity` does not treat.

    Notes
    -----
    Eq. 2 of Gast & Zimmermann (2020). With near coils δ_a = Re(w_a i_aᵀ ΔL i_a) to first order in
    ΔL, with the currents of the whole flat board, see `coilarray.response.near`.

    The eddy currents and the magnetisation of an indenter with a material count at the mean
    frequency of the states. Plates below the coils send the field of coils and dent back, and their
    losses count in the resonance. Plates with an outline send back the field of the coils only. The
    change of the coils' capacitance by the elastomer that a dent moves is left out.
    `coilarray.scan_design` has a bound of it.

    Examples
    --------
    >>> from coilarray import load_design
    >>> response = response_map(load_design("gast2020"), x=[-13.28e-3, 0], y=[0])
    >>> response.delta.dims, response.delta.shape
    (('depth', 'y', 'x', 'state'), (1, 1, 2, 6))
    """
    given = design_of(design)
    setup, true = indentation_of(given), imperfections or Imperfections()
    if not isinstance(accuracy, MapAccuracy):
        accuracy = MapAccuracy(accuracy)
    axes, coils, mesh = map_axes(given, depths, x, y), len(given.coil_names), accuracy.mesh or LayerMesh()
    metal = (_BYTES_OF_METAL if setup.ball is not None else 0.0) + (_BYTES_OF_PLATES if given.plates else 0.0)
    error = _allowed_error(accuracy.reach, axes, coils, metal=metal > 0)
    _require_room(axes, coils, len(given.plan), error, metal)
    changes.check_metal(axes, setup.ball)
    pressed = experiment(setup, given.sheets, axes, true)
    design = replace(given, sheets=pressed.sheets)
    network, ideal = true.network, true.network == "ideal"
    if not isinstance(network, Network):
        network = board_circuit(design).ideal if ideal else board_circuit(design).network
    if any(true.tilt):
        wedge = wedge_inductance(board_circuit(design), pressed.origin, true.tilt)
        network = replace(network, inductance=network.inductance + wedge)
    states = None
    if error:
        try:
            states = state_sensitivity(network, design.plan)
        except NetworkError:  # a state that measures several coils
            if accuracy.reach != "auto":
                raise
    given_to_both = (design, pressed, network, mesh)
    if states is not None:
        solved = _near_coils(*given_to_both, states=states, error=error, ideal=ideal, progress=progress)
    else:
        _require_room(axes, coils, len(design.plan), 0.0)
        solved = _all_coils(*given_to_both, rest=true.rest, keep=keep, ideal=ideal, progress=progress)
    delta, base, budget, found, attributes = solved
    if pressed.correction is not None and setup.unevenness.lifts:
        attributes["lifted_m"] = float(pressed.correction.lifted.max())
    drift = true.drift * axes.order("rows") + true.column_drift * axes.order("columns")
    delta = delta.reshape(*drift.shape, -1) + drift[..., None]
    if true.noise:
        random = np.random.default_rng(true.seed)
        peak, at_rest = (1 + true.noise * random.standard_normal(delta.shape) for _ in range(2))
        delta = (1 + delta) * peak / at_rest - 1
    attributes["noise"] = float(budget.independent.max())
    more = found | budget.variables()
    return response_dataset(
        given, axes, pressed.contact, delta, base, network.inductance, more=more, attributes=attributes
    )


def _near_coils(
    design: Design,
    pressed: Experiment,
    network: Network,
    mesh: LayerMesh,
    *,
    states: StateSensitivity,
    error: float,
    ideal: bool,
    progress: Progress | None,
) -> _Solved:
    # Each state has the losses of its own coil here.
    C, resistance = network.switches.tank_capacitance, network.resistance
    frequency = 1 / (2 * np.pi * np.sqrt(states.base_inductance * C))
    own = np.diagonal(resistance(float(frequency.mean())))[states.measured]
    with np.errstate(divide="ignore"):
        quality = 2 * np.pi * frequency * states.base_inductance / (own + 2 * network.switches.on_resistance)
    delta, cutoff = near_response(pressed, design.conductors(), states, error, mesh, progress=progress)
    if pressed.correction is not None:
        origin, currents = pressed.origin, states.currents.T
        places = pressed.points - origin
        energy = shift_energy(
            design.paths, pressed.sheets, pressed.correction, places, origin, mesh, currents, currents
        )
        delta = delta + (states.weights * energy).real
    # The effect of dents on frequency and losses, some 1e-3, is left out of the readability here.
    R_p = 2 * np.pi * frequency * states.base_inductance * quality
    alone = {"frequency": frequency, "parallel_resistance": R_p}
    found = {} if ideal else _readability(design, network, alone, alone, ())
    attributes: dict[str, object] = {
        "error_of_peak": error,
        "state_cutoff_m": cutoff.states,
        "coil_cutoff_m": cutoff.coils,
    }
    return delta, states.base_inductance, budget_of(design, frequency, quality), found, attributes


def _all_coils(
    design: Design,
    pressed: Experiment,
    network: Network,
    mesh: LayerMesh,
    *,
    rest: float,
    keep: Keep,
    ideal: bool,
    progress: Progress | None,
) -> _Solved:
    axes, ball = pressed.axes, indentation_of(design).ball
    flats = [resonate(network, state) for state in design.plan]
    band, mean = _band(flats)
    change = changes.dent_changes(design.paths, design.plates, pressed, band, mesh, keep, progress)
    found: dict[str, changes.Variable] = {}
    attributes: dict[str, object] = {"error_of_peak": 0.0}
    if change.band is band:
        attributes |= {"plate_frequency_Hz": mean, "plate_lowest_Hz": band.low, "plate_highest_Hz": band.high}
        found |= _plate_variables(axes, change, mean)
    answers = changes.through_circuit(network, flats, change)
    if ball is not None:
        share = changes.metal_share(design.paths, design.plates, pressed, ball, mean, rest, mesh)
        dented, change = answers["delta"], changes.plus(change, share)
        answers = changes.through_circuit(network, flats, change)
        values, matrix = share.reshape(*axes.shape, *share.shape[1:]), (*_PLACES, "coil", "other")
        found |= variables(
            ("metal_delta", (*_PLACES, "state"), (answers["delta"] - dented).reshape(*axes.shape, -1), "1",
             "share of the indenter's material in delta"),
            ("metal_inductance_change", matrix, values.real, "H", "share of the indenter's material"),
            ("metal_resistance_change", matrix, -2 * np.pi * mean * values.imag, "ohm",
             "eddy-current loss in the indenter"),
        )  # fmt: skip
        attributes |= {"metal_frequency_Hz": mean, "rest_m": rest, "indenter_material": ball.material.name}
    if not ideal:
        found |= _readability(design, network, answers, _sensors_of(flats), axes.shape)
    n = len(network.names)
    found |= variables(
        ("inductance_change", (*_PLACES, "coil", "other"), change.at(mean).real.reshape(*axes.shape, n, n), "H",
         "inductance matrix, dented minus flat"),
    )  # fmt: skip
    budget = budget_of(design, [one.frequency for one in flats], [loaded_quality(network, one) for one in flats])
    return answers["delta"], np.array([one.effective_inductance for one in flats]), budget, found, attributes


def respond(
    design: Design,
    response: xr.Dataset,
    *,
    plan: Sequence[ScanState] | None = None,
    inductance_change: FloatArray | None = None,
    ideal: bool = False,
) -> xr.Dataset:
    """Put a map of all coils through the circuit again.

    `inductance_change` (depth, y, x, coil, other) is in H. The result is without noise. A response
    without inductance changes raises an ElastomerError.
    """
    if "inductance_change" not in response:
        raise ElastomerError("a response of only the near coils has no inductance changes; compute it with every coil.")
    states = design.plan if plan is None else tuple(plan)
    given = response.inductance_change.values if inductance_change is None else inductance_change
    shape, n = given.shape[:3], given.shape[-1]
    flat = given.reshape(-1, n, n)
    network = replace(design_circuit(design, ideal=ideal), inductance=response.inductance.values)
    flats = [resonate(network, state) for state in states]
    if "metal_resistance_change" in response:
        loss = response.metal_resistance_change.values.reshape(flat.shape)
        flat = flat - 1j * loss / (2 * np.pi * response.attrs["metal_frequency_Hz"])
    change = changes.constant_change(flat)
    if "plate_frequency" in response.dims:
        f, L = response.plate_frequency.values, response.plate_inductance_change.values
        loss = response.plate_resistance_change.values / (2 * np.pi * f[:, None, None, None, None, None])
        low, high = (float(response.attrs[f"plate_{end}_Hz"]) for end in ("lowest", "highest"))
        values = np.moveaxis((L - 1j * loss).reshape(len(f), -1, n, n), 0, 1)
        over = ChangeOverFrequency(FrequencyBand(low, high, _OVER_FREQUENCY), values)
        change = changes.plus(over, flat - over.at(response.attrs["plate_frequency_Hz"]).real)
    answers = changes.through_circuit(network, flats, change)
    others = response.drop_dims("state")  # also the share of a material in δ
    others["inductance_change"] = (response.inductance_change.dims, given, response.inductance_change.attrs)
    others["delta"] = ((*_PLACES, "state"), answers["delta"].reshape(*shape, -1), response.delta.attrs)
    if not ideal:
        others = others.assign(_readability(design, network, answers, _sensors_of(flats), shape))
    base = np.array([one.effective_inductance for one in flats])
    others["base_inductance"] = ("state", base, response.base_inductance.attrs)
    others = others.assign_coords(state=[state.name for state in states])
    if "common_noise" in response and list(response.state.values) == [state.name for state in states]:
        others["common_noise"] = response.common_noise
    return others


def inductance_changes(
    design: Design,
    axes: MapAxes,
    *,
    paths: Sequence[Conductor] | None = None,
    imperfections: Imperfections | None = None,
    frequency: float | None = None,
    progress: Progress | None = None,
) -> FloatArray:
    """Compute the changes (depth, y, x, paths, paths) in H.

    They are dented minus flat, for the design's coils by default. With a `frequency` in Hz the
    material of the indenter counts, against the indenter just touching the sheets.
    """
    ball = None if frequency is None else indentation_of(design).ball
    changes.check_metal(axes, ball)
    source = design.conductors() if paths is None else paths
    pressed = experiment(indentation_of(design), design.sheets, axes, imperfections)
    change = np.zeros((len(pressed.axes.depth), len(pressed.points), len(source), len(source)))
    backings: Sequence[Backing | None] = [None]
    shares = np.ones(1)
    if design.plates:
        network = design_circuit(design)
        band, mean = _band([resonate(network, state) for state in design.plan])
        over, _ = backings_of(source, design.plates, band.nodes.tolist(), pressed.sheets)
        if over:
            backings, shares = over, band.shares(np.array([mean]))[0]
    for share, backing in zip(shares.tolist(), backings, strict=True):
        for levels in together(pressed.levels):
            part = changes.changes_by_levels(source, levels, pressed.points, LayerMesh(), backing, progress)
            change += share * part.real
        change += share * changes.changes_by_bounds(pressed, source, LayerMesh(), backing).real
    if ball is not None and frequency is not None:
        by_metal = changes.metal_share(source, design.plates, pressed, ball, frequency, 0.0, LayerMesh())
        change += by_metal.real.reshape(change.shape)
    return change.reshape(*axes.shape, len(source), len(source))


def response_dataset(
    design: Design,
    axes: MapAxes,
    contact: xr.Dataset,
    delta: FloatArray,
    base: FloatArray,
    inductance: FloatArray,
    *,
    coils: Sequence[str] | None = None,
    states: Sequence[str] | None = None,
    per_length: bool = False,
    more: dict[str, changes.Variable] | None = None,
    attributes: Mapping[str, object] | None = None,
) -> xr.Dataset:
    """Assemble a response δ (…, states), in H or `per_length`."""
    setup, per = indentation_of(design), "/m" if per_length else ""
    own = (tuple(axes.x.tolist()), tuple(axes.y.tolist())) == (setup.x, setup.y)
    window = {ELLIPSE_WINDOW: list(setup.ellipse_bounds)} if own and setup.ellipse_bounds is not None else {}
    names = list(design.coil_names if coils is None else coils)
    kept = [design.coil_names.index(name) for name in names]
    states = [state.name for state in design.plan] if states is None else states
    state, pair = ("state",), ("coil", "other")
    rows = (
        ("delta", (*_PLACES, "state"), delta.reshape(*axes.shape, -1), "1", "relative change of inductance"),
        ("base_inductance", state, base, f"H{per}", "L_0 as the converter sees it"),
        ("inductance", pair, inductance, f"H{per}", "inductance matrix, flat sheets"),
        ("force", ("depth",), contact.force.values, f"N{per}", "force on the indenter"),
        ("contact_radius", ("depth",), contact.contact_radius.values, "m", "contact radius or half width"),
    )
    return xr.Dataset(
        variables(*rows[:2]) | (more or {}) | variables(*rows[2:]),
        coords={
            "depth": ("depth", axes.depth, {"units": "m", "long_name": "depth of the indentation"}),
            **map_coordinates(setup, axes.x, axes.y, states, names, design.centres[kept, :2]),
        },
        attrs={
            **provenance(design),
            "indenter": setup.indenter.name,
            "base": str(setup.base),
            "strain": setup.strain,
            **origin_attributes(setup),
            **window,
            **(attributes or {}),
        },
    )


def _allowed_error(reach: Reach, axes: MapAxes, coils: int, *, metal: bool) -> float:
    if reach == "auto":
        return 0.0 if metal or np.prod(axes.shape) * coils**2 <= _AUTO_VALUES else _AUTO_ERROR
    if reach is None:
        return 0.0
    if not (isinstance(reach, int | float) and LEAST_ERROR <= reach <= LARGEST_ERROR):
        raise ElastomerError(
            f'accuracy must be None, "auto" or the error of δ, {LEAST_ERROR:g} to {LARGEST_ERROR:g} of the peak; '
            f"got {reach}."
        )
    if metal:
        raise ElastomerError(
            "metal in the indenter or beside the coils needs every coil: use accuracy=None, or an indenter without a "
            "material."
        )
    return reach


def _require_room(axes: MapAxes, coils: int, states: int, error: float, more: float = 0.0) -> None:
    depths, places = len(axes.depth), len(axes.x) * len(axes.y)
    what = f"{depths} depths at {places} positions with {coils} coils"
    if error:
        require_memory(8.0 * depths * places * states, f"a map of {what}", "compute it in pieces")
        return
    values = depths * places * coils**2
    if values > _MOST_VALUES:
        raise ElastomerError(
            f"{what} are {values} inductance changes; at most {_MOST_VALUES} are allowed: compute the map in pieces "
            "or with near coils only."
        )
    require_memory((_BYTES_A_VALUE + more) * values, f"a map of {what}", "compute it in pieces")


def _band(flats: Sequence[Resonance]) -> tuple[FrequencyBand, float]:
    """Frequencies at which the states of a scan oscillate, and their mean in Hz."""
    found = [one.frequency for one in flats]
    return FrequencyBand(min(found), max(found), _OVER_FREQUENCY), float(np.mean(found))


def _plate_variables(axes: MapAxes, over: ChangeOverFrequency, mean: float) -> dict[str, changes.Variable]:
    matrix, f = (*_PLACES, "coil", "other"), over.band.nodes
    each = np.moveaxis(over.values, 1, 0)
    shape = (*axes.shape, *each.shape[2:])
    losses = -2 * np.pi * f[:, None, None, None] * each.imag
    loss = "change of the eddy-current loss in the plates, dented minus flat"
    over_f = ("plate_frequency", *matrix)
    return variables(
        ("resistance_change", matrix, -2 * np.pi * mean * over.at(mean).imag.reshape(shape), "ohm", loss),
        ("plate_frequency", ("plate_frequency",), f, "Hz", "frequency"),
        ("plate_inductance_change", over_f, each.real.reshape(len(f), *shape), "H",
         "inductance matrix over frequency, dented minus flat"),
        ("plate_resistance_change", over_f, losses.reshape(len(f), *shape), "ohm", loss),
    )  # fmt: skip


def _sensors_of(flats: Sequence[Resonance]) -> dict[str, FloatArray]:
    return {name: np.array([getattr(one, name) for one in flats]) for name in ("frequency", "parallel_resistance")}


def _readability(
    design: Design,
    network: Network,
    answers: Mapping[str, FloatArray],
    flat: Mapping[str, FloatArray],
    shape: tuple[int, ...],
) -> dict[str, changes.Variable]:
    """Readability at positions and for the flat board.

    Here Q = R_p/(ω L_eff) = ω C R_p, as in `Resonance`.
    """
    values, C = [], network.switches.tank_capacitance
    for of, to in ((answers, (*shape, -1)), (flat, (-1,))):
        f, R_p = of["frequency"].reshape(to), of["parallel_resistance"].reshape(to)
        values.append(dict(zip(RESONATOR, (f, R_p, 2 * np.pi * f * C * R_p), strict=True)))
    at, base = values
    over = ("depth", "y", "x", "state") if shape else ("state",)
    found = readability(design, over, at, base)
    rows = zip(RESONATOR, ("Hz", "ohm", "1"), strict=True)
    added = variables(*((name, over, at[name], unit, name.replace("_", " ")) for name, unit in rows))
    return {**found, **added} if found else {}
