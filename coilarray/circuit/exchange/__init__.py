"""Exchange with SPICE, FastHenry and Touchstone files."""

from __future__ import annotations

from coilarray.circuit.exchange.fasthenry import fasthenry_input, read_fasthenry_input, read_zc_matrix
from coilarray.circuit.exchange.network_file import exchange_frequencies, export_network
from coilarray.circuit.exchange.spice import plain_names, spice_subcircuit
from coilarray.circuit.exchange.touchstone import touchstone

__all__ = [
    "exchange_frequencies",
    "export_network",
    "fasthenry_input",
    "plain_names",
    "read_fasthenry_input",
    "read_zc_matrix",
    "spice_subcircuit",
    "touchstone",
]
