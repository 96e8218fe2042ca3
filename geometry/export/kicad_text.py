"""The text of KiCad's files: s-expressions, lengths, layer names, identifiers and footprints.

A footprint holds the terminals of a coil on a board, or a whole winding as a part of a library.
"""

from __future__ import annotations

import uuid
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import numpy.typing as npt

from coilarray.compute.arrays import IntArray
from coilarray.errors import OutputError
from coilarray.geometry.arcs import pieces_of
from coilarray.geometry.array import Array, Placement
from coilarray.geometry.copper import Drill, drills
from coilarray.geometry.export.silk import Label, silk_labels
from coilarray.geometry.stackup import Stackup

# The format of KiCad 6, the oldest with a stack-up in today's form. Later versions read it too.
FILE_VERSION = "20211014"

# Generator named in every file.
GENERATOR = "coilarray"

# KiCad's unit of length.
_NANOMETRES = 1e9

# Namespace of the identifiers of everything that this package writes.
_NAMESPACE = uuid.uuid5(uuid.NAMESPACE_URL, "coilarray")

# The layers of a board beside its copper: number, name, and the shown name if it differs.
OTHER_LAYERS = (
    (34, "B.Paste", ""), (35, "F.Paste", ""), (36, "B.SilkS", "B.Silkscreen"), (37, "F.SilkS", "F.Silkscreen"),
    (38, "B.Mask", ""), (39, "F.Mask", ""), (40, "Dwgs.User", "User.Drawings"), (41, "Cmts.User", "User.Comments"),
    (44, "Edge.Cuts", ""), (45, "Margin", ""), (46, "B.CrtYd", "B.Courtyard"), (47, "F.CrtYd", "F.Courtyard"),
    (48, "B.Fab", ""), (49, "F.Fab", ""),
)  # fmt: skip
_MOST_COPPER_LAYERS = 32
BOTTOM = 31
# Characters that KiCad's dialogue refuses in a layer's name.
_FORBIDDEN = frozenset('\\/:*?"<>|%')
# Height in m of the letters that are not printed.
_FAB_LETTERS = 1e-3
# Width of a stroke by the height of its letter, KiCad's own.
_STROKE = 0.15
# Attributes of a coil, which is not bought or placed.
_NO_PART = ("exclude_from_pos_files", "exclude_from_bom")


def node(name: str, *items: str) -> str:
    """Write an expression on one line: ``(name item item)``."""
    return f"({' '.join((name, *items))})"


def block(name: str, head: Iterable[str], children: Iterable[str]) -> str:
    """Write an expression with each child on its own lines.

    The children are indented by two spaces.
    """
    lines = [f"({' '.join((name, *head))}"]
    for child in children:
        lines += [f"  {line}" for line in child.split("\n")]
    return "\n".join((*lines, ")"))


def on_layer(name: str) -> str:
    """Write the ``(layer …)`` of one of KiCad's layers."""
    return node("layer", quoted(name))


def quoted(text: str) -> str:
    r"""Text in quotes, with escaped backslashes, quotes and newlines.

    Examples
    --------
    >>> quoted('a "b"')
    '"a \\"b\\""'
    """
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n").replace("\r", "\\r")
    return f'"{escaped}"'


def nanometres(metres: npt.ArrayLike) -> IntArray:
    """Round lengths in m to whole numbers of nanometres."""
    return np.rint(np.asarray(metres, dtype=np.float64) * _NANOMETRES).astype(np.int64)


def mm(nm: int) -> str:
    """Write a whole number of nanometres in mm, exactly.

    Examples
    --------
    >>> mm(-1_500_000), mm(100), mm(2_000_000)
    ('-1.5', '0.0001', '2')
    """
    whole, part = divmod(abs(nm), 1_000_000)
    digits = f"{whole}.{part:06d}".rstrip("0").rstrip(".")
    return f"-{digits}" if nm < 0 else digits


