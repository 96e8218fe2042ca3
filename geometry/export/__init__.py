"""Files of the geometry, one module a format."""

from coilarray.geometry.export.solid_files import write_solids

__all__ = ["write_solids"]
