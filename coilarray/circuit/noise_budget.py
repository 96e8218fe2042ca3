"""Noise and drift of readings of δ by cause.

The converter counts the oscillation of coil and tank against its clock. L = 1/((2πf)² C) is taken
with the nominal clock and capacitance, so that a relative error of f is twice as large in L. δ =
L/L_0 − 1 has the noise of a reading and of its L_0, and all changes between the two.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from coilarray.circuit.converter_limits import broken_limit
from coilarray.circuit.coupling import design_circuit
from coilarray.circuit.network import Network, loaded_quality, resonate
from coilarray.compute.arrays import FloatArray
from coilarray.compute.netcdf import variables
from coilarray.compute.table import html_card, html_table
from coilarray.design.model import Design, DesignFile, design_of
from coilarray.design.readout import DRIVE_DELAY, INTERNAL_CLOCK_PER_KELVIN, Readout
from coilarray.design.scan_states import Switches, referenced_names
from coilarray.errors import NetworkError

_THERMAL = 1.380649e-23 * 298.0  # J, kT at room temperature
_OF_CURVES = "assumed from the curves of SNOSCY9A, which stay within 0.2 % over supply and temperature"
_OF_CRYSTALS = "assumed for a crystal within ± 50 ppm from −20 to 70 °C"
_OF_UNITS = "SNOSCY9A, section 6.5: mean of units"
_CLOCKS = {  # by external clock: name, drift in 1/K and its source, change in 1/V and its source
    False: ("converter's own clock", INTERNAL_CLOCK_PER_KELVIN, _OF_UNITS, 50e-6, _OF_CURVES),
    True: ("crystal oscillator", 1e-6, _OF_CRYSTALS, 1e-6, "assumed for a crystal oscillator"),
}
_GIVEN = "[readout] of the design"
_NO_JITTER = "not published; none is counted"
_C0G = "C0G, at most ± 30 ppm/K (IEC 60384-8)"
_FR4 = "FR4 in its plane, 14 ppm/K; L grows with the size"
_COPPER = "IEC 60028 and the computed Q"
_ADG729 = "ADG729: 4.5 Ω at 25 °C, 5 Ω over temperature"
_DELAY = "5 ns of equation 1 of SNOSCY9A, not verified"
_RESOLUTION = (
    "8·10⁻⁷ of f at RCOUNT 0x800, SNOA944 as quoted by a firmware for the LDC1612; its fall with the root of RCOUNT is "
    "that of white noise"
)


@dataclass(frozen=True, eq=False)
class Cause:
    """Cause of errors of δ, with arrays (states,).

    `noise` is the relative standard deviation of L, independent from scan to scan. `drift` is the
    relative change of L in 1/K. `change` is the standard deviation of the change of δ since L_0,
    with the sign of the coefficient. A `common` cause is the same at all coils. `source` is the
    source of its size, `assumed` unless a public source or device has confirmed it.
    """

    name: str
    noise: FloatArray
    drift: FloatArray
    change: FloatArray
    common: bool
    source: str
    assumed: bool

    @property
    def counted(self) -> bool:
        """Whether the cause has any size in this budget."""
        return any(values.any() for values in (self.noise, self.drift, self.change))

    @property
    def size(self) -> str:
        """Knowledge of the cause's size: "known", "assumed", or "none"."""
        return "none" if not self.counted else "assumed" if self.assumed else "known"


