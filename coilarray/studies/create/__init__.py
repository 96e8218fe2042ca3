"""New designs from a few choices: winding, layers, pitch, terminals and tank are found."""

from coilarray.studies.create.arrangement import read_arrangement, read_size
from coilarray.studies.create.decoupling import neighbour_coupling
from coilarray.studies.create.new_design import Reach, check_choices, new_design, reach_of_fewer_layers
from coilarray.studies.create.tank import broken_limits, is_standard

__all__ = [
    "Reach",
    "broken_limits",
    "check_choices",
    "is_standard",
    "neighbour_coupling",
    "new_design",
    "reach_of_fewer_layers",
    "read_arrangement",
    "read_size",
]
