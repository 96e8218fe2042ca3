"""
Coupling matrix of six coils
============================

Neighbours that overlap by the right amount do not couple; here they are a little too close.
"""

import coilarray as ca
from coilarray.viz import plot_coupling

plot_coupling(ca.couple_design(ca.load_design("gast2020")))
