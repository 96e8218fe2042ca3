"""Network of a design: its coupling, resonances, impedance and fields."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from importlib import metadata
from itertools import combinations
from typing import Literal

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.circuit.board_circuit import BoardCircuit, bare_network, board_circuit
from coilarray.circuit.converter_limits import RESONATOR, readability
from coilarray.circuit.network import (
    Network,
    StateResult,
    checked_network,
    impedances,
    loaded_quality,
    resonate,
    self_resonance_of,
    solve_state,
)
from coilarray.circuit.state_sensitivity import resonances
from coilarray.compute.arrays import ComplexArray, FloatArray
from coilarray.compute.memory import require_memory
from coilarray.compute.netcdf import variables
from coilarray.compute.store import kept_dataset
from coilarray.compute.threads import Progress, part_of, serial_algebra
from coilarray.design.model import Design, DesignFile, design_of, digest_of
from coilarray.design.scan_states import PARTS, ScanState, Switches
from coilarray.electromagnetics.capacitance import elastomer_effect, self_resonance
from coilarray.electromagnetics.field import grid_points, magnetic_field
from coilarray.electromagnetics.inductance import Accuracy, coupling_matrix
from coilarray.errors import GeometryError, MetalError, NetworkError, require_finite
from coilarray.geometry import FinitePlate, Plate
from coilarray.geometry.conductor import CurrentPaths
from coilarray.metal.flat_plates import plate_field

Termination = Literal["short", "open"]  # termination of a passive coil: ``"short"`` to ground, or ``"open"``
CLOSE_CHANNELS = 0.03  # relative frequency distance below which channels that are active together pull each other
# Search of resonances without the tank beside plates: samples around the last guess, and rounds.
_AROUND, _SAMPLES, _ROUNDS = 0.15, 5, 4
_SWEPT, _SHOWN_BELOW, _BEYOND = (0.1, 4.0), 10.0, 1.25  # frequencies of a sweep, see `sweep_range`
_TOWARDS = np.geomspace(0.02, 0.3, 14)  # relative distances from a self-resonance at which a curve gets more points
_BYTES_A_RESISTANCE = 24.0  # per entry and frequency: as computed, as interpolated, and as copied on the way


def design_circuit(design: Design | DesignFile, *, ideal: bool = False, accuracy: Accuracy = "full") -> Network:
    """Make the network of a design's coils, switches and tank.

    If `ideal`, the alternating-current resistance of the copper, the capacitance of the windings
    and all strays of the switches are left out. The effect of plates remains, including their
    losses. The `accuracy` of the inductance matrix is that of `coilarray.inductance_matrix`.

    The ``left_out`` of the network lists the effects that it lacks. The resistance matrix is
    interpolated around the resonances of the `design`'s scan plan, and a state of it without a
    resonance raises a NetworkError. A second call for the same design costs nothing. If a coil has
    no turns beside each other, and so no capacitance model, the network has no winding capacitance.
    In an array of more than 24 coils the losses of a coil's field in the copper of other coils (1 %
    of its resistance in gast2020) are left out.

    >>> from coilarray import load_design
    >>> from coilarray.circuit.network import resonate
    >>> design = load_design("gast2020")
    >>> ideal = resonate(design_circuit(design, ideal=True), design.plan[0])
    >>> round(ideal.effective_inductance * 1e6, 2), round(ideal.frequency / 1e6, 3)
    (92.5, 1.511)
    """
    circuit = board_circuit(design, accuracy=accuracy)
    return circuit.ideal if ideal else circuit.network


def design_inductance(design: Design | DesignFile, *, accuracy: Accuracy = "full") -> tuple[FloatArray, FloatArray]:
    """Return the inductance matrix, at the working frequency of plates, and its sheets' part in H."""
    circuit = board_circuit(design, accuracy=accuracy)
    return circuit.inductance.copy(), circuit.windings.by_sheets.copy()


