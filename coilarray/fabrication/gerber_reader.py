"""Boards in zips or folders of Gerber and Excellon files, read through gerbonara."""

import json
import lzma
import math
import os
import re
import struct
import sys
import warnings
import zipfile
import zlib
from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path, PurePosixPath
from types import ModuleType
from typing import Any, Literal

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from coilarray.compute.extras import import_extra
from coilarray.compute.memory import require_memory
from coilarray.compute.threads import Progress
from coilarray.errors import BoardError, GeometryError, shown
from coilarray.fabrication.board import BoardCopper, CopperArea, Hole, Slab, SurfacePad, Track, completed_stackup
from coilarray.geometry.arcs import Point, arc_points
from coilarray.geometry.copper import disc
from coilarray.geometry.stackup import Stackup

_FILE_FUNCTION = re.compile(r"TF\.FileFunction,([^*\r\n]+)")
_GERBER = re.compile(r"%\s*FS[LTD]?[AI]|^G04\b", re.MULTILINE)
_EXCELLON = re.compile(r"^\s*M48\s*$|^T0*\d+\s*$(?:\s*^(?:G\d+)?X[-+\d.]+Y[-+\d.]+\s*$)", re.MULTILINE)
# names that promise a layer or a drill file, whatever made them
_PROMISES_DATA = re.compile(r".*\.(gbr|ger|g[tb][los]|gp?\d+|drl|xln)", re.IGNORECASE)
_NOT_PLATED = re.compile(r"npth|(non|un)\W?plated", re.IGNORECASE)


class NoLayerError(BoardError):
    """Files of which none says that it is copper, with the `names` of the Gerber files."""

    def __init__(self, message: str, names: Sequence[str]) -> None:
        super().__init__(message)
        self.names = tuple(names)


@dataclass(frozen=True)
class DataFile:
    """Gerber, Excellon or job file with the fields of its X2 .FileFunction."""

    label: str
    text: str
    kind: Literal["gerber", "excellon", "job"]
    function: tuple[str, ...]


def find_files(path: Path, layers: Mapping[str, str] | None = None) -> list[DataFile]:
    """Find the files of a board, their functions by X2 attributes or by name.

    `layers` are the names of the copper's files by layer, such as {"L1": "top.ger"}.
    """
    files = [file for label, data in _contents(path) if (file := _recognized(label, data)) is not None]
    names = {PurePosixPath(file.label).name for file in files}
    for layer, name in (layers or {}).items():
        if name not in names or not _LAYER.fullmatch(layer):
            known = ", ".join(sorted(names))
            raise BoardError(f"{path}: --layer must be L1=FILE, with a file of {known}; got {layer}={name}.")
    given = {name: int(layer[1:]) for layer, name in (layers or {}).items()}
    if given or not any(file.function[:1] == ("Copper",) for file in files):
        files = _named(files, given)
    for k, file in enumerate(files):
        if file.kind == "excellon" and file.function[:1] not in (("Plated",), ("NonPlated",), ("MixedPlating",)):
            not_plated = _NOT_PLATED.search(PurePosixPath(file.label).name)
            files[k] = replace(file, function=("NonPlated" if not_plated else "Plated",))
    seen: dict[tuple[str, ...], str] = {}
    for file in files:
        if file.function[:1] == ("Copper",):
            first = seen.setdefault(file.function[:2], file.label)
            if first != file.label:
                raise BoardError(f"{file.label}: is copper layer {file.function[1]}, and so is {first}.")
    return files


def gerbonara(module: str) -> ModuleType:
    """Import a module of gerbonara, or raise MissingDependencyError."""
    loaded = sys.modules.get(f"gerbonara.{module}")  # needed for every object
    if loaded is not None and sys.modules.get("gerbonara") is not None:
        return loaded
    return import_extra(f"gerbonara.{module}", "Gerber files", package="gerbonara", extra="fab")


def _contents(path: Path) -> Iterator[tuple[str, bytes]]:
    """Yield label and bytes of every file that is not hidden, by name."""

    def hidden(name: Path | PurePosixPath) -> bool:
        return any(part.startswith((".", "__MACOSX")) for part in name.parts)

    try:
        if path.is_dir():
            for file in (path, *sorted(path.rglob("*"))):
                if file.is_dir():
                    os.listdir(file)  # raises for a folder that rglob skips
                elif file.is_file() and not hidden(file.relative_to(path)):
                    require_memory(file.stat().st_size, str(file))
                    yield str(file), file.read_bytes()
            return
        with zipfile.ZipFile(path) as archive:
            require_memory(sum(entry.file_size for entry in archive.infolist()), str(path))
            for name in sorted(archive.namelist()):
                if not (name.endswith("/") or hidden(PurePosixPath(name))):
                    yield f"{path}/{name}", archive.read(name)
    except FileNotFoundError:
        raise BoardError(f"{path}: there is no such file or folder.") from None
    except (zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, RuntimeError, ValueError, struct.error) as error:
        raise BoardError(f"{path}: must be a folder or an intact zip of Gerber files; {shown(str(error))}.") from None
    except OSError as error:
        raise BoardError(f"{error.filename or path}: cannot be read: {error.strerror or error}.") from None


