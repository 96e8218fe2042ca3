"""
A flower of seven decoupled coils
=================================

Seven hexagonal coils around a middle one, moved together until neighbours do not couple.
"""

import numpy as np

import coilarray as ca
from coilarray.viz import plot_board, plot_coupling

# %%
# This makes the design. The same in the terminal, which writes it as a file:
#
# .. code-block:: sh
#
#    coilarray init flower.toml --coils 7-hex --size-mm 18 --inductance-uH 18 --overlap decoupled --no-elastomer

made = ca.new_design("flower", "7-hex", size=18e-3, inductance=18e-6, overlap="decoupled", elastomer=False)
array = made.design.array
layers = made.document["coils"]["hexagon"]["winding_layers"]
print(f"pitch {made.document['array']['pitch_mm']:.2f} mm")
print(f"{layers} layers for each coil, {len(array.stackup.names)} copper layers in all")
plot_board(array)

# %%
# Coils that overlap must not share a copper layer. Any three neighbours overlap each other, so the board needs three
# times the layers of one coil. Some neighbours are further apart in height than others, so one pitch cannot make all of
# their couplings zero at once.

coupling = ca.couple_design(made.design)
plot_coupling(coupling)

# %%
values = np.abs(coupling.coupling.values[~np.eye(7, dtype=bool)])
print(f"largest |k| {values.max():.4f}, root mean square {np.sqrt((values**2).mean()):.4f}")

# %%
# The largest is that of coils two places apart in the ring, coil2 and coil4 for example, which no overlap cancels. For
# comparison, side by side without overlap:

apart = ca.vary(made, {"array.pitch_mm": 19.0})
values = np.abs(ca.couple_design(apart).coupling.values[~np.eye(7, dtype=bool)])
print(f"at a pitch of 19 mm: largest |k| {values.max():.4f}")
