"""Circuit and noise budget of a design's board.

The circuit has all losses and strays. It serves an emulated board and the simulation of a real board. The noise budget
holds for the settings with which the board is read.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import xarray as xr

from coilarray.circuit.network import Network, SampledMatrix
from coilarray.compute.store import Store
from coilarray.design.model import Design
from coilarray.design.scan_states import Switches
from coilarray.design.switch_parts import CONVERTER_PIN
from coilarray.hardware.scan.settings import ScanSettings

if TYPE_CHECKING:
    from coilarray.circuit.noise_budget import NoiseBudget


def board_network(design: Design, store: Store, *, wired: bool = False) -> Network:
    """Return the circuit of a design from a store.

    It is `coilarray.circuit.coupling.design_circuit`, which takes 4 s for gast2020. If the coils are `wired` to the
    channels of a converter, no switches are in their way, whatever the design has. A state of the design's plan without
    a resonance raises a NetworkError.
    """
    parts = store.dataset(["circuit", design.digest], lambda: _circuit(design))
    return Network(
        design.array.names,
        parts.inductance.values,
        SampledMatrix(parts.frequency.values, parts.resistance.values),
        parts.winding_capacitance.values,
        parts.mutual_capacitance.values,
        _without_switches(design) if wired else design.circuit.switches,
        tuple(filter(None, parts.attrs["left_out"].split("\n"))),
        SampledMatrix(parts.frequency.values, parts.dispersion.values) if "dispersion" in parts else None,
    )


def board_budget(
    design: Design, settings: ScanSettings, store: Store, *, baseline_scans: int | None = None
) -> NoiseBudget:
    """Return the noise budget of all states of a design.

    The board is read with the given settings, which determine the clock and the length of a conversion. Coefficients
    and changes are taken from the design's `Readout`. `store` has the same meaning as in `board_network`. With
    `baseline_scans` for L_0 a reading is a single scan. Otherwise both numbers are taken from the design too.
    """
    from coilarray.circuit.noise_budget import noise_budget  # not needed by the emulator

    readout = replace(
        design.readout, rcount=settings.rcount, clock=settings.clock, external_clock=settings.external_clock,
        reference_divider=settings.fref_divider,
    )  # fmt: skip
    if baseline_scans is not None:
        readout = replace(readout, averaged_scans=1, baseline_scans=baseline_scans)
    return noise_budget(design, readout=readout, network=board_network(design, store, wired=settings.wired))


def _without_switches(design: Design) -> Switches:
    """Return leads and tank of a design.

    Of the capacitances of its part only the pins of the converter remain.
    """
    switches = replace(design.circuit.switches, on_resistance=0.0)
    if design.circuit.part is None:
        return switches
    bus = min(switches.bus_capacitance, CONVERTER_PIN)
    return replace(switches, off_capacitance=0.0, terminal_capacitance=0.0, bus_capacitance=bus)


def _circuit(design: Design) -> xr.Dataset:
    """Compute the circuit of a design as a dataset."""
    from coilarray.circuit.coupling import design_circuit

    network = design_circuit(design)
    resistance = network.resistance
    assert isinstance(resistance, SampledMatrix)
    pair = ("coil", "other")
    dispersion = {} if network.dispersion is None else {"dispersion": network.dispersion.matrices}  # at the R samples
    return xr.Dataset(
        {
            "inductance": (pair, network.inductance, {"units": "H"}),
            "resistance": (("frequency", *pair), resistance.matrices, {"units": "ohm"}),
            "winding_capacitance": ("coil", network.winding_capacitance, {"units": "F"}),
            "mutual_capacitance": (pair, network.mutual_capacitance, {"units": "F"}),
            **{name: (("frequency", *pair), matrices, {"units": "H"}) for name, matrices in dispersion.items()},
        },
        coords={"frequency": ("frequency", resistance.frequencies, {"units": "Hz"})},
        attrs={"left_out": "\n".join(network.left_out)},
    )
