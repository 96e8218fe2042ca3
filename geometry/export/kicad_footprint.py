"""KiCad footprints: the terminals of a coil on a board, and a whole winding as a part of a library."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Literal

from coilarray.geometry.array import CoilArray, Placement
from coilarray.geometry.copper import Drill, drills
from coilarray.geometry.export.kicad_text import (
    FILE_VERSION,
    GENERATOR,
    Drawing,
    at,
    block,
    copper_names,
    length,
    node,
    on_layer,
    quoted,
)
from coilarray.geometry.export.silk import Label, silk_labels
from coilarray.geometry.values import IntArray

# Height in m of the letters that are not printed.
_FAB_LETTERS = 1e-3
# Width of a stroke by the height of its letter, KiCad's own.
_STROKE = 0.15
# A coil is nothing to buy or to place.
_NO_PART = ("exclude_from_pos_files", "exclude_from_bom")


def library_footprints(array: CoilArray) -> dict[str, str]:
    """Write a footprint for every coil shape and set of layers, by the name of the first coil that has them.

    Pads 1 and 2 are the terminals. A footprint has no vias: they are pads V1, V2, … without a net. The winding is drawn
    as lines on the copper layers, and the footprint is a net tie, which is KiCad's word for a part that joins nets on
    purpose: its check then lets the terminals have different nets, as those of a coil have in a circuit.

    All holes go through the board, as pads of a footprint have no blind ones.
    """
    shapes: dict[tuple[int, tuple[str, ...]], list[Placement]] = {}
    for placement in array.placements:
        shapes.setdefault((id(placement.coil), placement.layers), []).append(placement)
    return {alike[0].name: _winding(array, alike) for alike in shapes.values()}


def _winding(array: CoilArray, alike: Sequence[Placement]) -> str:
    """Footprint of coils that differ in place and rotation only, in the frame of their shape."""
    name = alike[0].name
    placement = replace(alike[0], name="REF**", x=0.0, y=0.0, rotation=0.0)
    single = replace(array, placements=(placement,), through_holes=True)
    drawing = Drawing(f"footprint/{name}", copper_names(array.stackup))
    users = ", ".join(user.name for user in alike)
    children = [
        node("descr", quoted(f"winding of {users} on {', '.join(placement.layers)}")),
        # how the format of KiCad 6 marks a net tie; later versions read it as a group of all pads
        node("tags", quoted("net tie planar coil")),
        _attributes(placement),
        _reference(placement, silk_labels(single)[0], drawing),
        _value(name, drawing),
        _outline(placement, drawing),
        *(
            node("fp_line", at("start", start), at("end", end), layer, width, drawing.identifier("line", k))
            for k, (start, end, width, layer) in enumerate(segments(placement, drawing))
        ),
        *_via_pads(single, placement, drawing),
        *_terminal_pads(single, placement, (), drawing),
    ]
    head = (quoted(name), node("version", FILE_VERSION), node("generator", GENERATOR), on_layer("F.Cu"))
    return block("footprint", head, children) + "\n"


def terminal_footprint(array: CoilArray, placement: Placement, label: Label | None, net: str, drawing: Drawing) -> str:
    """Write the footprint that carries a coil's terminals and, where there is a label, its name on the board.

    `net` is the ``(net …)`` of its pads, `drawing` the coil's part of the board's. It belongs to no library: the tracks
    of the board are the winding.
    """
    children = [
        drawing.identifier("footprint"),
        at("at", drawing.point(placement.x, placement.y)),
        _attributes(placement, "board_only"),
        _reference(placement, label, drawing),
        _value("coil", drawing),
        *_terminal_pads(array, placement, (net,), drawing),
    ]
    return block("footprint", (quoted("coil_terminals"), on_layer("F.Cu")), children)


def segments(placement: Placement, drawing: Drawing) -> Iterator[tuple[IntArray, IntArray, str, str]]:
    """Give the straight pieces of a coil's path in order: both ends on the sheet in nm, (width …) and (layer …)."""
    last: IntArray | None = None
    for line, widths, layer in placement.traces():
        points = drawing.points(line)
        if last is not None:
            points[0] = last  # a line begins where the one before ended, but to 1 nm only
        last = points[-1]
        for (start, end), width in zip(pairwise(points), widths.tolist(), strict=True):
            if (start != end).any():
                yield start, end, node("width", length(width)), drawing.layer(layer)


