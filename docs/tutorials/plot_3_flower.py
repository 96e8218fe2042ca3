"""
A flower of seven decoupled coils
=================================

Seven hexagonal coils around a middle one, moved together until neighbours do not couple.
"""

import numpy as np

import coilarray as ca
from coilarray.viz import plot_copper, plot_coupling

# %%
# ``coilarray init flower.toml --coils 7-hex --overlap decoupled --inductance-uH 18``

made = ca.new_design("flower", "7-hex", size=18e-3, inductance=18e-6, overlap="decoupled", elastomer=False)
array = made.design.array
print(f"pitch {made.document['array']['pitch_mm']:.2f} mm, {len(array.stackup.names)} copper layers")
plot_copper(array, array.stackup.names[0])

# %%
# Coils that overlap must not share copper, so that the three neighbours that meet in a point take three pairs of
# layers. Neighbours on different pairs of layers have slightly different distances: one pitch cannot make all of their
# couplings zero at once.

coupling = ca.couple_design(made.design)
plot_coupling(coupling)

# %%
values = np.abs(coupling.coupling.values[~np.eye(7, dtype=bool)])
print(f"largest |k| {values.max():.4f}, root mean square {np.sqrt((values**2).mean()):.4f}")

# %%
# Without the overlap, side by side:

apart = ca.vary(made, {"array.pitch_mm": 19.0})
values = np.abs(ca.couple_design(apart).coupling.values[~np.eye(7, dtype=bool)])
print(f"at a pitch of 19 mm: largest |k| {values.max():.4f}")
