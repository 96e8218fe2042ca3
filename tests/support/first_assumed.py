"""gast2020 as it was assumed before its calibration: the board for which results of other programs are known.

23 mm across corners, a gap of 0.1 mm, coil 2 below its neighbours, equal dielectrics, a bonded elastomer with a
magnetic sheet of µr 2.7 and 166 kPa. Its dent is narrow, so that on a lattice few coils are enough for some to be far.
"""

import copy

from coilarray.design.bundled import STARTER
from coilarray.design.model import build_design, load_design_file
from coilarray.design.vary import vary_document

_ENTRIES = {
    "coils.hexagon.outer_across_corners_mm": 23.0,
    "coils.hexagon.gap_mm": 0.1,
    "array.layers": [["L1", "L2"], ["L3", "L4"]],
    "stackup.dielectric_thickness_mm": [0.215, 0.215, 0.215],
    "elastomer.1.relative_permeability": 2.7,
    "elastomer.1.youngs_modulus_kPa": 166.0,
    "indentation.base": "bonded",
    "fab.min_gap_mm": 0.1,
}


def first_assumed_document():
    """Return its document, without the reasons of what is assumed."""
    document = copy.deepcopy(load_design_file(STARTER).document)
    del document["assumed"]
    del document["coils"]["hexagon"]["outer_across_flats_mm"], document["indentation"]["seat_stiffness_kPa_per_mm"]
    return vary_document(document, _ENTRIES)


def first_assumed():
    """Return the design."""
    return build_design(first_assumed_document(), STARTER)


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
