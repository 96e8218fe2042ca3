"""
A wireless link
===============

Two coils face each other, each with a series capacitor for 6.78 MHz. Coupled this closely their common resonance
splits in two (dotted). Between them a source of 2 Ω passes little of its available power to the load, but most of what
enters at the coil arrives.
"""

import numpy as np

import coilarray as ca
from coilarray.circuit.ports import solve_ports
from coilarray.design.ports import Port
from coilarray.viz import ports_figure

coil = ca.Spiral(sides=4, diameter=30e-3, turns=6, width=0.6e-3, gap=0.4e-3, layers=1)
C = 1 / ((2 * np.pi * 6.78e6) ** 2 * coil.inductance)
ports = Port("coil1", 2.0, None, C), Port("receiver/coil1", None, 2.0, C)
board = ca.Array.row(coil, 1)
receiver = ca.Board(board, ca.Pose(z=10e-3), "receiver")
design = ca.Design(board, boards=(receiver,), circuit=ca.Circuit(ports=ports, link_frequency=6.78e6))
ports_figure(solve_ports(design, np.linspace(5e6, 9e6, 201)))
