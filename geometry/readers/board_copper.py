"""What every reader of board files returns: tracks, holes, pads and the stack-up, in metres."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from shapely.geometry.base import BaseGeometry

from coilarray.geometry.copper import disc
from coilarray.geometry.stackup import Stackup


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
        In m.
    net : str or None
        None where the file names none.
    where : str
        "file:line" or "file", for messages.
    """

    layer: str
    start: tuple[float, float]
    end: tuple[float, float]
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
    net : str or None
        None where the file names none.
    kind : {"via", "pad"}
        Pads are where a net may begin and end.
    where : str
        "file:line" or "file", for messages.
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
    layer : str
        Name of the copper layer in the stack-up.
    net : str or None
        None where the file names none.
    where : str
        "file:line" or "file", for messages.
    number : str
        Number of the pad in its footprint; empty where the file has none.
    size : float
        Smaller side or diameter in m; a track that ends within half of it from the centre is joined to the pad.
    shape : shapely geometry, optional
        What it covers in m; without it a disc of `size`.
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
    """Copper that is no track: a filled zone, a region, a polygon, a drawn line or text.

    Parameters
    ----------
    layer : str
        Name of the copper layer in the stack-up.
    shape : shapely geometry
        The copper (of a zone without fill, its outline) in m.
    net : str or None
        None where the file names none.
    what : str
        What it is, for messages: "a filled zone", "a drawn line".
    where : str
        "file:line" or "file", for messages.
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
        In the order of the file.
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
        What a user should know of how the file was read, a sentence each.
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
