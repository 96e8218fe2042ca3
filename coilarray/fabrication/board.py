"""Copper of a board's files, with assumptions for missing values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Literal

import shapely
from shapely.geometry.base import BaseGeometry

from coilarray.errors import GeometryError
from coilarray.geometry.arcs import Point
from coilarray.geometry.copper import disc
from coilarray.geometry.stackup import BOARD_THICKNESS, COPPER_THICKNESS, EPSILON_R, Stackup


@dataclass(frozen=True)
class Track:
    """Straight piece of a trace, arc or drawn line in m, of a `net` if named, at "file:line" or "file"."""

    layer: str
    start: Point
    end: Point
    width: float
    net: str | None
    where: str
    what: str = "a track"
    part: str = ""  # reference of the footprint ("L1")

    @property
    def copper(self) -> dict[str, BaseGeometry]:
        """Area in m by layer, with round ends."""
        return {self.layer: shapely.LineString((self.start, self.end)).buffer(self.width / 2)}


@dataclass(frozen=True)
class Hole:
    """Plated hole of a via or a pad, in m."""

    x: float
    y: float
    drill: float  # smaller side of a slot
    pad: float  # smaller side
    layers: tuple[str, ...]  # that it joins, top to bottom
    net: str | None
    kind: Literal["via", "pad"]  # nets begin and end at a "pad"
    where: str
    number: str = ""  # of a pad in its footprint ("1", "A4"), empty for vias
    shapes: Mapping[str, BaseGeometry] = field(default_factory=dict, repr=False, compare=False)  # none: a disc
    part: str = ""  # reference of the footprint ("U1")
    value: str = ""  # of the footprint ("100 pF")

    @property
    def what(self) -> str:
        """Its name in messages."""
        return f"a {self.kind}"

    @property
    def copper(self) -> dict[str, BaseGeometry]:
        """Area in m by layer, of the barrel where it has no pad."""
        barrel = disc(self.x, self.y, self.drill if self.shapes else self.pad)
        return {layer: self.shapes.get(layer, barrel) for layer in self.layers}


@dataclass(frozen=True)
class SurfacePad:
    """Pad in m without a hole, a disc by default, of the smaller side `size`."""

    what: ClassVar[str] = "a pad"
    kind: ClassVar[str] = "pad"
    x: float
    y: float
    layer: str
    net: str | None
    where: str
    number: str = ""
    size: float = 0.0
    shape: BaseGeometry | None = field(default=None, repr=False, compare=False)
    part: str = ""
    value: str = ""

    @property
    def copper(self) -> dict[str, BaseGeometry]:
        """Area in m by layer."""
        return {self.layer: disc(self.x, self.y, self.size) if self.shape is None else self.shape}


@dataclass(frozen=True, eq=False)
class CopperArea:
    """Copper in m such as "a filled zone"."""

    layer: str
    shape: BaseGeometry
    net: str | None
    what: str
    where: str
    part: str = ""

    @property
    def copper(self) -> dict[str, BaseGeometry]:
        """Area in m by layer."""
        return {self.layer: self.shape}


Copper = Track | Hole | SurfacePad | CopperArea


@dataclass(frozen=True, eq=False)
class BoardCopper:
    """Conductors of a board as its file has them."""

    source: str
    stackup: Stackup
    tracks: tuple[Track, ...]
    holes: tuple[Hole, ...]
    pads: tuple[SurfacePad, ...]
    assumed: dict[str, str] = field(default_factory=dict)  # reasons by dotted keys of [stackup]
    areas: tuple[CopperArea, ...] = ()  # zones and drawn shapes
    edge: tuple[float, float, float, float] | None = None  # x_min, y_min, x_max, y_max in m of the outline
    notes: tuple[str, ...] = ()  # sentences for the user


Slab = tuple[float | None, float | None]
"""Thickness in m and relative permittivity of a dielectric, None if unknown."""


def united(parts: Sequence[Slab]) -> Slab:
    """Return one dielectric with the thickness, if known, and capacitance of several."""
    thicknesses = [thickness for thickness, _ in parts if thickness is not None]
    epsilons = [epsilon for _, epsilon in parts if epsilon is not None]
    thickness = sum(thicknesses) if parts and len(thicknesses) == len(parts) else None
    if len(parts) == 1 or not parts or len(epsilons) < len(parts) or min(epsilons) <= 0:
        return thickness, parts[0][1] if len(parts) == 1 else None
    weights = [1.0] * len(parts) if thickness is None else thicknesses
    return thickness, sum(weights) / sum(d / epsilon for d, epsilon in zip(weights, epsilons, strict=True))


def completed_stackup(
    names: Sequence[str],
    copper: Sequence[float | None],
    slabs: Sequence[Sequence[Slab]],
    board: float | None,
    files: str,
    assumed: dict[str, str],
) -> Stackup:
    """Make a stack-up in m, with usual values where some are missing."""
    # `board` is the whole thickness, `slabs` are dielectrics in series, `assumed` records, `files` is "the files do".
    between = [united(parts) for parts in slabs]
    if None in copper:
        assumed["stackup.copper_thickness_um"] = f"{files} not say; standard 1 oz copper"
    thicknesses = [COPPER_THICKNESS if thickness is None else thickness for thickness in copper]
    missing = sum(thickness is None for thickness, _ in between)
    share = 0.0
    if missing:
        whole = BOARD_THICKNESS if board is None else board
        share = (whole - sum(thicknesses) - sum(thickness or 0.0 for thickness, _ in between)) / missing
        given = "usual" if board is None else "given"
        if share <= 0:
            raise GeometryError(
                f"a board of {whole * 1e3:g} mm, the {given} thickness, is too thin for its {len(names)} copper layers."
            )
        assumed["stackup.dielectric_thickness_mm"] = (
            f"{files} not say; equal parts of what is left of the {given} board thickness of {whole * 1e3:g} mm"
        )
    if any(epsilon is None for _, epsilon in between):
        assumed["stackup.dielectric_epsilon_r"] = f"{files} not say; FR-4, {EPSILON_R:g}"
    return Stackup(
        tuple(names),
        tuple(thicknesses),
        tuple(share if thickness is None else thickness for thickness, _ in between),
        tuple(EPSILON_R if epsilon is None else epsilon for _, epsilon in between),
    )
