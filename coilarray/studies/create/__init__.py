"""New designs from a few choices."""

from coilarray.studies.create.layout import neighbour_coupling
from coilarray.studies.create.new_design import broken_limits, is_standard, new_design
from coilarray.studies.create.plan import LONG_SHAPES, Choices, read_arrangement, read_size

__all__ = [
    "LONG_SHAPES",
    "Choices",
    "broken_limits",
    "is_standard",
    "neighbour_coupling",
    "new_design",
    "read_arrangement",
    "read_size",
]
