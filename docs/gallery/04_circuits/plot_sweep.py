"""
Inductance and resistance over frequency
========================================

Skin and proximity effect raise the resistance; the capacitance of the winding makes the inductance rise towards the
self-resonance.
"""

import numpy as np

import coilarray as ca
from coilarray.viz import frequency_figure

design = ca.load_design("starter")
scan = ca.scan_design(design)
sweep = ca.sweep_design(design, np.geomspace(0.2e6, 15e6, 40))
frequency_figure(sweep, scan)
