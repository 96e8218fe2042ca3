"""SVG drawings of the board, at its size in millimetres."""

from __future__ import annotations

import math
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from coilarray.compute.files import require_suffix, write_text
from coilarray.geometry.array import Array
from coilarray.geometry.copper import board_outline, copper_by_layer, drills

_MM = 1e3
_ON_SCREEN = 3000  # parts of the board that a screen shows
_DIGITS = 4  # of a coordinate in mm: 0.1 µm, a thousandth of the finest trace
_TEXT_HEIGHT = 1.5  # mm
_BASELINE = "0.5"  # mm below the middle of the text: half the height of a capital
_LAMINATE = "#F4F1E8"
_MARGIN = 0.5  # mm of paper around the board
# Okabe & Ito (2008), "Color Universal Design": neighbouring layers differ strongly, for eyes of any colour vision
_LAYER_COLOURS = ("#D55E00", "#E69F00", "#0072B2", "#56B4E9", "#CC79A7", "#009E73")
_INKSCAPE = "http://www.inkscape.org/namespaces/inkscape"


def write_svg(array: Array, path: Path, *, title: str = "") -> None:
    """Write the board as an SVG drawing.

    It has the size of the board.

    Parameters
    ----------
    array : Array
        The board.
    path : Path
        File name ending in ``.svg``. The file is written completely or not at all.
    title : str
        Title of the drawing.

    Raises
    ------
    OutputError
        If the suffix is different, or the file cannot be written.

    Notes
    -----
    Inside the group ``board`` coordinates are in mm, with y upwards and the origin of the design. Its groups, from the
    back to the front, are layers in Inkscape: ``outline``, ``copper-<n>``, ``drills`` and ``names``. ``copper-<n>`` is
    the n-th copper layer, with the lowest first. It has a path for each coil, with the name as its title, filled by the
    even-odd rule. The same board gives the same bytes.

    Examples
    --------
    >>> from coilarray.geometry import PlatedHole, Placement, Stackup, path_coil
    >>> coil = path_coil([[(0, 0), (1e-2, 0)]], 0.2e-3, 0.2e-3, PlatedHole(0.3e-3, 0.6e-3))
    >>> board = Array(Stackup(("top",), (35e-6,), (), ()), (Placement("A", coil, ("top",), 0, 0),))
    >>> write_svg(board, Path("board.png"))
    Traceback (most recent call last):
    coilarray.errors.OutputError: cannot write board.png: the suffix must be .svg; got '.png'.
    """
    require_suffix(path, ".svg")
    write_text(path, f'<?xml version="1.0" encoding="UTF-8"?>\n{svg_text(array, title=title)}\n')


def svg_text(array: Array, *, title: str = "", coarse: bool = False) -> str:
    """Return the drawing of `write_svg` as an ``svg`` element.

    A `coarse` drawing, for the screen, is accurate to a three-thousandth of the board and much shorter.
    """
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
