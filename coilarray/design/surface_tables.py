"""The table of a design file about coils on a surface."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, model_validator

from coilarray.design.board_tables import BoardTable, coil_named, require_layers
from coilarray.design.keys import MM, Degrees, LimitMillimetres, Millimetres, Name, Position, Table, entry_of
from coilarray.errors import DesignError, GeometryError
from coilarray.geometry import Array, Coil, Pose, Stackup, Surface, SurfaceLattice, spread
from coilarray.geometry.surface import MOST_COILS, Mirror
from coilarray.geometry.surface_array import OnSurface, sizes_by_distance

_Place = Annotated[list[Position], Field(min_length=3, max_length=3)]


class SurfaceArray(Table):
    """``[array]`` with ``lattice = "surface"``: coils on a dome or a mesh, each on a board of its own."""

    ATTRIBUTES: ClassVar = {"level_step_mm": "step"}

    lattice: Literal["surface"]
    """Coils on a surface."""
    coil: str
    """Name of their shape, a table of `[coils]`."""
    surface: str
    """The word "dome", or a mesh file beside this file: .stl, .obj, .ply or .off."""
    radii_mm: Annotated[list[Millimetres], Field(min_length=3, max_length=3)] | None = None
    """Half axes of a dome, half an ellipsoid about the origin that points along z."""
    skirt_mm: LimitMillimetres = 0.0
    """Length of the elliptic cylinder below a dome."""
    unit_mm: Millimetres = 1.0
    """Length of the unit of a mesh file, which does not name it."""
    count: Annotated[int, Field(ge=1, le=MOST_COILS)] | None = None
    """Number of coils, which are spread evenly; give this or points_mm."""
    mirror: Mirror | None = None
    """Axis across a plane through the origin at which the places of spread coils are mirrored."""
    points_mm: Annotated[list[_Place], Field(min_length=1, max_length=MOST_COILS)] | None = None
    """Places [x, y, z] of the coils' centres on the surface."""
    sizes_mm: list[Millimetres] | None = None
    """Width of every coil; that of the shape by default."""
    size_over_distance: Annotated[float, Field(gt=0, le=3)] | None = None
    """Width of every coil over its mean distance to its neighbours, in place of sizes_mm."""
    wrapped: bool = False
    """Whether the coils are laid onto the surface; otherwise they are flat and tangent to it."""
    level_step_mm: Millimetres | None = None
    """Height by which a coil lies over another where they overlap; twice the board by default."""
    rotation_deg: Degrees = 0.0
    """Rotation of every coil about its normal, counter-clockwise; y of a coil points up the slope."""
    layers: list[str] = Field(min_length=1)
    """Copper layers of every coil."""
    names: list[Name] | None = None
    """Names of the coils in order; coil1, coil2 and so on by default."""

    @model_validator(mode="after")
    def _one_of_each(self) -> SurfaceArray:
        dome = self.surface == "dome"
        if (self.radii_mm is not None) != dome:
            raise ValueError(f'{"needs" if dome else "has no"} radii_mm for surface = "{Path(self.surface).name}"')
        if self.skirt_mm and not dome:
            raise ValueError('has skirt_mm for surface = "dome" only')
        if self.unit_mm != 1.0 and dome:
            raise ValueError("has unit_mm for mesh files only")
        if (self.count is None) == (self.points_mm is None):
            raise ValueError("needs exactly one of count and points_mm")
        if self.mirror is not None and self.count is None:
            raise ValueError("has mirror beside count only")
        if self.sizes_mm is not None and self.size_over_distance is not None:
            raise ValueError("needs at most one of sizes_mm and size_over_distance")
        if self.size_over_distance is not None and 1 in (self.count, len(self.points_mm or ())):
            raise ValueError("has size_over_distance for several coils only")
        return self

    def build(self, stackup: Stackup, coils: Mapping[str, Coil], board: BoardTable) -> tuple[tuple[Array, Pose], ...]:
        """Return the boards of the coils in SI, with their poses."""
        coil = coil_named(coils, self.coil, "array.coil")
        require_layers(stackup, self.layers, "array.layers")
        try:
            if self.radii_mm is not None:
                surface = Surface.dome([radius * MM for radius in self.radii_mm], self.skirt_mm * MM)
            else:
                surface = Surface.read(Path(self.surface), self.unit_mm * MM)
        except GeometryError as error:
            raise DesignError(f"array.surface: {error}") from None
        given = self.in_si("layers", "rotation_deg", "level_step_mm", "wrapped", "names", "points_mm", "sizes_mm")
        points, sizes = given.pop("points"), given.pop("sizes")
        if self.count is not None:
            points = spread(surface, self.count, self.mirror)
        if self.size_over_distance is not None:
            sizes = sizes_by_distance(surface, points, self.size_over_distance)
        return SurfaceLattice(surface, points, sizes=sizes, **given).boards(coil, stackup, **board.of_array)

    @classmethod
    def of(cls, made: OnSurface, names: Mapping[str, str], layers: Mapping[str, str]) -> dict[str, Any]:
        """Return the entries of a lattice, with its places."""
        lattice, surface = made.lattice, made.lattice.surface
        table: dict[str, Any] = {"lattice": "surface", "coil": made.coil.name or "shape1", "surface": surface.file}
        if surface.dome_sizes is not None:
            entries = [entry_of(size, MM) for size in surface.dome_sizes]
            table |= {"surface": "dome", "radii_mm": entries[:3], "skirt_mm": entries[3]}
        elif surface.file is None:
            raise DesignError("a design file cannot hold a mesh; write it to a file and read that by Surface.read.")
        elif surface.unit != MM:
            table["unit_mm"] = entry_of(surface.unit, MM)
        keys = ("points_mm", "sizes_mm", "wrapped", "level_step_mm", "rotation_deg")
        table |= cls.entries_of(lattice, *keys) | {"layers": [layers[layer] for layer in lattice.layers]}
        return table if lattice.names is None else table | {"names": [names[name] for name in lattice.names]}
