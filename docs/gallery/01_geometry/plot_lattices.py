"""
Rows, squares, rings
====================

One coil at every point of a lattice. Neighbours that overlap lie on different layers, drawn in two colours.
"""

import matplotlib.pyplot as plt

import coilarray as ca
from coilarray.viz import plot_board

board = ca.Stackup.uniform(("L1", "L2", "L3", "L4"))
coil = ca.Spiral(sides=6, diameter=16e-3, turns=12, width=0.15e-3, gap=0.15e-3, leads=None)
layers = (("L1", "L2"), ("L3", "L4"))
lattices = (
    ca.Lattice("linear", pitch=13e-3, columns=4, layers=layers),
    ca.Lattice("square", pitch=19e-3, columns=3, rows=3, layers=(("L1", "L2"),)),
    ca.Lattice("rings", pitch=19e-3, rings=1, layers=(("L1", "L2"),)),
)
figure, axes = plt.subplots(1, 3, figsize=(11, 4), width_ratios=(1.2, 1, 1), layout="constrained")
for ax, lattice in zip(axes, lattices, strict=True):
    plot_board(ca.lattice_array(board, coil, lattice), ax)
    ax.set_title(lattice.kind, loc="left")
    ax.get_legend().remove()