@dataclass(frozen=True, eq=False)
class NoiseBudget:
    """Noise and drift of readings by cause, for a `readout`.

    Arrays of the `causes` are in the order of `states`. `reference` are the coils whose δ has been
    subtracted. `unread` are states and reference coils that no LDC1614 can read.
    """

    states: tuple[str, ...]
    causes: tuple[Cause, ...]
    readout: Readout
    reference: tuple[str, ...] = ()
    unread: tuple[str, ...] = ()

    def __repr__(self) -> str:
        noise, drift = self.noise.max(), np.abs(self.drift).max()
        most = f"at most σ of δ {self.largest:.2g}, of it noise {noise:.2g}; drift {drift:.2g} per K"
        return f"<NoiseBudget of {len(self.states)} states: {most}>"

    def _repr_html_(self) -> str:
        numbers = zip(self.noise.tolist(), self.drift.tolist(), self.sigma.tolist(), strict=True)
        rows = [(name, *(f"{number:.3g}" for number in row)) for name, row in zip(self.states, numbers, strict=True)]
        causes = [
            (cause.name, "assumed, not verified" if cause.size == "assumed" else cause.size, cause.source)
            for cause in self.causes
        ]
        return html_card(
            " less ".join(["NoiseBudget of δ", *([", ".join(self.reference)] if self.reference else [])]),
            html_table(("state", "noise of δ", "drift of δ (1/K)", "σ of δ"), rows),
            html_table(("cause", "size", "source"), causes),
        )

    @property
    def scan_noise(self) -> FloatArray:
        """Relative standard deviation (states,) of L of one scan."""
        return _quadrature([cause.noise for cause in self.causes])

    @property
    def noise(self) -> FloatArray:
        """Standard deviation of δ (states,) by noise, with averages."""
        return self.scan_noise * math.sqrt(1 / self.readout.averaged_scans + 1 / self.readout.baseline_scans)

    @property
    def drift(self) -> FloatArray:
        """Change (states,) of δ in 1/K, in quadrature, as some signs are unknown."""
        return _quadrature([cause.drift for cause in self.causes])

    @property
    def sigma(self) -> FloatArray:
        """Standard deviation of δ (states,) by noise and changes."""
        return _quadrature([self.noise, *(cause.change for cause in self.causes)])

    @property
    def largest(self) -> float:
        """Largest `sigma`, the noise of δ of a single coil."""
        return float(self.sigma.max())

    @property
    def independent(self) -> FloatArray:
        """Standard deviation of δ (states,) by own causes, the diagonal beside `common`."""
        return np.hypot(self.noise, self.own_change)

    @property
    def own_change(self) -> FloatArray:
        """Standard deviation of δ (states,) by own changes since L_0."""
        return _quadrature([np.zeros(len(self.states)), *(one.change for one in self.causes if not one.common)])

    @property
    def common(self) -> dict[str, FloatArray]:
        """Changes c (states,) of δ by causes common to coils."""
        return {cause.name: cause.change for cause in self.causes if cause.common and cause.change.any()}

    def variables(self) -> dict[str, tuple[tuple[str, ...], Any, dict[str, str]]]:
        """Return `common` as ``common_noise`` (drift_cause, state)."""
        if not (common := self.common):
            return {}
        changes = np.array(list(common.values()))
        rows = variables(("common_noise", ("drift_cause", "state"), changes, "1", "change of δ by a cause"))
        return {"drift_cause": (("drift_cause",), list(common), {}), **rows}

    def select(self, states: Sequence[str]) -> NoiseBudget:
        """Return the budget of some states in the given order."""
        if unknown := [name for name in states if name not in self.states]:
            raise NetworkError(f"the budget has no state {unknown[0]!r}; there are {', '.join(self.states)}.")
        kept = [self.states.index(name) for name in states]
        causes = tuple(
            replace(one, noise=one.noise[kept], drift=one.drift[kept], change=one.change[kept]) for one in self.causes
        )
        return replace(self, states=tuple(states), causes=causes)

    def referenced(self, reference: Sequence[str]) -> NoiseBudget:
        """Return the budget less the mean of reference coils, common changes as far as they differ."""
        others = referenced_names(self.states, reference)
        kept, taken = ([self.states.index(name) for name in names] for names in (others, reference))

        def less(values: FloatArray, *, common: bool) -> FloatArray:
            if common:
                return np.asarray(values[kept] - values[taken].mean())
            return np.asarray(np.hypot(values[kept], np.linalg.norm(values[taken]) / len(taken)))

        causes = []
        for one in self.causes:
            drift, change = (less(values, common=one.common) for values in (one.drift, one.change))
            causes.append(replace(one, noise=less(one.noise, common=False), drift=drift, change=change))
        return replace(self, states=others, causes=tuple(causes), reference=tuple(reference))

    def to_record(self) -> dict[str, Any]:
        """Return the budget in SI as plain values for JSON."""
        return {
            "states": list(self.states),
            "not_readable": list(self.unread),
            "reference": list(self.reference),
            "rcount": self.readout.rcount,
            "reference_frequency_Hz": self.readout.reference,
            "counting_limit": self.readout.counting_limit,
            "averaged_scans": self.readout.averaged_scans,
            "baseline_scans": self.readout.baseline_scans,
            "temperature_change_K": self.readout.temperature_change,
            "supply_change_V": self.readout.supply_change,
            "causes": [
                {
                    "cause": cause.name,
                    "scan_noise": cause.noise.tolist(),
                    "drift_per_K": cause.drift.tolist(),
                    "change": np.abs(cause.change).tolist(),
                    "common": cause.common,
                    "assumed": cause.size == "assumed",
                    "source": cause.source,
                }
                for cause in self.causes
            ],
            "scan_noise": self.scan_noise.tolist(),
            "noise": self.noise.tolist(),
            "drift_per_K": self.drift.tolist(),
            "sigma": self.sigma.tolist(),
        }


