"""
Flux through an overlap where k is zero
=======================================

The left coil carries a current, at the distance where its coupling to the right coil vanishes. Above, B_z in the plane
of the right coil: its turns enclose as much flux upwards in the overlap as downwards in the rest of it. Below, lines of
B in the section through both middles: what rises through the overlap comes back through the right coil beside it.
"""

import matplotlib.pyplot as plt
import numpy as np

import coilarray as ca

coil = ca.Spiral(sides=6, diameter=20e-3, turns=12, width=0.2e-3, gap=0.2e-3, layers=2, leads=None)
pitches = np.linspace(12e-3, 17e-3, 11)
k = [float(ca.Array.row(coil, 2, pitch=pitch).coupling[0, 1]) for pitch in pitches]
pitch = float(np.interp(0.0, k[::-1], pitches[::-1]))  # k falls with the distance
pair = ca.Array.row(coil, 2, pitch=pitch)
middle = float(pair.conductors()[1].vertices[:, 2].mean())
x, y, z = np.linspace(-22e-3, 26e-3, 241), np.linspace(-13e-3, 13e-3, 131), np.linspace(-9e-3, 9e-3, 91) + middle


def field_on(y, z):
    X, Y, Z = np.meshgrid(x, y, z, indexing="ij")
    field = pair.field(np.column_stack((X.ravel(), Y.ravel(), Z.ravel())), [1e-3, 0.0]) * 1e6
    return field.reshape(*X.shape, 3).squeeze().transpose(1, 0, 2)


level, upright = field_on(y, middle), field_on(0.0, z)
figure, (ax, section) = plt.subplots(
    2, 1, figsize=(8, 7.6), sharex=True, layout="constrained", height_ratios=(26, 18), gridspec_kw={"hspace": 0.0}
)
image = ax.pcolormesh(x * 1e3, y * 1e3, level[..., 2], cmap="RdBu_r", vmin=-3, vmax=3)
figure.colorbar(image, ax=ax, label="B_z of the left coil (µT at 1 mA)")
section.streamplot(
    x * 1e3,
    z * 1e3,
    upright[..., 0],
    upright[..., 2],
    color="#8a8a8a",
    linewidth=0.9,
    density=0.55,
    broken_streamlines=False,
)
for number, (place, path) in enumerate(zip(pair.placements, pair.conductors(), strict=True)):
    outline = place.to_board(place.coil.outline)
    ax.fill(*outline.T * 1e3, fill=False, linewidth=2.5, edgecolor="black", linestyle="-" if number else "--")
    start, end = path.vertices[:-1], path.vertices[1:]
    crossing = start[:, 1] * end[:, 1] < 0
    share = (start[crossing, 1] / (start[crossing, 1] - end[crossing, 1]))[:, None]
    turns = start[crossing] + share * (end[crossing] - start[crossing])
    section.plot(*turns[:, [0, 2]].T * 1e3, "s", markersize=2.6, color=("#B5652B", "#202020")[number])
ax.set(ylabel="y (mm)", aspect="equal", title=f"k = 0 at a pitch of {pitch * 1e3:.2f} mm")
section.set(xlabel="x (mm)", ylabel="z (mm)", aspect="equal", title="at y = 0; brown: the coil with the current")
