"""The circuit of a design with all losses and strays, for an emulated board and for the simulation of a real one."""

from __future__ import annotations

import xarray as xr

from coilarray.circuit.network import Network, SampledMatrix
from coilarray.compute.store import Store
from coilarray.design.model import Design


def board_network(design: Design, store: Store) -> Network:
    """Return `coilarray.circuit.coupling.design_circuit` of a design, which takes 4 s for gast2020, kept in a store.

    NetworkError for a state of the design's plan without a resonance.
    """
    parts = store.dataset(["circuit", design.digest], lambda: _circuit(design))
    return Network(
        design.array.names,
        parts.inductance.values,
        SampledMatrix(parts.frequency.values, parts.resistance.values),
        parts.winding_capacitance.values,
        parts.mutual_capacitance.values,
        design.circuit.switches,
        tuple(filter(None, parts.attrs["left_out"].split("\n"))),
        SampledMatrix(parts.frequency.values, parts.dispersion.values) if "dispersion" in parts else None,
    )


def _circuit(design: Design) -> xr.Dataset:
    from coilarray.circuit.coupling import design_circuit

    network = design_circuit(design)
    resistance = network.resistance
    assert isinstance(resistance, SampledMatrix)
    pair = ("coil", "other")
    dispersion = {} if network.dispersion is None else {"dispersion": network.dispersion.matrices}  # at those of R
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
