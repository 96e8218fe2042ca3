"""
Steel against aluminium
=======================

The same plate of two metals: eddy currents lower L and Q; in steel, whose permeability works against them, L changes
less, and Q falls the most.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import coilarray as ca
from coilarray.circuit.coupling import design_circuit

design = ca.load_design("proximity")
network = design_circuit(design)
distances = np.geomspace(1e-3, 12e-3, 6)
figure, axes = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
for name in ("aluminium", "steel"):
    target = replace(design.target, body=replace(design.target.body, material=ca.MATERIALS[name]))
    found = ca.target_map(replace(design, target=target), distances=distances, network=network)
    for ax, quantity, scale in zip(axes, ("effective_inductance", "quality_factor"), (1e6, 1), strict=True):
        ax.plot(distances * 1e3, np.ravel(found[quantity]) * scale, "o-", label=ca.MATERIALS[name].words)
axes[0].set(xlabel="distance (mm)", ylabel="effective inductance (µH)")
axes[1].set(xlabel="distance (mm)", ylabel="Q")
axes[0].legend()
