"""Response of every scan state to an indentation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.circuit.board_circuit import board_circuit
from coilarray.circuit.coupling import design_circuit, provenance
from coilarray.circuit.network import Network, Resonance, loaded_quality, resonate
from coilarray.circuit.noise_budget import NoiseBudget, budget_of
from coilarray.circuit.readability import RESONATOR, readability
from coilarray.circuit.state_sensitivity import StateSensitivity, state_sensitivity
from coilarray.compute.arrays import FloatArray
from coilarray.compute.memory import require_memory
from coilarray.compute.netcdf import variables
from coilarray.compute.store import not_kept
from coilarray.compute.threads import Progress
from coilarray.design.model import Design, DesignFile, Indentation, design_of
from coilarray.design.scan_states import ScanState
from coilarray.elastomer.face_shift import shift_energy
from coilarray.elastomer.scattering import LayerMesh
from coilarray.electromagnetics.flat_stack import Backing
from coilarray.errors import ElastomerError, NetworkError
from coilarray.geometry import Ball, Conductor, Material
from coilarray.metal.backing import backings_of
from coilarray.metal.frequencies import ChangeOverFrequency, FrequencyBand
from coilarray.response.changes import (
    Variable,
    changes_by_bounds,
    changes_by_levels,
    check_metal,
    constant_change,
    dent_changes,
    metal_attributes,
    metal_share,
    metal_variables,
    plus,
    through_circuit,
)
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

if TYPE_CHECKING:
    from coilarray.compute.store import Keep

__all__ = [
    "Imperfections",
    "Reach",
    "inductance_changes",
    "respond",
    "response_dataset",
    "response_map",
    "with_material",
]

Reach = float | Literal["auto"] | None
"""Coils that count at a position.

