"""Files of the geometry, one module per format."""

from coilarray.geometry.export.dxf import write_dxf
from coilarray.geometry.export.gerber import write_gerbers
from coilarray.geometry.export.kicad import write_kicad
from coilarray.geometry.export.solid_files import write_solids
from coilarray.geometry.export.step import write_step
from coilarray.geometry.export.svg import write_svg

__all__ = ["write_dxf", "write_gerbers", "write_kicad", "write_solids", "write_step", "write_svg"]
