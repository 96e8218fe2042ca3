"""Fabrication data in one zip: Gerber, Excellon, job file."""

import json
import re
import uuid
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from coilarray.compute.arrays import FloatArray
from coilarray.compute.files import require_suffix, write_atomically
from coilarray.errors import OutputError
from coilarray.fabrication.drawings import silk_labels
from coilarray.fabrication.gerber_reader import gerbonara
from coilarray.geometry.arcs import arc_centre, arc_size, pieces_of
from coilarray.geometry.array import Array
from coilarray.geometry.copper import Drill, drills

_MM = 1e3
_DIGITS = 6  # of a coordinate in mm, 1 nm: the finest that the Gerber format recommends
_SILK_LINE = 0.15  # width of a letter's strokes over its height, as in KiCad
_PROFILE_LINE = 0.05  # mm
_REVISION = "1"  # of every project
_ZIP_TIME = (1980, 1, 1, 0, 0, 0)  # equal bytes from equal designs


def write_gerbers(array: Array, path: Path, *, name: str, check: Callable[[Path], None] | None = None) -> None:
    """Write the fabrication data of the project `name` as one zip.

    `check` is called with the path of the finished zip before it is moved to its place: if it
    raises, nothing is changed. The files are in mm, with the origin of the design, named as in
    KiCad, and without a date, so equal designs give equal bytes: Gerber X2 with nets and numbers of
    terminals, solder masks open over terminals only, the names of the coils, the edge, an Excellon
    file for each span of layers, and a job file with the stack-up.

    Ends and corners of strokes are round, whereas the outlines of `coilarray.geometry.copper` are
    mitred. At a corner of the angle θ the strokes have less copper by (w/2)² (tan θ/2 − θ/2), with
    w the width of the trace: 2e-4 of a hexagonal coil of 30 turns with 0.1 mm traces.
    """
    require_suffix(path, ".zip")
    if not name.strip():
        raise OutputError(f"cannot write {path}: the project must have a name; got {name!r}.")
    project = _Project(name)
    files = [*_gerbers(array, project), *_drill_files(array, project)]
    content = {file.name: file.text for file in files}
    content[f"{project.stem}-job.gbrjob"] = _job(array, project, files)

    def write(temporary: Path) -> None:
        with zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive:
            for file, text in content.items():
                entry = zipfile.ZipInfo(file, _ZIP_TIME)
                entry.compress_type = zipfile.ZIP_DEFLATED
                entry.create_system = 3  # Unix, on every machine
                entry.external_attr = 0o644 << 16
                archive.writestr(entry, text.encode("utf-8"))
        if check is not None:
            check(temporary)

    write_atomically(path, write)


@dataclass(frozen=True)
class _Project:
    name: str

    @property
    def stem(self) -> str:
        """Name without characters that file systems may refuse."""
        return re.sub(r"[^A-Za-z0-9._-]+", "_", self.name)

    @property
    def guid(self) -> str:
        return str(uuid.uuid5(uuid.NAMESPACE_URL, f"coilarray:{self.name}"))

    def attributes(self, function: Sequence[str], polarity: str = "") -> dict[str, tuple[str, ...]]:
        """File attributes of one layer."""
        attributes = {
            ".GenerationSoftware": ("coilarray", "coilarray", metadata.version("coilarray")),
            ".ProjectId": (_field(self.name), self.guid, _REVISION),
            ".Part": ("Single",),
            ".SameCoordinates": ("Original",),
            ".FileFunction": tuple(function),
        }
        return attributes | ({".FilePolarity": (polarity,)} if polarity else {})


