"""The whole circuit of a design: AC resistance, capacitance and switches, state by state and over frequency."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.circuit.coupling import design_inductance, provenance
from coilarray.circuit.network import Network, impedances, loaded_quality, resonate, self_resonance_of, solve_state
from coilarray.compute.memory import require_memory
from coilarray.compute.threads import Progress
from coilarray.design.model import Design
from coilarray.electromagnetics.ac_resistance import resistance_matrix
from coilarray.electromagnetics.capacitance import coil_capacitance, elastomer_effect, self_resonance
from coilarray.electromagnetics.resistance import dc_resistance

FloatArray = npt.NDArray[np.float64]

CLOSE_CHANNELS = 0.03
"""Relative distance of two frequencies below which simultaneous channels would pull each other."""
_RESISTANCE_POINTS = 9
_BYTES_A_RESISTANCE = 24.0  # an entry at a frequency: as computed, interpolated, and a copy on the way


@dataclass(frozen=True, eq=False)
class DesignNetwork:
    """A design's network with direct-current resistances, and its capacitances.

    Parameters
    ----------
    network : Network
        Ready to be solved.
    capacitance : xarray.Dataset
        As `coilarray.electromagnetics.capacitance.coil_capacitance` returns it.
    design : Design
        Which it is of.
    """

    network: Network
    capacitance: xr.Dataset
    design: Design

    @cached_property
    def elastomer(self) -> xr.Dataset:
        """What `capacitance.elastomer_effect` says; a dent reaches at most through the topmost sheet."""
        return _elastomer(self.design)


def design_network(design: Design, inductance: Callable[[], FloatArray] | None = None) -> DesignNetwork:
    """Compute what does not depend on frequency, once for several scans and sweeps.

    Parameters
    ----------
    design : Design
        As `coilarray.load_design` returns it.
    inductance : callable, optional
        Returns the first of `coilarray.circuit.coupling.design_inductance` where that is known or on its way; it is
        called last. Computed here by default.

    Returns
    -------
    DesignNetwork

    Raises
    ------
    GeometryError
        A coil whose capacitance has no model: see `coilarray.electromagnetics.capacitance.winding_capacitance`.
    """
    conductors = design.array.conductors()
    parts = coil_capacitance(design.array, design.sheets, relative_permittivity=_permittivity(design))
    between = -parts.capacitance.values.copy()
    np.fill_diagonal(between, 0.0)
    R = np.diag(dc_resistance(conductors, design.circuit.resistivity))
    network = Network(
        design.array.names,
        design_inductance(design)[0] if inductance is None else inductance(),
        lambda frequency: R,
        parts.coil_capacitance.values,
        np.maximum(0.5 * (between + between.T), 0.0),  # rounding
        design.circuit.switches,
    )
    return DesignNetwork(network, parts, design)


def scan_design(design: Design, progress: Progress | None = None, prepared: DesignNetwork | None = None) -> xr.Dataset:
    """Solve every state of a design's scan plan where the converter oscillates.

    Parameters
    ----------
    design : Design
        As `coilarray.load_design` returns it.
    progress : callable, optional
        Called with (done, total).
    prepared : DesignNetwork, optional
        As `design_network` returns it; made here where it is not given.

    Returns
    -------
    xarray.Dataset
        Dimensions ``state`` and ``coil``. For each state ``frequency``, ``effective_inductance``,
        ``effective_resistance``, ``quality_factor`` (of the coils), ``loaded_quality_factor`` (of the resonator),
        ``state_self_resonance`` (without the tank), ``parallel_resistance``, ``resistance_ratio`` (R_eff against the
        same with DC resistances), and ``current_real``, ``current_imag`` (state, coil) in A per A of the first measured
        coil. For each coil ``winding_capacitance``, ``self_resonance``, ``ac_resistance`` (at the states' mean
        frequency), ``resistance_model``, and what the elastomer's permittivity does: ``bare_winding_capacitance``
        without it, ``elastomer_delta``, the change of L that laying it on feigns, and ``dent_delta_bound``, which no
        dent through the topmost sheet exceeds (`coilarray.electromagnetics.capacitance.elastomer_effect`).
        ``capacitance`` (coil, other) is the Maxwell matrix. Units in the attributes.

    Raises
    ------
    NetworkError
        A state without a resonance, or one that cannot be solved.
    """
    prepared = prepared or design_network(design)
    effect = prepared.elastomer
    coil = ("coil",)
    return scan_states(prepared, progress).assign(
        bare_winding_capacitance=(coil, effect.without.values, {"units": "F", "long_name": "without elastomer"}),
        elastomer_delta=(
            coil, effect.apparent_delta.values, {"units": "1", "long_name": "feigned by the elastomer laid on"}
        ),
        dent_delta_bound=(coil, effect.dent_bound.values, {"units": "1", "long_name": "most that a dent feigns"}),
    )  # fmt: skip


def scan_states(prepared: DesignNetwork, progress: Progress | None = None) -> xr.Dataset:
    """Solve every state as `scan_design` does, without what the elastomer's permittivity does: half of its time.

    Parameters
    ----------
    prepared : DesignNetwork
        As `design_network` returns it.
    progress : callable, optional
        Called with (done, total).

    Returns
    -------
    xarray.Dataset
        As `scan_design`, but for ``bare_winding_capacitance``, ``elastomer_delta`` and ``dent_delta_bound``.

    Raises
    ------
    NetworkError
        A state without a resonance, or one that cannot be solved.
    """
    design, network = prepared.design, prepared.network
    plan = design.plan
    steps = 2 * len(plan) + 1
    first = []
    for k, state in enumerate(plan):
        first.append(resonate(network, state))
        _tell(progress, k + 1, steps)
    grid, ac = resistance_near(design, [r.frequency for r in first])
    _tell(progress, len(plan) + 1, steps)
    lossy = replace(network, resistance=interpolated_resistance(grid, ac.resistance.values))
    results = []
    for k, state in enumerate(plan):
        results.append(resonate(lossy, state))
        _tell(progress, len(plan) + 2 + k, steps)
    direct = [solve_state(network, r.state, r.frequency).effective_resistance for r in results]
    middle = float(np.sqrt(grid[0] * grid[-1]))
    at_middle = lossy.resistance(middle)
    states, pair, coil = ("state",), ("state", "coil"), ("coil",)
    currents = np.array([r.currents for r in results])
    nearest = int(np.abs(grid - middle).argmin())
    return xr.Dataset(
        {
            "frequency": (states, [r.frequency for r in results], {"units": "Hz", "long_name": "resonance"}),
            "effective_inductance": (states, [r.effective_inductance for r in results], {"units": "H"}),
            "effective_resistance": (states, [r.effective_resistance for r in results], {"units": "ohm"}),
            "quality_factor": (states, [r.quality_factor for r in results], {"units": "1"}),
            "loaded_quality_factor": (
                states, [loaded_quality(lossy, r) for r in results], {"units": "1", "long_name": "Q of the resonator"}
            ),
            "state_self_resonance": (
                states, [self_resonance_of(lossy, r) for r in results], {"units": "Hz", "long_name": "without the tank"}
            ),
            "parallel_resistance": (states, [r.parallel_resistance for r in results], {"units": "ohm"}),
            "resistance_ratio": (
                states,
                [r.effective_resistance / d for r, d in zip(results, direct, strict=True)],
                {"units": "1", "long_name": "effective resistance over the same with direct-current resistances"},
            ),
            "current_real": (pair, currents.real, {"units": "A/A"}),
            "current_imag": (pair, currents.imag, {"units": "A/A"}),
            "winding_capacitance": (coil, network.winding_capacitance, {"units": "F"}),
            "self_resonance": (
                coil, self_resonance(np.diag(network.inductance), network.winding_capacitance), {"units": "Hz"}
            ),
            "ac_resistance": (coil, np.diag(at_middle), {"units": "ohm", "long_name": "own AC resistance"}),
            "resistance_model": (coil, ac.model.values[nearest].astype(object), {"long_name": "model of R"}),
            "capacitance": (("coil", "other"), prepared.capacitance.capacitance.values, {"units": "F"}),
        },
        coords={
            "state": [state.name for state in plan], "coil": list(network.names), "other": list(network.names),
        },
        attrs={**provenance(design), "ac_resistance_frequency_Hz": middle},
    )  # fmt: skip


def resistance_near(design: Design, frequencies: Sequence[float]) -> tuple[FloatArray, xr.Dataset]:
    """AC resistance matrices around the frequencies that a design oscillates at with its DC resistances.

    Parameters
    ----------
    design : Design
        Of the coils.
    frequencies : sequence of float
        In Hz.

    Returns
    -------
    grid : ndarray, shape (n,)
        From 5 % below the lowest to 5 % above the highest in Hz: AC resistance shifts a resonance by far less.
    resistance : xarray.Dataset
        As `coilarray.electromagnetics.ac_resistance.resistance_matrix` returns it.
    """
    grid = np.geomspace(0.95 * min(frequencies), 1.05 * max(frequencies), _RESISTANCE_POINTS)
    return grid, resistance_matrix(design.array, grid, design.circuit.resistivity)


def interpolated_resistance(frequencies: FloatArray, R: FloatArray) -> Callable[[float], FloatArray]:
    """Resistance matrix at any frequency: linear between those computed, constant beyond.

    Parameters
    ----------
    frequencies : ndarray, shape (f,)
        Rising, in Hz.
    R : ndarray, shape (f, n, n)
        In Ω.

    Returns
    -------
    callable
        Takes a frequency in Hz and returns an ndarray, shape (n, n), in Ω.
    """

    def at(frequency: float) -> FloatArray:
        k = int(np.clip(np.searchsorted(frequencies, frequency) - 1, 0, max(len(frequencies) - 2, 0)))
        if len(frequencies) == 1:
            return np.asarray(R[0])
        share = float(np.clip((frequency - frequencies[k]) / (frequencies[k + 1] - frequencies[k]), 0, 1))
        return np.asarray((1 - share) * R[k] + share * R[k + 1])

    return at


def sweep_design(
    design: Design,
    frequencies: npt.ArrayLike,
    progress: Progress | None = None,
    prepared: DesignNetwork | None = None,
) -> xr.Dataset:
    """Impedance of every state of a design's scan plan over frequency.

    Parameters
    ----------
    design : Design
        As `coilarray.load_design` returns it.
    frequencies : array_like, shape (n,)
        In Hz, positive and rising.
    progress : callable, optional
        Called with (done, total).
    prepared : DesignNetwork, optional
        As `design_network` returns it; made here where it is not given.

    Returns
    -------
    xarray.Dataset
        Dimensions ``frequency`` and ``state``: ``impedance_real`` and ``impedance_imag`` in Ω between the sides of the
        converter without the tank's capacitor, ``apparent_inductance`` Im Z/ω in H, ``quality_factor`` Im Z/Re Z.

    Raises
    ------
    ValueError
        Frequencies that are not positive, finite and rising.
    MemoryLimitError
        More coils and frequencies than there is memory for.
    NetworkError
        A state that cannot be solved.
    """
    f = np.atleast_1d(np.asarray(frequencies, dtype=np.float64))
    if f.ndim != 1 or not f.size or not np.isfinite(f).all() or f[0] <= 0 or (np.diff(f) <= 0).any():
        raise ValueError("frequencies must be positive, finite and rising.")
    coils = len(design.array.names)
    require_memory(
        _BYTES_A_RESISTANCE * len(f) * coils**2, f"the impedance of {coils} coils at {len(f)} frequencies", "take fewer"
    )
    network = (prepared or design_network(design)).network
    R = resistance_matrix(design.array, f, design.circuit.resistivity).resistance.values
    lossy = replace(network, resistance=interpolated_resistance(f, R))
    plan = design.plan
    Z = np.empty((len(f), len(plan)), dtype=np.complex128)
    for k, state in enumerate(plan):
        Z[:, k] = impedances(lossy, state, f)
        _tell(progress, k + 1, len(plan))
    dims = ("frequency", "state")
    return xr.Dataset(
        {
            "impedance_real": (dims, Z.real, {"units": "ohm"}),
            "impedance_imag": (dims, Z.imag, {"units": "ohm"}),
            "apparent_inductance": (dims, Z.imag / (2 * np.pi * f[:, None]), {"units": "H"}),
            "quality_factor": (dims, Z.imag / Z.real, {"units": "1"}),
        },
        coords={"frequency": ("frequency", f, {"units": "Hz"}), "state": [state.name for state in plan]},
        attrs=provenance(design),
    )


def close_channels(names: Sequence[str], frequencies: npt.ArrayLike) -> list[tuple[str, str, float]]:
    """Pairs of states whose frequencies are closer than `CLOSE_CHANNELS`.

    Parameters
    ----------
    names : sequence of str, length n
        Of the states.
    frequencies : array_like, shape (n,)
        In Hz.

    Returns
    -------
    list of (str, str, float)
        Both names and the relative distance, the closest first. It matters for channels that oscillate at the same
        time; a multiplexer that grounds all others has only one.

    Examples
    --------
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


def _elastomer(design: Design) -> xr.Dataset:
    """Compute what the elastomer's permittivity does; a dent reaches at most through the topmost sheet."""
    below = sum(sheet.thickness for sheet in design.sheets[:-1])
    return elastomer_effect(
        design.array,
        _permittivity(design),
        design.circuit.capacitance,
        design.sheets,
        undisturbed=below,
    )


def _permittivity(design: Design) -> float:
    """Relative permittivity above the board: air where no elastomer lies there."""
    return design.circuit.elastomer_permittivity if design.sheets else 1.0


def _tell(progress: Progress | None, done: int, total: int) -> None:
    if progress is not None:
        progress(done, total)
