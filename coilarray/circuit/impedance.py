"""Resonances and impedance of the states of a scan."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.circuit.board_circuit import BoardCircuit, board_circuit
from coilarray.circuit.converter_limits import LARGEST_SHARE_OF_SELF_RESONANCE
from coilarray.circuit.coupling import provenance
from coilarray.circuit.network import StateResult, impedances, loaded_quality, resonate, self_resonance_of, solve_state
from coilarray.circuit.readability import RESONATOR, readability
from coilarray.compute.arrays import FloatArray
from coilarray.compute.memory import require_memory
from coilarray.compute.netcdf import variables
from coilarray.compute.store import kept_dataset
from coilarray.compute.threads import Progress, serial_algebra
from coilarray.design.model import Design, DesignFile, design_of, digest_of
from coilarray.design.scan_states import PARTS, Switches
from coilarray.electromagnetics.capacitance import elastomer_effect, self_resonance
from coilarray.electromagnetics.inductance import Accuracy

CLOSE_CHANNELS = 0.03
"""Relative frequency distance below which channels that are active together pull each other."""
# Search of resonances without the tank beside plates: samples around the last guess, and rounds.
_AROUND, _SAMPLES, _ROUNDS = 0.15, 5, 4
_SWEPT, _SHOWN_BELOW, _BEYOND = (0.1, 4.0), 10.0, 1.25  # frequencies of a sweep, see `sweep_range`
_TOWARDS = np.geomspace(0.02, 0.3, 14)  # relative distances from a self-resonance at which a curve gets more points
_BYTES_A_RESISTANCE = 24.0  # per entry and frequency: as computed, as interpolated, and as copied on the way


def part_switches(design: Design) -> Switches:
    """Return the switches with the capacitances of the named part.

    >>> from coilarray import load_design
    >>> round(part_switches(load_design("gast2020")).across_coil * 1e12)
    218
    """
    circuit = design.circuit
    if circuit.part is None:
        return circuit.switches
    return PARTS[circuit.part].capacitances(circuit.switches, len(design.array.names))


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
        Dimensions ``state`` and ``coil``, units in the attributes. For each state

        - ``frequency``,
        - ``effective_inductance``: 1/(ω²C),
        - ``effective_resistance``: Re Z,
        - ``parallel_resistance``,
        - ``quality_factor``: Im Z/Re Z, without the tank,
        - ``loaded_quality_factor``: quality factor of the resonator,
        - ``state_self_resonance``: without the tank,
        - ``resistance_ratio``: R_eff relative to the same with DC resistances,
        - ``readable`` and the others of `coilarray.circuit.readability.readability`, for a design
          with a converter,
        - ``current_real`` and ``current_imag`` (state, coil): in A per A of the first measured
          coil.

        For each coil

        - ``winding_capacitance`` and ``self_resonance``,
        - ``ac_resistance``, at the mean frequency of the states, and its ``resistance_model``,
        - the effect of the elastomer's permittivity, if requested: ``bare_winding_capacitance``,
          without the elastomer, ``elastomer_delta``, the apparent change of L when it is laid on,
          and ``dent_delta_bound``, an upper bound for any dent through the topmost sheet
          (`coilarray.electromagnetics.capacitance.elastomer_effect`).

        ``capacitance`` (coil, other) is the Maxwell matrix. If a coil has no capacitance model
        (`coilarray.electromagnetics.capacitance.coil_capacitance`), all capacitances of the
        windings are left out, and the attribute ``left_out`` gives the reason. For a design that
        names the part of its switches but gives other capacitances, ``part_frequency`` (state) is
        the frequency with the capacitances of the part, which are typical and not verified.

    Raises
    ------
    NetworkError
        A state without a resonance, or one that cannot be solved.
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
    for k, state in enumerate(plan):
        results.append(resonate(network, state))
        tell(k + 2)
    direct = [solve_state(circuit.direct, r.state, r.frequency).effective_resistance for r in results]
    grid = ac.frequency.values
    middle = float(np.sqrt(grid[0] * grid[-1]))
    nearest = int(np.abs(grid - middle).argmin())
    states, pair, coil = ("state",), ("state", "coil"), ("coil",)
    currents, beside_q = np.array([r.currents for r in results]), network.switches.beside_q
    rows = [
        ("frequency", states, [r.frequency for r in results], "Hz", "resonance frequency"),
        ("effective_inductance", states, [r.effective_inductance for r in results], "H", "effective inductance"),
        ("effective_resistance", states, [r.effective_resistance for r in results], "ohm", "effective resistance"),
        ("quality_factor", states, [r.quality_factor for r in results], "1",
         f"quality factor of the coil{beside_q}"),
        ("loaded_quality_factor", states, [loaded_quality(network, r) for r in results], "1",
         f"quality factor with the tank{beside_q}"),
        ("state_self_resonance", states, _self_resonances(circuit, results), "Hz",
         "self-resonance without the tank"),
        ("parallel_resistance", states, [r.parallel_resistance for r in results], "ohm", "parallel resistance"),
        ("resistance_ratio", states, [r.effective_resistance / d for r, d in zip(results, direct, strict=True)], "1",
         "effective resistance, AC over DC"),
        ("current_real", pair, currents.real, "A/A", "in-phase current"),
        ("current_imag", pair, currents.imag, "A/A", "quadrature current"),
        ("ac_resistance", coil, np.diag(network.resistance(middle)), "ohm", "AC resistance"),
        ("resistance_model", coil, ac.model.values[nearest].astype(object), "", "model of the AC resistance"),
    ]  # fmt: skip
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
    if elastomer and design.sheets and capacitance is not None:
        below = sum(sheet.thickness for sheet in design.sheets[:-1])  # a dent reaches through the topmost sheet at most
        above = circuit.windings.above
        effect = kept_dataset(
            ("elastomer effect", digest_of(design.array, design.sheets, above, design.circuit.capacitance)),
            lambda: elastomer_effect(design.array, above, design.circuit.capacitance, design.sheets, undisturbed=below),
        )
        rows += [
            ("bare_winding_capacitance", coil, effect.without.values, "F", "capacitance without elastomer"),
            ("elastomer_delta", coil, effect.apparent_delta.values, "1", "apparent δ of the elastomer"),
            ("dent_delta_bound", coil, effect.dent_bound.values, "1", "largest apparent δ of a dent"),
        ]
    names = list(network.names)
    at = {name: np.array([getattr(one, name) for one in results]) for name in RESONATOR}
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
def resonators(design: Design, accuracy: Accuracy = "screen") -> xr.Dataset:
    """Return quantities of readability of the flat board over ``state``.

    `scan_design` takes longer. ``state_self_resonance`` is infinite if it is too far above the
    frequency to count, and leaves out the effect of plates there.
    """
    network = board_circuit(design, accuracy=accuracy).network
    results = [resonate(network, state) for state in design.plan]
    at = {name: np.array([getattr(one, name) for one in results]) for name in RESONATOR}
    states, within = ("state",), 1 / LARGEST_SHARE_OF_SELF_RESONANCE
    rows = variables(
        ("frequency", states, at["frequency"], "Hz", "resonance frequency"),
        ("parallel_resistance", states, at["parallel_resistance"], "ohm", "parallel resistance"),
        ("loaded_quality_factor", states, [loaded_quality(network, one) for one in results], "1", "quality factor"),
        ("state_self_resonance", states, [self_resonance_of(network, one, within) for one in results], "Hz",
         "self-resonance without the tank"),
    )  # fmt: skip
    return xr.Dataset(rows | readability(design, states, at, at), {"state": [state.name for state in design.plan]})


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
        Frequencies in Hz, positive and rising.
    progress : callable, optional
        Called with (done, total).

    Returns
    -------
    xarray.Dataset
        Dimensions ``frequency`` and ``state``. ``impedance_real`` and ``impedance_imag`` in Ω are
        between the sides of the converter without the tank's capacitor. ``apparent_inductance`` is
        Im Z/ω in H, ``quality_factor`` is Im Z/Re Z.

    Raises
    ------
    ValueError
        Frequencies that are not positive, finite and rising.
    MemoryLimitError
        More coils and frequencies than fit into memory.
    NetworkError
        A state that cannot be solved.
    """
    design = design_of(design)
    f = np.atleast_1d(np.asarray(frequencies, dtype=np.float64))
    if f.ndim != 1 or not f.size or not np.isfinite(f).all() or f[0] <= 0 or (np.diff(f) <= 0).any():
        raise ValueError("frequencies must be positive, finite and rising.")
    coils = len(design.array.names)
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
