"""
Decoupling by overlap, and why
==============================

The coupling of two coils on different layers, as one is moved over the other: it has a zero.
"""

import matplotlib.pyplot as plt
import numpy as np

import coilarray as ca
from coilarray.viz import plot_field_map

board = ca.Stackup.uniform(("L1", "L2", "L3", "L4"))
coil = ca.Spiral(sides=6, diameter=20e-3, turns=12, width=0.2e-3, gap=0.2e-3, leads=None)


def pair(pitch):
    """Return two coils at a distance."""
    return ca.lattice_array(board, coil, ca.Lattice("linear", pitch, columns=2, layers=(("L1", "L2"), ("L3", "L4"))))


pitches = np.linspace(8e-3, 26e-3, 19)
k = [ca.coupling_matrix(ca.inductance_matrix(pair(pitch).conductors()))[0, 1] for pitch in pitches]
zero = float(np.interp(0.0, -np.array(k[:12]), pitches[:12]))
figure, ax = plt.subplots(figsize=(7, 4), layout="constrained")
ax.axhline(0, color="grey", linewidth=0.8)
ax.axvline(zero * 1e3, color="grey", linestyle=":")
ax.plot(pitches * 1e3, k, "o-")
ax.set(xlabel="pitch (mm)", ylabel="coupling coefficient k", title=f"zero at {zero * 1e3:.2f} mm")

# %%
# The flux of the first coil goes up inside of it and comes down outside. A second coil beside it links the flux that
# comes down, so that k is negative. A second coil on top of it links the flux that goes up, so that k is positive. In
# between there is a place where both parts are equal and cancel: k is zero.

design = ca.Design(pair(zero))
coupling = ca.couple_design(design, ideal=True)
x_min, y_min, x_max, y_max = design.array.bounds
field = ca.operating_field(
    design, coupling, "coil1", np.linspace(x_min, x_max, 140), np.linspace(y_min, y_max, 90), 0.5e-3, terminated=False
)
plot_field_map(field, outlines=[place.to_board(place.coil.outline) for place in design.array.placements])

# %%
# Beyond that pitch k has a minimum. Far away it falls off with the third power of the distance, as the field of a
# dipole does.

far = np.array([40e-3, 80e-3, 160e-3])
values = [ca.coupling_matrix(ca.inductance_matrix(pair(pitch).conductors()))[0, 1] for pitch in far]
print("exponent of k from 40 to 80 and from 80 to 160 mm:", np.round(np.diff(np.log2(np.abs(values))), 2))
