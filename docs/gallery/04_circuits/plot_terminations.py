"""
Neighbours grounded or open
===========================

The effective inductance of every coil, its neighbours left open or grounded.
"""

import matplotlib.pyplot as plt

import coilarray as ca

design = ca.load_design("gast2020")
figure, ax = plt.subplots(figsize=(7, 4), layout="constrained")
for word, label in (("open", "open"), ("short", "grounded")):
    coupling = ca.couple_design(ca.vary(design, {"circuit.default_termination": word}))
    ax.plot(design.array.names, coupling.effective_inductance * 1e6, "o", label=label)
ax.set(ylabel="effective inductance (µH)")
figure.legend(title="neighbours", loc="outside right upper")