None counts all coils. A number is the allowed error of δ relative to its peak. "auto" chooses by the size of the map.
"""


_MOST_VALUES = 100_000_000  # of the inductance changes: 0.8 GB
_BYTES_A_VALUE = 24.0  # the change, the inductances for the circuit, and a copy on the way
_BYTES_OF_METAL = 80.0  # more with a metal indenter: complex changes, their copies, and two variables
_BYTES_OF_PLATES = 200.0  # more with plates: the same at some four frequencies
_ERRORS = (1e-4, 0.1)  # of the peak; the linear model leaves out up to 4e-5 (tests/response/test_near_response.py)
_AUTO_VALUES = 5_000_000  # of the inductance changes; above, "auto" leaves far coils out
_AUTO_ERROR = 1e-3
_OVER_FREQUENCY = 1e-4  # error of the change by dents beside plates between the computed frequencies

_PLACES = ("depth", "y", "x")


def response_map(
    design: Design | DesignFile,
    *,
    depths: npt.ArrayLike | None = None,
    x: npt.ArrayLike | None = None,
    y: npt.ArrayLike | None = None,
    reach: Reach = None,
    imperfections: Imperfections | None = None,
    network: Network | None = None,
    ideal: bool = False,
    dielectric: bool = False,
    metal: bool = True,
    rest: float = 0.0,
    accuracy: LayerMesh | None = None,
    keep: Keep | None = None,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Compute the sensor response matrix of a design.

    Parameters
    ----------
    design : Design or DesignFile
        Design with an indentation.
    depths, x, y : array_like, shape (n,), optional
        Depths and positions of the indenter in m, positions from the map's origin. By default those in the design. A
        depth below 0 is a height above the sheets, where only the material of an indenter counts.
    reach : float, "auto" or None
        Coils that count at a position. None: every coil, and the resonance of the whole circuit with all inductance
        changes. A number from 1e-4 to 0.1: only the coils near the indenter, out to a distance that keeps the error of
        δ below this part of its peak. The cost of a position then does not grow with the array. "auto": None up to 5
        million inductance changes (depths × positions × coils²), above that 1e-3, unless `dielectric` is set or the
        indenter has a material that counts.
    imperfections : Imperfections, optional
        Deviations of the experiment from the design. None by default.
    network : Network, optional
        Coils, switches and strays under the flat sheets with their true thicknesses. By default
        `coilarray.circuit.coupling.design_circuit`.
    ideal : bool
        Leave AC resistance and all strays out of the circuit, unless `network` is given.
    dielectric : bool
        Include the change of the coils' capacitance, which the converter takes for a change of L:
        `coilarray.elastomer.dielectric.dent_capacitance` with the design's permittivity. It is about 1e-7 of L, and
        needs every coil.
    metal : bool
        Count the eddy currents and the magnetisation of an indenter with a material,
        `coilarray.metal.indenter.indenter_inductance`, at the mean frequency of the states. It needs every coil.
    rest : float
        Height in m of an indenter with a material over the sheets while L_0 is read at the same position. At 0 it just
        touches them, as in a campaign. At inf it is far away.
    accuracy : LayerMesh, optional
        Accuracy of the magnetic problem.
    keep : callable, optional
        Keeps the finished parts of a map of all coils, so that an interrupted run goes on from there, for example
        ``coilarray.compute.store.Store(folder).dataset``.
    progress : callable, optional
        Called with (done, total) as the work goes on.

    Returns
    -------
    xarray.Dataset
        Dimensions ``depth``, ``y``, ``x``, ``state``, ``coil`` and ``other``. The variables are

        - ``delta`` (depth, y, x, state): (L_peak − L_0)/L_0 as the converter sees it, with L = 1/((2πf)² C),
        - ``base_inductance`` (state): L_0 in H,
        - ``inductance`` (coil, other): in H, with flat sheets,
        - ``force`` in N and ``contact_radius`` in m (depth),
        - ``coil_x`` and ``coil_y`` (coil): centres in m from the map's origin, which the attributes ``origin_x`` and
          ``origin_y`` place on the board (`coilarray.response.dataset.on_board`).

        With every coil also

        - ``inductance_change`` (depth, y, x, coil, other): in H, dented minus flat,
        - ``capacitance_change`` (depth, y, x, coil): in F, zero without `dielectric`.

        Unless `ideal`, and for a design with a converter, ``frequency`` in Hz, ``parallel_resistance`` in Ω and
        ``quality_factor`` (depth, y, x, state), and ``readable`` and the others of
        `coilarray.circuit.readability.readability`. With only near coils they hold for the flat board, over state.

        With an indenter whose material counts, ``delta`` and ``inductance_change`` include its effect, and

        - ``metal_delta``, ``metal_inductance_change`` in H and ``metal_resistance_change`` in Ω are the share of the
          material, relative to the indenter at rest,
        - the attributes ``indenter_material``, ``metal_frequency_Hz`` and ``rest_m`` give the material, the frequency
          of these shares and the height at rest.

        Beside plates

        - ``resistance_change`` (depth, y, x, coil, other): in Ω, the change of the losses in the plates by the dent.
          It and ``inductance_change`` hold at the mean frequency of the states, the attribute ``plate_frequency_Hz``.
        - ``plate_inductance_change`` and ``plate_resistance_change``: the same over ``plate_frequency`` in Hz.
          ``delta`` uses the values at the frequency of each state.

        Attributes: ``noise`` is the standard deviation of δ of a reading by the noise budget of the design, which is
        not in ``delta``. ``error_of_peak`` is the error that `reach` allows, 0 with every coil. With only near coils
        ``delta`` is 0 for states beyond ``state_cutoff_m``, and currents in coils beyond ``coil_cutoff_m`` are left
        out. ``lifted_m`` is the largest height by which a sample rises off a seat that it can leave.

    Raises
    ------
    ElastomerError
        A design without an indentation, grids that are not finite and rising, a contact that is outside the sample or
        lost on a tilted sample, a `reach` outside its limits or together with `dielectric` or a material.
    MetalError
        A `rest` below 0, or plates above the sheets.
    NetworkError
        A state without a resonance. With `reach` also a network with stray capacitances, and states and switches that
        `coilarray.circuit.state_sensitivity` does not treat.

    Notes
    -----
    Eq. 2 of Gast & Zimmermann (2020). Without `reach` every position is solved: contact, dented sheets, and the
    resonance of the whole circuit with the changed inductance matrix. With `reach` δ_a = Re(w_a i_aᵀ ΔL i_a) to first
    order in ΔL, with the currents of the whole flat board, see `coilarray.response.near`.

    Beside plates below the coils, every position includes the field of coils and dent that the plates send back. Their
    losses count in the resonance. For plates with an outline, only the field of the coils is included. The field of the
    dent is left out. It would change ΔL by up to 2 % if a dent comes within 1.4 mm of the plate.

    Examples
    --------
    >>> from coilarray import load_design
    >>> response = response_map(load_design("gast2020"), x=[-13.28e-3, 0], y=[0])
    >>> response.delta.dims, response.delta.shape
    (('depth', 'y', 'x', 'state'), (1, 1, 2, 6))
    """
    design = design_of(design)
    true, mesh = imperfections or Imperfections(), accuracy or LayerMesh()
    axes, coils = map_axes(design, depths, x, y), len(design.array.names)
    ball = indentation_of(design).ball if metal else None
    per_value = (_BYTES_OF_METAL if ball is not None else 0.0) + (_BYTES_OF_PLATES if design.plates else 0.0)
    error = _allowed_error(reach, axes, coils, dielectric=dielectric, metal=per_value > 0)
    _require_room(axes, coils, len(design.plan), error, per_value)
    check_metal(axes, ball, rest)
    pressed = experiment(design, axes, true)
    if network is None:
        circuit = board_circuit(pressed.design)
        network = circuit.ideal if ideal else circuit.network
    flat = replace(network, inductance=network.inductance + wedge_inductance(pressed.design, true.tilt))
    states = _sensitivity(flat, design.plan, required=reach != "auto") if error else None
    if states is not None:
        solved = _near_coils(pressed, flat, states, error, mesh, ideal=ideal, progress=progress)
    else:
        _require_room(axes, coils, len(design.plan), 0.0)
        permittivity = design.circuit.elastomer_permittivity if dielectric else None
        solved = _all_coils(
            pressed, flat, ball, permittivity, rest, mesh, ideal=ideal, keep=keep or not_kept, progress=progress
        )
    if pressed.correction is not None and indentation_of(design).unevenness.lifts:
        solved.attributes["lifted_m"] = float(pressed.correction.lifted.max())
    drift = true.drift * axes.order("rows") + true.column_drift * axes.order("columns")
    delta = solved.delta.reshape(*drift.shape, -1) + drift[..., None]
    if true.noise:
        delta = _noisy(delta, true)
    solved.attributes["noise"] = float(solved.budget.independent.max())
    more = solved.variables | solved.budget.variables()
    return response_dataset(
        design, axes, pressed.contact, delta, solved.base, flat.inductance, more=more, attributes=solved.attributes
    )


