"""
Decoupling by overlap
=====================

Coupling coefficient k of two hexagonal coils, 20 mm wide, against their distance. Where they overlap by about a third
of their width, the flux through the overlap cancels the flux outside it, and k is zero.
"""

import matplotlib.pyplot as plt
import numpy as np

import coilarray as ca

board = ca.Stackup.uniform(("L1", "L2", "L3", "L4"))
coil = ca.Spiral(sides=6, diameter=20e-3, turns=12, width=0.2e-3, gap=0.2e-3, leads=None)
pitches = np.linspace(10e-3, 24e-3, 15)
k = []
for pitch in pitches:
    pair = ca.Lattice("linear", pitch, columns=2, layers=(("L1", "L2"), ("L3", "L4")))
    matrix = ca.inductance_matrix(ca.lattice_array(board, coil, pair).conductors())
    k.append(ca.coupling_matrix(matrix)[0, 1])
figure, ax = plt.subplots(figsize=(7, 4), layout="constrained")
ax.axhline(0, color="grey", linewidth=0.8)
ax.plot(pitches * 1e3, k, "o-")
ax.set(xlabel="pitch (mm)", ylabel="coupling coefficient k")