def _recognized(label: str, data: bytes) -> DataFile | None:
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    if label.lower().endswith(".gbrjob"):
        return DataFile(label, text, "job", ())
    text = "" if b"\0" in data else text
    kind: Literal["gerber", "excellon"]
    if _GERBER.search(text):
        kind = "gerber"
    elif _EXCELLON.search(text):
        kind = "excellon"
    elif _PROMISES_DATA.fullmatch(label):
        raise BoardError(f"{label}: is neither a Gerber nor an Excellon file.")
    else:
        return None
    found = _FILE_FUNCTION.search(text)
    return DataFile(label, text, kind, tuple(found[1].strip().split(",")) if found else ())


# What files hold by words of their names, the first that fits: programs agree on little else.
_NAMES: tuple[tuple[str, str], ...] = (
    ("Soldermask", r"mask|stop|resist|\.(gts|gbs|smt|smb|stc|sts|tsm|bsm)$"),
    ("", r"paste|cream|silk|legend|overlay|glue|adhes|assembl|place|court|fab|pads?master|drawing|keep"),
    ("", r"crc|crs|\.g[tb][op]$"),
    ("", r"\.(plc|pls|tsk|bsk|sst|ssb|spt|spb|gpt|gpb|gd\d|gg\d|rep|drr|ipc|rul|extrep|ldp|apr\w*|gpi|dri)$"),
    ("Profile", r"outline|profile|edge|contour|border|dimension|boundary|\.(gko|gml|gm\d+|dim|mil|oln|fab)$"),
    ("Inner", r"(?<![a-z])(?:in|inner|mid|signal|plane|pln|internal\W*plane)\W*(?:l|layer)?\W*(\d+)"),
    ("Inner", r"\.(?:gp?|in|ly|internalplane)(\d+)l?(?:\.ger)?$"),
    ("Top", r"top|front|(?<![a-z])f\W?cu|component|primary|\.(gtl|cmp|top)$"),
    ("Bottom", r"bot(?![a-z])|bottom|back|(?<![a-z])b\W?cu|solder|secondary|\.(gbl|sol|sld|bot)$"),
    ("Number", r"(?:art|layer|(?<![a-z])l|copper)\W*0*(\d+)"),
    ("Profile", r"mech"),
)


def _named(files: Sequence[DataFile], given: Mapping[str, int]) -> list[DataFile]:
    """Add functions by the names of files, or as `given`, such as {"top.ger": 1}."""
    found: dict[int, tuple[str, int]] = {}
    for k, file in enumerate(files):
        name = PurePosixPath(file.label).name
        if name in given:
            found[k] = "Number", given[name]
        elif file.kind == "gerber" and not given:
            for use, pattern in _NAMES:
                if match := re.search(pattern, name.lower().replace("_", "-")):
                    found[k] = use, int(match[1]) if use in ("Inner", "Number") else 0
                    break
    uses = {use for use, _ in found.values()}
    inner = sorted({number for use, number in found.values() if use == "Inner"})
    numbers = {number for use, number in found.values() if use == "Number"}
    last = max(numbers) if numbers else len(inner) + 2 if "Top" in uses or inner else 1
    named = [*files]
    for k, (use, number) in found.items():
        if use in ("Soldermask", "Profile"):
            named[k] = replace(files[k], function=(use,))
        elif use and (use != "Number" or given or not uses & {"Top", "Bottom"}):
            layer = {"Top": 1, "Bottom": last, "Number": number}.get(use) or inner.index(number) + 2
            side = "Inr" if use == "Inner" or 1 < layer < last else "Top" if layer == 1 else "Bot"
            named[k] = replace(files[k], function=("Copper", f"L{layer}", side))
    return named


_MM = 1e-3
_LAYER = re.compile(r"L0*([1-9]\d*)")