@dataclass(frozen=True, eq=False)
class _Solved:
    """δ of all depths, places and states, L_0 (states,) in H, the noise budget, and what else belongs to the map."""

    delta: FloatArray
    base: FloatArray
    budget: NoiseBudget
    variables: dict[str, Variable]
    attributes: dict[str, object]


def _near_coils(
    pressed: Experiment,
    flat: Network,
    states: StateSensitivity,
    error: float,
    mesh: LayerMesh,
    *,
    ideal: bool,
    progress: Progress | None,
) -> _Solved:
    """Compute a map with the coils near the indenter only."""
    design = pressed.design
    budget, alone = _budget_of_states(design, flat, states)
    delta, cutoff = near_response(pressed, design.array.conductors(), states, error, mesh, progress=progress)
    if pressed.correction is not None:
        origin, currents = indentation_of(design).origin_point, states.currents.T
        places = pressed.points - origin
        energy = shift_energy(design.array, design.sheets, pressed.correction, places, origin, mesh, currents, currents)
        delta = delta + (states.weights * energy).real
    # The effect of dents on frequency and losses, some 1e-3, is left out of the readability here.
    found = {} if ideal else _readability(design, flat, alone, alone, ())
    attributes: dict[str, object] = {
        "error_of_peak": error,
        "state_cutoff_m": cutoff.states,
        "coil_cutoff_m": cutoff.coils,
    }
    return _Solved(delta, states.base_inductance, budget, found, attributes)


