"""
Leads to a connector
====================

`route_leads` routes the leads of all coils to one row of pads at an edge of the board, without a crossing.
"""

import coilarray as ca
from coilarray.viz import plot_copper

made = ca.new_design("strip", "4", size=12e-3, connector="bottom", elastomer=False)
array = made.design.array
plot_copper(array, array.stackup.names[0])