def job_stackup(job: DataFile | None, copper_layers: int, source: str) -> tuple[Stackup, dict[str, str]]:
    """Read the stack-up and assumed values from a job file, if any, of a `source`."""
    document: Any = {}
    if job is not None:
        try:
            document = json.loads(job.text)
        except json.JSONDecodeError as error:
            raise BoardError(f"{job.label}:{error.lineno}: is not a complete Gerber job file: {error.msg}.") from None
        document = document if isinstance(document, dict) else {}
    where = source if job is None else job.label
    listed = document.get("MaterialStackup")
    layers = [layer for layer in listed if isinstance(layer, dict)] if isinstance(listed, list) else []
    at = [k for k, layer in enumerate(layers) if layer.get("Type") == "Copper"]
    if at and len(at) != copper_layers:
        raise BoardError(f"{where}: the stack-up has {len(at)} copper layers and there are files for {copper_layers}.")
    assumed: dict[str, str] = {}
    names = tuple(str(layers[k]["Name"]) for k in at if layers[k].get("Name"))
    if len(set(names)) != copper_layers:
        names = tuple(f"L{k + 1}" for k in range(copper_layers))
        assumed["stackup.layers"] = "the files give the order of the layers, not their names"
    slabs: list[list[Slab]] = [
        [
            (_positive(layer, "Thickness", _MM), _positive(layer, "DielectricConstant"))
            for layer in layers[first:last]
            if layer.get("Type") == "Dielectric"
        ]
        for first, last in pairwise(at)
    ]
    copper = [_positive(layers[k], "Thickness", _MM) for k in at] or [None] * copper_layers
    slabs = slabs or [[(None, None)]] * (copper_layers - 1)
    board = _positive(document.get("GeneralSpecs"), "BoardThickness", _MM)
    try:
        return completed_stackup(names, copper, slabs, board, "the files do", assumed), assumed
    except GeometryError as error:
        raise BoardError(f"{where}: {error}") from None


def _positive(node: Any, key: str, unit: float = 1.0) -> float | None:
    value = node.get(key) if isinstance(node, dict) else None
    if not isinstance(value, (int, float)) or isinstance(value, bool) or value <= 0:
        return None
    return float(value) * unit


# Warnings of gerbonara 1.5 for things that it then skips or gets wrong, or words in its own way,
# and our wording.
_REFUSED = {
    "File may be truncated": "the file ends without M02, it is truncated",
    "Unknown statement found": "the statement is not supported",
    "Unknown excellon statement": "the statement is not supported",
    "IF include statement": "included files are not supported",
    "Deprecated IR": "the rotation of the whole image is not supported",
    "Deprecated MI": "the mirroring of the whole image is not supported",
    "Deprecated SF": "the scaling of the whole image is not supported",
    "Deprecated AS": "the exchange of the axes is not supported",
    "Deprecated IP": "the negative image is not supported",
    "Routing command found before first tool": "no tool is selected",
    "No number format set": "the numbers have no decimal point, and the file does not say where it is",
}
# Transformations of apertures that change nothing, which gerbonara does not know.
_IDLE = re.compile(r"%LMN\*%|%LR[+-]?0*(\.0*)?\*%|%LS\+?1(\.0*)?\*%")
_STEP_REPEAT = re.compile(r"%SR(?:X(\d+)Y(\d+)I([-+]?\d*\.?\d+)J([-+]?\d*\.?\d+))?\*%")
# X2 attributes as comments, for readers that know no attributes
_COMMENTED = re.compile(r"G04\s*#@!\s*(T[FAOD][^*\r\n]*)\*")
_TOOL_FUNCTION = re.compile(r";\s*#@!\s*T([AD])(?:\.AperFunction,(.*))?")
_TOOL = re.compile(r"T0*(\d+)[A-Z].*")
_ESCAPE = re.compile(r"\\u([0-9A-Fa-f]{4})")
# G92 and G93 set the zero, here where it is; a slot from one place to another is a hole at the first
_ZERO_SET = re.compile(r"^G9[23](?:[XY][-+]?0*\.?0*)*[ \t]*$", re.MULTILINE)
_SLOT = re.compile(r"^(.*)G85.*$", re.MULTILINE)
_NO_NET = ("", "N/C")
_WIDEST = 10.0  # m, of an aperture or a hole
_MOST_REPEATS = 1000
_SHOWN = 12  # names in a message


@dataclass(frozen=True)
class Stroke:
    """Round aperture drawn along straight pieces, in m, of the net .N at "file:line"."""

    points: tuple[Point, ...]
    width: float
    net: str | None
    where: str

    @property
    def shape(self) -> BaseGeometry:
        """Area covered by the stroke, in m."""
        return shapely.LineString(self.points).buffer(self.width / 2)


@dataclass(frozen=True)
class Flash:
    """Aperture put down once, in m, with its .AperFunction and number of .P, or ""."""

    x: float
    y: float
    size: float
    shape: BaseGeometry
    function: str
    pin: str
    net: str | None
    where: str


