"""
The six-coil sensor of the paper
================================

Gast and Zimmermann (2020) press on a soft magnetic elastomer over six overlapping hexagonal coils, and find the
position from the change of their inductances. This tutorial goes once through the whole package with their board, which
comes with it as ``gast2020``.
"""

import numpy as np

import coilarray as ca
from coilarray.viz import plot_copper, plot_coupling, plot_response, plot_response_profile

# %%
# A design
# --------
#
# A design has the coils and their places, the sheets, what presses on them, and the circuit. It can be read from a
# file, as here, or made in Python. It is never changed in place.

design = ca.load_design("gast2020")
print(design.title)
print(f"{len(design.array.names)} coils, {len(design.sheets)} sheets, {design.indentation.indenter}")
plot_copper(design.array, "L1")

# %%
# Neighbours overlap, so they lie on different layers. Where two coils overlap by the right amount, the flux of one
# through the other is zero, and they do not couple.
#
# Couplings
# ---------
#
# ``coilarray impedance gast2020`` prints the same in the terminal.

coupling = ca.couple_design(design)
plot_coupling(coupling)

# %%
# The converter drives a coil with a capacitor in parallel and measures the frequency f at which both oscillate. From f
# and the capacitance C of that capacitor follows the effective inductance, 1/((2πf)²C). It differs from the inductance
# of the coil by itself:

alone, seen = coupling.open_inductance[2], coupling.effective_inductance[2]
print(f"coil3 alone {float(alone) * 1e6:.2f} µH, in its circuit {float(seen) * 1e6:.2f} µH")
print(f"it oscillates at {float(coupling.frequency[2]) / 1e6:.3f} MHz")

# %%
# It has two causes. The capacitance of the winding adds to the capacitor, so that the coil seems larger; that of
# the switches would too, but this design takes it as zero. And while one coil is measured, all others are grounded:
# currents flow in them, which make it seem smaller. The ideal circuit has neither capacitance of windings nor losses,
# and shows what the neighbours do by themselves:

print(f"ideal: {float(coupling.ideal_effective_inductance[2]) * 1e6:.2f} µH")

# %%
# An indentation
# --------------
#
# A ball of 5 mm diameter is pressed 1 mm into the elastomer, at one place after the other along the row of coils. δ is
# the relative change of the effective inductance.

x = np.linspace(-40e-3, 40e-3, 81)
response = ca.response_map(design, x=x, y=[0.0])
plot_response_profile(response)

# %%
# Every coil responds within about its own width: by 1.1 parts in a thousand, or by 1.5 if it lies on the upper layers,
# which are nearer to the sheet. Over the plane:

plane = ca.response_map(design, x=np.linspace(-26e-3, 26e-3, 27), y=np.linspace(-12e-3, 12e-3, 13))
plot_response(plane, "coil2")

# %%
# Position
# --------
#
# The curves of equal δ look like ellipses, and the paper finds positions where the ellipses of two coils meet
# (``coilarray paper fit``). The package also finds them without ellipses: it computes δ of all coils over a grid of
# places and depths, and searches for the place whose δ agree with a reading. Here the reading is computed too, for
# (5, 3) mm and a depth of 0.7 mm. The coils are in a row, which cannot distinguish y from −y, so that there are two
# answers.

table = ca.response_map(
    design,
    depths=np.array([0.4, 0.6, 0.8, 1.0]) * 1e-3,
    x=np.linspace(-26e-3, 26e-3, 27),
    y=np.linspace(-12e-3, 12e-3, 13),
)
model = ca.forward_model(table)
truth = ca.response_map(design, depths=[0.7e-3], x=[5e-3], y=[3e-3]).delta.squeeze()
reading = dict(zip(truth.state.values.tolist(), truth.values.tolist(), strict=True))
for mode in ca.locate(model, reading, noise=1e-6).modes:
    print(f"x {mode.x * 1e3:.2f} mm, y {mode.y * 1e3:.2f} mm, depth {mode.depth * 1e3:.3f} mm")

# %%
# What the grounded neighbours do to the centres of the ellipses has a page of its own: :doc:`/paper`.
