"""
Currents in grounded neighbours
===============================

While one coil of the six is driven, those beside it, which are shorted, carry a twelfth of its current in antiphase;
the next but one carry less, in phase.
"""

import coilarray as ca
from coilarray.viz import plot_currents

plot_currents(ca.couple_design(ca.load_design("gast2020")))
