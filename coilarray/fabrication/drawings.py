"""Drawings of a board in mm, SVG and DXF, and places of names on the silk screen."""

from __future__ import annotations

import base64
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from coilarray.compute.arrays import FloatArray
from coilarray.compute.extras import import_extra
from coilarray.compute.files import require_suffix, write_atomically, write_text
from coilarray.compute.table import html_card, html_table
from coilarray.errors import OutputError
from coilarray.geometry.arcs import pieces_of
from coilarray.geometry.array import Array, array_facts
from coilarray.geometry.copper import board_outline, copper_by_layer, disc, drills

_MM = 1e3
_MOST_POINTS = 10_000  # of traces, which are drawn in about a second
_ON_SCREEN = 3000  # parts of the board that a screen shows
_DIGITS = 4  # of a coordinate in mm: 0.1 µm, a thousandth of the finest trace
_TEXT_HEIGHT = 1.5  # mm
_BASELINE = "0.5"  # mm below the middle of the text: half the height of a capital
_LAMINATE = "#F4F1E8"
_MARGIN = 0.5  # mm of paper around the board
# Okabe & Ito (2008), "Color Universal Design": neighbouring layers differ strongly, for eyes of any
# colour vision
_LAYER_COLOURS = ("#D55E00", "#E69F00", "#0072B2", "#56B4E9", "#CC79A7", "#009E73")
_INKSCAPE = "http://www.inkscape.org/namespaces/inkscape"


def write_svg(array: Array, path: Path, *, title: str = "") -> None:
    """Write the board as an SVG drawing in its size.

    The group ``board`` is in mm, with y upwards and the origin of the design. Its groups are layers
    in Inkscape, from the back ``outline``, ``copper-<n>`` with a path for each coil, ``drills`` and
    ``names``.
    """
    require_suffix(path, ".svg")
    write_text(path, f'<?xml version="1.0" encoding="UTF-8"?>\n{svg_text(array, title=title)}\n')


def svg_text(array: Array, *, title: str = "", coarse: bool = False) -> str:
    """Return the ``svg`` of `write_svg`, `coarse` to a three-thousandth of the board."""
    outline = board_outline(array)
    within = max(np.ptp(np.reshape(outline.bounds, (2, 2)), axis=0)) / _ON_SCREEN if coarse else 0.0
    digits = max(-math.floor(math.log10(within * _MM)), 0) if coarse else _DIGITS
    x_min, y_min, x_max, y_max = (np.array(outline.bounds) * _MM + np.array([-1, -1, 1, 1]) * _MARGIN).tolist()
    width, height = _number(x_max - x_min), _number(y_max - y_min)
    namespaces = {"xmlns": "http://www.w3.org/2000/svg", "xmlns:inkscape": _INKSCAPE}
    box = f"{_number(x_min)} {_number(-y_max)} {width} {height}"
    root = ET.Element("svg", {**namespaces, "width": f"{width}mm", "height": f"{height}mm", "viewBox": box})
    if title:
        ET.SubElement(root, "title").text = title
    board = ET.SubElement(root, "g", {"id": "board", "transform": "scale(1 -1)"})
    edge = _layer(board, "outline", "outline", fill=_LAMINATE, stroke="#202020", stroke_width="0.1")
    ET.SubElement(edge, "path", {"d": _path_data(outline, digits)})
    names = array.stackup.names
    copper_of = copper_by_layer(array)
    for k in reversed(range(len(names))):
        colour = _LAYER_COLOURS[k % len(_LAYER_COLOURS)]
        copper = _layer(board, f"copper-{k + 1}", names[k], fill=colour, fill_rule="evenodd", fill_opacity="0.75")
        for net, shape in copper_of[names[k]].items():
            trace = ET.SubElement(
                copper, "path", {"d": _path_data(shape.simplify(within) if coarse else shape, digits)}
            )
            ET.SubElement(trace, "title").text = net
    holes = _layer(board, "drills", "drills", fill="#FFFFFF", stroke="#202020", stroke_width="0.05")
    for hole in (hole for hole in drills(array) if hole.drilled):
        x, y, r = (_number(value * _MM) for value in (hole.x, hole.y, hole.diameter / 2))
        ET.SubElement(holes, "circle", {"cx": x, "cy": y, "r": r})
    font = {"font_family": "sans-serif", "font_size": f"{_TEXT_HEIGHT:g}", "text_anchor": "middle"}
    # so that names on copper can be read
    halo = {"stroke": _LAMINATE, "stroke_width": "0.3", "paint_order": "stroke"}
    texts = _layer(board, "names", "names", fill="#202020", **font, **halo)
    for placement in array.placements:
        at = f"translate({_number(placement.x * _MM)} {_number(placement.y * _MM)}) scale(1 -1)"
        ET.SubElement(texts, "text", {"transform": at, "y": _BASELINE}).text = placement.name
    ET.indent(root, " ")
    return ET.tostring(root, encoding="unicode")


