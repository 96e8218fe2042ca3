"""
The worst margins of a board
============================

Every width, gap and hole against the limits of a board house; the picture shows the worst.
"""

import coilarray as ca
from coilarray.viz import check_figure

design = ca.load_design("starter")
margins = ca.check_rules(design.array, design.rules)
print(margins[0])
check_figure(design.array, margins)
