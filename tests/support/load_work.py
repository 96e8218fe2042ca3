"""One of everything that computes, for tests that do it in several threads and processes at once."""

import hashlib

import numpy as np

from coilarray import inductance_matrix, load_design, magnetic_field
from coilarray.circuit.coupling import sweep_design
from coilarray.design.vary import vary
from coilarray.elastomer.scattering import LayerMesh
from coilarray.electromagnetics.field import vector_potential
from coilarray.response.map import MapAccuracy, response_map

POINTS = np.random.default_rng(5).uniform(-30e-3, 30e-3, (6000, 3))
MESH = LayerMesh(harmonics=4, width=0.7, rows=2)


def results():
    """Everything that computes, on small problems: B, A, L, impedances, and a response."""
    design = vary(
        load_design("starter"),
        {"coils.hexagon.turns_per_layer": 4, "array.columns": 2, "indentation.strain": "linear"},
    )
    sweep = sweep_design(design, [1e6, 3e6])
    response = response_map(design, x=[-5e-3, 0.0], y=[0.0], accuracy=MapAccuracy(mesh=MESH))
    return {
        "B": magnetic_field(design.array, POINTS, [1.0, 2.0]),
        "A": vector_potential(design.array, POINTS, [1.0, 2.0]),
        "L": inductance_matrix(design.array),
        "Z": np.stack((sweep.impedance_real.values, sweep.impedance_imag.values)),
        "response": response.delta.values,
    }


def digests(arrays):
    return {name: hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest() for name, array in arrays.items()}
