"""Copper of a board that was made elsewhere, and what is assumed where its files say nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from shapely.geometry.base import BaseGeometry

from coilarray.geometry.copper import disc
from coilarray.geometry.stackup import BOARD_THICKNESS, COPPER_THICKNESS, EPSILON_R, Stackup
from coilarray.geometry.values import Point


@dataclass(frozen=True)
class Track:
    """A straight piece of trace with round or flat ends; arcs come divided into such pieces.

    Parameters
    ----------
    layer : str
        Name of the copper layer in the stack-up.
    start, end : tuple of float
        Ends of the centre line in m, in the frame of the board (x right, y up).
    width : float
        Width in m.
    net : str or None
        None if the file names none.
    where : str
        "file:line" or "file", for messages.
    """

    layer: str
    start: Point
    end: Point
    width: float
    net: str | None
    where: str


@dataclass(frozen=True)
class Hole:
    """A drilled and plated hole, of a via or of a pad.

    Parameters
    ----------
    x, y : float
        Centre in m.
    drill : float
        Diameter of the hole in m; of a slot, the smaller one.
    pad : float
        Diameter of the pad in m; of a pad that is not round, the smaller one.
    layers : tuple of str
        Copper layers that it joins, top to bottom.
    net, where
        As of `Track`.
    kind : {"via", "pad"}
        Pads are where a net may begin and end.
    number : str
        Number of a pad in its footprint ("1", "A4"); empty for vias and where the file has none.
    shapes : mapping of str to shapely geometry
        The pad in m on the layers where it is; empty for a disc of `pad` on all of them.
    """

    x: float
    y: float
    drill: float
    pad: float
    layers: tuple[str, ...]
    net: str | None
    kind: Literal["via", "pad"]
    where: str
    number: str = ""
    shapes: Mapping[str, BaseGeometry] = field(default_factory=dict, repr=False, compare=False)

    def copper(self, layer: str) -> BaseGeometry:
        """Return the copper on one layer in m: the pad, or the barrel alone where it has no pad."""
        size = self.drill if self.shapes else self.pad
        return self.shapes[layer] if layer in self.shapes else disc(self.x, self.y, size)


@dataclass(frozen=True)
class SurfacePad:
    """A pad without a hole.

    Parameters
    ----------
    x, y : float
        Centre in m.
    layer, net, where, number
        As of `Track` and `Hole`.
    size : float
        Smaller side or diameter in m; a track that ends within half of it from the centre is joined to the pad.
    shape : shapely geometry, optional
        Area that it covers, in m; without it a disc of diameter `size`.
    """

    x: float
    y: float
    layer: str
    net: str | None
    where: str
    number: str = ""
    size: float = 0.0
    shape: BaseGeometry | None = field(default=None, repr=False, compare=False)

    @property
    def copper(self) -> BaseGeometry:
        """What it covers, in m."""
        return disc(self.x, self.y, self.size) if self.shape is None else self.shape


@dataclass(frozen=True, eq=False)
class CopperArea:
    """Copper that is not a track: a filled zone, a region, a polygon, a drawn line or text.

    Parameters
    ----------
    layer, net, where
        As of `Track`.
    shape : shapely geometry
        The copper (of a zone without fill, its outline) in m.
    what : str
        Name for messages: "a filled zone", "a drawn line".
    """

    layer: str
    shape: BaseGeometry
    net: str | None
    what: str
    where: str


@dataclass(frozen=True, eq=False)
class BoardCopper:
    """The conductors of a board as its file has them.

    Parameters
    ----------
    source : str
        Name of the file or folder, for messages.
    stackup : Stackup
        The board's layers, with the file's own layer names.
    tracks : tuple of Track
        Tracks in the order of the file.
    holes : tuple of Hole
        Plated ones only.
    pads : tuple of SurfacePad
        Pads without a hole.
    assumed : dict of str to str
        Dotted keys of the design's [stackup] table that the file does not say, with what was taken and why.
    areas : tuple of CopperArea
        Copper that cannot be followed as a path; refused where a coil touches it or shares its net.
    edge : tuple of float, optional
        x_min, y_min, x_max, y_max in m of the board's outline, where the file has one.
    notes : tuple of str
        Sentences on how the file was read, for the user.
    """

    source: str
    stackup: Stackup
    tracks: tuple[Track, ...]
    holes: tuple[Hole, ...]
    pads: tuple[SurfacePad, ...]
    assumed: dict[str, str] = field(default_factory=dict)
    areas: tuple[CopperArea, ...] = ()
    edge: tuple[float, float, float, float] | None = None
    notes: tuple[str, ...] = ()


Slab = tuple[float | None, float | None]
"""Thickness in m and relative permittivity of a dielectric, None if it is not said."""


def united(parts: Sequence[Slab]) -> Slab:
    """Return one dielectric of the thickness and the capacitance of several in series between two copper layers.

    Without a thickness where one part has none: then the permittivity is that of equal parts.

    Examples
    --------
    >>> thickness, epsilon_r = united([(0.1e-3, 4.0), (0.3e-3, 3.0)])
    >>> round(thickness, 9), round(epsilon_r, 9)
    (0.0004, 3.2)
    """
    thicknesses = [thickness for thickness, _ in parts if thickness is not None]
    epsilons = [epsilon for _, epsilon in parts if epsilon is not None]
    thickness = sum(thicknesses) if parts and len(thicknesses) == len(parts) else None
    if len(parts) == 1 or not parts or len(epsilons) < len(parts) or min(epsilons) <= 0:
        return thickness, parts[0][1] if len(parts) == 1 else None
    weights = [1.0] * len(parts) if thickness is None else thicknesses
    return thickness, sum(weights) / sum(d / epsilon for d, epsilon in zip(weights, epsilons, strict=True))


def filled_copper(given: Sequence[float | None], files: str, assumed: dict[str, str]) -> tuple[float, ...]:
    """Put the usual thickness of copper where none is given, and say so in `assumed`; `files` is "the files do"."""
    if None in given:
        assumed["stackup.copper_thickness_um"] = f"{files} not say; standard 1 oz copper"
    return tuple(COPPER_THICKNESS if thickness is None else thickness for thickness in given)


def filled_dielectrics(
    slabs: Sequence[Slab], copper: Sequence[float], board: float | None, files: str, assumed: dict[str, str]
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Put usual values where a dielectric, top to bottom, has none, and say so in `assumed` (as in `BoardCopper`).

    `copper` are thicknesses in m, `board` is that of the whole board where it is said, `files` is "the files do".
    Returns thicknesses in m, not positive where the board is too thin for its copper, and relative permittivities.
    """
    missing = sum(thickness is None for thickness, _ in slabs)
    share = 0.0
    if missing:
        whole = BOARD_THICKNESS if board is None else board
        share = (whole - sum(copper) - sum(thickness or 0.0 for thickness, _ in slabs)) / missing
        assumed["stackup.dielectric_thickness_mm"] = (
            f"{files} not say; equal parts of what is left of the {'usual' if board is None else 'given'} board "
            f"thickness of {whole * 1e3:g} mm"
        )
    if any(epsilon is None for _, epsilon in slabs):
        assumed["stackup.dielectric_epsilon_r"] = f"{files} not say; FR-4, {EPSILON_R:g}"
    return (
        tuple(share if thickness is None else thickness for thickness, _ in slabs),
        tuple(EPSILON_R if epsilon is None else epsilon for _, epsilon in slabs),
    )