@dataclass(frozen=True, eq=False)
class Region:
    """Filled outline in m, or any clear shape, which removes what was drawn before."""

    shape: BaseGeometry
    net: str | None
    where: str
    clear: bool = False


Drawn = Stroke | Flash | Region


@dataclass(frozen=True)
class DrilledHole:
    """Hole or middle of a slot in m, `plated` if said, with the last .AperFunction."""

    x: float
    y: float
    diameter: float
    function: str
    plated: bool | None
    where: str


def parse_gerber(file: DataFile) -> list[Drawn]:
    """Read the objects of a Gerber file, or raise BoardError."""
    rs274x = gerbonara("rs274x")
    target = rs274x.GerberFile()
    parser = rs274x.GerberParser(target)
    target.objects = found = _Recorder(lambda: (parser.lineno, dict(parser.graphics_state.object_attrs)))
    text = _COMMENTED.sub(r"%\1*%", _IDLE.sub("", _STEP_REPEAT.sub("", file.text)))  # which gerbonara does not repeat
    _refusing(file.label, lambda: parser.parse(text, filename=file.label))
    if parser.file_settings.is_incremental:
        raise BoardError(f"{file.label}: incremental coordinates are not supported.")
    objects: list[Drawn] = []
    repeats = _repeats(file)
    for (line, attributes), item in found.records:
        where = f"{file.label}:{line}"
        for dx, dy in repeats(line):
            copied = copy(item)
            copied.offset(dx, dy, parser.file_settings.unit)
            read = _object(copied, attributes, where)
            objects.append(read if item.polarity_dark else Region(read.shape, None, where, clear=True))
    return objects


def _repeats(file: DataFile) -> Callable[[int], list[Point]]:
    """Return the shifts in the file's unit at which the drawing of a line is repeated."""
    begins: list[tuple[int, list[Point]]] = [(0, [(0.0, 0.0)])]
    for match in _STEP_REPEAT.finditer(file.text):
        line, shifts = file.text.count("\n", 0, match.start()) + 1, [(0.0, 0.0)]
        if match[1]:
            columns, rows = int(match[1]), int(match[2])
            if not 1 <= columns * rows <= _MOST_REPEATS:
                most = f"1 to {_MOST_REPEATS} copies"
                raise BoardError(f"{file.label}:{line}: step and repeat must have {most}; got {columns} × {rows}.")
            i, j = float(match[3]), float(match[4])
            shifts = [(i * column, j * row) for row in range(rows) for column in range(columns)]
        begins.append((line, shifts))
    lines = [line for line, _ in begins]
    return lambda line: begins[bisect_right(lines, line) - 1][1]


def parse_drills(file: DataFile, settings: Any = None) -> list[DrilledHole]:
    """Read the holes of an Excellon or Gerber file, with gerbonara's settings where it has none."""
    if file.kind == "gerber":
        return [
            DrilledHole(*_middle(item.points), item.width, "", None, item.where)
            if isinstance(item, Stroke)
            else DrilledHole(item.x, item.y, item.size, "", None, item.where)
            for item in parse_gerber(file)
            if isinstance(item, Stroke | Flash)
        ]
    excellon = gerbonara("excellon")
    parser = excellon.ExcellonParser(None if settings is None else settings.copy())
    parser.objects = found = _Recorder(lambda: parser.lineno)
    text = _SLOT.sub(lambda match: match[1], _ZERO_SET.sub("", file.text))
    _refusing(file.label, lambda: parser.do_parse(text, filename=file.label))
    if parser.program_state is not excellon.ProgramState.FINISHED:
        raise BoardError(f"{file.label}: the file ends without M30, it is truncated.")
    # X2 attributes of the tools stand in comments
    functions: dict[int, tuple[str, ...]] = {}
    current: tuple[str, ...] = ()
    for line in map(str.strip, file.text.splitlines()):
        if attribute := _TOOL_FUNCTION.fullmatch(line):
            current = tuple(attribute[2].split(",")) if attribute[1] == "A" and attribute[2] else ()
        elif current and (tool := _TOOL.fullmatch(line)):
            functions[int(tool[1])] = current
    by_tool = {id(tool): functions.get(index, ()) for index, tool in parser.tools.items()}
    holes = []
    for line, item in found.records:
        where, tool, function = f"{file.label}:{line}", item.tool, by_tool.get(id(item.tool), ())
        if item.unit is None or tool.unit is None:
            raise _NoFormatError(f"{where}: the file does not say its unit, METRIC or INCH.")
        if not tool.diameter:
            raise BoardError(f"{where}: the tool has no diameter.")
        if isinstance(item, gerbonara("graphic_objects").Flash):
            x, y = item.x / _in_metre(item.unit), item.y / _in_metre(item.unit)
        else:
            x, y = _middle(tuple(_way(item)))
        plated = {"Plated": True, "NonPlated": False}.get("".join(function[:1]), tool.plated)
        holes.append(DrilledHole(x, y, _diameter(tool, where), "".join(function[-1:]), plated, where))
    return holes


