"""Response of every scan state to an indentation."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.circuit.coupling import design_circuit, design_inductance, provenance
from coilarray.circuit.network import Network, Resonance, cases_at_once, loaded_quality, resonate, resonators_near
from coilarray.circuit.noise_budget import NoiseBudget, budget_of
from coilarray.circuit.readability import RESONATOR, readability
from coilarray.circuit.state_sensitivity import StateSensitivity, state_sensitivity
from coilarray.compute.arrays import ComplexArray, FloatArray
from coilarray.compute.memory import require_memory
from coilarray.compute.netcdf import variables
from coilarray.compute.threads import Progress, part_of, ranges
from coilarray.design.model import Design, DesignFile, Indentation, design_of
from coilarray.design.scan_states import ScanState
from coilarray.elastomer.face_shift import shift_energy
from coilarray.elastomer.scattering import LayerMesh
from coilarray.electromagnetics.flat_stack import Backing
from coilarray.electromagnetics.source import Source
from coilarray.errors import ElastomerError, NetworkError
from coilarray.geometry import Conductor, Material
from coilarray.metal.backing import backings_of
from coilarray.metal.frequencies import ChangeOverFrequency, FrequencyBand
from coilarray.response.coordinates import ELLIPSE_WINDOW, map_coordinates, origin_attributes
from coilarray.response.dent_changes import changes_by_bounds, changes_by_dents, changes_by_levels
from coilarray.response.metal_share import Variable, check_metal, metal_attributes, metal_share, metal_variables
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

_Changed = Callable[[float], FloatArray | ComplexArray]  # ΔL − jΔR/ω in H, (depths, places, n, n), at a frequency in Hz


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
    inductance: Callable[[], FloatArray] | None = None,
    dielectric: bool = False,
    metal: bool = True,
    rest: float = 0.0,
    mesh: LayerMesh | None = None,
    parts: str | Path | None = None,
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
        Coils, switches and strays. Its inductance matrix is replaced. By default
        `coilarray.circuit.coupling.design_circuit`.
    ideal : bool
        Leave AC resistance and all strays out of the circuit, unless `network` is given.
    inductance : callable, optional
        Function that returns the inductance matrix in H under the flat sheets with their true thicknesses, for a matrix
        that is known or being computed elsewhere. Without `reach` it is called after the dents are solved. By default
        the matrix is computed with `coilarray.circuit.coupling.design_inductance`.
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
    mesh : LayerMesh, optional
        Accuracy of the magnetic problem.
    parts : str or Path, optional
        Folder for the finished parts of a map of all coils, so that an interrupted run goes on from there.
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
          ``origin_y`` place on the board (`coilarray.response.coordinates.on_board`).

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
        lost on a tilted sample, a `reach` outside its limits or together with `dielectric` or a material, and the
        errors of `indent` and `dent_inductance`.
    MetalError
        A `rest` below 0, plates above the sheets, and the errors of `ball_inductance` and
        `coilarray.metal.finite_plates.eddy_currents`.
    NetworkError
        A state without a resonance. With `reach` also a network with stray capacitances, and states and switches that
        `coilarray.circuit.state_sensitivity` does not treat.
    MemoryLimitError
        More values than fit into memory.
    OutputError
        A part that cannot be written.

    Notes
    -----
    Eq. 2 of Gast & Zimmermann (2020). Without `reach` every position is solved: contact, dented sheets, and the
    resonance of the whole circuit with the changed inductance matrix. With `reach` δ_a = Re(w_a i_aᵀ ΔL i_a) to first
    order in ΔL, with the currents of the whole flat board, see `coilarray.response.near`. With 1e-3, δ differs from a
    map of all coils by 8e-4 of the peak for gast2020, and by 3e-4 for 4 × 4 of its coils in a hexagonal lattice. For 16
    × 16 coils, with 38 states and 110 coils near, it differs by 9e-4 (benchmarks/large_response.py).

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
    true, mesh = imperfections or Imperfections(), mesh or LayerMesh()
    axes, coils = map_axes(design, depths, x, y), len(design.array.names)
    ball = indentation_of(design).ball if metal else None
    more = (_BYTES_OF_METAL if ball is not None else 0.0) + (_BYTES_OF_PLATES if design.plates else 0.0)
    error = _allowed_error(reach, axes, coils, dielectric=dielectric, metal=more > 0)
    _require_room(axes, coils, len(design.plan), error, more)
    check_metal(axes, ball, rest)
    pressed = experiment(design, axes, true)

    def flat_network() -> Network:
        L0 = design_inductance(pressed.design)[0] if inductance is None else inductance()
        L0 = L0 + wedge_inductance(pressed.design, true.tilt)
        return replace(design_circuit(pressed.design, ideal=ideal) if network is None else network, inductance=L0)

    flat = flat_network() if error or design.plates else None
    states = None if flat is None or not error else _sensitivity(flat, design.plan, required=reach != "auto")
    if flat is not None and states is not None:
        base = states.base_inductance
        budget, alone = _budget_of_states(pressed.design, flat, states)
        delta, cutoff = near_response(pressed, design.array.conductors(), states, error, mesh, progress=progress)
        delta += _shift_of_states(pressed, states, mesh)
        # The effect of dents on frequency and losses, some 1e-3, is left out of the readability here.
        changes: dict[str, Variable] = {} if ideal else _readability(design, flat, alone, alone, ())
        attributes: dict[str, object] = {
            "error_of_peak": error, "state_cutoff_m": cutoff.states, "coil_cutoff_m": cutoff.coils
        }  # fmt: skip
    else:
        _require_room(axes, coils, len(design.plan), 0.0)
        permittivity = design.circuit.elastomer_permittivity if dielectric else None
        backings = [] if flat is None else _backings(pressed, design.array, _band(flat, design.plan))
        cases = [changes_by_dents(pressed, permittivity, mesh, one, parts, part_of(progress, k, max(len(backings), 1)))
                 for k, one in enumerate(backings or [None])]  # fmt: skip
        change, _, capacitance_change = cases[0]
        flat = flat or flat_network()
        flats = [resonate(flat, state) for state in design.plan]
        changes, attributes = {}, {"error_of_peak": 0.0}
        changed = _at_any(change)
        if backings:
            over = ChangeOverFrequency(
                _band(flat, design.plan), np.stack([one - 1j * loss for one, loss, _ in cases], axis=2)
            )
            changed, mean = over.at, _mean_frequency(flat, design.plan)
            change = over.at(mean).real
            attributes |= {
                "plate_frequency_Hz": mean, "plate_lowest_Hz": over.band.low, "plate_highest_Hz": over.band.high
            }  # fmt: skip
            changes = _plate_variables(axes, over, mean)
        delta, sensors = _through_circuit(flat, flats, changed, capacitance_change)
        if ball is not None:
            frequency = _mean_frequency(flat, design.plan)
            share = metal_share(pressed, design.array, ball, frequency, rest, mesh)
            both, sensors = _through_circuit(flat, flats, _moved(changed, share), capacitance_change)
            changes |= metal_variables(axes, both - delta, share, frequency)
            attributes |= metal_attributes(ball, frequency, rest)
            delta, change = both, change + share.real
        if not ideal:
            changes |= _readability(design, flat, sensors, _sensors(flats), axes.shape)
        base = np.array([_converted(flat, one) for one in flats])
        budget = budget_of(design, [one.frequency for one in flats], [loaded_quality(flat, one) for one in flats])
        changes |= {
            "inductance_change": (
                ("depth", "y", "x", "coil", "other"), change.reshape(*axes.shape, coils, coils),
                {"units": "H", "long_name": "inductance matrix, dented minus flat"},
            ),
            "capacitance_change": (
                ("depth", "y", "x", "coil"), capacitance_change.reshape(*axes.shape, coils),
                {"units": "F", "long_name": "capacitance of each coil, dented minus flat"},
            ),
        }  # fmt: skip
    if pressed.correction is not None and indentation_of(design).unevenness.lifts:
        attributes["lifted_m"] = float(pressed.correction.lifted.max())
    drift = true.drift * axes.order("rows") + true.column_drift * axes.order("columns")
    delta = delta + drift[..., None]
    if true.noise:
        delta = _noisy(delta, true)
    return response_dataset(
        design, axes, pressed.contact, delta, base, flat.inductance,
        variables=changes | budget.variables(), attributes=attributes | {"noise": float(budget.independent.max())},
    )  # fmt: skip


def respond(
    design: Design,
    response: xr.Dataset,
    *,
    plan: Sequence[ScanState] | None = None,
    inductance_change: FloatArray | None = None,
    ideal: bool = False,
) -> xr.Dataset:
    """Put a computed map through the circuit again.

    The scan plan or the inductance changes may differ from the map's.

    Parameters
    ----------
    design : Design
        Design of the map.
    response : xarray.Dataset
        Response of all coils, from `response_map` without `reach`.
    plan : sequence of ScanState, optional
        States of the scan. By default the design's.
    inductance_change : ndarray, shape (depth, y, x, coil, other), optional
        Changes in H. By default the map's own.
    ideal : bool
        Leave out alternating-current resistance and all strays.

    Returns
    -------
    xarray.Dataset
        Response with the new plan or changes, without noise.

    Raises
    ------
    ElastomerError
        A response without inductance changes.
    NetworkError
        A state without a resonance, or a state that names an unknown coil.
    """
    if "inductance_change" not in response:
        raise ElastomerError("a response of only the near coils has no inductance changes; compute it with reach=None.")
    states = design.plan if plan is None else tuple(plan)
    change = response.inductance_change.values if inductance_change is None else inductance_change
    n = change.shape[-1]
    flat = change.reshape(change.shape[0], -1, n, n)
    capacitance_change = response.capacitance_change.values.reshape(*flat.shape[:3])
    network = replace(design_circuit(design, ideal=ideal), inductance=response.inductance.values)
    flats = [resonate(network, state) for state in states]
    lossy: FloatArray | ComplexArray = flat
    if "metal_resistance_change" in response:
        loss = response.metal_resistance_change.values.reshape(flat.shape)
        lossy = flat - 1j * loss / (2 * np.pi * response.attrs["metal_frequency_Hz"])
    changed = _at_any(lossy)
    if "plate_frequency" in response.dims:
        over = _over_frequency(response)
        changed = _moved(over.at, lossy - over.at(response.attrs["plate_frequency_Hz"]).real)
    delta, sensors = _through_circuit(network, flats, changed, capacitance_change)
    base = np.array([_converted(network, one) for one in flats])
    others = response.drop_dims("state")  # also the share of a material in δ
    others["inductance_change"] = (response.inductance_change.dims, change, response.inductance_change.attrs)
    others["delta"] = (("depth", "y", "x", "state"), delta.reshape(*change.shape[:3], -1), response.delta.attrs)
    if not ideal:
        others = others.assign(_readability(design, network, sensors, _sensors(flats), change.shape[:3]))
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
    mesh: LayerMesh | None = None,
) -> xr.Dataset:
    """Put an indenter with a material into a computed map.

    The map was computed without a material. The result is the response that it would have had.

    Parameters
    ----------
    design : Design
        Design of the map, with a hemisphere for an indenter.
    response : xarray.Dataset
        Response of all coils, from `response_map` without `reach` and without an indenter's material.
    material : Material
        Material of the indenter.
    imperfections : Imperfections, optional
        Imperfections of the map.
    rest, ideal, mesh
        As for `response_map`.

    Returns
    -------
    xarray.Dataset
        The response with the material included, as `response_map` returns it.

    Raises
    ------
    ElastomerError, DesignError, NetworkError, MetalError
        As `response_map` and `respond`.
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
    share = metal_share(pressed, design.array, ball, frequency, rest, mesh or LayerMesh())
    variables = metal_variables(axes, np.zeros((*share.shape[:2], response.sizes["state"])), share, frequency)
    whole = respond(
        design,
        response.assign(variables).assign_attrs(metal_attributes(ball, frequency, rest)),
        inductance_change=response.inductance_change.values + variables["metal_inductance_change"][1],
        ideal=ideal,
    )
    of_metal = (whole.delta - respond(design, response, ideal=ideal).delta).assign_attrs(variables["metal_delta"][2])
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
    """Compute the inductance changes of a map in H.

    They are given at every depth and position as dented minus flat, shape (depth, y, x, paths, paths). The paths are
    the design's coils by default, but may be any. With a `frequency` in Hz the material of the indenter counts, against
    the indenter just touching the sheets. Without a frequency it does not count. Plates count at the mean frequency of
    the states. Errors for a design, axes or a contact are as in `response_map`.
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
        band = _band(network, design.plan)
        over = _backings(pressed, source, band)
        if over:
            backings, shares = over, band.shares(np.array([_mean_frequency(network, design.plan)]))[0]
    for share, backing in zip(shares.tolist(), backings, strict=True):
        for levels in together(pressed.levels):
            part = changes_by_levels(source, levels, pressed.points, LayerMesh(), backing, progress)
            change += share * part.real
        change += share * changes_by_bounds(pressed, source, LayerMesh(), backing).real
    if ball is not None and frequency is not None:
        change += metal_share(pressed, source, ball, frequency, 0.0, LayerMesh()).real
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
    variables: Mapping[str, Variable] | None = None,
    attributes: Mapping[str, object] | None = None,
) -> xr.Dataset:
    """Assemble the dataset of a computed response.

    It holds δ (…, states) at the axes, for all coils and states or for the named. With `per_length` inductances are in
    H/m and forces in N/m. `variables` are additional variables: dimensions, values and attributes by name.
    """
    setup, per = indentation_of(design), "/m" if per_length else ""
    names = list(design.array.names if coils is None else coils)
    kept = [design.array.names.index(name) for name in names]
    states = [state.name for state in design.plan] if states is None else states
    return xr.Dataset(
        {
            "delta": (
                ("depth", "y", "x", "state"), delta.reshape(*axes.shape, -1),
                {"units": "1", "long_name": "relative change of inductance"},
            ),
            "base_inductance": ("state", base, {"units": f"H{per}", "long_name": "L_0 as the converter sees it"}),
            **(variables or {}),
            "inductance": (
                ("coil", "other"), inductance, {"units": f"H{per}", "long_name": "inductance matrix, flat sheets"}
            ),
            "force": ("depth", contact.force.values, {"units": f"N{per}", "long_name": "force on the indenter"}),
            "contact_radius": (
                "depth", contact.contact_radius.values, {"units": "m", "long_name": "contact radius or half width"}
            ),
        },
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
    )  # fmt: skip


def _ellipse_window(setup: Indentation, axes: MapAxes) -> dict[str, list[float]]:
    """Return the ellipse attribute of a design's own map.

    Some of the map's positions are for ellipses.
    """
    own = (tuple(axes.x.tolist()), tuple(axes.y.tolist())) == (setup.x, setup.y)
    return {ELLIPSE_WINDOW: list(setup.ellipse_bounds)} if own and setup.ellipse_bounds is not None else {}


def _allowed_error(reach: Reach, axes: MapAxes, coils: int, *, dielectric: bool, metal: bool) -> float:
    """Error of δ from near coils, relative to its peak.

    The error is the allowed maximum. It is 0 for every coil.
    """
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
    """Refuse a map that is too large before any computation.

    `more` are the bytes per value that metal takes.
    """
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


def _at_any(change: FloatArray | ComplexArray) -> _Changed:
    """Take a change as constant over frequency."""
    return lambda frequency: change


def _moved(changed: _Changed, by: FloatArray | ComplexArray) -> _Changed:
    """Add the same value to a change at all frequencies."""
    return lambda frequency: changed(frequency) + by


def _band(flat: Network, plan: Sequence[ScanState]) -> FrequencyBand:
    """Frequencies at which the states of a scan oscillate."""
    found = [resonate(flat, state).frequency for state in plan]
    return FrequencyBand(min(found), max(found), _OVER_FREQUENCY)


def _backings(pressed: Experiment, source: Source, band: FrequencyBand) -> list[Backing]:
    """Return the field that the plates send back.

    It is given at the nodes of a band. There is none without plates.
    """
    return backings_of(source, pressed.design.plates, band.nodes.tolist(), pressed.design.sheets)


def _plate_variables(axes: MapAxes, over: ChangeOverFrequency, mean: float) -> dict[str, Variable]:
    """Return the variables of the changes beside plates.

    These are the loss at the mean frequency, and both changes over frequency.
    """
    matrix = ("depth", "y", "x", "coil", "other")
    each, f = np.moveaxis(over.values, 2, 0), over.band.nodes
    shape = (*axes.shape, *each.shape[3:])
    losses = -2 * np.pi * f[:, None, None, None, None] * each.imag
    loss = {"units": "ohm", "long_name": "change of the eddy-current loss in the plates, dented minus flat"}
    return {
        "resistance_change": (matrix, -2 * np.pi * mean * over.at(mean).imag.reshape(shape), loss),
        "plate_frequency": (("plate_frequency",), f, {"units": "Hz", "long_name": "frequency"}),
        "plate_inductance_change": (
            ("plate_frequency", *matrix), each.real.reshape(len(f), *shape),
            {"units": "H", "long_name": "inductance matrix over frequency, dented minus flat"},
        ),
        "plate_resistance_change": (("plate_frequency", *matrix), losses.reshape(len(f), *shape), loss),
    }  # fmt: skip


def _over_frequency(response: xr.Dataset) -> ChangeOverFrequency:
    """Return the changes beside plates of a map.

    See `_plate_variables`.
    """
    f, L = response.plate_frequency.values, response.plate_inductance_change.values
    loss = response.plate_resistance_change.values / (2 * np.pi * f[:, None, None, None, None, None])
    low, high = (float(response.attrs[f"plate_{end}_Hz"]) for end in ("lowest", "highest"))
    values = np.moveaxis((L - 1j * loss).reshape(len(f), L.shape[1], -1, *L.shape[-2:]), 0, 2)
    return ChangeOverFrequency(FrequencyBand(low, high, _OVER_FREQUENCY), values)


def _mean_frequency(network: Network, plan: Sequence[ScanState]) -> float:
    """Mean frequency in Hz at which the scan states oscillate."""
    return float(np.mean([resonate(network, state).frequency for state in plan]))


def _shift_of_states(pressed: Experiment, states: StateSensitivity, mesh: LayerMesh) -> FloatArray | float:
    """Contribution to δ of a finite sample's sides and seat.

    It is added to δ of the dents and has shape (depths, places, states). It is 0 for a wide sample.
    """
    if pressed.correction is None:
        return 0.0
    design, origin, currents = pressed.design, indentation_of(pressed.design).origin_point, states.currents.T
    places = pressed.points - origin
    energy = shift_energy(design.array, design.sheets, pressed.correction, places, origin, mesh, currents, currents)
    return np.asarray((states.weights * energy).real)


def _converted(network: Network, flat: Resonance) -> float:
    """Inductance L_0 in H of a state for the converter."""
    return 1 / ((2 * np.pi * flat.frequency) ** 2 * network.switches.tank_capacitance)


def _through_circuit(
    network: Network, flats: Sequence[Resonance], changed: _Changed, capacitance_change: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Compute δ of every depth, place and state.

    It follows from the resonances of the states under flat sheets. `_sensors` of all are returned with it.
    """
    shape = capacitance_change.shape[:2]
    capacitances = network.winding_capacitance + capacitance_change.reshape(-1, len(network.names))
    delta, frequency, resistance = np.empty((3, *shape, len(flats)))
    for k, flat in enumerate(flats):
        inductances = network.inductance + changed(flat.frequency).reshape(-1, *network.inductance.shape)
        parts = []
        for start, stop in ranges(len(inductances), cases_at_once(network)):
            # The network itself comes first, so an unchanged network gives zero to the last digit.
            found, losses = resonators_near(
                network,
                flat,
                np.insert(inductances[start:stop], 0, network.inductance, axis=0),
                np.insert(capacitances[start:stop], 0, network.winding_capacitance, axis=0),
            )
            parts.append(((found[0] / found[1:]) ** 2 - 1, found[1:], losses[1:]))
        for values, part in zip((delta, frequency, resistance), zip(*parts, strict=True), strict=True):
            values[..., k] = np.concatenate(part).reshape(shape)
    return delta, np.stack((frequency, resistance))


def _sensors(flats: Sequence[Resonance]) -> FloatArray:
    """Frequencies in Hz and parallel resistances in Ω.

    The shape is (2, states).
    """
    return np.array([(one.frequency, one.parallel_resistance) for one in flats]).T


def _readability(
    design: Design, network: Network, sensors: FloatArray, flat: FloatArray, shape: tuple[int, ...]
) -> dict[str, Variable]:
    """Return the readability variables of a converter.

    They follow from `_sensors` at positions of a shape and of the flat board. Here Q = R_p/(ω L_eff) = ω C R_p, as in
    `Resonance`.
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
    """Solve the states of a scan.

    If a state measures several coils, raise a NetworkError, or return None unless required.
    """
    try:
        return state_sensitivity(network, plan)
    except NetworkError:
        if required:
            raise
        return None


def _budget_of_states(design: Design, network: Network, states: StateSensitivity) -> tuple[NoiseBudget, FloatArray]:
    """Noise budget with the losses of each state's own coil.

    `_sensors` with these losses are returned as well.
    """
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