def length(metres: float) -> str:
    """Write a length in mm, rounded to 1 nm.

    `metres` is the length in m.
    """
    return mm(int(nanometres(metres)))


def at(name: str, point: npt.ArrayLike) -> str:
    """Write the position ``(name x y)`` of a point.

    The point is in nm. The point is on the sheet.
    """
    x, y = np.asarray(point).tolist()
    return node(name, mm(x), mm(y))


@dataclass(frozen=True)
class Drawing:
    """Mapping of a design into one file.

    `root` begins the identifiers of the file's pieces. `layers` are KiCad's names of the stack-up's copper layers. `x0`
    and `y0` are the origin of the design on the sheet in nm. The sheet's y axis points down.
    """

    root: str
    layers: dict[str, str]
    x0: int = 0
    y0: int = 0

    def points(self, xy: npt.ArrayLike) -> IntArray:
        """Transform points of the design to the sheet, in nm.

        The points have the shape (…, 2), in m.
        """
        return np.asarray(nanometres(xy) * np.array([1, -1]) + np.array([self.x0, self.y0]))

    def point(self, x: float, y: float) -> IntArray:
        """Transform a point of the design to the sheet.

        The point is in m. The result has the shape (2,), in nm.
        """
        return self.points((x, y))

    def within(self, part: str) -> Drawing:
        """Return the drawing of a part, with its own identifiers."""
        return replace(self, root=f"{self.root}/{part}")

    def layer(self, name: str) -> str:
        """Write the ``(layer …)`` of a copper layer.

        The layer belongs to the stack-up.
        """
        return on_layer(self.layers[name])

    def identifier(self, *parts: object) -> str:
        """Write the ``(tstamp …)`` of a piece.

        The piece is named by the parts. It is the same for the same design.
        """
        return node("tstamp", str(uuid.uuid5(_NAMESPACE, "/".join(map(str, (self.root, *parts))))))


def copper_names(stackup: Stackup) -> dict[str, str]:
    """KiCad's name of each copper layer, top to bottom.

    The names are F.Cu, In1.Cu, …, B.Cu. A single layer is F.Cu.

    Raises OutputError for an odd number of layers above one, more than 32, or a name that KiCad cannot hold.

    Examples
    --------
    >>> copper_names(Stackup(("L1", "L2"), (35e-6, 35e-6), (0.2e-3,), (4.5,)))
    {'L1': 'F.Cu', 'L2': 'B.Cu'}
    """
    n = len(stackup.names)
    if n > _MOST_COPPER_LAYERS or (n > 1 and n % 2 == 1):
        raise OutputError(
            f"a KiCad board must have one copper layer or an even number up to {_MOST_COPPER_LAYERS}; got {n}."
        )
    kicad = ["F.Cu", *(f"In{k}.Cu" for k in range(1, n - 1)), "B.Cu"][:n]
    taken = {name for _, *names in OTHER_LAYERS for name in names}
    for own, canonical in zip(stackup.names, kicad, strict=True):
        if not own.strip() or own == "signal" or _FORBIDDEN & set(own) or not own.isprintable():
            raise OutputError(
                'a layer name for KiCad must be printable, not empty, not "signal" and without \\ / : * ? " < > | %; '
                f"got {own!r}."
            )
        if own != canonical and (own in taken or own in _ALL_COPPER):
            raise OutputError(f"layer {own!r} must have another name for KiCad, where it would be {canonical}.")
    return dict(zip(stackup.names, kicad, strict=True))


_ALL_COPPER = frozenset({"F.Cu", "B.Cu", *(f"In{k}.Cu" for k in range(1, BOTTOM))})


