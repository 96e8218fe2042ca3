"""
Neighbours grounded or open
===========================

The effective inductance of every coil with the others open and grounded: the currents in grounded coils lower it.
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