class _Recorder(list[Any]):
    """List that records `state` with every object of gerbonara's parser."""

    def __init__(self, state: Callable[[], Any]) -> None:
        super().__init__()
        self.records: list[tuple[Any, Any]] = []
        self._state = state

    def append(self, item: Any) -> None:
        self.records.append((self._state(), item))


def _refusing(label: str, parse: Callable[[], None]) -> None:
    """Let gerbonara parse, and refuse errors and wrong results."""
    complaints: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            parse()
        except SyntaxError as error:
            complaints.append(str(error))
    for text in [*(str(warning.message) for warning in caught), *complaints]:
        known = next((ours for sign, ours in _REFUSED.items() if sign in text), None)
        if not known and text not in complaints:
            continue
        match = re.fullmatch(r':(\d+) "(.*?)": (.*)', text.removeprefix(label), re.DOTALL)
        if "No number format set" in text:
            raise _NoFormatError(f"{label}: {known}; give it as --drill-format 4.4,mm.")
        if match is None:
            raise BoardError(f"{label}: {known or text}.")
        # gerbonara goes on with advice to programmers, and has line 0 for the end of the file
        line, statement, reason = match[1], " ".join(match[2].split()), match[3].split(". ")[0].rstrip(".")
        at = f":{line}" if line != "0" else ""
        raise BoardError(f"{label}{at}: {known or reason}{f' ({statement})' if statement else ''}.")


def _object(item: Any, attributes: dict[str, tuple[str, ...]], where: str) -> Drawn:
    """Convert gerbonara's object to a stroke, flash or region."""
    objects, apertures = gerbonara("graphic_objects"), gerbonara("apertures")
    net = _ESCAPE.sub(lambda match: chr(int(match[1], 16)), attributes.get(".N", ("",))[0])
    named = None if net in _NO_NET else net
    if item.unit is None:
        raise BoardError(f"{where}: the file does not say its unit, MM or IN.")
    if isinstance(item, objects.Region):
        return Region(_region(item), named, where)
    aperture = item.aperture
    if aperture is None:
        raise BoardError(f"{where}: no aperture is selected.")
    if aperture.unit is None:
        raise BoardError(f"{where}: the file does not say the unit of an aperture, MM or IN.")
    pin = (*attributes.get(".P", ()), "", "")[1]
    if isinstance(item, objects.Flash):
        unit = _in_metre(item.unit)
        return _flash(item.x / unit, item.y / unit, aperture, pin, named, where)
    way = tuple(_way(item))
    if len(way) == 2 and way[0] == way[1]:  # a dot
        return _flash(*way[0], aperture, pin, named, where)
    if not isinstance(aperture, apertures.CircleAperture):  # as wide as it is across the stroke
        x0, y0, x1, y1 = _flash(0.0, 0.0, aperture, pin, named, where).shape.bounds
        (xa, ya), (xb, yb) = way[0], way[-1]
        length = math.dist(way[0], way[-1]) or 1.0
        return Stroke(way, ((x1 - x0) * abs(yb - ya) + (y1 - y0) * abs(xb - xa)) / length, named, where)
    return Stroke(way, _diameter(aperture, where), named, where)


def _flash(x: float, y: float, aperture: Any, pin: str, net: str | None, where: str) -> Flash:
    """Make a flash of an aperture in m."""
    function = dict(aperture.attrs or ()).get(".AperFunction", ("",))[0]
    if isinstance(aperture, gerbonara("apertures").CircleAperture):
        size = _diameter(aperture, where)
        return Flash(x, y, size, disc(x, y, size), function, pin, net, where)
    try:
        (x_min, y_min), (x_max, y_max) = aperture.bounding_box(gerbonara("utils").MM)
    except (TypeError, ValueError, ArithmeticError, LookupError) as error:
        raise BoardError(f"{where}: the aperture has no shape: {error}.") from None
    corners = [value / 1e3 for value in (x_min, y_min, x_max, y_max)]
    if not all(abs(value) <= _WIDEST for value in corners):
        raise BoardError(f"{where}: an aperture must be at most {_WIDEST:g} m wide; got {max(corners, key=abs):g} m.")
    shape = shapely.box(x + corners[0], y + corners[1], x + corners[2], y + corners[3])
    size = min(corners[2] - corners[0], corners[3] - corners[1])
    return Flash(x, y, size, shape, function, pin, net, where)