def _all_coils(
    pressed: Experiment,
    flat: Network,
    ball: Ball | None,
    permittivity: float | None,
    rest: float,
    mesh: LayerMesh,
    *,
    ideal: bool,
    keep: Keep,
    progress: Progress | None,
) -> _Solved:
    """Compute a map with every coil, and the resonance of the whole circuit at every depth and place."""
    design, axes = pressed.design, pressed.axes
    flats = [resonate(flat, state) for state in design.plan]
    band, mean = _band(flats), _mean_frequency(flats)
    change, capacitance_change = dent_changes(pressed, band, permittivity, mesh, keep, progress)
    found: dict[str, Variable] = {}
    attributes: dict[str, object] = {"error_of_peak": 0.0}
    if change.band is band:
        attributes |= {"plate_frequency_Hz": mean, "plate_lowest_Hz": band.low, "plate_highest_Hz": band.high}
        found |= _plate_variables(axes, change, mean)
    answers = through_circuit(flat, flats, change, capacitance_change)
    if ball is not None:
        share = metal_share(pressed, design.array, ball, mean, rest, mesh)
        dented, change = answers["delta"], plus(change, share)
        answers = through_circuit(flat, flats, change, capacitance_change)
        found |= metal_variables(axes, answers["delta"] - dented, share, mean)
        attributes |= metal_attributes(ball, mean, rest)
    if not ideal:
        found |= _readability(design, flat, _sensors(answers), _sensors_of(flats), axes.shape)
    found |= _change_variables(axes, change.at(mean).real, capacitance_change)
    budget = budget_of(design, [one.frequency for one in flats], [loaded_quality(flat, one) for one in flats])
    base = np.array([one.effective_inductance for one in flats])
    return _Solved(answers["delta"], base, budget, found, attributes)


def respond(
    design: Design,
    response: xr.Dataset,
    *,
    plan: Sequence[ScanState] | None = None,
    inductance_change: FloatArray | None = None,
    ideal: bool = False,
) -> xr.Dataset:
    """Put a computed map of all coils through the circuit again, with another scan plan or other changes.

    `response` comes from `response_map` without `reach`. `inductance_change` (depth, y, x, coil, other) is in H. The
    result is without noise. A response without inductance changes raises an ElastomerError, a state without a resonance
    or of an unknown coil a NetworkError.
    """
    if "inductance_change" not in response:
        raise ElastomerError("a response of only the near coils has no inductance changes; compute it with reach=None.")
    states = design.plan if plan is None else tuple(plan)
    given = response.inductance_change.values if inductance_change is None else inductance_change
    shape, n = given.shape[:3], given.shape[-1]
    flat = given.reshape(-1, n, n)
    network = replace(design_circuit(design, ideal=ideal), inductance=response.inductance.values)
    flats = [resonate(network, state) for state in states]
    if "metal_resistance_change" in response:
        loss = response.metal_resistance_change.values.reshape(flat.shape)
        flat = flat - 1j * loss / (2 * np.pi * response.attrs["metal_frequency_Hz"])
    change = constant_change(flat)
    if "plate_frequency" in response.dims:
        over = _over_frequency(response)
        change = plus(over, flat - over.at(response.attrs["plate_frequency_Hz"]).real)
    answers = through_circuit(network, flats, change, response.capacitance_change.values.reshape(-1, n))
    others = response.drop_dims("state")  # also the share of a material in δ
    others["inductance_change"] = (response.inductance_change.dims, given, response.inductance_change.attrs)
    others["delta"] = ((*_PLACES, "state"), answers["delta"].reshape(*shape, -1), response.delta.attrs)
    if not ideal:
        others = others.assign(_readability(design, network, _sensors(answers), _sensors_of(flats), shape))
    base = np.array([one.effective_inductance for one in flats])
    others["base_inductance"] = ("state", base, response.base_inductance.attrs)
    others = others.assign_coords(state=[state.name for state in states])
    if "common_noise" in response and list(response.state.values) == [state.name for state in states]:
        others["common_noise"] = response.common_noise
    return others


