"""Planar coil arrays: from a short design file to geometry, inductance, coupling and a report.

The names below are loaded when they are first used, so that ``import coilarray`` stays quick. Everything takes and
returns SI units.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from coilarray.circuit.active_coil import active_coil, every_active_coil, impedance_matrix, resonance
    from coilarray.circuit.coupling import couple, couple_design
    from coilarray.circuit.operating_field import operating_currents, operating_field
    from coilarray.design.model import Design, DesignFile, load_design, load_design_file, parse_design
    from coilarray.design.vary import vary
    from coilarray.elastomer.contact import indent
    from coilarray.elastomer.dent import dent_of
    from coilarray.elastomer.dented_layer import dent_inductance
    from coilarray.elastomer.filled import bruggeman_permeability, guth_gold_modulus, maxwell_garnett_permeability
    from coilarray.elastomer.flat_layer import layer_inductance
    from coilarray.electromagnetics.field import grid_points, magnetic_field, vector_potential
    from coilarray.electromagnetics.inductance import (
        coupling_matrix,
        inductance_matrix,
        mutual_inductance,
        rectangular_bars,
        self_inductance,
        straight_filaments,
    )
    from coilarray.electromagnetics.resistance import dc_resistance
    from coilarray.errors import CoilarrayError, DesignError, ElastomerError, GeometryError, RuleViolationError
    from coilarray.geometry import CoilArray, Conductor
    from coilarray.localize.comparison import compare_responses
    from coilarray.report import write_report
    from coilarray.response.map import Imperfections, response_map
    from coilarray.response.two_dimensional import line_response
    from coilarray.studies.sweep import sweep

__all__ = [
    "CoilArray",
    "CoilarrayError",
    "Conductor",
    "Design",
    "DesignError",
    "DesignFile",
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
    "load_design_file",
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
    "sweep",
    "vary",
    "vector_potential",
    "write_report",
]

_HOME = {
    "circuit.active_coil": ("active_coil", "every_active_coil", "impedance_matrix", "resonance"),
    "localize.comparison": ("compare_responses",),
    "circuit.coupling": ("couple", "couple_design"),
    "design.model": ("Design", "DesignFile", "load_design", "load_design_file", "parse_design"),
    "design.vary": ("vary",),
    "elastomer.contact": ("indent",),
    "elastomer.dent": ("dent_of",),
    "elastomer.dented_layer": ("dent_inductance",),
    "elastomer.filled": ("bruggeman_permeability", "guth_gold_modulus", "maxwell_garnett_permeability"),
    "elastomer.flat_layer": ("layer_inductance",),
    "errors": ("CoilarrayError", "DesignError", "ElastomerError", "GeometryError", "RuleViolationError"),
    "electromagnetics.field": ("grid_points", "magnetic_field", "vector_potential"),
    "geometry": ("CoilArray", "Conductor"),
    "electromagnetics.inductance": (
        "coupling_matrix",
        "inductance_matrix",
        "mutual_inductance",
        "rectangular_bars",
        "self_inductance",
        "straight_filaments",
    ),
    "response.two_dimensional": ("line_response",),
    "circuit.operating_field": ("operating_currents", "operating_field"),
    "report": ("write_report",),
    "electromagnetics.resistance": ("dc_resistance",),
    "response.map": ("Imperfections", "response_map"),
    "studies.sweep": ("sweep",),
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}


def __getattr__(name: str) -> object:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"coilarray.{_MODULE_OF[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
