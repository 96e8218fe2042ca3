"""Fabrication data in one zip: Gerber X2 layers, Excellon drills and a Gerber job file."""

from __future__ import annotations

import json
import re
import uuid
import zipfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib import metadata
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from coilarray.compute.files import write_atomically
from coilarray.errors import OutputError
from coilarray.geometry.array import CoilArray
from coilarray.geometry.copper import Drill, drills
from coilarray.geometry.export.silk import silk_labels
from coilarray.geometry.readers.gerber_files import gerbonara

FloatArray = npt.NDArray[np.float64]

_MM = 1e3
_DIGITS = 6  # of a coordinate in mm, 1 nm: the finest that the Gerber format recommends
_SILK_LINE = 0.15  # width of a letter's strokes by its height, as KiCad draws them
_PROFILE_LINE = 0.05  # mm
# equal bytes from equal designs: zip files carry no time of their own
_ZIP_TIME = (1980, 1, 1, 0, 0, 0)


def write_gerbers(
    array: CoilArray,
    path: Path,
    *,
    name: str,
    revision: str = "1",
    check: Callable[[Path], None] | None = None,
) -> None:
    """Write everything a board house needs as one zip.

    Parameters
    ----------
    array : CoilArray
        The board.
    path : Path
        Ends in ``.zip``. Written whole or not at all.
    name : str
        Name of the project; the names of the files begin with it.
    revision : str
        Revision of the project.
    check : callable, optional
        Called with the path of the finished zip before it is in its place; what it raises leaves all as it was.

    Raises
    ------
    OutputError
        Another suffix, an empty name, or a file that cannot be written.
    MissingDependencyError
        gerbonara is not installed.

    Notes
    -----
    The files, in mm with the origin of the design, named as KiCad names them:

    - a Gerber X2 file each copper layer: traces as strokes with round apertures, pads as flashes. Every object
      carries its net (the coil's name), pads of terminals also the coil and their number, 1 where the path begins.
    - solder masks with an opening as large as each pad of a terminal on the outer layers (board houses widen it to
      their registration); vias are covered.
    - the names of the coils on top, where they fit.
    - the edge of the board.
    - Excellon files of the plated holes, one for each span of layers. A terminal that reaches one layer of several
      only is a pad without a hole.
    - a Gerber job file with the stack-up.

    Strokes, not regions: board houses edit and check traces as strokes, and readers get the path back. Their ends and
    corners are round. The outlines of `coilarray.geometry.copper` are mitred, so at a corner of the angle θ the strokes
    have less copper by (w/2)² (tan θ/2 − θ/2), with w the width of the trace: 2e-4 of the copper of a hexagonal coil
    of 30 turns with 0.1 mm traces.

    No file carries a date: equal designs give equal bytes.

    Examples
    --------
    >>> from coilarray.geometry import PlatedHole, Placement, Stackup, path_coil
    >>> coil = path_coil([[(0, 0), (1e-2, 0)]], 0.2e-3, 0.2e-3, PlatedHole(0.3e-3, 0.6e-3))
    >>> board = CoilArray(Stackup(("top",), (35e-6,), (), ()), (Placement("A", coil, ("top",), 0, 0),))
    >>> write_gerbers(board, Path("board.rar"), name="board")
    Traceback (most recent call last):
    coilarray.errors.OutputError: cannot write board.rar: the suffix must be .zip; got '.rar'.
    """
    if path.suffix.lower() != ".zip":
        raise OutputError(f"cannot write {path}: the suffix must be .zip; got {path.suffix!r}.")
    if not name.strip():
        raise OutputError(f"cannot write {path}: the project must have a name; got {name!r}.")
    project = _Project(name, revision)
    files = [*_copper_files(array, project), *_mask_files(array, project)]
    files += [_silk_file(array, project), _profile_file(array, project), *_drill_files(array, project)]
    content = {file.name: file.text for file in files}
    content[f"{project.stem}-job.gbrjob"] = _job(array, project, files)

    def write(temporary: Path) -> None:
        _fill(temporary, content)
        if check is not None:
            check(temporary)

    write_atomically(path, write)


@dataclass(frozen=True)
class _Project:
    name: str
    revision: str

    @property
    def stem(self) -> str:
        """The name with what file systems may refuse replaced."""
        return re.sub(r"[^A-Za-z0-9._-]+", "_", self.name)

    @property
    def guid(self) -> str:
        return str(uuid.uuid5(uuid.NAMESPACE_URL, f"coilarray:{self.name}"))

    @property
    def software(self) -> tuple[str, str, str]:
        """Vendor, application and version."""
        return "coilarray", "coilarray", metadata.version("coilarray")

    def attributes(self, function: Sequence[str], polarity: str = "") -> dict[str, tuple[str, ...]]:
        """File attributes of one layer."""
        attributes = {
            ".GenerationSoftware": self.software,
            ".ProjectId": (_field(self.name), self.guid, _field(self.revision)),
            ".Part": ("Single",),
            ".SameCoordinates": ("Original",),
            ".FileFunction": tuple(function),
        }
        return attributes | ({".FilePolarity": (polarity,)} if polarity else {})


