"""
An emulated board, from wiring to readings
==========================================

Reading a board can be tried without one: the emulator models the converter at the level of its registers, the switches,
and the coils of a design with an indenter above them.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd

from coilarray.cli.main import main

folder = Path(tempfile.mkdtemp())

# %%
# Is it wired as the file says?
# -----------------------------
#
# ``coilarray board test`` lists the ports of this computer, asks the chips who they are and tests every switch.
# ``--port`` names the port of a real board. Without it the emulator answers, and every line begins with ``[emulator]``.

main(["board", "test"])

# %%
# Measure
# -------
#
# Twenty scans go into one file, with the raw words and all that is needed to evaluate them again. The noise of L is
# relative. ``coilarray board info run.sqlite`` prints the same again at any time, and makes tables and netCDF files of
# it.

main(["board", "measure", "gast2020", "--scans", "20", "--out", str(folder / "run.sqlite")])

# %%
# Press, and watch
# ----------------
#
# The emulator moves a finger over the board. ``coilarray board live`` shows δ of every coil in parts per million, scan
# by scan, as soon as it has a baseline. It also shows where the finger is, which is left out here
# (``--no-locate``) because it needs a table, which takes some 15 s to compute. With ``--plot`` all of this is shown on
# a page in the browser.

main(["board", "live", "gast2020", "--scans", "25", "--no-locate", "--out", str(folder / "touches.sqlite")])

# %%
# ``--out`` records every scan. ``coilarray board info`` makes a table of the recording, a line for each scan. After the
# first ten, the baseline, the finger presses over coil 2, and then near coil 1:

main(["board", "info", str(folder / "touches.sqlite"), "--out", str(folder / "touches.csv")])
touches = pd.read_csv(folder / "touches.csv", index_col="time_s", comment="#").filter(regex=r"^coil\d$") * 1e6
figure, ax = plt.subplots(figsize=(7, 4), layout="constrained")
touches.plot(ax=ax, xlabel="time (s)", ylabel="δ (10⁻⁶)")
