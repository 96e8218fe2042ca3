"""Texts, dimensions and whatever else stands on a copper layer of a KiCad board, as the rectangles around them."""

from __future__ import annotations

import math
from collections.abc import Iterator

import shapely
import shapely.affinity
from shapely.geometry.base import BaseGeometry

from coilarray.geometry.readers.kicad_graphics import Point, ToBoard, pair
from coilarray.geometry.readers.sexpr import Node

_TEXTS = {"gr_text": 0, "fp_text": 1, "property": 1}  # with the index of the text among the words
_NO_COPPER = ("generated", "image", "layer", "pad", "zone")  # what copper they have stands elsewhere in the file
_PLACES = ("at", "start", "mid", "end", "center", "xy")
_LETTER = 1.2  # largest width of KiCad's letters over the size of the font
_LINE = 1.7  # distance of lines over the size
_PER_M = 1e3  # numbers in the file are in mm


def other_copper(node: Node, to_board: ToBoard) -> Iterator[tuple[BaseGeometry, str]]:
    """Give the rectangle in m around a node that is no track and no shape, and what it is; none where it is hidden.

    Parameters
    ----------
    node : Node
        A text, a text box, a dimension, or one that is not known.
    to_board : callable
        From the frame that the node is in.
    """
    if node.name in _NO_COPPER or _is_hidden(node):
        return
    if node.name in _TEXTS:
        yield _text_box(node, to_board), "a text"
        return
    what = {"gr_text_box": "a text box", "fp_text_box": "a text box", "dimension": "a dimension"}.get(node.name)
    height = node.child("height")
    margin = 0.0 if height is None else abs(height.number()) / _PER_M  # of a dimension's line from what it measures
    around = shapely.MultiPoint([to_board(x, y) for x, y in _places(node)]).envelope
    yield around.buffer(max(margin, 1e-9)), what or f"an unknown ({node.name} …)"


def _text_box(node: Node, to_board: ToBoard) -> BaseGeometry:
    """Rectangle around a text; one that is not centred reaches to both sides, for it may be mirrored or turned over."""
    effects = node.child("effects") or node
    font = effects.child("font")
    size = None if font is None else font.child("size")
    height, width = (1.0, 1.0) if size is None else pair(size)
    stroke = None if font is None else font.child("thickness")
    bold = 0.15 * height if stroke is None else stroke.number()
    text = node.words[_TEXTS[node.name]] if len(node.words) > _TEXTS[node.name] else ""
    rows = text.split("\n")
    justify = effects.child("justify")
    words = () if justify is None else justify.words
    x = max(map(len, rows)) * width * _LETTER / 2 * (2 if {"left", "right"} & set(words) else 1) + bold
    y = len(rows) * height * _LINE / 2 * (2 if {"top", "bottom"} & set(words) else 1) + bold
    place = node.need("at")
    turn = math.radians(place.number(2)) if len(place.words) > 2 and _is_number(place.words[2]) else 0.0
    box = shapely.box(-x / _PER_M, -y / _PER_M, x / _PER_M, y / _PER_M)
    turned = shapely.affinity.rotate(box, turn, origin=(0, 0), use_radians=True)
    return shapely.affinity.translate(turned, *to_board(*pair(place)))


def _is_number(word: str) -> bool:
    return word.lstrip("+-").replace(".", "", 1).isdecimal()


def _is_hidden(node: Node) -> bool:
    return any(
        "hide" in part.words or any(hide.words[:1] != ("no",) for hide in part.children("hide"))
        for part in (node, *node.children("effects"))
    )


def _places(node: Node) -> Iterator[Point]:
    """Give every place inside a node."""
    for item in node.items:
        if isinstance(item, Node):
            if item.name in _PLACES and len(item.words) > 1:
                yield pair(item)
            yield from _places(item)
