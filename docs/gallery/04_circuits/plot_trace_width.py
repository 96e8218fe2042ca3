"""
Quality factor against the width of the trace
=============================================

Wider traces have less resistance until the turns no longer fit; a sweep of a design's entries computes any quantity.
"""

import coilarray as ca
from coilarray.viz import plot_sweep_lines

design = ca.load_design("starter")
result = ca.sweep(design, {"coils.hexagon.trace_width_mm": [0.10, 0.12, 0.14, 0.16, 0.18]}, ["q"])
plot_sweep_lines(result, "q")
