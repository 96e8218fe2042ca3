"""Designs of many coils for the tests: the winding of gast2020 as first assumed on lattices.

Its bonded elastomer has a narrow dent, so that few coils are enough for some to be far.
"""

from coilarray.design.model import build_design
from coilarray.design.vary import vary_document
from support.first_assumed import first_assumed_document


def hexagonal(columns, rows, turns=30):
    """Return a design of columns × rows hexagonal coils that overlap on three pairs of layers, about the origin."""
    document = first_assumed_document()
    del document["indentation"]["origin"]
    entries = {
        "array.lattice": "hexagonal",
        "array.columns": columns,
        "array.rows": rows,
        "array.layers": [["L1", "L2"], ["L3", "L4"], ["L5", "L6"]],
        "coils.hexagon.turns_per_layer": turns,
        "stackup.layers": [f"L{k}" for k in range(1, 7)],
        "stackup.copper_thickness_um": [35] * 6,
        "stackup.dielectric_thickness_mm": [0.215] * 5,
        "stackup.dielectric_epsilon_r": [4.5] * 5,
    }
    return build_design(vary_document(document, entries))
