"""
Files for KiCad
===============

A board with nets, vias, terminals and design rules, ready to be opened in KiCad.
"""

import tempfile
from pathlib import Path

import coilarray as ca
from coilarray.viz import plot_board

design = ca.load_design("starter")
with tempfile.TemporaryDirectory() as folder:
    exported = ca.export(design, Path(folder) / "board", "kicad")
    print(*(path.name for path in sorted(Path(folder).rglob("*"))), sep="\n")
plot_board(design.array)
