"""
Currents in grounded neighbours
===============================

While one coil of the six is driven, its shorted neighbours carry a twelfth of its current in antiphase; the coils two
places away carry less, in phase.
"""

import coilarray as ca
from coilarray.viz import plot_currents

plot_currents(ca.couple_design(ca.load_design("gast2020")))