def _way(item: Any) -> Iterator[Point]:
    """Yield points in m along a line or arc."""
    unit = _in_metre(item.unit)
    start, end = (item.x1 / unit, item.y1 / unit), (item.x2 / unit, item.y2 / unit)
    if isinstance(item, gerbonara("graphic_objects").Arc):
        centre = start[0] + item.cx / unit, start[1] + item.cy / unit
        yield from _arc(start, end, centre, clockwise=item.clockwise)
    else:
        yield from (start, end)


def _arc(start: Point, end: Point, centre: Point, *, clockwise: bool) -> list[Point]:
    """Points on an arc about a centre, on the whole circle if it ends where it begins."""
    first = math.atan2(start[1] - centre[1], start[0] - centre[0])
    last = math.atan2(end[1] - centre[1], end[0] - centre[0])
    turn = 2 * math.pi if start == end else (last - first) % (2 * math.pi)
    if clockwise:
        turn = -turn if start == end else turn - 2 * math.pi
    radius = 0.5 * (math.dist(start, centre) + math.dist(end, centre))  # equal but for rounding
    half = first + turn / 2
    middle = centre[0] + radius * math.cos(half), centre[1] + radius * math.sin(half)
    return [(x, y) for x, y in arc_points(start, middle, end).tolist()]


def _region(item: Any) -> BaseGeometry:
    """Convert a region of gerbonara to a polygon in m."""
    unit = _in_metre(item.unit)
    points: list[Point] = []
    for start, end, (clockwise, centre) in item.iter_segments():
        a, b = (start[0] / unit, start[1] / unit), (end[0] / unit, end[1] / unit)
        if centre is None or centre[0] is None:
            points += [a, b]
        else:
            points += _arc(a, b, (centre[0] / unit, centre[1] / unit), clockwise=clockwise)
    if len(points) < 4:
        return shapely.Polygon()
    # holes are cut in as keyholes, which touch themselves
    return shapely.Polygon(points).buffer(0)


def _middle(points: tuple[Point, ...]) -> Point:
    (x1, y1), (x2, y2) = points[0], points[-1]
    return (x1 + x2) / 2, (y1 + y2) / 2


def _diameter(tool: Any, where: str) -> float:
    diameter = float(tool.diameter / _in_metre(tool.unit))
    if not 0 <= diameter <= _WIDEST:
        raise BoardError(f"{where}: a diameter must be from 0 to {_WIDEST:g} m; got {diameter:g} m.")
    return diameter


def _in_metre(unit: Any) -> float:
    """Lengths of a unit in a metre, for exact divisions."""
    return 1e3 / float(unit.this_in_mm)


def read_gerbers(
    path: Path,
    stackup: Stackup | None = None,
    layers: Mapping[str, str] | None = None,
    drill_format: str | None = None,
    progress: Progress | None = None,
) -> BoardCopper:
    """Read the conductors of a board from a zip or folder of fabrication data.

    Strokes are tracks, divided on arcs within 1 µm. Flashes are the pads of the holes drilled
    through them, otherwise surface pads. Regions are areas, and so is what a clear shape cuts. A
    hole is a terminal's pad if an attribute says so or the solder mask is open over it, otherwise a
    via. It reaches the layers given by the file's function, by default all, and has the smallest
    pad of its layers. Without a pad it is a disc of its drill where a track leads into it, and left
    out with a note elsewhere. `layers` are the copper's files by layer if their names do not tell,
    such as {"L1": "top.ger"}. `drill_format` is that of drill files which do not state theirs, as
    "4.4,mm" or "2.4,inch,trailing" with the zeros that are left out. By default the format is taken
    with which most holes lie in pads.
    """
    files = find_files(path, layers)
    copper = _copper_files(files, path)
    if stackup is None:
        job = next((file for file in files if file.kind == "job"), None)
        board, assumed = job_stackup(job, len(copper), str(path))
    elif len(stackup.names) == len(copper):
        board, assumed = stackup, {}
    else:
        raise BoardError(f"{path}: has {len(copper)} copper layers and the given stack-up {len(stackup.names)}.")
    # short files first, so that what is wrong with them is known before long work
    drills = {file.label: _try_drills(file, drill_format) for file in files if _is_plated(file)}
    parsed = {
        file.label: parse_gerber(file)
        for file in files if file.function[:1] in (("Soldermask",), ("Profile",)) and file.kind == "gerber"
    }  # fmt: skip
    drawn: dict[str, list[Drawn]] = {}
    for k, (layer, file) in enumerate(zip(board.names, copper, strict=True)):
        drawn[layer] = _cut_out(parse_gerber(file))
        if progress is not None:
            progress(k + 1, len(copper))
    tracks = tuple(
        Track(layer, start, end, item.width, item.net, item.where)
        for layer, objects in drawn.items() for item in objects if isinstance(item, Stroke)
        for start, end in pairwise(item.points)
    )  # fmt: skip
    areas = tuple(
        CopperArea(layer, part, item.net, "a region", item.where)
        for layer, objects in drawn.items() for item in objects if isinstance(item, Region)
        for part in shapely.get_parts(item.shape).tolist() if part.area > 0
    )  # fmt: skip
    lands = [(layer, item) for layer, objects in drawn.items() for item in objects if isinstance(item, Flash)]
    openings = [
        (item.x, item.y) for file in files if file.function[:1] == ("Soldermask",)
        for item in parsed[file.label] if isinstance(item, Flash)
    ]  # fmt: skip
    bores = [
        (_span(file, board), bore)
        for file in files if _is_plated(file)
        for bore in drills[file.label] or _drills_on_pads(file, lands) if bore.plated is not False
    ]  # fmt: skip
    holes, bored, bare = _holes(bores, tracks, lands, openings)
    pads = tuple(
        SurfacePad(pad.x, pad.y, layer, pad.net, pad.where, pad.pin, pad.size, pad.shape)
        for layer, pad in lands
        if id(pad) not in bored
    )
    notes = (f"{bare} plated hole{'s' if bare > 1 else ''} without a pad left out.",) if bare else ()
    outline = [
        point
        for file in files
        if file.function[:1] == ("Profile",) and file.kind == "gerber"
        for item in parsed[file.label]
        for point in (item.points if isinstance(item, Stroke) else shapely.get_coordinates(item.shape).tolist())
    ]
    edge = shapely.MultiPoint(outline).bounds if outline else None
    return BoardCopper(str(path), board, tracks, tuple(holes), pads, assumed, areas, edge, notes)


