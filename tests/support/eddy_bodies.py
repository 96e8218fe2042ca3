"""Bodies other than plates on which eddy currents have closed forms."""

from dataclasses import replace

import numpy as np

from coilarray.geometry.bodies import Disc
from coilarray.metal.half_body import EddyBody
from coilarray.metal.plate_mesh import plate_meshes


def sphere_body(radius, fineness):
    """A sphere of a radius in m: the mesh of a disc's face drawn over half of it."""
    face = plate_meshes(Disc(1.0), 1.0, fineness)[1]
    top = face.triangles[~face.rim]
    nodes = face.nodes[: top.max() + 1, :2]
    edge = np.unique(face.triangles[face.rim])
    edge = edge[edge < len(nodes)]
    distance = np.hypot(*nodes.T)
    angle = np.pi / 2 * np.minimum(distance / distance[edge].mean(), 1.0)
    angle[edge] = np.pi / 2
    turned = nodes * (np.sin(angle) / np.maximum(distance, 1e-12))[:, None]
    height = np.cos(angle)
    height[edge] = 0.0
    points = radius * np.column_stack((turned, height))
    return EddyBody(replace(face, nodes=points, triangles=top, rim=np.zeros(len(top), bool), ring=edge))