def couple_design(
    design: Design | DesignFile | CurrentPaths, *, ideal: bool = False, progress: Progress | None = None
) -> xr.Dataset:
    """Compute the coupling of a design.

    Parameters
    ----------
    design : Design, DesignFile, Array, Coil or Spiral
        Design of the board. Coils alone have the usual circuit.
    ideal : bool
        Leave out alternating-current resistance of the copper and all strays, see `design_circuit`.
    progress : callable, optional
        Called with (done, total) as the work goes on.

    Returns
    -------
    xarray.Dataset
        The variables of `couple`, under the flat sheets and as the converter sees them. Over (coil)
        also ``ideal_effective_inductance`` in H and ``ideal_frequency`` in Hz, the same with the
        direct-current resistance of the copper and without strays, and the centres ``x`` and ``y``,
        of a bent board also ``z``, in m. ``sheet_inductance`` (coil, other) in H is the part due to
        the magnetic sheets.

        With plates, ``plate_inductance`` in H and ``plate_resistance`` in Ω (coil, other) are their
        contribution at the attribute ``working_frequency_Hz``, for which inductance and coupling
        then hold. Of plates with an outline, the attributes ``plate_error_inductance`` and
        ``plate_error_resistance`` are relative errors of ΔL and ΔR by mesh and model, and
        ``plate_skin_depths`` is the thickness in skin depths. A coil or a state of the scan plan
        without a resonance raises a NetworkError.

    Examples
    --------
    >>> from coilarray import load_design
    >>> result = couple_design(load_design("gast2020"), ideal=True)
    >>> round(float(result.open_inductance[0]) * 1e6, 1), round(float(result.coupling[0, 1]), 3)
    (93.1, 0.08)
    """
    design = design_of(design)
    circuit = board_circuit(design, progress=progress)
    network = circuit.ideal if ideal else circuit.network
    result = _coupled(network, design.coils_in_turn, terminations_of(design), circuit.direct_resistance)
    without = resonances(circuit.ideal, design.coils_in_turn)
    single, array = ("coil",), design.array
    centres = array.centres if array.form is None and not design.boards else design.centres
    meaning = "ideal: direct-current copper, no strays"
    L, f = np.array([(one.effective_inductance, one.frequency) for one in without]).T
    rows = [
        ("ideal_effective_inductance", single, L, "H", f"effective inductance, {meaning}"),
        ("ideal_frequency", single, f, "Hz", f"resonance frequency, {meaning}"),
        ("sheet_inductance", ("coil", "other"), circuit.windings.by_sheets, "H", "inductance due to the sheets"),
    ]
    places = [
        (axis, single, at, "m", f"centre of the coil, {axis}") for axis, at in zip("xyz", centres.T, strict=False)
    ]
    if (plates := circuit.plates) is not None:
        rows += [
            ("plate_inductance", ("coil", "other"), plates.inductance, "H", "inductance due to the plates"),
            ("plate_resistance", ("coil", "other"), plates.resistance, "ohm", "resistance due to the plates"),
        ]
        result = result.assign_attrs(working_frequency_Hz=plates.working)
    result = result.assign(variables(*rows)).assign_coords(variables(*places))
    return result.assign_attrs({**provenance(design), **circuit.plate_error_attributes})


def terminations_of(design: Design) -> list[str]:
    """Return the termination of each coil that is not measured."""
    return ["short" if passive == "ground" else passive for passive in design.terminations.values()]


def provenance(design: Design) -> dict[str, str]:
    """Return the design, hash and version of a result."""
    return {"design": design.name, "design_hash": design.digest, "coilarray_version": metadata.version("coilarray")}


