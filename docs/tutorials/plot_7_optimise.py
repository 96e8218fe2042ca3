"""
Optimise a layout
=================

An optimisation changes entries of a design until a quantity is as good as it gets: here the strongest coupling of any
two coils.
"""

import tempfile
from pathlib import Path

import coilarray as ca
from coilarray.cli.main import main
from coilarray.viz import boards_figure, plot_sweep_lines

# %%
# First a look around
# -------------------
#
# ``coilarray sweep`` computes quantities of a design over any of its entries. More than twenty are to be had:
# couplings, inductance, quality factor, margins of fabrication, response, errors of position.

design = ca.load_design_file("starter")
around = ca.sweep(design, {"array.pitch_mm": [9.0, 10.0, 11.0, 12.0, 13.0]}, ["worst_k", "q"])
plot_sweep_lines(around, "worst_k")

# %%
# Then the search
# ---------------
#
# ``coilarray optimize DESIGN GOAL`` takes a goal from a file, or one that comes with the package and derives its ranges
# from the design. A simple one can be said on the command line, as here: an entry with its range, and what is to
# become small. The design as it was is the first trial, so that the result is never worse. A search that is interrupted
# goes on where it was.

folder = Path(tempfile.mkdtemp()) / "better"
line = "optimize starter --vary array.pitch_mm=9:13 --goal worst_k --trials 12 --workers 1"
main([*line.split(), "--out", str(folder)])

# %%
# The folder has a report, the trials, and the best design:

best = ca.load_design(folder / "best.toml")
boards_figure({"before": design.design.array, "best": best.array})
