"""
The largest coupling over two entries
=====================================

The largest magnitude of k of any pair of coils in a row, over their pitch and their turns. The diamond is the design
as it is.
"""

import coilarray as ca
from coilarray.viz import plot_sweep_map

entries = {"array.pitch_mm": [11, 12, 13, 14, 15, 16], "coils.hexagon.turns_per_layer": [6, 8, 10, 12]}
result = ca.sweep(ca.load_design("starter"), entries, ["worst_k"], accuracy="screen")
plot_sweep_map(result, "worst_k")
