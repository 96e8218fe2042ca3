"""Boards made elsewhere: the copper in their files, and the coils in it."""

from coilarray.geometry.readers.board_copper import BoardCopper, CopperArea, Hole, SurfacePad, Track
from coilarray.geometry.readers.gerber_board import read_gerbers
from coilarray.geometry.readers.kicad_board import read_kicad
from coilarray.geometry.readers.traced_array import TracedArray, traced_array
from coilarray.geometry.readers.tracing import Tracing, trace_coils
from coilarray.geometry.readers.track_graph import TracedCoil

__all__ = [
    "BoardCopper", "CopperArea", "Hole", "SurfacePad", "TracedArray", "TracedCoil", "Tracing", "Track", "read_gerbers",
    "read_kicad", "trace_coils", "traced_array",
]  # fmt: skip
