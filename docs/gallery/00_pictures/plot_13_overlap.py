"""
Flux through an overlap where k is zero
=======================================

B_z of the left coil in the plane of the right one, at the distance where their coupling vanishes. The turns
of the right coil enclose as much flux upwards in the overlap as downwards in the rest of it.
"""

import matplotlib.pyplot as plt
import numpy as np

import coilarray as ca

coil = ca.Spiral(sides=6, diameter=20e-3, turns=12, width=0.2e-3, gap=0.2e-3, layers=2, leads=None)
pitches = np.linspace(12e-3, 17e-3, 11)
k = [float(ca.Array.row(coil, 2, pitch=pitch).coupling[0, 1]) for pitch in pitches]
pitch = float(np.interp(0.0, k[::-1], pitches[::-1]))  # k falls with the distance
pair = ca.Array.row(coil, 2, pitch=pitch)
x, y = np.linspace(-22e-3, 26e-3, 241), np.linspace(-14e-3, 14e-3, 141)
X, Y = np.meshgrid(x, y)
points = np.column_stack((X.ravel(), Y.ravel(), np.full(X.size, -pair.stackup.thickness / 2)))
B = pair.field(points, [1e-3, 0.0])[:, 2].reshape(X.shape) * 1e6

figure, ax = plt.subplots(figsize=(8, 4.6), layout="constrained")
image = ax.pcolormesh(x * 1e3, y * 1e3, B, cmap="RdBu_r", vmin=-4, vmax=4)
for number, place in enumerate(pair.placements):
    outline = place.to_board(place.coil.outline)
    ax.fill(*outline.T * 1e3, fill=False, linewidth=2.5, edgecolor="black", linestyle="-" if number else "--")
ax.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal", title=f"k = 0 at a pitch of {pitch * 1e3:.2f} mm")
figure.colorbar(image, label="B_z of the left coil (µT at 1 mA)")