def with_material(
    design: Design,
    response: xr.Dataset,
    material: Material,
    *,
    imperfections: Imperfections | None = None,
    rest: float = 0.0,
    ideal: bool = False,
    accuracy: LayerMesh | None = None,
) -> xr.Dataset:
    """Put an indenter with a material into a computed map of all coils without one.

    The design has a hemisphere for an indenter, and the imperfections are those of the map. The result is the response
    that the map would have had. Errors are as in `response_map` and `respond`.
    """
    if "metal_delta" in response:
        raise ElastomerError("the response has an indenter with a material already; compute it with metal=False.")
    solid = replace(design, indentation=replace(indentation_of(design), material=material))
    axes = map_axes(design, response.depth, response.x, response.y)
    ball = indentation_of(solid).ball
    check_metal(axes, ball, rest)
    assert ball is not None  # it has the material
    capacitance = design.circuit.switches.tank_capacitance
    frequency = float((1 / np.sqrt(response.base_inductance * capacitance)).mean()) / (2 * np.pi)
    pressed = experiment(solid, axes, imperfections)
    share = metal_share(pressed, design.array, ball, frequency, rest, accuracy or LayerMesh())
    found = metal_variables(axes, np.zeros((len(share), response.sizes["state"])), share, frequency)
    whole = respond(
        design,
        response.assign(found).assign_attrs(metal_attributes(ball, frequency, rest)),
        inductance_change=response.inductance_change.values + found["metal_inductance_change"][1],
        ideal=ideal,
    )
    of_metal = (whole.delta - respond(design, response, ideal=ideal).delta).assign_attrs(found["metal_delta"][2])
    delta = (response.delta + of_metal).assign_attrs(response.delta.attrs)  # noise and drift stay unchanged
    return whole.assign(delta=delta, metal_delta=of_metal)


def inductance_changes(
    design: Design,
    axes: MapAxes,
    *,
    paths: Sequence[Conductor] | None = None,
    imperfections: Imperfections | None = None,
    frequency: float | None = None,
    progress: Progress | None = None,
) -> FloatArray:
    """Compute the inductance changes (depth, y, x, paths, paths) of a map in H, dented minus flat.

    The paths are the design's coils by default, but may be any. With a `frequency` in Hz the material of the indenter
    counts, against the indenter just touching the sheets. Plates count at the mean frequency of the states. Errors for
    a design, axes or a contact are as in `response_map`.
    """
    ball = None if frequency is None else indentation_of(design).ball
    check_metal(axes, ball, 0.0)
    source = design.array.conductors() if paths is None else paths
    pressed = experiment(design, axes, imperfections)
    change = np.zeros((len(pressed.axes.depth), len(pressed.points), len(source), len(source)))
    backings: Sequence[Backing | None] = [None]
    shares = np.ones(1)
    if design.plates:
        network = design_circuit(design)
        flats = [resonate(network, state) for state in design.plan]
        band = _band(flats)
        over = backings_of(source, pressed.design.plates, band.nodes.tolist(), pressed.design.sheets)
        if over:
            backings, shares = over, band.shares(np.array([_mean_frequency(flats)]))[0]
    for share, backing in zip(shares.tolist(), backings, strict=True):
        for levels in together(pressed.levels):
            part = changes_by_levels(source, levels, pressed.points, LayerMesh(), backing, progress)
            change += share * part.real
        change += share * changes_by_bounds(pressed, source, LayerMesh(), backing).real
    if ball is not None and frequency is not None:
        change += metal_share(pressed, source, ball, frequency, 0.0, LayerMesh()).real.reshape(change.shape)
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
    more: dict[str, Variable] | None = None,
    attributes: Mapping[str, object] | None = None,
) -> xr.Dataset:
    """Assemble the dataset of a response δ (…, states) at the axes, for all coils and states or for the named.

    With `per_length` inductances are in H/m and forces in N/m. `more` are additional variables.
    """
    setup, per = indentation_of(design), "/m" if per_length else ""
    names = list(design.array.names if coils is None else coils)
    kept = [design.array.names.index(name) for name in names]
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
            **map_coordinates(setup, axes.x, axes.y, states, names, design.array.centres[kept]),
        },
        attrs={
            **provenance(design),
            "indenter": setup.indenter.name,
            "base": str(setup.base),
            "strain": setup.strain,
            **origin_attributes(setup),
            **_ellipse_window(setup, axes),
            **(attributes or {}),
        },
    )


