"""Geometry without physics: spirals, coils, stack-ups, arrays, copper, rules and solids."""

from coilarray.geometry.array import Array, Connector, Lattice, Placement, lattice, lattice_array
from coilarray.geometry.ball import Ball
from coilarray.geometry.coil import Coil, Leads, PlatedHole, hull_outline, path_coil
from coilarray.geometry.conductor import Conductor
from coilarray.geometry.connectivity import Barrel, NetCheck, NetFault, board_layers, check_nets, connected_pieces
from coilarray.geometry.connector import route_leads
from coilarray.geometry.copper import CopperFeature, Drill, board_outline, copper_by_layer, copper_features, drills
from coilarray.geometry.indenter import Cone, CylinderEdge, FlatPunch, Hemisphere, Indenter, Paraboloid
from coilarray.geometry.material import MATERIAL_SOURCES, MATERIALS, Material
from coilarray.geometry.plate import Disc, FinitePlate, Outline, Plate, Polygon, Rectangle, Ring
from coilarray.geometry.rules import FabRules, Margin, check_rules, require_kept, require_rules
from coilarray.geometry.sheet import EVEN, Seat, Sheet, Unevenness
from coilarray.geometry.solids import solids
from coilarray.geometry.spiral import RoundedSpiral, Spiral, across_flats
from coilarray.geometry.stackup import Stackup
from coilarray.geometry.target import Target

__all__ = [
    "EVEN",
    "MATERIALS",
    "MATERIAL_SOURCES",
    "Array",
    "Ball",
    "Barrel",
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
    "NetCheck",
    "NetFault",
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
    "board_layers",
    "board_outline",
    "check_nets",
    "check_rules",
    "connected_pieces",
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
