"""
Grounded neighbours narrow the field
====================================

A driven coil induces currents in its shorted neighbours. Their field makes that of the coil narrower: B above the
board with the neighbours open, and with them grounded.
"""

import numpy as np

import coilarray as ca
from coilarray.viz import plot_field_lines

design = ca.load_design("gast2020")
coupling = ca.couple_design(design)
x0, y0 = design.array.centres[2]
x = np.linspace(x0 - 35e-3, x0 + 35e-3, 401)
fields = {
    label: ca.operating_field(design, coupling, "coil3", x, y0, 4e-3, terminated=grounded)
    for label, grounded in (("others open", False), ("others grounded", True))
}
plot_field_lines(fields)
