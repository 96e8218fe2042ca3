"""
Coils of a given inductance
===========================

`new_design` finds the number of turns, trace width, layers and pitch with which a board house can make the board and
the converter can read it; `coilarray init` does the same in the terminal.
"""

import coilarray as ca
from coilarray.viz import plot_copper

made = ca.new_design("flower", "7-hex", size=14e-3, inductance=12e-6, elastomer=False)
spiral = made.document["coils"]["hexagon"]
print(f"{spiral['turns_per_layer']} turns on each of {spiral['winding_layers']} layers")
inductance = ca.couple_design(made.design, ideal=True).open_inductance.values
print((inductance * 1e6).round(2), "µH")
plot_copper(made.design.array, made.design.array.stackup.names[0])