def array_html(array: Array) -> str:
    """Return a board for a notebook: its picture and facts."""
    return html_card("Array", array_picture(array), html_table((), array_facts(array)))


def array_picture(array: Array, title: str = "") -> str:
    """Return a drawing as an HTML image, or why it takes too long."""
    points = sum(len(line) for place in array.placements for line, _, _ in place.traces())
    if points > _MOST_POINTS:
        return f"<p>not drawn here, as its traces have {points} points; coilarray.export draws it</p>"
    drawing = base64.b64encode(svg_text(array, title=title, coarse=True).encode()).decode()
    return f'<p><img alt="the board" src="data:image/svg+xml;base64,{drawing}"></p>'


def _layer(parent: ET.Element, identity: str, label: str, **style: str) -> ET.Element:
    attributes = {"id": identity, "inkscape:groupmode": "layer", "inkscape:label": label}
    return ET.SubElement(parent, "g", attributes | {key.replace("_", "-"): value for key, value in style.items()})


def _path_data(shape: BaseGeometry, digits: int) -> str:
    rings = [shapely.get_coordinates(ring)[:-1] * _MM for ring in shapely.get_rings(shapely.get_parts(shape))]
    # Z closes the ring
    return " ".join(
        f"M{' '.join(f'{_number(x, digits)},{_number(y, digits)}' for x, y in ring.tolist())}Z" for ring in rings
    )


def _number(value: float, digits: int = _DIGITS) -> str:
    return f"{round(value, digits) + 0.0:.{digits}f}".rstrip("0").rstrip(".")


_DXF_DIGITS = 9  # of a coordinate in mm
_RELEASE = "R2010"  # the first that every program of today reads and that is UTF-8 throughout
# of the AutoCAD colour index, away from the black or white of the background
_DXF_COLOURS = (1, 5, 3, 6, 30, 4)
_DRILL_COLOUR, _OUTLINE_COLOUR, _SILK_COLOUR = 8, 7, 2
_NOT_IN_NAMES = '<>/\\":;?*|=`'


def write_dxf(array: Array, path: Path) -> None:
    """Write the board as a DXF drawing in mm, y upwards, with the design's origin.

    Layers ``copper_<layer>`` have traces and pads united as closed polylines without width, for
    cutters, field solvers and CAM programs, in which holes are not cut out. ``path_<layer>`` have
    centre lines with widths, for programs that route, switched off as they show the same copper.
    ``drill`` has a circle for each hole, or ``drill_L1_L2`` of blind ones. ``outline`` is the edge,
    and ``silk`` has the names of the coils.
    """
    require_suffix(path, ".dxf")
    names = array.stackup.names
    listed = ", ".join(names)
    if any(character in name for name in names for character in _NOT_IN_NAMES):
        raise OutputError(f"cannot write {path}: names of layers must be free of {_NOT_IN_NAMES}; got {listed}.")
    if len({name.casefold() for name in names}) < len(names):
        raise OutputError(f"cannot write {path}: names of layers must differ in more than capitals; got {listed}.")
    ezdxf = import_extra("ezdxf", "DXF files", package="ezdxf", extra="fab")
    drawing: Any = ezdxf.new(_RELEASE, units=ezdxf.units.MM)
    holes = [
        (hole, "drill" if hole.layers == names else "_".join(("drill", *hole.layers)))
        for hole in drills(array)
        if hole.drilled
    ]
    for k, name in enumerate(names):
        colour = _DXF_COLOURS[k % len(_DXF_COLOURS)]
        drawing.layers.add(f"copper_{name}", color=colour)
        drawing.layers.add(f"path_{name}", color=colour, plot=False).off()
    for name in sorted({layer for _, layer in holes}):
        drawing.layers.add(name, color=_DRILL_COLOUR)
    drawing.layers.add("outline", color=_OUTLINE_COLOUR)
    drawing.layers.add("silk", color=_SILK_COLOUR)
    space = drawing.modelspace()

    def add_ring(ring: shapely.LinearRing, layer: str) -> None:
        corners = _in_mm(shapely.get_coordinates(ring))[:-1]  # the closing edge is implied
        space.add_lwpolyline(corners.tolist(), close=True, dxfattribs={"layer": layer})

    for name, nets in reversed(copper_by_layer(array).items()):  # the top in front
        for copper in nets.values():
            for ring in shapely.get_rings(shapely.get_parts(copper)):
                add_ring(ring, f"copper_{name}")
    for placement in array.placements:  # centre lines with widths and arcs
        for k, (line, widths, layer) in enumerate(placement.traces()):
            pieces = list(pieces_of(line, placement.coil.arcs_of(k)))
            # a vertex carries width and bulge of the piece that begins there, the last those of none
            begun = np.array([(widths[piece.first] * _MM, piece.bulge) for piece in pieces])
            begun = np.vstack((begun, (begun[-1, 0], 0.0)))
            places = _in_mm(line[[piece.first for piece in pieces] + [len(line) - 1]])
            vertices = np.column_stack((places, begun[:, [0, 0, 1]])).tolist()
            space.add_lwpolyline(vertices, format="xyseb", dxfattribs={"layer": f"path_{layer}"})
    for hole, layer in holes:
        x, y = _in_mm(np.array([hole.x, hole.y])).tolist()
        space.add_circle((x, y), hole.diameter / 2 * _MM, dxfattribs={"layer": layer})
    outline = board_outline(array)
    add_ring(outline.exterior, "outline")
    for placement in array.placements:
        x, y = _in_mm(np.array([placement.x, placement.y])).tolist()
        text = space.add_text(placement.name, height=_TEXT_HEIGHT, dxfattribs={"layer": "silk"})
        text.set_placement((x, y), align=ezdxf.enums.TextEntityAlignment.MIDDLE_CENTER)
    x_min, y_min, x_max, y_max = _in_mm(np.array(outline.bounds)).tolist()
    space.reset_extents((x_min, y_min, 0), (x_max, y_max, 0))
    # programs open the drawing on the whole board
    drawing.set_modelspace_vport(1.1 * max(x_max - x_min, y_max - y_min), ((x_min + x_max) / 2, (y_min + y_max) / 2))
    write_atomically(path, drawing.saveas)