def couple(
    names: Sequence[str],
    inductance: npt.ArrayLike,
    resistance: npt.ArrayLike,
    capacitance: float,
    terminations: Sequence[Termination] | None = None,
    short_resistance: float = 0.0,
) -> xr.Dataset:
    """Solve R and L matrices, each coil active in turn.

    The coils have `names`. The inductance matrix (n, n) is in H, the resistance (n,) or scalar in Ω
    at all frequencies, the capacitance of the tank in F. The `terminations` are "short", by
    default, or "open". `short_resistance` in Ω is of the two switches that ground a coil. The
    measured coil has two of them as well. Every coil is solved where its Im Y = 0.

    In the result, over (coil, other), ``current_real`` and ``current_imag`` are in A per A of the
    active coil, and ``contribution`` is the part of each other coil in its inductance, Re(M i).
    Without losses and strays the contributions add up to L_eff − L. Over (coil),
    ``open_inductance`` is with all others open, ``effective_inductance`` is 1/(ω²C), and
    ``inductance_change`` is by the other coils.
    """
    L, R = checked_network(inductance, resistance)
    if L.shape != (len(names), len(names)):
        raise NetworkError(f"{len(names)} names need an inductance matrix of that many rows; got shape {L.shape}.")
    ends: list[Termination] = ["short"] * len(L) if terminations is None else list(terminations)
    if len(ends) != len(L) or not set(ends) <= {"short", "open"}:
        raise NetworkError(f"terminations must be {len(L)} of 'short' or 'open'; got {ends}.")
    network = bare_network(names, L, R, Switches(short_resistance / 2, tank_capacitance=capacitance))
    opened = [name for name, end in zip(names, ends, strict=True) if end == "open"]
    states = [
        ScanState(name, ((name, 1),), exceptions={other: "open" for other in opened if other != name}) for name in names
    ]
    return _coupled(network, states, ends, R)


def _coupled(network: Network, states: Sequence[ScanState], terminations: Sequence[str], R: FloatArray) -> xr.Dataset:
    names, L = network.names, network.inductance
    solved = resonances(network, states)
    alone = resonances(network, [ScanState(name, ((name, 1),), others="open") for name in names])
    currents = np.array([state.currents for state in solved])
    contributions = np.real(L * currents) * (1 - np.eye(len(L)))
    each = partial(_of_each, solved)
    effective, unchanged = each("effective_inductance"), _of_each(alone, "effective_inductance")
    pair, single = ("coil", "other"), ("coil",)
    rows = (
        ("inductance", pair, L, "H", "inductance matrix"),
        ("coupling", pair, coupling_matrix(L), "1", "coupling coefficient"),
        ("resistance", single, R, "ohm", "DC resistance"),
        ("open_inductance", single, np.diag(L).copy(), "H", f"inductance{', all other coils open' * (len(L) > 1)}"),
        ("effective_inductance", single, effective, "H", "effective inductance"),
        ("open_effective_inductance", single, unchanged, "H", "effective inductance, others open"),
        ("inductance_change", single, effective / unchanged - 1, "1", "change by the others"),
        ("effective_resistance", single, each("effective_resistance"), "ohm", "effective resistance"),
        ("quality_factor", single, each("quality_factor"), "1", f"quality factor{network.switches.beside_q}"),
        ("open_frequency", single, _of_each(alone, "frequency"), "Hz", "resonance frequency, others open"),
        ("frequency", single, each("frequency"), "Hz", "resonance frequency"),
        ("current_real", pair, currents.real, "A/A", "in-phase current"),
        ("current_imag", pair, currents.imag, "A/A", "quadrature current"),
        ("contribution", pair, contributions, "H", "part in L_eff − L"),
        ("termination", single, np.array(terminations, dtype=object), "", "state while passive"),
    )
    return xr.Dataset(
        variables(*rows),
        coords={"coil": list(names), "other": list(names)},
        attrs={
            "capacitance_F": network.switches.tank_capacitance,
            "short_resistance_ohm": 2 * network.switches.on_resistance,
            "left_out": "; ".join(network.left_out),
        },
    )


def _of_each(results: Sequence[StateResult], name: str) -> FloatArray:
    return np.array([getattr(one, name) for one in results])


