"""Boards in zips or folders of Gerber and Excellon files."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Literal

import shapely

from coilarray.errors import BoardError
from coilarray.fabrication.board import BoardCopper, CopperArea, Hole, SurfacePad, Track
from coilarray.fabrication.gerber_files import (
    Clear,
    DataFile,
    DrilledHole,
    Flash,
    Region,
    Stroke,
    find_files,
    job_stackup,
    parse_drills,
    parse_gerber,
)
from coilarray.geometry.arcs import Point
from coilarray.geometry.stackup import Stackup

_LAYER = re.compile(r"L0*([1-9]\d*)")


def read_gerbers(path: Path, stackup: Stackup | None = None) -> BoardCopper:
    """Read the conductors of a board from fabrication data.

    `path` is a zip or folder with a Gerber file for every copper layer and, from two layers on,
    Excellon files. A given `stackup` replaces the stack-up of the job file. Nets come from the
    attribute .N. `assumed` lists the values that neither a job file nor `stackup` gives.

    Strokes are tracks, divided on arcs within 1 µm. Flashes are the pads of the holes drilled
    through them, otherwise surface pads. Regions are areas, which are no path for a current. A
    plated hole is a terminal's pad if an attribute marks it as such or the solder mask is open over
    it. Otherwise it is a via. Holes reach the layers given by the file's function, by default all.
    Clear shapes may cut regions, but not tracks and pads. A hole has one pad size, the smallest of
    its layers. A hole without a pad is left out with a note, or refused if a track leads into it.
    """
    files = find_files(path)
    copper = _copper_files(files, path)
    if stackup is None:
        job = next((file for file in files if file.kind == "job"), None)
        board, assumed = job_stackup(job, len(copper), str(path))
    elif len(stackup.names) == len(copper):
        board, assumed = stackup, {}
    else:
        raise BoardError(f"{path}: has {len(copper)} copper layers and the given stack-up {len(stackup.names)}.")
    drawn = {layer: parse_gerber(file) for layer, file in zip(board.names, copper, strict=True)}
    for objects in drawn.values():
        solid = [(k, item.shape) for k, item in enumerate(objects) if isinstance(item, Stroke | Flash)]
        tree = shapely.STRtree([shape for _, shape in solid])
        for k, item in enumerate(objects):
            if isinstance(item, Clear) and any(solid[index][0] < k for index in tree.query(item.shape, "intersects")):
                raise BoardError(f"{item.where}: a clear shape over a track or pad is not supported.")
    tracks = tuple(
        Track(layer, start, end, item.width, item.net, item.where)
        for layer, objects in drawn.items()
        for item in objects
        if isinstance(item, Stroke)
        for start, end in pairwise(item.points)
    )
    areas = tuple(area for layer, objects in drawn.items() for area in _areas(layer, objects))
    lands = [(layer, item) for layer, objects in drawn.items() for item in objects if isinstance(item, Flash)]
    bores = _bores(files, board, lands)
    masks = [item for file in files if file.function[:1] == ("Soldermask",) for item in parse_gerber(file)]
    openings = [(item.x, item.y) for item in masks if isinstance(item, Flash)]
    holes = [_hole(bore, openings) for bore in bores if _has_pad(bore, tracks)]
    if len(copper) > 1 and not holes:
        raise BoardError(f"{path}: has {len(copper)} copper layers and no plated hole to connect them.")
    bored = {id(flash) for bore in bores for _, flash in bore.lands}
    pads = tuple(
        SurfacePad(pad.x, pad.y, layer, pad.net, pad.where, pad.pin, pad.size, pad.shape)
        for layer, pad in lands
        if id(pad) not in bored
    )
    bare = len(bores) - len(holes)
    notes = (f"{bare} plated hole{'s' if bare > 1 else ''} without a pad left out.",) if bare else ()
    return BoardCopper(str(path), board, tracks, tuple(holes), pads, assumed, areas, _edge(files), notes)


_Land = tuple[str, Flash]
"""Flash with the copper layer on which it lies."""


@dataclass(frozen=True, eq=False)
class _Bore:
    """Plated hole with its layers and the flashes around it."""

    hole: DrilledHole
    layers: tuple[str, ...]
    lands: tuple[_Land, ...]

    @property
    def pads(self) -> dict[str, list[Flash]]:
        """Flashes by layer that are wider than the hole."""
        found: dict[str, list[Flash]] = {}
        for layer, flash in self.lands:
            if flash.size > self.hole.diameter:
                found.setdefault(layer, []).append(flash)
        return found


def _copper_files(files: Sequence[DataFile], path: Path) -> list[DataFile]:
    """Pick the files of copper, top to bottom."""
    numbered: dict[int, DataFile] = {}
    for file in files:
        if file.function[:1] == ("Copper",):
            match = _LAYER.fullmatch("".join(file.function[1:2]))
            if match is None:
                raise BoardError(f"{file.label}: a copper layer must be L1, L2, …; got {','.join(file.function)}.")
            numbered[int(match[1])] = file
    if not numbered:
        boards = sorted(path.glob("*.kicad_pcb")) if path.is_dir() else []
        hint = f"; did you mean {boards[0]}?" if boards else "."
        raise BoardError(f"{path}: has no copper layer among its {len(files)} Gerber and Excellon files{hint}")
    last = max(numbered)
    missing = [f"L{number}" for number in range(1, last + 1) if number not in numbered]
    if numbered[last].function[2:3] == ("Inr",):
        missing.append(f"the bottom below L{last}")
    if missing:
        raise BoardError(f"{path}: copper layers are missing: {', '.join(missing)}.")
    return [numbered[number] for number in sorted(numbered)]


def _areas(layer: str, objects: Sequence[Stroke | Flash | Region | Clear]) -> Iterator[CopperArea]:
    """Yield the regions, cut by the clear shapes after them."""
    for k, item in enumerate(objects):
        if isinstance(item, Region):
            cuts = [later.shape for later in objects[k + 1 :] if isinstance(later, Clear)]
            shape = item.shape - shapely.union_all(cuts) if cuts else item.shape
            if not shape.is_empty:
                yield CopperArea(layer, shape, item.net, "a region", item.where)


def _bores(files: Iterable[DataFile], board: Stackup, lands: Sequence[_Land]) -> list[_Bore]:
    """Collect the plated holes with the flashes around them."""
    tree = shapely.STRtree([shapely.Point(flash.x, flash.y) for _, flash in lands])
    bores = []
    for file in files:
        if file.function[:1] not in (("Plated",), ("MixedPlating",)):
            continue
        layers = _span(file, board)
        for hole in parse_drills(file):
            if hole.plated is False:
                continue
            near = tree.query(shapely.Point(hole.x, hole.y), predicate="dwithin", distance=hole.diameter / 2)
            around = tuple(lands[k] for k in sorted(near.tolist()) if lands[k][0] in layers)
            bores.append(_Bore(hole, layers, around))
    return bores


def _span(file: DataFile, board: Stackup) -> tuple[str, ...]:
    """Copper layers that a drill file's holes reach.

    Its function gives them, such as Plated,1,4,PTH. By default it is all layers.
    """
    ends = file.function[1:3]
    if len(ends) < 2:
        return board.names
    first, last = (int(end) if end.isdecimal() else 0 for end in ends)
    if not 1 <= first <= last <= len(board.names):
        raise BoardError(
            f"{file.label}: holes must go from one of the {len(board.names)} copper layers down to another; got "
            f"{','.join(file.function)}."
        )
    return board.names[first - 1 : last]


def _has_pad(bore: _Bore, tracks: Iterable[Track]) -> bool:
    """Whether a hole has a pad, refusing tracks without one."""
    if bore.pads:
        return True
    hole = bore.hole
    for track in tracks:
        for x, y in (track.start, track.end):
            if track.layer in bore.layers and math.hypot(x - hole.x, y - hole.y) <= hole.diameter / 2:
                raise BoardError(f"{hole.where}: the plated hole has no pad; the track at {track.where} ends in it.")
    return False


def _hole(bore: _Bore, openings: Sequence[Point]) -> Hole:
    """Make the hole of a bore with pads and kind."""
    pads = bore.pads
    flashes = [flash for on_layer in pads.values() for flash in on_layer]
    net = next((flash.net for flash in flashes if flash.net is not None), None)
    pin = next((flash.pin for flash in flashes if flash.pin), "")
    x, y = flashes[0].x, flashes[0].y  # less rounded than the drill file
    size = min(max(flash.size for flash in on_layer) for on_layer in pads.values())
    kind = "pad" if pin else _kind(bore.hole, flashes, openings)
    shapes = {layer: shapely.union_all([flash.shape for flash in on_layer]) for layer, on_layer in pads.items()}
    return Hole(x, y, bore.hole.diameter, size, bore.layers, net, kind, bore.hole.where, pin, shapes)


def _kind(hole: DrilledHole, pads: Sequence[Flash], openings: Sequence[Point]) -> Literal["via", "pad"]:
    """Kind of a plated hole by attributes or solder mask."""
    functions = {hole.function, *(pad.function for pad in pads)}
    if functions & {"ComponentDrill", "ComponentPad"}:
        return "pad"
    if functions & {"ViaDrill", "ViaPad"}:
        return "via"
    at = (pads[0].x, pads[0].y)
    return "pad" if any(math.dist(at, opening) <= hole.diameter / 2 for opening in openings) else "via"


def _edge(files: Iterable[DataFile]) -> tuple[float, float, float, float] | None:
    """Bounds of the board's outline, if a file has it."""
    points = [
        point
        for file in files
        if file.function[:1] == ("Profile",) and file.kind == "gerber"
        for item in parse_gerber(file)
        for point in (item.points if isinstance(item, Stroke) else shapely.get_coordinates(item.shape).tolist())
    ]
    return shapely.MultiPoint(points).bounds if points else None
