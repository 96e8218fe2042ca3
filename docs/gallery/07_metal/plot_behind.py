"""
Response with a backplane
=========================

An aluminium plate 2 mm below the board weakens the field, and with it δ.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import coilarray as ca

design = ca.load_design("starter")
underside = -design.array.stackup.thickness
x = np.linspace(-25e-3, 25e-3, 101)
figure, ax = plt.subplots(figsize=(7, 4), layout="constrained")
for gap in (None, 2e-3):
    plate = () if gap is None else (ca.Plate("backplane", underside - gap - 1e-3, 1e-3, ca.MATERIALS["aluminium"]),)
    response = ca.response_map(replace(design, plates=plate), depths=[1e-3], x=x, y=[0.0])
    label = "no plate" if gap is None else f"plate {gap * 1e3:g} mm below"
    ax.plot(x * 1e3, np.ravel(response.delta.sel(state="coil2")) * 1e4, label=label)
ax.set(xlabel="x (mm)", ylabel="δ of coil2 ($10^{-4}$)")
ax.legend()
