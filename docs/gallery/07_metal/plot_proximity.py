"""
An aluminium target comes nearer
================================

Inductance, losses, Q and frequency of a coil against the distance of an aluminium plate.
"""

import numpy as np

import coilarray as ca
from coilarray.viz import target_figure

design = ca.load_design("proximity")
target_figure(ca.target_map(design, distances=np.linspace(1e-3, 10e-3, 7)))
