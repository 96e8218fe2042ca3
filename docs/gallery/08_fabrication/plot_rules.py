"""
The worst margins of a board
============================

Every width, gap and hole is compared with the limits of a board house. Circles mark the places nearest to a limit, one
row for each layer; at the right, the nearest of that layer.
"""

import coilarray as ca
from coilarray.viz import check_figure

design = ca.load_design("starter")
margins = ca.check_rules(design.array, design.rules)
worst = min((one for one in margins if one.unit == "m"), key=lambda one: one.margin)
print(f"{worst.rule}: {worst.value * 1e3:.3f} mm, the limit is {worst.limit * 1e3:.3f} mm")
check_figure(design.array, margins)
