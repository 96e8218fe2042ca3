"""
Optimise a layout for position error
====================================

A touch strip has four coils in a row. How far apart should they be, and how far above them the magnetic sheet, so that
the position of a touch is known best? An optimisation changes entries of a design until a quantity is as good as it
gets.
"""

import csv
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt

import coilarray as ca
from coilarray.cli.main import main
from coilarray.viz import boards_figure, plot_sweep_lines

folder = Path(tempfile.mkdtemp())
strip = ca.vary(ca.load_design_file("starter"), {"array.columns": 4})
ca.save_design(strip, folder / "strip.toml")

# %%
# What is to be improved
# ----------------------
#
# The readings of the coils scatter and drift: their noise budget says by how much. The least standard deviation of x
# that any unbiased method can reach with such readings is the Cramér–Rao bound; ``position_error_mm`` is its median
# over a region. The region here is the strip itself, 32 mm long, beside the middle line, on which coils in a row say
# nothing about y.

error = "position_error_mm[region_mm=-16:16:1:3]"

# %%
# First a look around
# -------------------
#
# ``coilarray sweep`` computes quantities of a design over any of its entries. ``coilarray optimize --list-quantities``
# prints all of them: couplings, inductance, quality factor, margins of fabrication, response, errors of position. The
# dashed line is the design as it is.

around = ca.sweep(strip, {"array.pitch_mm": [9.0, 10.5, 12.0]}, [error], accuracy="screen")
plot_sweep_lines(around, error)

# %%
# Then the search
# ---------------
#
# A goal is a file that says what may change and in which range, what is to become small, and which bounds must be kept.
# ``coilarray optimize strip.toml position_error --template goal.toml`` writes one for the design at hand, with
# comments. This one has two variables, few trials, and the condition that the board house can still make the board: no
# margin to its limits is negative, except for rounding.

goal = f"""
schema = 1
title = "Finest position on the strip"

[[variable]]
entry = "array.pitch_mm"
low = 8.5
high = 12.0

[[variable]]
entry = "elastomer.0.thickness_mm"
low = 1.5
high = 4.0

[[objective]]
quantity = "{error}"
direction = "minimize"

[[constraint]]
quantity = "fab_margin_mm"
at_least = -0.001

[search]
trials = 8
polish = 0
accuracy = "screen"
"""
(folder / "goal.toml").write_text(goal, encoding="utf-8")

# %%
# ``coilarray optimize strip.toml goal.toml --out better``. The given design is tried first, so that the result is
# never worse, and the same command resumes a search that was interrupted.

found = folder / "better"
main(["optimize", str(folder / "strip.toml"), str(folder / "goal.toml"), "--workers", "1", "--out", str(found)])

# %%
# The folder has a report, the best design, and a table of all trials. Each dot is a trial:

with (found / "trials.csv").open(encoding="utf-8") as file:
    trials = list(csv.DictReader(file))
columns = ("array.pitch_mm", "elastomer.0.thickness_mm", error)
pitch, thickness, sigma = ([float(one[name]) for one in trials] for name in columns)
figure, ax = plt.subplots(figsize=(7, 4), layout="constrained")
dots = ax.scatter(pitch, sigma, c=thickness, s=60)
ax.set(xlabel="pitch (mm)", ylabel="standard deviation of x (mm)")
figure.colorbar(dots, label="thickness of the lower sheet (mm)")

# %%
# Where coils overlap more, more of them respond to one touch, and their differences say where it is. The lower sheet,
# between board and magnetic sheet, has a best thickness: a thin one makes a narrow dent, which few coils see, and a
# thick one lifts the magnetic sheet away from the coils.

best = ca.load_design(found / "best.toml")
boards_figure({"before": strip.array, "best": best.array})