def library_footprints(array: Array) -> dict[str, str]:
    """Write footprints of all coil shapes.

    There is a footprint for every shape and set of layers. It is named after the first coil with this shape and these
    layers.

    Pads 1 and 2 are the terminals. A footprint has no vias. They are pads V1, V2, … without a net. The winding is drawn
    as lines on the copper layers. The footprint is a net tie, KiCad's word for a part that joins nets on purpose.
    KiCad's check then allows different nets at the terminals, as a coil has in a circuit.

    All holes go through the board, because pads of a footprint have no blind holes.
    """
    shapes: dict[tuple[int, tuple[str, ...]], list[Placement]] = {}
    for placement in array.placements:
        shapes.setdefault((id(placement.coil), placement.layers), []).append(placement)
    return {alike[0].name: _winding(array, alike) for alike in shapes.values()}


def _winding(array: Array, alike: Sequence[Placement]) -> str:
    """Footprint of equal coils, in the frame of their shape.

    The coils differ in place and rotation only.
    """
    name = alike[0].name
    placement = replace(alike[0], name="REF**", x=0.0, y=0.0, rotation=0.0)
    single = replace(array, placements=(placement,), through_holes=True)
    drawing = Drawing(f"footprint/{name}", copper_names(array.stackup))
    users = ", ".join(user.name for user in alike)
    children = [
        node("descr", quoted(f"winding of {users} on {', '.join(placement.layers)}")),
        # how the format of KiCad 6 marks a net tie. Later versions read it as a group of all pads
        node("tags", quoted("net tie planar coil")),
        _attributes(placement),
        _reference(placement, silk_labels(single)[0], drawing),
        _value(name, drawing),
        _outline(placement, drawing),
        *(
            node(f"fp_{'line' if len(ends) == 2 else 'arc'}", *ends, layer, width, drawing.identifier("line", k))
            for k, (ends, width, layer) in enumerate(tracks(placement, drawing))
        ),
        *_via_pads(single, placement, drawing),
        *_terminal_pads(single, placement, (), drawing),
    ]
    head = (quoted(name), node("version", FILE_VERSION), node("generator", GENERATOR), on_layer("F.Cu"))
    return block("footprint", head, children) + "\n"


def terminal_footprint(array: Array, placement: Placement, label: Label | None, net: str, drawing: Drawing) -> str:
    """Write the footprint with a coil's terminals and its label.

    The label, if any, is the coil's name on the board. `net` is the ``(net …)`` of the pads. `drawing` is the coil's
    part of the board's drawing. The footprint belongs to no library, because the tracks of the board are the winding.
    """
    children = [
        drawing.identifier("footprint"),
        at("at", drawing.point(placement.x, placement.y)),
        _attributes(placement, "board_only"),
        _reference(placement, label, drawing),
        _value("coil", drawing),
        *_terminal_pads(array, placement, (net,), drawing),
    ]
    return block("footprint", (quoted("coil_terminals"), on_layer("F.Cu")), children)


def tracks(placement: Placement, drawing: Drawing) -> Iterator[tuple[tuple[str, ...], str, str]]:
    """Yield the pieces of a coil's path.

    A piece has (start …), the (mid …) of an arc, (end …), then (width …) and (layer …).
    """
    last: IntArray | None = None
    for k, (line, widths, layer) in enumerate(placement.traces()):
        points = drawing.points(line)
        if last is not None:
            points[0] = last  # the ends of consecutive lines agree to 1 nm only
        last = points[-1]
        for piece in pieces_of(line, placement.coil.arcs_of(k)):
            start, end = points[piece.first], points[piece.last]
            if (start != end).any():
                middle = (at("mid", drawing.points(piece.points(line)[1])),) if piece.bulge else ()
                ends = (at("start", start), *middle, at("end", end))
                yield ends, node("width", length(widths[piece.first])), drawing.layer(layer)


def holes_of(
    array: Array, placement: Placement, kind: Literal["via", "terminal"], drawing: Drawing
) -> list[tuple[Drill, IntArray]]:
    """Holes of one coil with places in nm.

    The places are on the sheet. They are in the order of the path.
    """
    own = drills(array.with_placements((placement,)))
    return [(hole, drawing.point(hole.x, hole.y)) for hole in own if hole.kind == kind]


def _attributes(placement: Placement, *more: str) -> str:
    return node("attr", "smd" if placement.coil.terminal is None else "through_hole", *more, *_NO_PART)