def _in_mm(lengths: FloatArray) -> FloatArray:
    return np.round(lengths * _MM, _DXF_DIGITS) + 0.0  # + 0.0: no −0 in the file


# Heights of the letters in m, the first that fits. Below 0.8 mm KiCad warns and screens blur.
_SIZES = (1.0e-3, 0.8e-3)
_LETTER_WIDTH, _LETTER_HEIGHT = 1.2, 1.8  # of the widest, over the size, with gap and descenders
_CLEARANCE, _EDGE = 0.15e-3, 0.5e-3  # m, of ink from pads and other names, and from the edge of the board
_STEP = 0.5e-3  # m, of the places that are tried


@dataclass(frozen=True)
class Label:
    """Middle and letter height of a coil's name, in m."""

    x: float
    y: float
    size: float


def silk_labels(array: Array) -> tuple[Label | None, ...]:
    """Place names near the centres, clear of pads, names and edge, if they fit."""
    holes = [disc(hole.x, hole.y, hole.pad + 2 * _CLEARANCE) for hole in drills(array)]
    inside = board_outline(array).buffer(-_EDGE, join_style="mitre")
    free = shapely.difference(inside, shapely.union_all(holes))
    shapely.prepare(free)
    labels: list[Label | None] = []
    taken = np.zeros((0, 4))
    for placement in array.placements:
        # a grid over the coil's winding, the places nearest to its centre first
        outline = placement.to_board(placement.coil.outline)
        count = np.ceil(0.5 * np.ptp(outline, axis=0) / _STEP).astype(int)
        x, y = np.meshgrid(*(_STEP * np.arange(-n, n + 1) for n in count))
        grid = np.column_stack((x.ravel(), y.ravel()))
        middle = 0.5 * (outline.min(axis=0) + outline.max(axis=0))
        places: FloatArray = middle + grid[np.argsort(np.hypot(*grid.T), kind="stable")]
        label = None
        for size in _SIZES:
            half = 0.5 * np.array([_LETTER_WIDTH * len(placement.name), _LETTER_HEIGHT]) * size
            boxes = np.hstack((places - half, places + half))
            beyond = boxes[:, None, :2] >= taken[:, 2:] + _CLEARANCE
            before = boxes[:, None, 2:] <= taken[:, :2] - _CLEARANCE
            clear = np.all(np.any(beyond | before, axis=2), axis=1)
            fits = np.flatnonzero(shapely.contains(free, shapely.box(*boxes.T)) & clear)
            if len(fits):
                label = Label(float(places[fits[0], 0]), float(places[fits[0], 1]), size)
                taken = np.vstack((taken, boxes[fits[0]]))
                break
        labels.append(label)
    return tuple(labels)