def operating_currents(
    design: Design | DesignFile, coupling: xr.Dataset, active: str, *, terminated: bool = True
) -> ComplexArray:
    """Compute the currents (coils,) in A per A of the measured coil.

    `coupling` is the result of `coilarray.couple_design` for the design, and `active` names the
    measured coil. Without `terminated` all other coils are open. A coil that the design does not
    have raises a GeometryError.
    """
    design = design_of(design)
    names = design.coil_names
    if active not in names:
        raise GeometryError(f"there is no coil {active!r}; there are {', '.join(names)}.")
    if not terminated:
        return np.asarray(np.eye(len(names), dtype=np.complex128)[names.index(active)])
    mine = coupling.sel(coil=active)
    parts = mine.current_real.values, mine.current_imag.values
    require_finite("the currents of the coupling", *np.concatenate(parts).tolist())
    return np.asarray(parts[0] + 1j * parts[1])


def require_endless(design: Design) -> tuple[Plate, ...]:
    """Return the plates of a design, which must be infinite."""
    for plate in design.plates:
        if isinstance(plate, FinitePlate):
            raise MetalError(
                f"B beside a plate with an outline is not computed; {design.name} has {plate.name!r}: leave it out, or "
                'make it infinite with shape = "plate".'
            )
    return tuple(plate for plate in design.plates if isinstance(plate, Plate))


