"""PyVista, for the functions that draw in three dimensions: they import it from here, when they are called.

MissingDependencyError says which extra brings it, where it is not installed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from coilarray.compute.extras import import_extra

if TYPE_CHECKING:
    import pyvista
else:
    pyvista = import_extra("pyvista", "pictures in three dimensions", package="PyVista", extra="3d")

__all__ = ["pyvista"]
