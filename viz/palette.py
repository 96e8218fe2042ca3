"""The colours of all pictures: Okabe and Ito's set, which people with any colour vision tell apart."""

from __future__ import annotations

from collections.abc import Sequence

# Okabe & Ito (2008), "Color Universal Design", https://jfly.uni-koeln.de/color/; yellow is left out, being too faint
# for thin lines on white.
BLUE = "#0072B2"
VERMILLION = "#D55E00"
GREEN = "#009E73"
PURPLE = "#CC79A7"
ORANGE = "#E69F00"
SKY = "#56B4E9"
INK = "#202020"  # text and rulers

COILS = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY)
LAYERS = (VERMILLION, ORANGE, BLUE, SKY, PURPLE, GREEN)  # neighbours alike, pairs of layers far apart
LAMINATE = "#3F8F4F"
BARREL = "#8C6D1F"
SHEETS = ("#5F7391", "#8A4F9E", "#5B5B5B")


def cycled(colours: Sequence[str], names: Sequence[str]) -> dict[str, str]:
    """Give each name a colour, beginning again with the first where there are more names than colours."""
    return {name: colours[k % len(colours)] for k, name in enumerate(names)}
