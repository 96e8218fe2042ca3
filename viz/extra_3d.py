"""PyVista for functions that draw in three dimensions.

They import it from here when they are called. If it is not installed, MissingDependencyError names
the extra that brings it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from coilarray.compute.extras import import_extra

if TYPE_CHECKING:
    import pyvista
else:
    pyvista = import_extra("pyvista", "pictures in three dimensions", package="PyVista", extra="3d")

__all__ = ["pyvista"]
