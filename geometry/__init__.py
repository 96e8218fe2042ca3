"""Geometry without physics: coils, stack-ups, arrays, copper, rules and solids."""

from coilarray.geometry.array import Array, Connector, Lattice, Placement, lattice, lattice_array
from coilarray.geometry.bodies import (
    MATERIAL_SOURCES,
    MATERIALS,
    Ball,
    Disc,
    FinitePlate,
    Material,
    Outline,
    Plate,
    Polygon,
    Rectangle,
    Ring,
    Target,
)
from coilarray.geometry.coil import Coil, Leads, PlatedHole, hull_outline, path_coil
from coilarray.geometry.conductor import Conductor
from coilarray.geometry.connector import route_leads
from coilarray.geometry.copper import CopperFeature, Drill, board_outline, copper_by_layer, copper_features, drills
from coilarray.geometry.elastomer import (
    EVEN,
    Cone,
    CylinderEdge,
    FlatPunch,
    Hemisphere,
    Indenter,
    Paraboloid,
    Seat,
    Sheet,
    Unevenness,
)
from coilarray.geometry.rules import FabRules, Margin, check_rules, require_kept, require_rules
from coilarray.geometry.solids import solids
from coilarray.geometry.spiral import RoundedSpiral, Spiral, across_flats
from coilarray.geometry.stackup import Stackup

__all__ = [
    "EVEN",
    "MATERIALS",
    "MATERIAL_SOURCES",
    "Array",
    "Ball",
    "Coil",
    "Conductor",
    "Cone",
    "Connector",
    "CopperFeature",
    "CylinderEdge",
    "Disc",
    "Drill",
    "FabRules",
    "FinitePlate",
    "FlatPunch",
    "Hemisphere",
    "Indenter",
    "Lattice",
    "Leads",
    "Margin",
    "Material",
    "Outline",
    "Paraboloid",
    "Placement",
    "Plate",
    "PlatedHole",
    "Polygon",
    "Rectangle",
    "Ring",
    "RoundedSpiral",
    "Seat",
    "Sheet",
    "Spiral",
    "Stackup",
    "Target",
    "Unevenness",
    "across_flats",
    "board_outline",
    "check_rules",
    "copper_by_layer",
    "copper_features",
    "drills",
    "hull_outline",
    "lattice",
    "lattice_array",
    "path_coil",
    "require_kept",
    "require_rules",
    "route_leads",
    "solids",
]  # fmt: skip
