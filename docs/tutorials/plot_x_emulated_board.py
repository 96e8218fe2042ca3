"""
An emulated board, from wiring to readings
==========================================

Everything that a board does can be tried without one: the emulator plays the converter at the level of its registers,
the switches, and the coils of a design with an indenter above them.
"""

import tempfile
from pathlib import Path

from coilarray.cli.main import main

folder = Path(tempfile.mkdtemp())

# %%
# Is it wired as the file says?
# -----------------------------
#
# ``coilarray board`` looks for ports, asks the chips who they are and tests every switch. The port is the emulator
# where none is named; every line says so.

main(["board", "--self-test"])

# %%
# Measure
# -------
#
# Twenty scans, raw words and all that is needed to read them again, in one file:

main(["measure", "gast2020", "--scans", "20", "--out", str(folder / "run.sqlite")])
main(["scan-info", str(folder / "run.sqlite")])

# %%
# Press, and watch
# ----------------
#
# The emulator moves a finger over the board. ``coilarray live`` shows δ of every coil, scan by scan, and where the
# finger is, which is left out here (``--no-locate``) because it needs a table that takes half a minute. With ``--plot``
# it opens a window.

main(["live", "gast2020", "--scans", "25", "--no-locate"])
