"""KiCad's project file: the fabricator's limits as the rules of KiCad's own check."""

from __future__ import annotations

import json

from coilarray.geometry.array import CoilArray
from coilarray.geometry.export.kicad_text import block, node, quoted
from coilarray.geometry.rules import FabRules


def project_text(array: CoilArray, name: str, rules: FabRules) -> str:
    """Text of a ``.kicad_pro`` file; the first coil gives the sizes that KiCad offers for new tracks and vias.

    JSON, without severities, so that KiCad's own hold. KiCad has no limit for turns of one net, so `FabRules.min_gap`
    holds between nets only. The distance of foreign copper to a hole's wall takes the same limit.
    """
    coil = array.placements[0].coil
    gap = _mm(rules.min_gap)
    limits = {
        "allow_blind_buried_vias": not array.through_holes,
        "allow_microvias": False,
        "min_clearance": gap,
        "min_copper_edge_clearance": _mm(rules.min_edge_clearance),
        "min_hole_clearance": gap,
        "min_hole_to_hole": _mm(rules.min_hole_spacing),
        "min_through_hole_diameter": _mm(rules.min_drill),
        "min_track_width": _mm(rules.min_trace),
        "min_via_annular_width": _mm(rules.min_annular_ring),
        "min_via_diameter": _mm(rules.min_drill + 2 * rules.min_annular_ring),
    }
    default_class = {
        "name": "Default",
        "clearance": gap,
        "track_width": _mm(coil.trace_width),
        "via_diameter": _mm(coil.via.pad),
        "via_drill": _mm(coil.via.drill),
    }
    project = {
        "board": {"design_settings": {"meta": {"version": 2}, "rules": limits}},
        "meta": {"filename": f"{name}.kicad_pro", "version": 1},
        "net_settings": {"classes": [default_class], "meta": {"version": 2}},
    }
    return json.dumps(project, indent=2) + "\n"


def library_table_text(name: str) -> str:
    """Text of the ``fp-lib-table`` that lets KiCad find the footprints of the project, whose name the library has."""
    folder = quoted(f"${{KIPRJMOD}}/{name}.pretty")
    library = node(
        "lib",
        node("name", quoted(name)),
        node("type", quoted("KiCad")),
        node("uri", folder),
        node("options", quoted("")),
        node("descr", quoted("windings of the coils")),
    )
    return block("fp_lib_table", (), (library,)) + "\n"


def _mm(metres: float) -> float:
    """Millimetres, rounded to 1 nm."""
    return round(metres * 1e3, 6)
