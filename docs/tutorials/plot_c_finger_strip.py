"""
A strip around a finger
=======================

Six coils on a flexible board, flat and bent around a finger of 8 mm radius: what does the bend do to L and k?
"""

import dataclasses

import matplotlib.pyplot as plt
import numpy as np

import coilarray as ca

strip = ca.load_design("finger_strip").array  # bent, as its file says
flat = dataclasses.replace(strip, form=None)
for name, array in (("flat", flat), ("bent", strip)):
    L = ca.inductance_matrix(array)
    print(name, f"L {L[0, 0] * 1e9:.1f} nH, k of coil1", ca.coupling_matrix(L)[0, 1:].round(4))

# %%
# L loses 0.7 %, as opposite sides of a coil turn away from each other. Neighbours gain a fifth of k, coils after next
# become 2.6 times as strong, and the first and the last, which hardly couple on the flat strip, become neighbours
# across the gap. All are right to 10⁻⁴ of L. ``coilarray check finger_strip`` knows the bend too: the finger's radius
# is 47 times the thickness of the board, where ten are enough.
#
# Why does k grow, though the coils look away from each other? Far coils are dipoles. If the axes lean by ±a from
# the normal of their chord, two dipoles couple by 1 + sin²a instead of 1, and the chord is shorter than the arc by
# a/sin a, of which the third power counts.

file = ca.load_design_file("finger_strip")
radii = np.array([8.0, 10.0, 14.0, 20.0, 40.0])
turns = strip.lattice.pitch / (radii * 1e-3 + strip.stackup.thickness / 2)  # from coil to coil, in the board's middle
around = [ca.vary(file, {"board.bend_radius_mm": radius}).conductors() for radius in radii.tolist()]
figure, ax = plt.subplots(figsize=(7, 4), layout="constrained")
for other, name in ((1, "neighbours"), (2, "after next")):
    own = ca.mutual_inductance(*flat.conductors()[: other + 1 : other]).item()
    gains = [ca.mutual_inductance(*paths[: other + 1 : other]).item() / own for paths in around]
    (line,) = ax.plot(turns, gains, "o", label=name)
    a = other * np.linspace(0.01, turns[0], 50) / 2
    dipoles = (1 + np.sin(a) ** 2) * (a / np.sin(a)) ** 3
    ax.plot(2 * a / other, dipoles, color=line.get_color(), label=f"{name}, dipoles")
ax.set(xlabel="turn from coil to coil (rad)", ylabel="M, bent over flat")
ax.legend()

# %%
# Coils after next follow the dipoles to 7 %. Neighbours, whose copper is 0.5 mm apart, go half of the way.
#
# The strip bends, from a radius of 200 mm to that of the finger:
#
# .. film::
#
#    from pathlib import Path
#
#    import coilarray as ca
#    import numpy as np
#    from coilarray.viz import Scene, save_movie, scene_of_design
#
#    file = ca.load_design_file("finger_strip")
#    bends = [ca.vary(file, {"board.bend_radius_mm": 8 / share}) for share in np.linspace(0.04, 1.0, 25).tolist()]
#    frames = [scene_of_design(one) for one in bends]
#    save_movie(Scene(), frames, Path("bend.gif"))
