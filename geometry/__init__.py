"""Geometry without physics: spirals, coils, stack-ups, arrays, copper, rules and solids."""

from coilarray.geometry.array import CoilArray, Placement, lattice
from coilarray.geometry.coil import Coil, Leads, PlatedHole, path_coil, spiral_coil
from coilarray.geometry.conductor import Conductor
from coilarray.geometry.sheet import Sheet
from coilarray.geometry.spiral import Spiral, apothem_from_size
from coilarray.geometry.stackup import Stackup

__all__ = [
    "Coil",
    "CoilArray",
    "Conductor",
    "Leads",
    "Placement",
    "PlatedHole",
    "Sheet",
    "Spiral",
    "Stackup",
    "apothem_from_size",
    "lattice",
    "path_coil",
    "spiral_coil",
]
