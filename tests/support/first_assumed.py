"""gast2020 as it was assumed before its calibration: the board for which results of other programs are known.

23 mm across corners, a gap of 0.1 mm, coil 2 below its neighbours, equal dielectrics, a bonded elastomer with a
magnetic sheet of µr 2.7 and 166 kPa.
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