def _ellipse_window(setup: Indentation, axes: MapAxes) -> dict[str, list[float]]:
    """Ellipse attribute of a design's own map, of which some positions are for ellipses."""
    own = (tuple(axes.x.tolist()), tuple(axes.y.tolist())) == (setup.x, setup.y)
    return {ELLIPSE_WINDOW: list(setup.ellipse_bounds)} if own and setup.ellipse_bounds is not None else {}


def _allowed_error(reach: Reach, axes: MapAxes, coils: int, *, dielectric: bool, metal: bool) -> float:
    """Return the allowed error of δ from near coils, relative to its peak, 0 for every coil."""
    if reach == "auto":
        return 0.0 if dielectric or metal or np.prod(axes.shape) * coils**2 <= _AUTO_VALUES else _AUTO_ERROR
    if reach is None:
        return 0.0
    if not (isinstance(reach, int | float) and _ERRORS[0] <= reach <= _ERRORS[1]):
        raise ElastomerError(
            f'reach must be None, "auto" or the error of δ, {_ERRORS[0]:g} to {_ERRORS[1]:g} of the peak; got {reach}.'
        )
    if dielectric:
        raise ElastomerError("the change of capacitance needs every coil: dielectric needs reach=None.")
    if metal:
        raise ElastomerError(
            "metal in the indenter or beside the coils needs every coil: use reach=None, or metal=False to leave out "
            "the indenter's material."
        )
    return reach


def _require_room(axes: MapAxes, coils: int, states: int, error: float, more: float = 0.0) -> None:
    """Refuse a map that is too large, with `more` bytes per value for metal."""
    depths, places = len(axes.depth), len(axes.x) * len(axes.y)
    what = f"{depths} depths at {places} positions with {coils} coils"
    if error:
        require_memory(8.0 * depths * places * states, f"a map of {what}", "compute it in pieces")
        return
    values = depths * places * coils**2
    if values > _MOST_VALUES:
        raise ElastomerError(
            f"{what} are {values} inductance changes; at most {_MOST_VALUES} are allowed: compute the map in pieces "
            "or with reach."
        )
    require_memory((_BYTES_A_VALUE + more) * values, f"a map of {what}", "compute it in pieces")


def _change_variables(axes: MapAxes, change: FloatArray, capacitance_change: FloatArray) -> dict[str, Variable]:
    """Return the variables of the changes of inductance (cases, n, n) in H and capacitance (cases, n) in F."""
    n = change.shape[-1]
    L, C = change.reshape(*axes.shape, n, n), capacitance_change.reshape(*axes.shape, n)
    return variables(
        ("inductance_change", (*_PLACES, "coil", "other"), L, "H", "inductance matrix, dented minus flat"),
        ("capacitance_change", (*_PLACES, "coil"), C, "F", "capacitance of each coil, dented minus flat"),
    )


