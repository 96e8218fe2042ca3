"""Planar coil arrays: from a short design file to geometry, inductance, coupling and a report.

The names below are loaded when they are first used, so that ``import coilarray`` stays quick. Everything takes and
returns SI units.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from coilarray.circuit import active_coil, every_active_coil, impedance_matrix, resonance
    from coilarray.comparison import compare_responses
    from coilarray.coupling import couple, couple_design
    from coilarray.design import Design, load_design, parse_design
    from coilarray.elastomer.contact import indent
    from coilarray.elastomer.dent import dent_of
    from coilarray.elastomer.dented_layer import dent_inductance
    from coilarray.elastomer.filled import bruggeman_permeability, guth_gold_modulus, maxwell_garnett_permeability
    from coilarray.elastomer.flat_layer import layer_inductance
    from coilarray.errors import CoilarrayError, DesignError, ElastomerError, GeometryError, RuleViolationError
    from coilarray.field import grid_points, magnetic_field, vector_potential
    from coilarray.geometry import CoilArray, Conductor
    from coilarray.inductance import (
        coupling_matrix,
        inductance_matrix,
        mutual_inductance,
        rectangular_bars,
        self_inductance,
        straight_filaments,
    )
    from coilarray.line_response import line_response
    from coilarray.near_field import operating_currents, operating_field
    from coilarray.report import write_report
    from coilarray.resistance import dc_resistance
    from coilarray.response import Imperfections, response_map

__all__ = [
    "CoilArray",
    "CoilarrayError",
    "Conductor",
    "Design",
    "DesignError",
    "ElastomerError",
    "GeometryError",
    "Imperfections",
    "RuleViolationError",
    "active_coil",
    "bruggeman_permeability",
    "compare_responses",
    "couple",
    "couple_design",
    "coupling_matrix",
    "dc_resistance",
    "dent_inductance",
    "dent_of",
    "every_active_coil",
    "grid_points",
    "guth_gold_modulus",
    "impedance_matrix",
    "indent",
    "inductance_matrix",
    "layer_inductance",
    "line_response",
    "load_design",
    "magnetic_field",
    "maxwell_garnett_permeability",
    "mutual_inductance",
    "operating_currents",
    "operating_field",
    "parse_design",
    "rectangular_bars",
    "resonance",
    "response_map",
    "self_inductance",
    "straight_filaments",
    "vector_potential",
    "write_report",
]

_HOME = {
    "circuit": ("active_coil", "every_active_coil", "impedance_matrix", "resonance"),
    "comparison": ("compare_responses",),
    "coupling": ("couple", "couple_design"),
    "design": ("Design", "load_design", "parse_design"),
    "elastomer.contact": ("indent",),
    "elastomer.dent": ("dent_of",),
    "elastomer.dented_layer": ("dent_inductance",),
    "elastomer.filled": ("bruggeman_permeability", "guth_gold_modulus", "maxwell_garnett_permeability"),
    "elastomer.flat_layer": ("layer_inductance",),
    "errors": ("CoilarrayError", "DesignError", "ElastomerError", "GeometryError", "RuleViolationError"),
    "field": ("grid_points", "magnetic_field", "vector_potential"),
    "geometry": ("CoilArray", "Conductor"),
    "inductance": (
        "coupling_matrix",
        "inductance_matrix",
        "mutual_inductance",
        "rectangular_bars",
        "self_inductance",
        "straight_filaments",
    ),
    "line_response": ("line_response",),
    "near_field": ("operating_currents", "operating_field"),
    "report": ("write_report",),
    "resistance": ("dc_resistance",),
    "response": ("Imperfections", "response_map"),
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}


def __getattr__(name: str) -> object:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"coilarray.{_MODULE_OF[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