def noise_budget(
    design: Design | DesignFile, *, readout: Readout | None = None, network: Network | None = None
) -> NoiseBudget:
    """Compute noise and drift of a design's readings by cause.

    Parameters
    ----------
    design : Design or DesignFile
        Design with the circuit of its coils.
    readout : Readout, optional
        Settings and coefficients. By default from the design.
    network : Network, optional
        Coils, switches and strays. By default those of `coilarray.circuit.coupling.design_circuit`.

    Returns
    -------
    NoiseBudget
        For the states of the design's scan. A state without a resonance raises a NetworkError. Left
        out are neighbours that are warmer than others, flicker noise of clock and sensor, the
        change of the skin depth, and the elastomer.

    Examples
    --------
    >>> from coilarray import load_design
    >>> budget = noise_budget(load_design("gast2020"))
    >>> f"{budget.noise[0]:.1e}, {budget.drift[0]:.1e} per K, {budget.sigma[0]:.1e}"
    '3.0e-07, 4.3e-05 per K, 4.3e-06'
    """
    design = design_of(design)
    circuit = design_circuit(design) if network is None else network
    found = [resonate(circuit, state) for state in design.plan]
    changed = design if readout is None else replace(design, readout=readout)
    frequencies = [one.frequency for one in found]
    budget = budget_of(changed, frequencies, [loaded_quality(circuit, one) for one in found], switches=circuit.switches)
    if not design.readout.is_judged:
        return budget
    broken = broken_limit(
        frequencies, [one.parallel_resistance for one in found], [one.quality_factor for one in found]
    )
    return replace(budget, unread=tuple(name for name, no in zip(budget.states, broken.tolist(), strict=True) if no))


