"""The first coils of gast2020 over an aluminium backplane, as a design file says it."""

from coilarray.design.model import parse_design
from support.contacts import first_coils


def over_backplane(count, distance_mm=1.0):
    """Return a design of so many coils, with a plate so far below the board."""
    plate = f"""
[[plate]]
name = "backplane"
material = "aluminium"
thickness_mm = 1.0
distance_mm = {distance_mm}
side = "below"
"""
    return parse_design(first_coils(count) + plate)
