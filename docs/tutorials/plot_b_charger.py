"""
A charger of three coils
========================

Three transmitters that do not couple to each other, and a receiver: how much power reaches it, and from which?
"""

import math

import matplotlib.pyplot as plt
import numpy as np

import coilarray as ca
from coilarray.studies.link import link, pose_grid

design = ca.load_design("charger")
L = ca.inductance_matrix(design.array)
print("L", (np.diag(L) * 1e6).round(3), "µH; k", ca.coupling_matrix(L)[np.triu_indices(3, 1)].round(4))

# %%
# Each is as large as the printed coil of the Qi transmitter A32, with the same twelve turns on two of the board's four
# layers. At a pitch of 27.5 mm neighbours overlap so far that they hardly couple: to 0.002, which 0.1 mm more or less
# changes by 0.003. The outer two do not overlap, and keep their k of −0.027.
#
# The receiver is moved over them, 4 mm from copper to copper, at 127.7 kHz. The largest efficiency that a pair of coils
# allows depends only on k and both quality factors; the other transmitters are open.

x, y = np.arange(-54, 55, 6) * 1e-3, np.arange(-24, 25, 8) * 1e-3
result = link(design, {"receiver": pose_grid(x=x, y=y, z=4e-3, turn_x=math.pi)})
efficiency = result.best_efficiency.assign_coords(pair=result.coil.values)
figure, axes = plt.subplots(2, 2, figsize=(9, 4.6), sharex=True, sharey=True, layout="constrained")
panels = {name: efficiency.sel(pair=name) for name in ("left", "middle", "right")}
panels["best of the three"] = efficiency.max("pair")
for ax, (name, values) in zip(axes.flat, panels.items(), strict=True):
    image = ax.contourf(x * 1e3, y * 1e3, values.T, np.linspace(0, 0.7, 15))
    for place in design.array.placements:
        ax.plot(*(place.to_board(place.coil.outline).T * 1e3), color="white", linewidth=0.6)
    ax.set(title=name, aspect="equal", xlim=(x[0] * 1e3, x[-1] * 1e3), ylim=(y[0] * 1e3, y[-1] * 1e3))
figure.supxlabel("x of the receiver (mm)")
figure.supylabel("y of the receiver (mm)")
figure.colorbar(image, ax=axes, label="largest efficiency")

# %%
# A transmitter alone serves the receiver near its own middle, and not at all where as much flux comes down through the
# receiver as goes up. The best of the three leaves no such place along the row:

row = efficiency.sel(y=0.0)
best = row.max("pair")[np.abs(x) < 37e-3]
print(f"best of the three, within 36 mm of the middle: {best.min().item():.0%} to {best.max().item():.0%}")

# %%
# The design's own ports have a source at the middle coil, a load of 2.2 Ω, and one standard capacitor in series with
# each coil. They are tuned for the receiver over the middle, and reach the largest efficiency there:

served = result.efficiency.squeeze().sel(y=0.0)
centre = np.argmin(np.abs(x))
print(f"{served[centre].item():.0%} of {row.sel(pair='middle')[centre].item():.0%}")

# %%
# The copper is 35 µm thick, as of common boards, so that the quality factors are only 8 to 9; chargers of litz wire
# over ferrite have more. Traces of 1.9 mm are wide at this frequency. L is that of uniform direct current. R has the
# skin and proximity effect within each board, but no losses in the copper of another board. The efficiencies are
# therefore upper limits.
#
# The receiver moves over the transmitters:
#
# .. film::
#
#    coilarray link charger --move receiver --x-mm -40:40:4 --film receiver.gif
