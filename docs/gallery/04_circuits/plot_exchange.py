"""
The array in a circuit simulator
================================

A SPICE subcircuit and a Touchstone file of the coils; the latter is read again and gives the impedance of every coil
with the others open, up to the self-resonance.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import skrf

import coilarray as ca
from coilarray.circuit.coupling import design_circuit
from coilarray.circuit.network_files import export_network

network = design_circuit(ca.load_design("starter"))
with tempfile.TemporaryDirectory() as folder:
    export_network(network, Path(folder) / "coils.cir")
    print(*[line for line in (Path(folder) / "coils.cir").read_text().splitlines() if line[0] in "*LK"][:9], sep="\n")
    export_network(network, Path(folder) / "coils.s3p", np.geomspace(0.5e6, 50e6, 1001))
    read = skrf.Network(str(Path(folder) / "coils.s3p"))
figure, ax = plt.subplots(figsize=(7, 4), layout="constrained")
for port, name in enumerate(network.names):
    ax.loglog(read.f / 1e6, abs(read.z[:, port, port]), label=name)
ax.set(xlabel="frequency (MHz)", ylabel="|Z| (Ω), others open")
ax.legend()