def _cut_out(objects: Sequence[Drawn]) -> list[Drawn]:
    """Cut clear shapes out of what was drawn before: such tracks and pads become regions."""
    clear = [k for k, item in enumerate(objects) if isinstance(item, Region) and item.clear]
    if not clear:
        return [*objects]
    shapes = [item.shape for item in objects]
    met = shapely.STRtree([shapes[k] for k in clear]).query(shapes, predicate="intersects").T.tolist()
    cuts: dict[int, list[BaseGeometry]] = {}
    for k, index in met:
        if k < clear[index]:
            cuts.setdefault(k, []).append(shapes[clear[index]])
    return [
        Region(item.shape - shapely.union_all(cuts[k]), item.net, item.where) if k in cuts else item
        for k, item in enumerate(objects) if not (isinstance(item, Region) and item.clear)
    ]  # fmt: skip


def _is_plated(file: DataFile) -> bool:
    return file.function[:1] in (("Plated",), ("MixedPlating",))


# usual formats of drill files that state none: digits before and after the point, unit, zeros left out
_FORMATS = tuple(
    f"{digits},{unit},{zeros}"
    for unit, formats in (("mm", ("3.3", "4.4", "4.2", "3.2", "4.3", "3.5")), ("inch", ("2.4", "2.3", "2.5", "3.5")))
    for digits in formats
    for zeros in ("leading", "trailing")
)


def _settings(text: str) -> Any:
    """Return gerbonara's settings for a format "4.4,mm,leading"."""
    match = re.fullmatch(r"(\d)[.:](\d),(mm|inch)(?:,(leading|trailing))?", text.replace(" ", ""))
    if match is None:
        raise BoardError(f"the drill format must be as 4.4,mm or 2.4,inch,trailing; got {text!r}.")
    utils = gerbonara("utils")
    unit = utils.MM if match[3] == "mm" else utils.Inch
    digits = (min(int(match[1]), 6), min(int(match[2]), 7))
    return gerbonara("cam").FileSettings(unit=unit, number_format=digits, zeros=match[4] or "leading")


class _NoFormatError(BoardError):
    """A drill file that does not say where the point of its numbers is."""


def _try_drills(file: DataFile, drill_format: str | None) -> list[DrilledHole] | None:
    """Read drilled holes, or return None if their format is to be found on the pads."""
    try:
        return parse_drills(file)
    except _NoFormatError:
        return None if drill_format is None else parse_drills(file, _settings(drill_format))


