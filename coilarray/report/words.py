"""A board in words, made of the design itself: a title may be that of the design it was copied from."""

from __future__ import annotations

import numpy as np

from coilarray.compute.display_units import MM
from coilarray.geometry import CoilArray

_SHAPES = {3: "triangular", 4: "four-sided", 6: "hexagonal", 8: "octagonal"}
_ROUND = 12  # corners from which on an outline is a circle for the eye


def array_words(array: CoilArray) -> str:
    """Return number, shape and size of the coils, and the distance of the nearest neighbours.

    Examples
    --------
    >>> from coilarray import load_design
    >>> array_words(load_design("gast2020").array)
    '6 hexagonal coils of 23 × 26.6 mm, neighbours 13.3 mm apart'
    """
    outlines = [place.coil.outline for place in array.placements]
    corners = {len(outline) for outline in outlines}
    count = corners.pop() if len(corners) == 1 else 0
    shape = "round " if count > _ROUND else f"{_SHAPES[count]} " if count in _SHAPES else ""
    sizes = {tuple(f"{side:.3g}" for side in MM.of(np.ptp(outline, axis=0))) for outline in outlines}
    size = f" of {' × '.join(sizes.pop())} mm" if len(sizes) == 1 else ""
    if len(outlines) == 1:
        return f"1 {shape}coil{size}"
    apart = np.hypot(*(array.centres[:, None] - array.centres).transpose(2, 0, 1))
    np.fill_diagonal(apart, np.inf)
    return f"{len(outlines)} {shape}coils{size}, neighbours {MM.of(apart.min()):.3g} mm apart"