class _Layer:
    """Text of a Gerber layer and its round apertures."""

    def __init__(self) -> None:
        self._apertures: dict[tuple[str, str], int] = {}
        self._body: list[str] = []
        self._selected = 0
        self._at: tuple[str, str] | None = None

    def attribute(self, command: str) -> None:
        """Add an X2 command, such as "TO.N,coil1" or "TD"."""
        self._body.append(f"%{command}*%")

    def stroke(
        self, start: FloatArray, end: FloatArray, width: float, function: str = "", middle: FloatArray | None = None
    ) -> None:
        """Draw a stroke, or an arc through `middle`, in mm."""
        self._select(width, function)
        if self._at != _coordinates(start):
            self._operation(start, "D02")
        centre = None if middle is None else arc_centre(start, middle, end)
        if middle is None or centre is None:
            self._operation(end, "D01")
            return
        self._body.append("G02*" if arc_size(start, middle, end)[1] < 0 else "G03*")
        self._operation(end, "I{}J{}D01".format(*_coordinates(centre - start)))
        self._body.append("G01*")

    def flash(self, hole: Drill, function: str = "") -> None:
        """Flash the pad of a hole."""
        self._select(float(_mm(hole.pad)), function)
        self._operation(_mm((hole.x, hole.y)), "D03")

    def text(self, attributes: Mapping[str, Sequence[str]]) -> str:
        """Return the file with its attributes."""
        lines = [f"%TF{key},{','.join(value)}*%" for key, value in attributes.items()]
        lines += ["%MOMM*%", f"%FSLAX4{_DIGITS}Y4{_DIGITS}*%", "G75*", "G01*", "%LPD*%"]
        for (diameter, function), number in self._apertures.items():
            definition = f"%ADD{number}C,{diameter}*%"
            lines += [f"%TA.AperFunction,{function}*%", definition, "%TD*%"] if function else [definition]
        return "\n".join([*lines, *self._body, "M02*"]) + "\n"

    def _select(self, diameter: float, function: str) -> None:
        key = (f"{diameter:.{_DIGITS}f}", function)
        number = self._apertures.setdefault(key, len(self._apertures) + 10)  # 0 to 9 are reserved
        if number != self._selected:
            self._body.append(f"D{number}*")
            self._selected = number

    def _operation(self, at: FloatArray, code: str) -> None:
        self._at = _coordinates(at)
        self._body.append("X{}Y{}".format(*self._at) + f"{code}*")


def _coordinates(at: FloatArray) -> tuple[str, str]:
    """Write a point in mm as the format's whole numbers."""
    x, y = np.rint(at * 10**_DIGITS).astype(np.int64).tolist()
    return str(x), str(y)


@dataclass(frozen=True)
class _File:
    name: str
    text: str
    function: tuple[str, ...]
    polarity: str = ""


def _gerbers(array: Array, project: _Project) -> Iterator[_File]:
    """Yield copper from top to bottom, masks, names and edge."""
    names = array.stackup.names

    def file(name: str, layer: _Layer, function: tuple[str, ...], polarity: str = "") -> _File:
        text = layer.text(project.attributes(function, polarity))
        return _File(f"{project.stem}-{name}.gbr", text, function, polarity)

    for k, name in enumerate(names):
        side = "Top" if k == 0 else "Bot" if k == len(names) - 1 else "Inr"
        kicad = {"Top": "F_Cu", "Bot": "B_Cu", "Inr": f"In{k}_Cu"}[side]
        yield file(kicad, _copper(array, name), ("Copper", f"L{k + 1}", side), "Positive")
    for side, kicad, name in (("Top", "F_Mask", names[0]), ("Bot", "B_Mask", names[-1])):
        openings = _Layer()
        for hole in drills(array):
            if hole.kind == "terminal" and name in hole.layers:
                openings.flash(hole)
        yield file(kicad, openings, ("Soldermask", side), "Negative")
    yield file("F_Silkscreen", _silk(array), ("Legend", "Top"), "Positive")
    x_min, y_min, x_max, y_max = _mm(array.bounds).tolist()
    corners = np.array([(x_min, y_min), (x_max, y_min), (x_max, y_max), (x_min, y_max), (x_min, y_min)])
    edge = _Layer()
    for start, end in pairwise(corners):
        edge.stroke(start, end, _PROFILE_LINE, "Profile")
    yield file("Edge_Cuts", edge, ("Profile", "NP"))


