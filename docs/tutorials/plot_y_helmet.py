"""
A helmet of receive loops
=========================

Sixteen loops around a head, as coils of magnetic resonance imaging have them: neighbours overlap so far that they do
not couple. The bundled design ``helmet`` has them on a dome, half an ellipsoid on a short cylinder.
"""

import matplotlib.pyplot as plt
import numpy as np

import coilarray as ca
from coilarray.geometry import SurfaceLattice, spread
from coilarray.geometry.surface_array import sizes_by_distance
from coilarray.studies.create.surface import lattice_coupling
from coilarray.viz import plot_coupling

design = ca.load_design("helmet")
helmet = design.array.lattice  # surface, places and sizes, and the shape of the loops
dome, loop, board = helmet.lattice.surface, helmet.coil, design.array.stackup
near, far = lattice_coupling(helmet.lattice, loop, board)
print(f"largest |k| of neighbours {near:.3f}, of all other pairs {far:.3f}")

# %%
# Neighbours are loops whose parts of the surface have a common border. A preamplifier of low input impedance
# suppresses the current in its loop and so what is left of the coupling, also that of loops farther apart, which do
# not overlap and always keep a little.

plot_coupling(ca.couple_design(design, ideal=True))

# %%
# The first step to such a design spreads points evenly over the surface, here symmetric about the plane x = 0. A mesh
# file of a former, read by ``Surface.read``, can be in the dome's place. Loops are then sized by the distance of their
# neighbours.

points = spread(dome, 16, mirror="x")
ratios = np.array([0.95, 1.1, 1.25, 1.4])
largest = []
for ratio in ratios:
    lattice = SurfaceLattice(dome, points, ("L1",), sizes_by_distance(dome, points, ratio), step=1e-3, wrapped=True)
    largest.append(lattice_coupling(lattice, loop, board)[0])
figure, ax = plt.subplots(figsize=(6, 3.5), layout="constrained")
ax.plot(ratios, largest, "o-", label="evenly spread")
ax.axhline(near, color="grey", linestyle=":", label="helmet")
ax.set(xlabel="size over mean distance of neighbours", ylabel="largest |k| of neighbours", ylim=(0, None))
_ = ax.legend()

# %%
# One ratio for all leaves some pairs that overlap too much and some that overlap too little: loops at the corners of
# triangles can all be decoupled, loops at the corners of squares cannot, as two of them are √2 times as far apart as
# the others. ``decoupled_lattice`` therefore moves and resizes all loops until the couplings of all neighbours vanish:
#
# .. code-block:: python
#
#     from coilarray.studies.create.surface import decoupled_lattice
#
#     found = decoupled_lattice(lattice, loop, board)
#
# The helmet was found so, from one loop at the top, five about it and ten about these, a part of an icosahedron's
# lattice that has hardly any squares. Its file has the places and sizes that were found; ``coilarray impedance
# helmet`` prints the circuit.
#
# The evenly spread loops grow, until they overlap, and then move to the helmet's places:
#
# .. film::
#
#    from pathlib import Path
#
#    import coilarray as ca
#    import numpy as np
#    import pyvista
#    from coilarray.geometry import SurfaceLattice, spread
#    from coilarray.geometry.surface_array import sizes_by_distance
#    from coilarray.studies.create.surface import lattice_coupling
#    from coilarray.viz import Scene, save_movie
#    from coilarray.viz.scenes.board import moving_scenes
#    from coilarray.viz.scenes.scene import Part
#
#    design = ca.load_design("helmet")
#    helmet = design.array.lattice
#    dome, loop, board = helmet.lattice.surface, helmet.coil, design.array.stackup
#    points = spread(dome, 16, mirror="x")
#    lattices = [
#        SurfaceLattice(dome, points, ("L1",), sizes_by_distance(dome, points, ratio), step=1e-3, wrapped=True)
#        for ratio in np.linspace(0.8, 1.4, 9)
#    ]
#    frames = []
#    for lattice in [*lattices, helmet.lattice]:
#        boards = [ca.Board(array, pose, "") for array, pose in lattice.boards(loop, board)]
#        note = f"k of neighbours: {lattice_coupling(lattice, loop, board)[0]:.3f} and less in magnitude"
#        frames += moving_scenes([boards], [[note]])
#    head = Part("head", pyvista.make_tri_mesh(dome.vertices * 1e3, dome.faces), colour="#d8d2c8", smooth=True)
#    save_movie(Scene((head,)), frames, Path("helmet.gif"), rate=2.0)
