"""Circuit and noise budget of a design's board as it is wired and read."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from coilarray.circuit.network import Network
from coilarray.design.model import Design
from coilarray.design.scan_states import Switches
from coilarray.design.switch_parts import CONVERTER_PIN
from coilarray.hardware.scan.settings import ScanSettings

if TYPE_CHECKING:
    from coilarray.circuit.noise_budget import NoiseBudget


def board_network(design: Design, *, wired: bool = False) -> Network:
    """Return the circuit of a design, without switches if its coils are wired to the channels of a converter.

    A state of the design's plan without a resonance raises a NetworkError.
    """
    from coilarray.circuit.coupling import design_circuit

    network = design_circuit(design)
    return replace(network, switches=_without_switches(design)) if wired else network


def board_budget(design: Design, settings: ScanSettings, *, baseline_scans: int | None = None) -> NoiseBudget:
    """Return the noise budget of all states of a design.

    The board is read with the given settings, which determine the clock and the length of a conversion. Coefficients
    and changes are taken from the design's `Readout`. With `baseline_scans` for L_0 a reading is a single scan.
    Otherwise both numbers are taken from the design too.
    """
    from coilarray.circuit.noise_budget import noise_budget  # not needed by the emulator

    readout = replace(
        design.readout,
        rcount=settings.rcount,
        clock=settings.clock,
        external_clock=settings.external_clock,
        reference_divider=settings.fref_divider,
    )
    if baseline_scans is not None:
        readout = replace(readout, averaged_scans=1, baseline_scans=baseline_scans)
    return noise_budget(design, readout=readout, network=board_network(design, wired=settings.wired))


def _without_switches(design: Design) -> Switches:
    """Return leads and tank of a design.

    Of the capacitances of its part only the pins of the converter remain.
    """
    switches = replace(design.circuit.switches, on_resistance=0.0)
    if design.circuit.part is None:
        return switches
    bus = min(switches.bus_capacitance, CONVERTER_PIN)
    return replace(switches, off_capacitance=0.0, terminal_capacitance=0.0, bus_capacitance=bus)
