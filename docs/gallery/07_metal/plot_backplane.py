"""
A steel or aluminium backplane
==============================

Inductance of a coil with a metal plate below the board, against the distance of the plate.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import coilarray as ca

design = ca.load_design("starter")
gaps = np.array([1, 2, 4, 8, 16]) * 1e-3
underside = -design.array.stackup.thickness
figure, ax = plt.subplots(figsize=(7, 4), layout="constrained")
for name in ("aluminium", "steel"):
    found = []
    for gap in gaps:
        plate = ca.Plate("backplane", underside - gap - 1e-3, 1e-3, ca.MATERIALS[name])
        beside = replace(design, plates=(plate,))
        found.append(float(ca.couple_design(beside).open_inductance[0]))
    ax.semilogx(gaps * 1e3, np.array(found) * 1e6, "o-", label=name)
ax.set(xlabel="gap (mm)", ylabel="inductance (µH)", xticks=gaps * 1e3, xticklabels=[f"{gap * 1e3:g}" for gap in gaps])
ax.legend()
