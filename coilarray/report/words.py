"""A board in words, made of the design itself: a title may be that of the design it was copied from."""

from __future__ import annotations

import numpy as np

from coilarray.compute.display_units import MM
from coilarray.design.model import Design
from coilarray.geometry import Coil, CoilArray, RoundedSpiral

_SHAPES = {3: "triangular", 4: "square", 6: "hexagonal", 8: "octagonal"}


def array_words(array: CoilArray) -> str:
    """Return number, shape and size of the coils, and the distance of the nearest neighbours.

    Examples
    --------
    >>> from coilarray import load_design
    >>> array_words(load_design("gast2020").array)
    '6 hexagonal coils of 23 × 26.6 mm, neighbours 13.3 mm apart'
    """
    outlines = [place.coil.outline for place in array.placements]
    shapes = {_shape(place.coil) for place in array.placements}
    shape = shapes.pop() if len(shapes) == 1 else ""
    sizes = {tuple(f"{side:.3g}" for side in MM.of(np.ptp(outline, axis=0))) for outline in outlines}
    size = f" of {' × '.join(sizes.pop())} mm" if len(sizes) == 1 else ""
    if len(outlines) == 1:
        return f"1 {shape}coil{size}"
    apart = np.hypot(*(array.centres[:, None] - array.centres).transpose(2, 0, 1))
    np.fill_diagonal(apart, np.inf)
    return f"{len(outlines)} {shape}coils{size}, neighbours {MM.of(apart.min()):.3g} mm apart"


def metal_words(design: Design) -> str:
    """Return the metal near the coils: plates by their names, and the target; empty where there is none.

    Examples
    --------
    >>> from coilarray import load_design
    >>> metal_words(load_design("proximity")), metal_words(load_design("gast2020"))
    ('an aluminium plate as target', '')
    """
    found = [f"the plate {plate.name} of {plate.material.words}" for plate in design.plates]
    if design.target is not None:
        material = design.target.body.material.words
        article = "an" if material[0] in "aeiou" else "a"
        found.append(f"{article} {material} {design.target.kind} as target")
    return " and ".join([", ".join(found[:-1]), found[-1]] if len(found) > 1 else found)


def _shape(coil: Coil) -> str:
    """Return the word for a coil's shape, with a blank behind it; none for a path."""
    if coil.wound is None:
        return ""
    spiral = coil.wound.spiral
    if not isinstance(spiral, RoundedSpiral):
        return f"{_SHAPES.get(spiral.sides, f'{spiral.sides}-sided')} "
    if spiral.is_circle:
        return "round "
    if spiral.sides != 4:
        return f"rounded {_SHAPES.get(spiral.sides, f'{spiral.sides}-sided')} "
    if spiral.corner_radius >= min(spiral.extent, spiral.breadth) / 2:
        return "racetrack "
    return "square " if spiral.extent == spiral.breadth else "rectangular "
