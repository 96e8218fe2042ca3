"""
A layout with a smaller error of position
=========================================

An optimisation changes entries of a design until a quantity is as good as it gets.
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
# The Cramér–Rao bound of the position against the pitch: a layout can be judged before there is any board, or any estimator.

design = ca.load_design_file("starter")
around = ca.sweep(design, {"array.pitch_mm": [10.0, 12.0, 14.0]}, ["position_error_mm", "worst_k"])
plot_sweep_lines(around, "position_error_mm")

# %%
# Then the search
# ---------------
#
# ``coilarray optimize DESIGN GOAL`` takes a goal from a file, or one that comes with the package and derives its ranges from the design. A simple one
# can be said on the command line, as here: two entries with their ranges, and what is to become small. The design as it was is the first trial, so
# that the result is never worse. A search that is interrupted goes on where it was.

folder = Path(tempfile.mkdtemp()) / "better"
line = "optimize starter --vary array.pitch_mm=10:14 --vary elastomer.0.thickness_mm=2:4"
main([*line.split(), "--goal", "minimize position_error_mm", "--trials", "6", "--workers", "1", "--out", str(folder)])

# %%
# The folder has a report, the trials, and the best design:

best = ca.load_design(folder / "best.toml")
boards_figure({"before": design.design.array, "best": best.array})
