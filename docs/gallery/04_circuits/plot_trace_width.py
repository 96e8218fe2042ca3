"""
Quality factor against the width of the trace
=============================================

Wider traces have less resistance, but move the inner turns towards the centre, where they add little inductance. A
sweep computes any quantity over an entry of the design. Dashed: the design as it is.
"""

import coilarray as ca
from coilarray.viz import plot_sweep_lines

design = ca.load_design("starter")
result = ca.sweep(design, {"coils.hexagon.trace_width_mm": [0.10, 0.12, 0.14, 0.16, 0.18]}, ["q"])
plot_sweep_lines(result, "q")
