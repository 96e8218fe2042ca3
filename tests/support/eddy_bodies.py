"""Bodies other than plates on which eddy currents have closed forms."""

from dataclasses import replace

import numpy as np

from coilarray.geometry.plate import Disc
from coilarray.metal.half_body import EddyBody
from coilarray.metal.plate_mesh import plate_mesh


def sphere_body(radius, fineness):
    """A sphere of a radius in m: the mesh of a disc's face drawn over half of it."""
    face = plate_mesh(Disc(1.0), 1.0, fineness)
    top = face.triangles[~face.rim]
    nodes = face.nodes[: top.max() + 1, :2]
    distance = np.hypot(*nodes.T)
    angle = np.pi / 2 * np.minimum(distance / distance[face.triangles[face.rim, 0].min() : len(face.ring)].mean(), 1.0)
    turned = nodes * (np.sin(angle) / np.maximum(distance, 1e-12))[:, None]
    edge = np.flatnonzero(angle > np.pi / 2 * (1 - 1e-9))
    points = radius * np.column_stack((turned, np.where(angle > np.pi / 2 * (1 - 1e-9), 0.0, np.cos(angle))))
    return EddyBody(replace(face, nodes=points, triangles=top, rim=np.zeros(len(top), bool), ring=edge))
