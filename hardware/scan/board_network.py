"""The circuit of a design with all losses and strays, as an emulated board and a simulation of a real one need it."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from coilarray.circuit.impedance import design_network, interpolated_resistance, resistance_near
from coilarray.circuit.network import Network, resonate
from coilarray.design.model import Design
from coilarray.hardware.scan.kept_parts import kept


def board_network(design: Design, folder: Path) -> Network:
    """Return the network of `coilarray.circuit.impedance.scan_design`: alternating-current resistances and all strays.

    Parameters
    ----------
    design : Design
        Of the board.
    folder : Path
        Where the parts are kept: 4 s of work for the six coils of gast2020.

    Raises
    ------
    NetworkError
        A state of the design's plan without a resonance.
    GeometryError
        As `coilarray.circuit.impedance.design_network`.
    """
    parts = kept(folder, "circuit", design, "", lambda: _circuit(design))
    return Network(
        design.array.names,
        parts.inductance.values,
        interpolated_resistance(parts.frequency.values, parts.resistance.values),
        parts.winding_capacitance.values,
        parts.mutual_capacitance.values,
        design.circuit.switches,
    )


def _circuit(design: Design) -> xr.Dataset:
    network = design_network(design).network
    found = [resonate(network, state).frequency for state in design.plan]
    frequency, resistance = resistance_near(design, found)
    pair = ("coil", "other")
    return xr.Dataset(
        {
            "inductance": (pair, network.inductance, {"units": "H"}),
            "resistance": (("frequency", *pair), resistance.resistance.values, {"units": "ohm"}),
            "winding_capacitance": ("coil", network.winding_capacitance, {"units": "F"}),
            "mutual_capacitance": (pair, network.mutual_capacitance, {"units": "F"}),
        },
        coords={"frequency": ("frequency", frequency, {"units": "Hz"})},
    )