def _copper(array: Array, name: str) -> _Layer:
    layer = _Layer()
    holes = drills(array)
    for placement in array.placements:
        own = [hole for hole in holes if hole.net == placement.name]
        layer.attribute(f"TO.N,{_field(placement.name)}")
        for k in placement.lines_on(name):
            line, widths = placement.to_board(placement.coil.lines[k]), _mm(placement.coil.widths[k]).tolist()
            for piece in pieces_of(line, placement.coil.arcs_of(k)):
                start, middle, end = map(_mm, piece.points(line))
                layer.stroke(start, end, widths[piece.first], "Conductor", middle if piece.bulge else None)
        for hole in own:
            if hole.kind == "via" and name in hole.layers:
                layer.flash(hole, "ViaPad")
        for number, hole in enumerate((hole for hole in own if hole.kind == "terminal"), start=1):
            if name in hole.layers:
                layer.attribute(f"TO.P,{_field(placement.name)},{number}")
                layer.flash(hole, "ComponentPad" if hole.drilled else "SMDPad,CuDef")
        layer.attribute("TD")
    return layer


def _silk(array: Array) -> _Layer:
    font = gerbonara("newstroke").Newstroke.load()
    layer = _Layer()
    for placement, label in zip(array.placements, silk_labels(array), strict=True):
        if label is None:
            continue
        size = float(_mm(label.size))
        text = " ".join(placement.name.split())  # the font has no other blanks
        strokes = [np.array(stroke) for stroke in font.render(text, size=size, scale=(1, -1))]
        points = np.vstack(strokes)
        shift = _mm((label.x, label.y)) - 0.5 * (points.min(axis=0) + points.max(axis=0))
        for stroke in strokes:
            for start, end in pairwise(np.round(stroke + shift, _DIGITS)):
                layer.stroke(start, end, _SILK_LINE * size)
    return layer


def _drill_files(array: Array, project: _Project) -> Iterator[_File]:
    """Yield an Excellon file of plated holes for each span."""
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
        function = ("Plated", str(first), str(last), kind)
        places: dict[float, list[str]] = {}
        for hole in holes:
            x, y = _mm((hole.x, hole.y)).tolist()
            places.setdefault(float(_mm(hole.diameter)), []).append(f"X{x:.{_DIGITS}f}Y{y:.{_DIGITS}f}")
        # Excellon has no attributes: they stand in comments of the header
        lines = ["M48", *(f"; #@! TF{key},{','.join(text)}" for key, text in project.attributes(function).items())]
        lines += ["METRIC", *(f"T{k:02d}C{size:.{_DIGITS}f}" for k, size in enumerate(places, start=1)), "%", "G05"]
        for k, at in enumerate(places.values(), start=1):
            lines += [f"T{k:02d}", *at]
        yield _File(file, "\n".join([*lines, "M30"]) + "\n", function)


def _job(array: Array, project: _Project, files: Sequence[_File]) -> str:
    stackup = array.stackup
    software = {"Vendor": "coilarray", "Application": "coilarray", "Version": metadata.version("coilarray")}
    x_min, y_min, x_max, y_max = array.bounds
    layers: list[dict[str, Any]] = []
    for k, (name, copper) in enumerate(zip(stackup.names, stackup.copper_thickness, strict=True)):
        layers.append({"Type": "Copper", "Thickness": float(_mm(copper)), "Name": name})
        if k + 1 < len(stackup.names):
            slab = {"Type": "Dielectric", "Thickness": float(_mm(stackup.dielectric_thickness[k]))}
            below = f"{name}/{stackup.names[k + 1]}"
            layers.append(slab | {"DielectricConstant": stackup.epsilon_r[k], "Name": below})
    job = {
        "Header": {"GenerationSoftware": software},
        "GeneralSpecs": {
            "ProjectId": {"Name": project.name, "GUID": project.guid, "Revision": _REVISION},
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


def _field(text: str) -> str:
    """Escape characters with a meaning in Gerber attributes."""
    return re.sub(r"[%*,\\\x00-\x1f]", lambda match: f"\\u{ord(match[0]):04X}", text)


def _mm(lengths: npt.ArrayLike) -> FloatArray:
    """Convert lengths to rounded mm, without negative zeros."""
    return np.round(np.asarray(lengths, dtype=np.float64) * _MM, _DIGITS) + 0.0