def operating_field(
    design: Design | DesignFile,
    coupling: xr.Dataset,
    active: str,
    x: npt.ArrayLike,
    y: npt.ArrayLike,
    z: npt.ArrayLike,
    *,
    current: float = 1.0,
    terminated: bool = True,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Compute the flux density of an active coil in T.

    Parameters
    ----------
    design, coupling, active, terminated
        Design, its coupling from `couple_design`, name of the measured coil, and whether the others
        are terminated or open.
    x, y, z : array_like, shape (nx,), (ny,), (nz,) or scalar
        Grid in m. z = 0 is the top of the board.
    current : float
        Current of the active coil in A.
    progress : callable, optional
        Called with (done, total) as the work goes on.

    Returns
    -------
    xarray.Dataset
        ``B`` and ``B_quadrature`` in T with the dimensions (x, y, z, component): in phase with the
        active coil's current and 90° ahead of it. The field is in free space, or beside the
        design's plates at the active coil's frequency. Magnetic sheets change the currents only,
        with and without plates. An unknown coil, or points or a current that are not finite, raise
        a GeometryError, plates with an outline, whose field is not computed, or a height beside the
        copper of a design with plates a MetalError.
    """
    design = design_of(design)
    require_finite("current", current)
    endless = require_endless(design)
    currents = current * operating_currents(design, coupling, active, terminated=terminated)
    points = grid_points(x, y, z)
    x, y, z = axes = [np.atleast_1d(np.asarray(axis, dtype=np.float64)) for axis in (x, y, z)]
    conductors = design.conductors()
    if endless:
        beside = plate_field(conductors, currents, endless, float(coupling.frequency.sel(coil=active)), x, y, z)
        in_phase, quadrature = beside.real, beside.imag
    else:
        in_phase, quadrature = (
            magnetic_field(conductors, points, part, progress=part_of(progress, k, 2))
            for k, part in enumerate((currents.real, currents.imag))
        )
    dims = ("x", "y", "z", "component")
    places = {name: (name, axis, {"units": "m"}) for name, axis in zip("xyz", axes, strict=True)}
    rows = (
        ("B", dims, in_phase, "T", "flux density in phase with the active current"),
        ("B_quadrature", dims, quadrature, "T", "flux density 90 degrees ahead"),
    )
    return xr.Dataset(
        variables(*rows),
        coords={**places, "component": ["x", "y", "z"]},
        attrs={
            **provenance(design),
            "active_coil": active,
            "other_coils": "none" if len(design.coil_names) == 1 else "as terminated" if terminated else "open",
            "active_current_A": current,
        },
    )


def part_switches(design: Design) -> Switches:
    """Return the switches with the capacitances of the named part."""
    circuit = design.circuit
    if circuit.part is None:
        return circuit.switches
    return PARTS[circuit.part].capacitances(circuit.switches, len(design.coil_names))


@serial_algebra()
def scan_design(
    design: Design | DesignFile,
    *,
    elastomer: bool = True,
    accuracy: Accuracy = "full",
    progress: Progress | None = None,
) -> xr.Dataset:
    """Solve every scan state where the converter oscillates.

    Parameters
    ----------
    design : Design or DesignFile
        Design of the board, for example from `coilarray.load_design`.
    elastomer : bool
        Compute also the effect of the elastomer's permittivity, which takes as long as all the
        rest. It has no effect on a board without elastomer.
    accuracy : {"full", "screen"}
        Accuracy of the inductance matrix, see `coilarray.inductance_matrix`.
    progress : callable, optional
        Called with (done, total) as the work goes on.

    Returns
    -------
    xarray.Dataset
        Dimensions ``state`` and ``coil``, units in the attributes. For each state ``frequency``,
        ``effective_inductance`` (1/(ω²C)), ``effective_resistance`` (Re Z),
        ``parallel_resistance``, ``quality_factor`` (Im Z/Re Z, without the tank),
        ``loaded_quality_factor`` of the resonator, ``state_self_resonance`` without the tank, and
        ``resistance_ratio``, R_eff relative to the same with DC resistances. For a design with a
        converter also ``readable`` and the others of
        `coilarray.circuit.converter_limits.readability`. ``current_real`` and ``current_imag``
        (state, coil) are in A per A of the first measured coil.

        For each coil ``winding_capacitance``, ``self_resonance``, ``ac_resistance`` at the mean
        frequency of the states and its ``resistance_model``. If requested, the effect of the
        elastomer's permittivity: ``bare_winding_capacitance`` without the elastomer,
        ``elastomer_delta``, the apparent change of L when it is laid on, and ``dent_delta_bound``,
        an upper bound for any dent through the topmost sheet
        (`coilarray.electromagnetics.capacitance.elastomer_effect`).

        ``capacitance`` (coil, other) is the Maxwell matrix. If a coil has no capacitance model
        (`coilarray.electromagnetics.capacitance.coil_capacitance`), all capacitances of the
        windings are left out, and the attribute ``left_out`` gives the reason. For a design that
        names the part of its switches but gives other capacitances, ``part_frequency`` (state) is
        the frequency with the capacitances of the part, which are typical and not verified. A state
        without a resonance, or that cannot be solved, raises a NetworkError.
    """
    design = design_of(design)
    plan = design.plan
    steps = len(plan) + 2

    def tell(done: int) -> None:
        if progress is not None:
            progress(done, steps)

    circuit = board_circuit(design, accuracy=accuracy)
    network, ac, (capacitance, _) = circuit.network, circuit.resistance, circuit.windings.capacitance
    tell(1)
    results = []
    for state in plan:
        results.append(resonate(network, state))
        tell(len(results) + 1)
    direct = [solve_state(circuit.direct, one.state, one.frequency).effective_resistance for one in results]
    grid = ac.frequency.values
    middle = float(np.sqrt(grid[0] * grid[-1]))
    model = ac.model.values[np.abs(grid - middle).argmin()]
    states, pair, coil = ("state",), ("state", "coil"), ("coil",)
    currents, beside_q = np.array([r.currents for r in results]), network.switches.beside_q
    found, loaded = partial(_of_each, results), [loaded_quality(network, one) for one in results]
    rows = [
        ("frequency", states, found("frequency"), "Hz", "resonance frequency"),
        ("effective_inductance", states, found("effective_inductance"), "H", "effective inductance"),
        ("effective_resistance", states, found("effective_resistance"), "ohm", "effective resistance"),
        ("quality_factor", states, found("quality_factor"), "1", f"quality factor of the coil{beside_q}"),
        ("loaded_quality_factor", states, loaded, "1", f"quality factor with the tank{beside_q}"),
        ("state_self_resonance", states, _self_resonances(circuit, results), "Hz", "self-resonance without the tank"),
        ("parallel_resistance", states, found("parallel_resistance"), "ohm", "parallel resistance"),
        ("resistance_ratio", states, found("effective_resistance") / direct, "1", "effective resistance, AC over DC"),
        ("current_real", pair, currents.real, "A/A", "in-phase current"),
        ("current_imag", pair, currents.imag, "A/A", "quadrature current"),
        ("ac_resistance", coil, np.diag(network.resistance(middle)), "ohm", "AC resistance"),
        ("resistance_model", coil, model.astype(object), "", "model of the AC resistance"),
    ]
    if capacitance is not None:
        own = self_resonance(np.diag(network.inductance), network.winding_capacitance)
        rows += [
            ("winding_capacitance", coil, network.winding_capacitance, "F", "capacitance of the winding"),
            ("self_resonance", coil, own, "Hz", "self-resonance of the coil alone"),
            ("capacitance", ("coil", "other"), capacitance.capacitance.values, "F", "capacitance matrix"),
        ]
    if (counted := part_switches(design)) != design.circuit.switches:
        with_part = [resonate(replace(network, switches=counted), state).frequency for state in plan]
        rows.append(("part_frequency", states, with_part, "Hz", f"with capacitances of {design.circuit.part}"))
    if elastomer and design.sheets and capacitance is not None and not design.boards:
        below = sum(sheet.thickness for sheet in design.sheets[:-1])  # a dent reaches through the topmost sheet at most
        above = design.circuit.elastomer_permittivity
        effect = kept_dataset(
            ("elastomer effect", digest_of(design.array, design.sheets, above, design.circuit.capacitance)),
            lambda: elastomer_effect(design.array, above, design.circuit.capacitance, design.sheets, undisturbed=below),
        )
        rows += [
            ("bare_winding_capacitance", coil, effect.without.values, "F", "capacitance without elastomer"),
            ("elastomer_delta", coil, effect.apparent_delta.values, "1", "apparent δ of the elastomer"),
            ("dent_delta_bound", coil, effect.dent_bound.values, "1", "largest apparent δ of a dent"),
        ]
    names, at = list(network.names), {name: found(name) for name in RESONATOR}
    scan = xr.Dataset(
        variables(*rows) | readability(design, states, at, at),
        coords={"state": [state.name for state in plan], "coil": names, "other": names},
        attrs={**provenance(design), "ac_resistance_frequency_Hz": middle, "left_out": "; ".join(network.left_out)},
    )
    tell(steps)
    return scan


def _self_resonances(circuit: BoardCircuit, results: Sequence[StateResult]) -> list[float]:
    """Self-resonances in Hz, with plates and copper at each."""
    found = [self_resonance_of(circuit.network, one) for one in results]
    for _ in range(_ROUNDS if circuit.design.plates else 0):
        finite = [one for one in found if math.isfinite(one)]
        if not finite:
            break
        low, high = (1 - _AROUND) * min(finite), (1 + _AROUND) * max(finite)
        there = circuit.swept(np.geomspace(low, high, _SAMPLES))
        found = [self_resonance_of(there, one) for one in results]
        if all(low <= one <= high for one in found if math.isfinite(one)):
            break
    return found


@serial_algebra()
def sweep_design(
    design: Design | DesignFile, frequencies: npt.ArrayLike, *, progress: Progress | None = None
) -> xr.Dataset:
    """Compute the impedance of every scan state over frequency.

    Parameters
    ----------
    design : Design or DesignFile
        Design of the board, for example from `coilarray.load_design`.
    frequencies : array_like, shape (n,)
        Frequencies in Hz, which must be positive, finite and rising.
    progress : callable, optional
        Called with (done, total).

    Returns
    -------
    xarray.Dataset
        Dimensions ``frequency`` and ``state``. ``impedance_real`` and ``impedance_imag`` in Ω are
        between the sides of the converter without the tank's capacitor. ``apparent_inductance`` is
        Im Z/ω in H, ``quality_factor`` is Im Z/Re Z. A state that cannot be solved raises a
        NetworkError, more coils and frequencies than fit into memory a MemoryLimitError.
    """
    design = design_of(design)
    f = np.atleast_1d(np.asarray(frequencies, dtype=np.float64))
    if f.ndim != 1 or not f.size or not np.isfinite(f).all() or f[0] <= 0 or (np.diff(f) <= 0).any():
        raise ValueError("frequencies must be positive, finite and rising.")
    coils = len(design.coil_names)
    require_memory(
        _BYTES_A_RESISTANCE * len(f) * coils**2, f"the impedance of {coils} coils at {len(f)} frequencies", "take fewer"
    )
    network = board_circuit(design).swept(f)
    plan = design.plan
    Z = np.empty((len(f), len(plan)), dtype=np.complex128)
    for k, state in enumerate(plan):
        Z[:, k] = impedances(network, state, f)
        if progress is not None:
            progress(k + 1, len(plan))
    dims = ("frequency", "state")
    rows = (
        ("impedance_real", dims, Z.real, "ohm", "resistance, Re Z"),
        ("impedance_imag", dims, Z.imag, "ohm", "reactance, Im Z"),
        ("apparent_inductance", dims, Z.imag / (2 * np.pi * f[:, None]), "H", "apparent inductance"),
        ("quality_factor", dims, Z.imag / Z.real, "1", f"quality factor{design.circuit.switches.beside_q}"),
    )
    frequency = variables(("frequency", ("frequency",), f, "Hz", "frequency"))
    return xr.Dataset(
        variables(*rows), {**frequency, "state": [state.name for state in plan]}, attrs=provenance(design)
    )


def sweep_range(scan: xr.Dataset) -> tuple[float, float]:
    """Return the range of frequencies in Hz for a sweep.

    It reaches from a tenth of the resonance with the tank to four times this resonance, or to 1.25
    times the highest self-resonance if that is below ten times the resonance.
    """
    middle = float(np.sqrt(scan.frequency.min() * scan.frequency.max()))
    own = float(scan.state_self_resonance.max())
    low, high = (share * middle for share in _SWEPT)
    return low, max(high, _BEYOND * own) if own < _SHOWN_BELOW * middle else high


def sweep_frequencies(scan: xr.Dataset, points: int, between: tuple[float, float] | None = None) -> FloatArray:
    """Return rising frequencies in Hz for curves.

    The `points` are spaced evenly on a logarithmic scale. More lie around the lowest and the
    highest self-resonance, where a curve bends most.
    """
    low, high = between or sweep_range(scan)
    own = scan.state_self_resonance.values
    within = own[(own > low) & (own < high)]
    ends = within[[within.argmin(), within.argmax()]] if within.size else within
    near = np.outer(ends, np.concatenate((1 - _TOWARDS, [1.0], 1 + _TOWARDS))).ravel()
    return np.unique(np.concatenate((np.geomspace(low, high, points), near[(near > low) & (near < high)])))


def close_channels(names: Sequence[str], frequencies: npt.ArrayLike) -> list[tuple[str, str, float]]:
    """Return pairs of states closer than `CLOSE_CHANNELS`, closest first.

    >>> [(a, b) for a, b, _ in close_channels(["a", "b", "c"], [1.00e6, 1.02e6, 2e6])]
    [('a', 'b')]
    """
    f = np.asarray(frequencies, dtype=np.float64)
    found = []
    for i, j in combinations(range(len(f)), 2):
        distance = abs(f[i] - f[j]) / math.sqrt(f[i] * f[j])
        if distance < CLOSE_CHANNELS:
            found.append((names[i], names[j], float(distance)))
    return sorted(found, key=lambda pair: pair[2])
