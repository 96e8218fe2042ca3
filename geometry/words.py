"""Descriptions of a board, made of the coils themselves: its title may belong to the design it was copied from."""

from __future__ import annotations

import base64

import numpy as np
import shapely

from coilarray.compute.display_units import MM
from coilarray.geometry.array import Array
from coilarray.geometry.coil import Coil
from coilarray.geometry.spiral import RoundedSpiral

_SHAPES = {3: "triangular", 4: "square", 6: "hexagonal", 8: "octagonal"}
_MOST_NAMES = 12  # of coils, in a row of a table
_MOST_POINTS = 10_000  # of traces, which are drawn in about a second


def array_words(array: Array) -> str:
    """Describe number, shape, size and spacing of the coils.

    Ways to a connector are left out. The spacing is the distance of the nearest coils. Circles, and windings that step
    in at every corner, have the size of their copper added.

    Examples
    --------
    >>> from coilarray import load_design
    >>> array_words(load_design("proximity").array)
    '1 round coil of 29 × 29 mm (copper 28.848 × 28.848 mm)'
    """
    array = array.unrouted
    outlines = [place.coil.outline for place in array.placements]
    shapes = {_shape(place.coil) for place in array.placements}
    shape = shapes.pop() if len(shapes) == 1 else ""
    sizes = {tuple(f"{side:.4g}" for side in MM.of(np.ptp(outline, axis=0))) for outline in outlines}
    coppers = {copper_words(place.coil) for place in array.placements}
    copper = coppers.pop() if len(coppers) == 1 else ""
    size = f" of {' × '.join(sizes.pop())} mm{copper}" if len(sizes) == 1 else ""
    if len(outlines) == 1:
        return f"1 {shape}coil{size}"
    apart = np.hypot(*(array.centres[:, None] - array.centres).transpose(2, 0, 1))
    np.fill_diagonal(apart, np.inf)
    return f"{len(outlines)} {shape}coils{size}, neighbours {MM.of(apart.min()):.4g} mm apart"


def copper_words(coil: Coil) -> str:
    """Return the size of a winding's copper in brackets.

    It is width by height. The text is empty if they are not below the stated size.
    """
    if coil.wound is None or coil.wound.is_parallel:
        return ""
    spiral = coil.wound
    lines = shapely.MultiLineString([spiral.centre_line(layer) for layer in range(spiral.layers)])
    copper = lines.buffer(spiral.width / 2, cap_style="flat", join_style="mitre")
    width, height = np.ptp(np.reshape(copper.bounds, (2, 2)), axis=0)
    return f" (copper {MM.of(width):.5g} × {MM.of(height):.5g} mm)"


def array_facts(array: Array) -> list[tuple[str, str]]:
    """Return facts about a board as rows.

    A row has a name and a value.
    """
    names, layers = array.names, array.stackup.names
    shown = names if len(names) <= _MOST_NAMES else (*names[:_MOST_NAMES], f"and {len(names) - _MOST_NAMES} more")
    x_min, y_min, x_max, y_max = array.bounds
    return [
        ("coils", array_words(array)),
        ("names", ", ".join(shown)),
        ("board", f"{MM.of(x_max - x_min):.4g} × {MM.of(y_max - y_min):.4g} mm, copper {', '.join(layers)}"),
    ]


def array_picture(array: Array, title: str = "") -> str:
    """Return a drawing as an HTML image.

    The board is drawn to scale. For a board that takes too long to draw it is a sentence.
    """
    points = sum(len(line) for place in array.placements for line, _, _ in place.traces())
    if points > _MOST_POINTS:
        return f"<p>not drawn here, as its traces have {points} points; coilarray.export draws it</p>"
    from coilarray.geometry.export.svg import svg_text

    drawing = base64.b64encode(svg_text(array, title=title, coarse=True).encode()).decode()
    return f'<p><img alt="the board" src="data:image/svg+xml;base64,{drawing}"></p>'


def _shape(coil: Coil) -> str:
    """Return the word for a coil's shape.

    A blank follows the word. It is empty for a path.
    """
    if coil.wound is None:
        return ""
    spiral = coil.wound
    if not isinstance(spiral, RoundedSpiral):
        return f"{_SHAPES.get(spiral.sides, f'{spiral.sides}-sided')} "
    if spiral.is_circle:
        return "round "
    if spiral.sides != 4:
        return f"rounded {_SHAPES.get(spiral.sides, f'{spiral.sides}-sided')} "
    if spiral.corner_radius >= min(spiral.extent, spiral.breadth) / 2:
        return "racetrack "
    return "square " if spiral.extent == spiral.breadth else "rectangular "
