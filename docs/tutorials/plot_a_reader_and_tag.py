"""
A reader and its tag
====================

How far does a 13.56 MHz reader couple to a card, what do shift and tilt change, and where does a match hold?
"""

import math

import matplotlib.pyplot as plt
import numpy as np

import coilarray as ca
from coilarray.studies.link import link, pose_grid

design = ca.load_design("nfc_reader")
result = link(design, {"card": pose_grid(z=np.arange(5e-3, 81e-3, 5e-3), turn_x=math.pi)})
plt.semilogy(result.z * 1e3, abs(result.coupling), "o-")
plt.gca().set(xlabel="distance (mm)", ylabel="magnitude of k")

# %%
# The bundled design ``nfc_reader`` is an antenna of 50 mm × 40 mm, over which it places ``nfc_card``, of the size of a
# credit card. ``coilarray link nfc_reader --move card --z-mm 5:80:5`` is the same in the terminal. k is right to 10⁻⁴.
# It is negative, as the card lies upside down.

for height in (5e-3, 20e-3, 80e-3):
    print(f"k {result.coupling.sel(z=height, method='nearest').item():.4f} at {height * 1e3:g} mm")

# %%
# Both antennas have four turns of 0.5 mm. The sum over the rectangles of all turns, by Grover's formula for parallel
# filaments, differs by 0.3 % and less from these inductances; it has sharp corners and no leads.

L = ca.inductance_matrix(design.conductors())
print(f"reader {L[0, 0] * 1e6:.3f} µH, card {L[1, 1] * 1e6:.3f} µH")

# %%
# Shift and tilt
# --------------
#
# Beside the reader the flux comes down again: where the card links as much downwards as upwards, it gets nothing,
# though it is near. A tilted card brings an edge nearer, so that k even grows at first; on edge it gets nothing.

shifts, tilts = np.arange(0, 81e-3, 4e-3), np.radians(np.arange(0, 91, 7.5))
shifted = link(design, {"card": pose_grid(x=shifts, z=20e-3, turn_x=math.pi)}).coupling[:, 0]
tilted = link(design, {"card": pose_grid(z=50e-3, turn_x=math.pi, turn_y=tilts)}).coupling[:, 0]
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
left.plot(shifts * 1e3, shifted, "o-")
right.plot(np.degrees(tilts), tilted, "o-")
right.plot(np.degrees(tilts), tilted[0].item() * np.cos(tilts), ":", label="cosine")
left.set(xlabel="shift at 20 mm (mm)", ylabel="k")
right.set(xlabel="tilt at 50 mm (degrees)", ylabel="k")
right.legend()
print(f"no coupling at a shift of {np.interp(0.0, shifted, shifts) * 1e3:.0f} mm")

# %%
# Matching
# --------
#
# A capacitor across the reader's coil and another in series make it look like the 50 Ω of its source at one distance.
# ``coilarray impedance nfc_reader --ports --match L --series E24`` finds the two for the distance of the design, 20 mm.
# Here are those for three distances. The card's own capacitor tunes it, and its chip is a load of 2 kΩ.

file = ca.load_design_file("nfc_reader")
figure, ax = plt.subplots(figsize=(7, 4), layout="constrained")
for matched_at, series, parallel in ((15, 72.3, 5.1), (20, 55.1, 23.7), (40, 22.9, 56.2)):
    ports = {"circuit.ports.reader.series_pF": series, "circuit.ports.reader.parallel_pF": parallel}
    there = link(ca.vary(file, ports), {"card": pose_grid(z=result.z, turn_x=math.pi)})
    ax.plot(result.z * 1e3, there.available_efficiency.squeeze(), "o-", label=f"matched at {matched_at} mm")
ax.plot(result.z * 1e3, result.best_efficiency.squeeze(), "k:", label="best network for each distance")
ax.set(xlabel="distance (mm)", ylabel="share of the available power in the chip")
ax.legend()

# %%
# Nearer than its match the card couples too much: the resonance splits, and the reader becomes more than 50 Ω. Farther
# away it couples too little. The match at 40 mm reaches farthest, and gives the least close by. Nearer than some 14 mm
# no two capacitors match 50 Ω.
#
# The losses are those of the copper, to some percent. Those of the laminate, and of the resistors that make the band of
# a reader broader, are left out: real shares are smaller.
#
# The card comes nearer:
#
# .. film::
#
#    coilarray link nfc_reader --move card --z-mm 60:5:-2.5 --film card.gif
