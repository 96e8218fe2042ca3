"""One Gerber or Excellon file through gerbonara: strokes, flashes, regions and holes with their lines."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import shapely
from shapely.geometry.base import BaseGeometry

from coilarray.errors import BoardError
from coilarray.geometry.arcs import arc_points
from coilarray.geometry.copper import disc
from coilarray.geometry.readers.gerber_files import DataFile, gerbonara
from coilarray.geometry.values import Point

# Warnings of gerbonara 1.5 for things that it then skips or gets wrong, or words in its own way, and our wording.
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
}
# Transformations of apertures that change nothing, which gerbonara does not know.
_IDLE = re.compile(r"%LMN\*%|%LR[+-]?0*(\.0*)?\*%|%LS\+?1(\.0*)?\*%")
_STEP_REPEAT = re.compile(r"%SRX(\d+)Y(\d+)")
# X2 attributes as comments, for readers that know no attributes
_COMMENTED = re.compile(r"G04\s*#@!\s*(T[FAOD][^*\r\n]*)\*")
_TOOL_FUNCTION = re.compile(r";\s*#@!\s*T([AD])(?:\.AperFunction,(.*))?")
_TOOL = re.compile(r"T0*(\d+)[A-Z].*")
_ESCAPE = re.compile(r"\\u([0-9A-Fa-f]{4})")
_NO_NET = ("", "N/C")
_WIDEST = 10.0  # m, of an aperture or a hole


@dataclass(frozen=True)
class Stroke:
    """Round aperture drawn along straight pieces.

    It has two points, or more on an arc. Points and width are in m. `net` is the net by the attribute .N, and `where`
    is "file:line", here and in the other objects.
    """

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
    """Aperture put down once at a place in m.

    `size` is the smaller side of its rectangle, or the diameter of a round aperture. `shape` is the covered area in m.
    For an aperture that is not round it is the rectangle. `function` is the first field of the aperture's X2 attribute
    .AperFunction, and `pin` the number of the pad from the attribute .P. Both are empty if missing.
    """

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
    """Filled outline, in m."""

    shape: BaseGeometry
    net: str | None
    where: str


@dataclass(frozen=True)
class Clear:
    """Shape, in m, that removes copper drawn before it."""

    shape: BaseGeometry
    where: str


@dataclass(frozen=True)
class DrilledHole:
    """Hole of a drill file, in m.

    For a slot it is the middle. `function` is the last field of the tool's attribute .AperFunction, such as "ViaDrill".
    It is empty if missing. `plated` is None if the file does not specify it.
    """

    x: float
    y: float
    diameter: float
    function: str
    plated: bool | None
    where: str


def parse_gerber(file: DataFile) -> list[Stroke | Flash | Region | Clear]:
    """Read the objects of a Gerber file in order.

    Raises BoardError, with file and line, for data that would be read wrongly.
    """
    repeated = next((match for match in _STEP_REPEAT.finditer(file.text) if match.groups() != ("1", "1")), None)
    if repeated:
        line = file.text.count("\n", 0, repeated.start()) + 1
        raise BoardError(f"{file.label}:{line}: step and repeat is not supported.")
    rs274x = gerbonara("rs274x")
    target = rs274x.GerberFile()
    parser = rs274x.GerberParser(target)
    target.objects = found = _Recorder(lambda: (parser.lineno, dict(parser.graphics_state.object_attrs)))
    text = _COMMENTED.sub(r"%\1*%", _IDLE.sub("", file.text))
    _refusing(file.label, lambda: parser.parse(text, filename=file.label))
    if parser.file_settings.is_incremental:
        raise BoardError(f"{file.label}: incremental coordinates are not supported.")
    objects: list[Stroke | Flash | Region | Clear] = []
    for (line, attributes), item in found.records:
        where = f"{file.label}:{line}"
        read = _object(item, attributes, where)
        objects.append(read if item.polarity_dark else Clear(read.shape, where))
    return objects


def parse_drills(file: DataFile) -> list[DrilledHole]:
    """Read the holes of a drill file.

    It is an Excellon file, or a Gerber file in its place. Raises BoardError as `parse_gerber` does, and for coordinates
    without a unit and tools without a diameter.
    """
    if file.kind == "gerber":
        return [
            DrilledHole(*_middle(item.points), item.width, "", None, item.where)
            if isinstance(item, Stroke)
            else DrilledHole(item.x, item.y, item.size, "", None, item.where)
            for item in parse_gerber(file)
            if isinstance(item, Stroke | Flash)
        ]
    excellon = gerbonara("excellon")
    parser = excellon.ExcellonParser()
    parser.objects = found = _Recorder(lambda: parser.lineno)
    _refusing(file.label, lambda: parser.do_parse(file.text, filename=file.label))
    if parser.program_state is not excellon.ProgramState.FINISHED:
        raise BoardError(f"{file.label}: the file ends without M30, it is truncated.")
    functions = _tool_functions(file.text)
    by_tool = {id(tool): functions.get(index, ()) for index, tool in parser.tools.items()}
    return [_hole(item, by_tool.get(id(item.tool), ()), f"{file.label}:{line}") for line, item in found.records]


class _Recorder(list[Any]):
    """List that records `state` with every appended object.

    It replaces the list to which a parser of gerbonara appends.
    """

    def __init__(self, state: Callable[[], Any]) -> None:
        super().__init__()
        self.records: list[tuple[Any, Any]] = []
        self._state = state

    def append(self, item: Any) -> None:
        self.records.append((self._state(), item))


def _refusing(label: str, parse: Callable[[], None]) -> None:
    """Let gerbonara parse, and convert its errors to BoardError.

    Warnings that mean a wrong result are converted too.
    """
    complaints: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            parse()
        except SyntaxError as error:
            complaints.append(str(error))
    for text in [*(str(warning.message) for warning in caught), *complaints]:
        known = next((ours for sign, ours in _REFUSED.items() if sign in text), None)
        if known or text in complaints:
            line, statement, reason = _parted(label, text)
            raise BoardError(f"{label}{line}: {known or reason}{statement}.")


def _parted(label: str, text: str) -> tuple[str, str, str]:
    """Split gerbonara's 'file:line "statement": reason'.

    The parts are ":line", " (statement)" and the reason.
    """
    match = re.fullmatch(r':(\d+) "(.*?)": (.*)', text.removeprefix(label), re.DOTALL)
    if match is None:
        return "", "", text
    line, statement, reason = match.groups()
    # gerbonara goes on with advice to programmers, and has line 0 for the end of the file
    first, statement = reason.split(". ")[0].rstrip("."), " ".join(statement.split())
    return f":{line}" if line != "0" else "", f" ({statement})" if statement else "", first


def _object(item: Any, attributes: dict[str, tuple[str, ...]], where: str) -> Stroke | Flash | Region:
    """Convert an object of gerbonara.

    The result is a stroke, flash or region.
    """
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
    if not isinstance(aperture, apertures.CircleAperture):
        raise BoardError(f"{where}: a stroke must have a round aperture; got {aperture}.")
    way = tuple(_way(item))
    if len(way) == 2 and way[0] == way[1]:  # a dot
        return _flash(*way[0], aperture, pin, named, where)
    return Stroke(way, _diameter(aperture, where), named, where)


def _flash(x: float, y: float, aperture: Any, pin: str, net: str | None, where: str) -> Flash:
    """Make a flash of an aperture.

    The place is in m.
    """
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
    """Points on an arc about a centre.

    It is the whole circle if the arc ends at its beginning.
    """
    first = math.atan2(start[1] - centre[1], start[0] - centre[0])
    last = math.atan2(end[1] - centre[1], end[0] - centre[0])
    turn = 2 * math.pi if start == end else (last - first) % (2 * math.pi)
    if clockwise:
        turn = -turn if start == end else turn - 2 * math.pi
    radius = 0.5 * (math.dist(start, centre) + math.dist(end, centre))  # they differ by the file's rounding
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


def _tool_functions(text: str) -> dict[int, tuple[str, ...]]:
    """Read the X2 attribute .AperFunction of every tool.

    It stands in the comments of an Excellon file.
    """
    functions: dict[int, tuple[str, ...]] = {}
    current: tuple[str, ...] = ()
    for line in text.splitlines():
        if attribute := _TOOL_FUNCTION.fullmatch(line.strip()):
            current = tuple(attribute[2].split(",")) if attribute[1] == "A" and attribute[2] else ()
        elif current and (tool := _TOOL.fullmatch(line.strip())):
            functions[int(tool[1])] = current
    return functions


def _hole(item: Any, function: tuple[str, ...], where: str) -> DrilledHole:
    """Convert a hole of gerbonara."""
    tool = item.tool
    if item.unit is None or tool.unit is None:
        raise BoardError(f"{where}: the file does not say its unit, METRIC or INCH.")
    if not tool.diameter:
        raise BoardError(f"{where}: the tool has no diameter.")
    if isinstance(item, gerbonara("graphic_objects").Flash):
        x, y = item.x / _in_metre(item.unit), item.y / _in_metre(item.unit)
    else:
        x, y = _middle(tuple(_way(item)))
    plated = {"Plated": True, "NonPlated": False}.get(function[0], tool.plated) if function else tool.plated
    return DrilledHole(x, y, _diameter(tool, where), function[-1] if function else "", plated, where)


def _middle(points: tuple[Point, ...]) -> Point:
    (x1, y1), (x2, y2) = points[0], points[-1]
    return (x1 + x2) / 2, (y1 + y2) / 2


def _diameter(tool: Any, where: str) -> float:
    diameter = float(tool.diameter / _in_metre(tool.unit))
    if not 0 <= diameter <= _WIDEST:
        raise BoardError(f"{where}: a diameter must be from 0 to {_WIDEST:g} m; got {diameter:g} m.")
    return diameter


def _in_metre(unit: Any) -> float:
    """Return the number of a unit's lengths in a metre.

    Dividing by it keeps 35 mm equal to the 0.035 m of a design.
    """
    return 1e3 / float(unit.this_in_mm)