@dataclass(frozen=True)
class _Round:
    """A round aperture of a diameter in mm and with the function that X2 gives it.

    gerbonara's own writes four digits and no function.
    """

    diameter: float
    function: str = ""

    def to_gerber(self, settings: object = None) -> str:
        """Return the shape and size as gerbonara writes them into the definition of an aperture."""
        return f"C,{self.diameter:.{_DIGITS}f}"


@dataclass(frozen=True)
class _Statement:
    """A statement among the objects of a file that gerbonara has no object for."""

    text: str

    def to_statements(self, state: object) -> Iterator[str]:
        """Yield the lines as gerbonara's own objects do."""
        yield self.text


@dataclass(frozen=True)
class _File:
    name: str
    text: str
    function: tuple[str, ...]
    polarity: str = ""


def _copper_files(array: CoilArray, project: _Project) -> Iterator[_File]:
    names = array.stackup.names
    for k, layer in enumerate(names):
        side = "Top" if k == 0 else "Bot" if k == len(names) - 1 else "Inr"
        file = {"Top": "F_Cu", "Bot": "B_Cu", "Inr": f"In{k}_Cu"}[side]
        objects = _copper(array, layer)
        yield _gerber(project, file, objects, ("Copper", f"L{k + 1}", side), "Positive")


def _copper(array: CoilArray, layer: str) -> list[Any]:
    objects: list[Any] = []
    holes = drills(array)
    for placement in array.placements:
        own = [hole for hole in holes if hole.net == placement.name]
        objects.append(_Statement(f"%TO.N,{_field(placement.name)}*%"))
        for k in placement.lines_on(layer):
            points, widths = _mm(placement.to_board(placement.coil.lines[k])), _mm(placement.coil.widths[k])
            objects += [
                _line(start, end, _Round(width, "Conductor"))
                for start, end, width in zip(points, points[1:], widths.tolist(), strict=False)
            ]
        objects += [
            _flash(hole.x, hole.y, _Round(float(_mm(hole.pad)), "ViaPad"))
            for hole in own
            if hole.kind == "via" and layer in hole.layers
        ]
        for number, hole in enumerate((hole for hole in own if hole.kind == "terminal"), start=1):
            if layer in hole.layers:
                pad = _Round(float(_mm(hole.pad)), "ComponentPad" if hole.drilled else "SMDPad,CuDef")
                objects.append(_Statement(f"%TO.P,{_field(placement.name)},{number}*%"))
                objects.append(_flash(hole.x, hole.y, pad))
        objects.append(_Statement("%TD*%"))
    return objects


def _mask_files(array: CoilArray, project: _Project) -> Iterator[_File]:
    for side, file, layer in (("Top", "F_Mask", array.stackup.names[0]), ("Bot", "B_Mask", array.stackup.names[-1])):
        openings = [
            _flash(hole.x, hole.y, _Round(float(_mm(hole.pad))))
            for hole in drills(array)
            if hole.kind == "terminal" and layer in hole.layers
        ]
        yield _gerber(project, file, openings, ("Soldermask", side), "Negative")


def _silk_file(array: CoilArray, project: _Project) -> _File:
    font = gerbonara("newstroke").Newstroke.load()
    objects: list[Any] = []
    for placement, label in zip(array.placements, silk_labels(array), strict=True):
        if label is None:
            continue
        size = float(_mm(label.size))
        pen = _Round(_SILK_LINE * size)
        text = " ".join(placement.name.split())  # the font has no other blanks
        strokes = [np.array(stroke) for stroke in font.render(text, size=size, scale=(1, -1))]
        points = np.vstack(strokes)
        shift = _mm((label.x, label.y)) - 0.5 * (points.min(axis=0) + points.max(axis=0))
        for stroke in strokes:
            placed = np.round(stroke + shift, _DIGITS)
            objects += [_line(start, end, pen) for start, end in pairwise(placed)]
    return _gerber(project, "F_Silkscreen", objects, ("Legend", "Top"), "Positive")


def _profile_file(array: CoilArray, project: _Project) -> _File:
    x_min, y_min, x_max, y_max = _mm(array.bounds).tolist()
    corners = np.array([(x_min, y_min), (x_max, y_min), (x_max, y_max), (x_min, y_max), (x_min, y_min)])
    pen = _Round(_PROFILE_LINE, "Profile")
    objects = [_line(start, end, pen) for start, end in pairwise(corners)]
    return _gerber(project, "Edge_Cuts", objects, ("Profile", "NP"))