def _reference(placement: Placement, label: Label | None, drawing: Drawing) -> str:
    """Write the coil's name as reference.

    It is on the silk screen if it fits.
    """
    if label is None:
        return _text("reference", placement.name, at("at", (0, 0)), "F.Fab", _FAB_LETTERS, drawing)
    place = drawing.point(label.x, label.y) - drawing.point(placement.x, placement.y)
    return _text("reference", placement.name, at("at", place), "F.SilkS", label.size, drawing)


def _value(value: str, drawing: Drawing) -> str:
    return _text("value", value, at("at", (0, 2_000_000)), "F.Fab", _FAB_LETTERS, drawing)


def _text(kind: str, text: str, place: str, layer: str, height: float, drawing: Drawing) -> str:
    size = node("size", length(height), length(height))
    font = node("font", size, node("thickness", length(_STROKE * height)))
    rest = (on_layer(layer), node("effects", font), drawing.identifier(kind))
    return node("fp_text", kind, quoted(text), place, *rest)


def _outline(placement: Placement, drawing: Drawing) -> str:
    """Outline of the winding for the assembly drawing.

    There is no courtyard, since coils of an array may overlap.
    """
    points = node("pts", *(at("xy", point) for point in drawing.points(placement.coil.outline)))
    style = (on_layer("F.Fab"), node("width", "0.1"), node("fill", "none"))
    return node("fp_poly", points, *style, drawing.identifier("outline"))


def _via_pads(array: Array, placement: Placement, drawing: Drawing) -> Iterator[str]:
    """Yield the pads V1, V2, … for vias.

    They are under the solder mask.
    """
    for k, (hole, point) in enumerate(holes_of(array, placement, "via", drawing)):
        layers = node("layers", _through(array))
        drill = node("drill", length(hole.diameter))
        yield _pad(f"V{k + 1}", "thru_hole", point, hole.pad, drill, layers, drawing.identifier("via", k))


def _terminal_pads(array: Array, placement: Placement, net: Sequence[str], drawing: Drawing) -> Iterator[str]:
    """Yield pads 1 and 2 at the path's ends.

    A pad without a hole lies on its own layer. A bare end has a pad as wide as its trace, under the solder mask, that
    adds no copper. For KiCad's check it marks the intended end of the track.
    """
    coil = placement.coil
    origin = drawing.point(placement.x, placement.y)
    ends = drawing.points(placement.to_board(coil.terminal_points)) - origin
    layers = (placement.layers[0], placement.layers[-1])
    widths = (coil.widths[0][0], coil.widths[-1][-1])
    holes = [hole for hole, _ in holes_of(array, placement, "terminal", drawing)]
    for k, (end, layer, width) in enumerate(zip(ends, layers, widths, strict=True)):
        number, rest = str(k + 1), (*net, drawing.identifier("terminal", k))
        copper = drawing.layers[layer]
        if not holes:
            yield _pad(number, "smd", end, width, node("layers", quoted(copper)), *rest)
        elif holes[k].drilled:
            drill = node("drill", length(holes[k].diameter))
            both = node("layers", _through(array), quoted("*.Mask"))
            yield _pad(number, "thru_hole", end, holes[k].pad, drill, both, *rest)
        else:
            mask = () if copper.startswith("In") else (quoted(copper.replace(".Cu", ".Mask")),)
            yield _pad(number, "smd", end, holes[k].pad, node("layers", quoted(copper), *mask), *rest)


def _through(array: Array) -> str:
    """Copper layers of a hole through the board.

    The back of a board of one copper layer stays empty.
    """
    return quoted("*.Cu" if len(array.stackup.names) > 1 else "F.Cu")


def _pad(number: str, kind: str, point: IntArray, diameter: float, *rest: str) -> str:
    size = node("size", length(diameter), length(diameter))
    return node("pad", quoted(number), kind, "circle", at("at", point), size, *rest)