def budget_of(
    design: Design, frequency: npt.ArrayLike, quality_factor: npt.ArrayLike, *, switches: Switches | None = None
) -> NoiseBudget:
    """Return the budget of a design's states from their resonances.

    The resonances (states,) are in Hz, and the quality factors of the whole resonators. Noise of f
    in one conversion of the duration T:

    - resolution of the converter and jitter of its clock, as `Readout` has them,
    - thermal noise of the losses. It lets the phase of an oscillator diffuse, S_φ = (4kT_K/P)
      (f/(2Qf_m))² at the offset f_m with the dissipated power P (D. B. Leeson, Proc. IEEE 54, 329,
      1966, in the form of A. Hajimiri & T. H. Lee, IEEE J. Solid-State Circuits 33, 179, 1998, with
      F = 1). This is white noise of f, S_y = kT_K/(Q²P), whose mean over T has σ² = S_y/(2T) =
      kT_K/(QωCV²T) with P = ωCV²/(2Q). The converter's amplifier adds more.

    Changes with temperature: L follows from the square of the clock, the capacitance and the size
    of the board. A coil with a series resistance R has L_eff = L (1 + 1/Q²) at Im Y = 0, which
    changes by 2/(Q² + 1) times the relative change of R, the switches' included. R is taken to
    change as at direct current, an upper bound if the skin effect counts. The delay of 5 ns in the
    converter's drive (SNOSCY9A, equation 1) adds 5 ns · ω/Q times that change.
    """
    readout = design.readout
    if switches is None:
        switches = design.circuit.switches
    f, Q = (np.asarray(values, dtype=np.float64) for values in (frequency, quality_factor))
    omega, every, none = 2 * np.pi * f, np.ones_like(f), np.zeros_like(f)
    susceptance = omega * switches.tank_capacitance
    clock, per_kelvin, kelvin_source, per_volt, volt_source = _CLOCKS[readout.external_clock]
    if readout.clock_per_kelvin is not None:
        per_kelvin = readout.clock_per_kelvin
    if readout.clock_per_volt is not None:
        per_volt, volt_source = readout.clock_per_volt, _GIVEN
    measured = [(state.connection == "series", len(state.measured)) for state in design.plan]
    closed = np.array([2.0 * coils if series else 2.0 / coils for series, coils in measured])  # between the two sides
    # The switches are a share of the resistance in series.
    of_switches = np.minimum(closed * switches.on_resistance * susceptance * np.where(np.isfinite(Q), Q, 0.0), 1.0)
    copper = (1 - of_switches) * readout.size("copper_per_kelvin")
    closed_ones = of_switches * readout.size("switch_per_kelvin")
    delay = DRIVE_DELAY * omega / Q * (copper + closed_ones)
    energy = Q * susceptance * readout.amplitude**2 * readout.conversion_time

    def noisy(name: str, size: FloatArray, source: str, *, given: float | None = None, known: bool = False) -> Cause:
        said = source if given is None else _GIVEN
        return Cause(name, 2 * size, none, none, False, said, given is None and not known)

    def drifting(
        name: str, size: FloatArray, key: str, source: str, *, known: bool = False, common: bool = True
    ) -> Cause:
        given = getattr(readout, key) is not None
        said = _GIVEN if given else source
        return Cause(name, none, size, size * readout.temperature_change, common, said, not (known or given))

    supply, inside = 2 * per_volt * readout.supply_change * every, not readout.external_clock
    capacitor, shared_tank = readout.size("capacitor_per_kelvin"), switches.tank_at == "converter"
    thermal = f"Leeson, for {readout.amplitude:g} V and the losses alone"
    assumed_supply = readout.clock_per_volt is None
    causes = (
        noisy("resolution of the converter", readout.resolution_noise * every, _RESOLUTION, given=readout.resolution),
        noisy(f"jitter of the {clock}", readout.jitter_noise * every, _NO_JITTER, given=readout.clock_jitter),
        noisy("thermal noise of the losses", np.sqrt(_THERMAL / energy), thermal, known=True),
        Cause("clock with the supply", none, none, supply, True, volt_source, assumed_supply),
        drifting("clock with temperature", 2 * per_kelvin * every, "clock_per_kelvin", kelvin_source, known=inside),
        drifting("capacitor of the tank", capacitor * every, "capacitor_per_kelvin", _C0G, common=shared_tank),
        drifting("expansion of the board", readout.size("board_per_kelvin") * every, "board_per_kelvin", _FR4),
        drifting("resistance of the copper", 2 * copper / (Q**2 + 1), "copper_per_kelvin", _COPPER, known=True),
        drifting("resistance of the switches", 2 * closed_ones / (Q**2 + 1), "switch_per_kelvin", _ADG729),
        Cause("losses by the converter's delay", none, delay, delay * readout.temperature_change, True, _DELAY, True),
    )
    return NoiseBudget(tuple(state.name for state in design.plan), causes, readout)


def _quadrature(values: Sequence[FloatArray]) -> FloatArray:
    return np.asarray(np.sqrt(np.sum(np.square(values), axis=0)))
