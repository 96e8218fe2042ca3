"""The circuit of a design with all losses and strays, as an emulated board and a simulation of a real one need it."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from coilarray.circuit.coupling import design_circuit
from coilarray.circuit.network import Network, SampledResistance
from coilarray.design.model import Design
from coilarray.hardware.scan.kept_parts import kept


def board_network(design: Design, folder: Path) -> Network:
    """Return `coilarray.circuit.coupling.design_circuit` of a design, kept on disk between runs.

    Parameters
    ----------
    design : Design
        Design of the board.
    folder : Path
        Folder where the network's parts are kept: 4 s of work for the six coils of gast2020.

    Raises
    ------
    NetworkError
        A state of the design's plan without a resonance.
    """
    parts = kept(folder, "circuit", design, "", lambda: _circuit(design))
    return Network(
        design.array.names,
        parts.inductance.values,
        SampledResistance(parts.frequency.values, parts.resistance.values),
        parts.winding_capacitance.values,
        parts.mutual_capacitance.values,
        design.circuit.switches,
        tuple(filter(None, parts.attrs["left_out"].split("\n"))),
    )


def _circuit(design: Design) -> xr.Dataset:
    network = design_circuit(design)
    resistance = network.resistance
    assert isinstance(resistance, SampledResistance)
    pair = ("coil", "other")
    return xr.Dataset(
        {
            "inductance": (pair, network.inductance, {"units": "H"}),
            "resistance": (("frequency", *pair), resistance.matrices, {"units": "ohm"}),
            "winding_capacitance": ("coil", network.winding_capacitance, {"units": "F"}),
            "mutual_capacitance": (pair, network.mutual_capacitance, {"units": "F"}),
        },
        coords={"frequency": ("frequency", resistance.frequencies, {"units": "Hz"})},
        attrs={"left_out": "\n".join(network.left_out)},
    )
