"""
Neighbours grounded or open
===========================

The effective inductance of every coil, its neighbours left open or grounded.
"""

import matplotlib.pyplot as plt
import numpy as np

import coilarray as ca

design = ca.load_design("gast2020")
names = list(design.array.names)
figure, ax = plt.subplots(figsize=(7, 4), layout="constrained")
for shift, (word, label) in enumerate((("open", "open"), ("short", "grounded"))):
    coupling = ca.couple_design(ca.vary(design, {"circuit.default_termination": word}))
    ax.bar(np.arange(len(names)) + 0.35 * shift, coupling.effective_inductance * 1e6, 0.35, label=label)
ax.set_xticks(np.arange(len(names)) + 0.18, names)
ax.set(ylabel="effective inductance (µH)", ylim=(90, None))
ax.legend(title="neighbours")
