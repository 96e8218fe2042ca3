"""
A 4 × 4 touch pad of your own
=============================

From nothing to a board that a fabricator can make and a converter can read. ``coilarray init pad.toml --coils 4x4
--shape square --size-mm 12`` does the first step in the terminal, and writes a file with comments.
"""

import numpy as np

import coilarray as ca
from coilarray.viz import check_figure, plot_board, plot_response

# %%
# Choose what matters, and let the rest be found
# ----------------------------------------------

made = ca.new_design("pad", "4x4", shape="square", size=12e-3)
design = made.design
coil = made.document["coils"]["square"]
print(f"{coil['turns_per_layer']} turns on each of {coil['winding_layers']} layers, trace {coil['trace_width_mm']} mm")
plot_board(design.array)

# %%
# Number of turns, trace and layers were found so that an LDC1614 can drive the coils; the pitch leaves room for the
# terminals. ``ca.save_design(made, "pad.toml")`` writes the file that the commands take. What had to be assumed is
# marked, with the reason:

for key, reason in made.assumed.items():
    print(f"{key}: {reason}")

# %%
# Can it be made?
# ---------------
#
# Every width, gap and hole is compared with the limits of the board house (``coilarray check pad.toml``). The picture
# has a row for each layer. Circles mark the places, numbered as in the table of ``check``, the worst first; the worst
# of each layer is enlarged.

margins = ca.check_rules(design.array, design.rules)
worst = min((one for one in margins if one.unit == "m"), key=lambda one: one.margin)
print(f"{sum(not one.kept for one in margins)} of {len(margins)} limits are broken")
print(f"nearest to its limit: {worst.rule}, {worst.value * 1e3:.3f} mm; the limit is {worst.limit * 1e3:.3f} mm")
check_figure(design.array, margins)

# %%
# What does it measure?
# ---------------------

coupling = ca.couple_design(design)
print(f"L {float(coupling.open_inductance.min()) * 1e6:.2f} to {float(coupling.open_inductance.max()) * 1e6:.2f} µH")
print(f"f {float(coupling.frequency.min()) / 1e6:.2f} to {float(coupling.frequency.max()) / 1e6:.2f} MHz")
off_diagonal = coupling.coupling.values[~np.eye(16, dtype=bool)]
print(f"strongest coupling {off_diagonal[np.abs(off_diagonal).argmax()]:+.3f}")

# %%
# The response to a ball that is pressed 0.6 mm into the elastomer, around one of the middle coils:

name = design.array.middle_coil
x0, y0 = design.array.centres[design.array.names.index(name)]
around = np.linspace(-15e-3, 15e-3, 21)
response = ca.response_map(design, depths=[0.6e-3], x=x0 + around, y=y0 + around)
plot_response(response, name, outlines=[place.to_board(place.coil.outline) for place in design.array.placements])

# %%
# A change is another design
# --------------------------
#
# Any entry of the file can be varied. A thinner base lets the magnetic sheet come nearer:

nearer = ca.vary(made, {"elastomer.0.thickness_mm": 2.0})
peak = ca.response_map(nearer, depths=[0.6e-3], x=[x0], y=[y0]).delta.sel(state=name)
before, after = (float(values.max()) * 1e6 for values in (response.delta.sel(state=name), peak))
print(f"largest δ {before:.0f}, now {after:.0f} parts per million")

# %%
# To the board house
# ------------------
#
# In the terminal ``coilarray report pad.toml --out results`` writes a page with all of this and more.
# ``coilarray export pad.toml --to kicad`` writes a board for KiCad, and ``--to gerber`` the files that a board house
# makes it from; the latter needs the extra ``fab``.
