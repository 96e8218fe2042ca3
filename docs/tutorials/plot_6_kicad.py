"""
To KiCad and back
=================

A design becomes a board for KiCad, and a board that exists becomes a design.
"""

import tempfile
from pathlib import Path

import numpy as np

import coilarray as ca
from coilarray.cli.main import main
from coilarray.viz import plot_copper

# %%
# ``starter`` is a bundled design, three overlapping hexagonal coils. ``coilarray export starter --to kicad`` writes its
# board into the folder ``starter-kicad``, with nets, vias, terminals, stack-up and a project whose design rules are
# those of the design. The same in Python:

folder = Path(tempfile.mkdtemp())
design = ca.load_design("starter")
exported = ca.export(design, folder / "board", "kicad")
for path in exported.files:
    print(path.relative_to(folder))

# %%
# The copper can be changed in KiCad, or the board can be one that coilarray never made. ``coilarray import``
# follows the current through copper that overlaps, layer by layer; without ``--nets`` it takes all that winds. In a
# terminal: ``coilarray import starter-kicad/starter.kicad_pcb back.toml --nets coil1,coil2,coil3``. In Python
# ``main`` runs a command:

board = next(folder.rglob("*.kicad_pcb"))
nets = ",".join(design.array.names)
main(["import", str(board), str(folder / "back.toml"), "--nets", nets])

# %%
# The result is a design as any other, and ``coilarray impedance back.toml`` prints its inductances and couplings. A
# board file says nothing of what lies on the board: this design has no elastomer, whose magnetic sheet makes 3 % of L
# here. The coils by themselves are those of before:

back = ca.load_design(folder / "back.toml")
before, after = (ca.inductance_matrix(one.array.conductors()) for one in (design, back))
print(f"largest difference of the inductances {np.abs(after / before - 1).max() * 1e9:.1f} parts in 10⁹")
plot_copper(back.array, back.array.stackup.names[0])
