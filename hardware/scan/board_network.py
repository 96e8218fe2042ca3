"""The circuit of a design with all losses and strays, for an emulated board and for the simulation of a real one."""

from __future__ import annotations

import xarray as xr

from coilarray.circuit.impedance import design_network, interpolated_resistance, resistance_near
from coilarray.circuit.network import Network, resonate
from coilarray.compute.store import Store
from coilarray.design.model import Design


def board_network(design: Design, store: Store) -> Network:
    """Return the network of `coilarray.circuit.impedance.scan_design`: alternating-current resistances and all strays.

    Parameters
    ----------
    design : Design
        Design of the board.
    store : Store
        Store of the matrices, which take 4 s to compute for the six coils of gast2020.

    Raises
    ------
    NetworkError
        A state of the design's plan without a resonance.
    GeometryError
        Conductors for which the matrices cannot be computed.
    """
    parts = store.dataset(["circuit", design.digest], lambda: _circuit(design))
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
    found = [resonate(network, state).frequency for state in design.circuit.plan]
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