def _gerber(
    project: _Project, layer: str, objects: Sequence[Any], function: tuple[str, ...], polarity: str = ""
) -> _File:
    """Write a Gerber file through gerbonara and complete what version 1.5 leaves out.

    That is the functions of apertures, the interpolation mode that must stand before the first stroke, and the end of
    the statement G75. The nets are in `objects`.
    """
    file = gerbonara("rs274x").GerberFile(objects=list(objects))
    file.file_attrs = project.attributes(function, polarity)
    file.dedup_apertures = lambda: None  # it would merge a pad with a trace as wide
    functions = iter([aperture.function for aperture in file.apertures()])
    settings = gerbonara("cam").FileSettings(unit=_millimetre(), number_format=(4, _DIGITS))
    text = file.write_to_bytes(settings).decode("utf-8")
    text = text.replace("\n%IPPOS*%\nG75\n", "\nG75*\nG01*\n")

    def with_function(definition: re.Match[str]) -> str:
        function = next(functions)
        return f"%TA.AperFunction,{function}*%\n{definition[0]}\n%TD*%" if function else definition[0]

    text = re.sub(r"^%ADD\d+C,.*\*%$", with_function, text, flags=re.MULTILINE)
    return _File(f"{project.stem}-{layer}.gbr", text + "\n", function, polarity)


def _drill_files(array: CoilArray, project: _Project) -> Iterator[_File]:
    names = array.stackup.names
    spans: dict[tuple[int, int], list[Drill]] = {}
    for hole in drills(array):
        if hole.drilled:
            span = names.index(hole.layers[0]) + 1, names.index(hole.layers[-1]) + 1
            spans.setdefault(span, []).append(hole)
    for (first, last), holes in sorted(spans.items()):
        outer = (first == 1) + (last == len(names))
        kind = ("Buried", "Blind", "PTH")[outer]
        file = f"{project.stem}-PTH.drl" if outer == 2 else f"{project.stem}-PTH-L{first}-L{last}.drl"
        yield _excellon(project, file, holes, ("Plated", str(first), str(last), kind))


def _excellon(project: _Project, name: str, holes: Sequence[Drill], function: tuple[str, ...]) -> _File:
    tool = gerbonara("apertures").ExcellonTool
    objects = [
        _flash(hole.x, hole.y, tool(float(_mm(hole.diameter)), plated=True, unit=_millimetre())) for hole in holes
    ]
    settings = gerbonara("cam").FileSettings(unit=_millimetre(), number_format=(1, _DIGITS))
    written = gerbonara("excellon").ExcellonFile(objects=objects).write_to_bytes(settings).decode("utf-8")
    # gerbonara knows no attributes in Excellon files; they stand in comments of the header
    attributes = [f"; #@! TF{key},{','.join(value)}" for key, value in project.attributes(function).items()]
    _, begin, rest = written.partition("M48\n")
    return _File(name, begin + "\n".join(attributes) + "\n" + rest + "\n", function)


def _job(array: CoilArray, project: _Project, files: Sequence[_File]) -> str:
    stackup = array.stackup
    vendor, application, version = project.software
    x_min, y_min, x_max, y_max = array.bounds
    layers: list[dict[str, Any]] = []
    for k, (name, copper) in enumerate(zip(stackup.names, stackup.copper_thickness, strict=True)):
        layers.append({"Type": "Copper", "Thickness": float(_mm(copper)), "Name": name})
        if k + 1 < len(stackup.names):
            layers.append(
                {
                    "Type": "Dielectric",
                    "Thickness": float(_mm(stackup.dielectric_thickness[k])),
                    "DielectricConstant": stackup.epsilon_r[k],
                    "Name": f"{name}/{stackup.names[k + 1]}",
                }
            )
    job = {
        "Header": {"GenerationSoftware": {"Vendor": vendor, "Application": application, "Version": version}},
        "GeneralSpecs": {
            "ProjectId": {"Name": project.name, "GUID": project.guid, "Revision": project.revision},
            "Size": {"X": float(_mm(x_max - x_min)), "Y": float(_mm(y_max - y_min))},
            "LayerNumber": len(stackup.names),
            "BoardThickness": float(_mm(stackup.thickness)),
        },
        "FilesAttributes": [
            {"Path": file.name, "FileFunction": ",".join(file.function)}
            | ({"FilePolarity": file.polarity} if file.polarity else {})
            for file in files
        ],
        "MaterialStackup": layers,
    }
    return json.dumps(job, indent=2, ensure_ascii=False) + "\n"


def _line(start: FloatArray, end: FloatArray, aperture: _Round) -> Any:
    """Make a stroke between two points in mm."""
    return gerbonara("graphic_objects").Line(*start.tolist(), *end.tolist(), aperture, unit=_millimetre())


def _flash(x: float, y: float, aperture: Any) -> Any:
    """Make a flash at a place in m."""
    return gerbonara("graphic_objects").Flash(*_mm((x, y)).tolist(), aperture, unit=_millimetre())


def _millimetre() -> Any:
    return gerbonara("utils").MM


def _field(text: str) -> str:
    """Text as a field of an attribute: what has a meaning in Gerber files as an escape."""
    return re.sub(r"[%*,\\\x00-\x1f]", lambda match: f"\\u{ord(match[0]):04X}", text)


def _mm(lengths: npt.ArrayLike) -> FloatArray:
    """Lengths in mm to the last digit of the file; no negative zero."""
    return np.round(np.asarray(lengths, dtype=np.float64) * _MM, _DIGITS) + 0.0


def _fill(path: Path, content: dict[str, str]) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in content.items():
            entry = zipfile.ZipInfo(name, _ZIP_TIME)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system = 3  # Unix, on every machine
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, text.encode("utf-8"))
