"""New designs from a few choices: winding, layers, pitch, terminals and tank are found."""

from coilarray.studies.create.arrangement import read_arrangement, read_size
from coilarray.studies.create.decoupling import neighbour_coupling
from coilarray.studies.create.new_design import check_choices, new_design
from coilarray.studies.create.tank import broken_limits

__all__ = ["broken_limits", "check_choices", "neighbour_coupling", "new_design", "read_arrangement", "read_size"]
