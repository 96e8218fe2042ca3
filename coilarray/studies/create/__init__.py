"""New designs from a few choices: winding, layers, pitch, terminals and tank are found."""

from coilarray.studies.create.choices import LONG_SHAPES, Choices, read_arrangement, read_size
from coilarray.studies.create.layout import neighbour_coupling
from coilarray.studies.create.new_design import Reach, new_design, reach_of_fewer_layers
from coilarray.studies.create.tank import broken_limits, is_standard

__all__ = [
    "LONG_SHAPES",
    "Choices",
    "Reach",
    "broken_limits",
    "is_standard",
    "neighbour_coupling",
    "new_design",
    "reach_of_fewer_layers",
    "read_arrangement",
    "read_size",
]