def _drills_on_pads(file: DataFile, lands: Sequence[tuple[str, Flash]]) -> list[DrilledHole]:
    """Read drilled holes in the format with which most lie on pads."""
    tree = shapely.STRtree([shapely.Point(flash.x, flash.y) for _, flash in lands])
    best: list[DrilledHole] = []
    most = 0.0
    for text in _FORMATS:
        try:
            holes = parse_drills(file, _settings(text))
        except BoardError:
            continue
        places = np.asarray(shapely.points([(hole.x, hole.y) for hole in holes])) if holes else np.array([])
        met = tree.query(places, "dwithin", distance=_ON_PAD) if holes else np.empty((2, 0))
        on_pads = min(len(set(met[0].tolist())), len({(lands[k][1].x, lands[k][1].y) for k in met[1].tolist()}))
        if holes and on_pads / len(holes) > most:
            best, most = holes, on_pads / len(holes)
    if most < _MOSTLY:
        raise BoardError(
            f"{file.label}: the numbers have no decimal point, the file does not say where it is, and in no usual "
            "format do the holes lie on pads; give it as --drill-format 4.4,mm."
        )
    return best


_PAD_AT_LEAST = 1.02  # of the drill: a hole without a pad is drawn with a narrow rim, as a coil's holes have pads
_ON_PAD = 50e-6  # m between a hole and the middle of its pad
_MOSTLY = 0.5  # of the holes


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
        names = sorted(PurePosixPath(file.label).name for file in files if file.kind == "gerber")
        more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
        hint = f"; say which it is as --layer L1=FILE, of {', '.join(names[:_SHOWN])}{more}." if names else "."
        hint = f"; did you mean {boards[0]}?" if boards else hint
        message = f"{path}: has no copper layer among its {len(files)} Gerber and Excellon files{hint}"
        raise NoLayerError(message, names)
    last = max(numbered)
    missing = [f"L{number}" for number in range(1, last + 1) if number not in numbered]
    if numbered[last].function[2:3] == ("Inr",):
        missing.append(f"the bottom below L{last}")
    if missing:
        raise BoardError(f"{path}: copper layers are missing: {', '.join(missing)}.")
    return [numbered[number] for number in sorted(numbered)]


def _holes(
    bores: Sequence[tuple[tuple[str, ...], DrilledHole]],
    tracks: Sequence[Track],
    lands: Sequence[tuple[str, Flash]],
    openings: Sequence[Point],
) -> tuple[list[Hole], set[int], int]:
    """Make plated holes with pads: `lands`, flashes with their layers."""
    # `openings` are places without solder mask. Also the ids of the flashes that are drilled through, and the number
    # of holes without a pad.
    tree = shapely.STRtree([shapely.Point(flash.x, flash.y) for _, flash in lands])
    lines = shapely.STRtree([shapely.LineString((track.start, track.end)) for track in tracks])
    holes: list[Hole] = []
    bored: set[int] = set()
    bare = 0
    for layers, bore in bores:
        centre, radius = (bore.x, bore.y), bore.diameter / 2
        pads: dict[str, list[Flash]] = {}
        for k in sorted(tree.query(shapely.Point(centre), predicate="dwithin", distance=radius).tolist()):
            layer, flash = lands[k]
            if layer in layers:
                bored.add(id(flash))
                if flash.size > bore.diameter:
                    pads.setdefault(layer, []).append(flash)
        if not pads:
            met = lines.query(shapely.Point(centre), predicate="dwithin", distance=radius).tolist()
            if any(tracks[k].layer in layers for k in met):  # its barrel joins the tracks that lead into it
                holes.append(
                    Hole(*centre, bore.diameter, bore.diameter * _PAD_AT_LEAST, layers, None, "via", bore.where)
                )
            else:
                bare += 1
            continue
        flashes = [flash for on_layer in pads.values() for flash in on_layer]
        net = next((flash.net for flash in flashes if flash.net is not None), None)
        pin = next((flash.pin for flash in flashes if flash.pin), "")
        at = flashes[0].x, flashes[0].y  # less rounded than the drill file
        size = min(max(flash.size for flash in on_layer) for on_layer in pads.values())
        functions = {bore.function, *(flash.function for flash in flashes)}
        terminal = bool(pin or functions & {"ComponentDrill", "ComponentPad"})
        if not terminal and not functions & {"ViaDrill", "ViaPad"}:
            terminal = any(math.dist(at, opening) <= radius for opening in openings)
        shapes = {layer: shapely.union_all([flash.shape for flash in on_layer]) for layer, on_layer in pads.items()}
        kind: Literal["via", "pad"] = "pad" if terminal else "via"
        holes.append(Hole(*at, bore.diameter, size, layers, net, kind, bore.where, pin, shapes))
    return holes, bored, bare


def _span(file: DataFile, board: Stackup) -> tuple[str, ...]:
    """Layers that a drill file's holes reach by its function, such as Plated,1,4,PTH, or all."""
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