def _band(flats: Sequence[Resonance]) -> FrequencyBand:
    """Frequencies at which the states of a scan oscillate."""
    found = [one.frequency for one in flats]
    return FrequencyBand(min(found), max(found), _OVER_FREQUENCY)


def _mean_frequency(flats: Sequence[Resonance]) -> float:
    """Mean frequency in Hz at which the scan states oscillate."""
    return float(np.mean([one.frequency for one in flats]))


def _plate_variables(axes: MapAxes, over: ChangeOverFrequency, mean: float) -> dict[str, Variable]:
    """Return the loss by plates at the mean frequency, and both changes over frequency."""
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


def _over_frequency(response: xr.Dataset) -> ChangeOverFrequency:
    """Return the changes beside plates of a map, the inverse of `_plate_variables`."""
    f, L = response.plate_frequency.values, response.plate_inductance_change.values
    loss = response.plate_resistance_change.values / (2 * np.pi * f[:, None, None, None, None, None])
    low, high = (float(response.attrs[f"plate_{end}_Hz"]) for end in ("lowest", "highest"))
    values = np.moveaxis((L - 1j * loss).reshape(len(f), -1, *L.shape[-2:]), 0, 1)
    return ChangeOverFrequency(FrequencyBand(low, high, _OVER_FREQUENCY), values)


def _sensors(answers: Mapping[str, FloatArray]) -> FloatArray:
    """Frequencies in Hz and parallel resistances in Ω, shape (2, cases, states)."""
    return np.stack((answers["frequency"], answers["parallel_resistance"]))


def _sensors_of(flats: Sequence[Resonance]) -> FloatArray:
    """Frequencies in Hz and parallel resistances in Ω, shape (2, states)."""
    return np.array([(one.frequency, one.parallel_resistance) for one in flats]).T


def _readability(
    design: Design, network: Network, sensors: FloatArray, flat: FloatArray, shape: tuple[int, ...]
) -> dict[str, Variable]:
    """Readability variables of a converter from `_sensors` at positions of a shape and of the flat board.

    Here Q = R_p/(ω L_eff) = ω C R_p, as in `Resonance`.
    """
    at, base = (
        dict(zip(RESONATOR, (f, R_p, 2 * np.pi * f * network.switches.tank_capacitance * R_p), strict=True))
        for f, R_p in (sensors.reshape(2, *shape, -1), flat)
    )
    over = ("depth", "y", "x", "state") if shape else ("state",)
    found = readability(design, over, at, base)
    rows = zip(RESONATOR, ("Hz", "ohm", "1"), strict=True)
    added = variables(*((name, over, at[name], unit, name.replace("_", " ")) for name, unit in rows))
    return {**found, **added} if found else {}


def _sensitivity(network: Network, plan: Sequence[ScanState], *, required: bool) -> StateSensitivity | None:
    """Solve the states of a scan, or return None if a state measures several coils and none are required."""
    try:
        return state_sensitivity(network, plan)
    except NetworkError:
        if required:
            raise
        return None


def _budget_of_states(design: Design, network: Network, states: StateSensitivity) -> tuple[NoiseBudget, FloatArray]:
    """Noise budget with the losses of each state's own coil, and `_sensors` with these losses."""
    L = states.base_inductance
    frequency = 1 / (2 * np.pi * np.sqrt(L * network.switches.tank_capacitance))
    resistance = np.diagonal(network.resistance(float(frequency.mean())))[states.measured]
    with np.errstate(divide="ignore"):
        quality = 2 * np.pi * frequency * L / (resistance + 2 * network.switches.on_resistance)
    sensors = np.stack((frequency, 2 * np.pi * frequency * L * quality))
    return budget_of(design, frequency, quality), sensors


def _noisy(delta: FloatArray, imperfections: Imperfections) -> FloatArray:
    random = np.random.default_rng(imperfections.seed)
    peak, base = (1 + imperfections.noise * random.standard_normal(delta.shape) for _ in range(2))
    return (1 + delta) * peak / base - 1