def holes_of(
    array: CoilArray, placement: Placement, kind: Literal["via", "terminal"], drawing: Drawing
) -> list[tuple[Drill, IntArray]]:
    """Holes of one coil in the order of its path, with their places on the sheet in nm."""
    own = drills(array.with_placements((placement,)))
    return [(hole, drawing.point(hole.x, hole.y)) for hole in own if hole.kind == kind]


def _attributes(placement: Placement, *more: str) -> str:
    return node("attr", "smd" if placement.coil.terminal is None else "through_hole", *more, *_NO_PART)


def _reference(placement: Placement, label: Label | None, drawing: Drawing) -> str:
    """Write the coil's name, on the silk screen where there is a place for it."""
    if label is None:
        return _text("reference", placement.name, at("at", (0, 0)), "F.Fab", _FAB_LETTERS, drawing)
    place = drawing.point(label.x, label.y) - drawing.point(placement.x, placement.y)
    return _text("reference", placement.name, at("at", place), "F.SilkS", label.size, drawing)


def _value(value: str, drawing: Drawing) -> str:
    return _text("value", value, at("at", (0, 2_000_000)), "F.Fab", _FAB_LETTERS, drawing)


def _text(kind: str, text: str, place: str, layer: str, height: float, drawing: Drawing) -> str:
    size = node("size", length(height), length(height))
    font = node("font", size, node("thickness", length(_STROKE * height)))
    rest = (on_layer(layer), node("effects", font), drawing.identifier(kind))
    return node("fp_text", kind, quoted(text), place, *rest)


def _outline(placement: Placement, drawing: Drawing) -> str:
    """Outline of the winding for the assembly drawing; no courtyard, since coils of an array may overlap."""
    points = node("pts", *(at("xy", point) for point in drawing.points(placement.coil.outline)))
    style = (on_layer("F.Fab"), node("width", "0.1"), node("fill", "none"))
    return node("fp_poly", points, *style, drawing.identifier("outline"))


def _via_pads(array: CoilArray, placement: Placement, drawing: Drawing) -> Iterator[str]:
    """Yield the pads V1, V2, … in place of vias, under the solder mask."""
    for k, (hole, point) in enumerate(holes_of(array, placement, "via", drawing)):
        layers = node("layers", _through(array))
        drill = node("drill", length(hole.diameter))
        yield _pad(f"V{k + 1}", "thru_hole", point, hole.pad, drill, layers, drawing.identifier("via", k))


def _terminal_pads(array: CoilArray, placement: Placement, net: Sequence[str], drawing: Drawing) -> Iterator[str]:
    """Yield the pads 1 and 2 at the ends of the path.

    A pad without a hole lies on its own layer. A bare end has a pad as wide as its trace, under the solder mask, that
    adds no copper: it tells KiCad's check that the track is meant to end there.
    """
    coil = placement.coil
    origin = drawing.point(placement.x, placement.y)
    ends = drawing.points(placement.to_board(coil.terminal_points)) - origin
    layers = (placement.layers[0], placement.layers[-1])
    widths = (coil.widths[0][0], coil.widths[-1][-1])
    holes = [hole for hole, _ in holes_of(array, placement, "terminal", drawing)]
    for k, (end, layer, width) in enumerate(zip(ends, layers, widths, strict=True)):
        number, rest = str(k + 1), (*net, drawing.identifier("terminal", k))
        copper = drawing.layers[layer]
        if not holes:
            yield _pad(number, "smd", end, width, node("layers", quoted(copper)), *rest)
        elif holes[k].drilled:
            drill = node("drill", length(holes[k].diameter))
            both = node("layers", _through(array), quoted("*.Mask"))
            yield _pad(number, "thru_hole", end, holes[k].pad, drill, both, *rest)
        else:
            mask = () if copper.startswith("In") else (quoted(copper.replace(".Cu", ".Mask")),)
            yield _pad(number, "smd", end, holes[k].pad, node("layers", quoted(copper), *mask), *rest)


def _through(array: CoilArray) -> str:
    """Copper layers of a hole through the board; the back of a board of one copper layer stays empty."""
    return quoted("*.Cu" if len(array.stackup.names) > 1 else "F.Cu")


def _pad(number: str, kind: str, point: IntArray, diameter: float, *rest: str) -> str:
    size = node("size", length(diameter), length(diameter))
    return node("pad", quoted(number), kind, "circle", at("at", point), size, *rest)
