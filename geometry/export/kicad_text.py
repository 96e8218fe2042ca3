"""The text of KiCad's files: s-expressions, lengths, layer names and identifiers."""

from __future__ import annotations

import uuid
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from coilarray.errors import OutputError
from coilarray.geometry.stackup import Stackup
from coilarray.geometry.values import IntArray

# The format of KiCad 6, the oldest one with a stack-up in today's form; later versions read it too.
FILE_VERSION = "20211014"

# Every file says who wrote it.
GENERATOR = "coilarray"

# KiCad's unit of length.
_NANOMETRES = 1e9

# Of the identifiers of everything that this package writes.
_NAMESPACE = uuid.uuid5(uuid.NAMESPACE_URL, "coilarray")

# The layers of a board beside its copper: number, name, and the name shown where it differs.
OTHER_LAYERS = (
    (34, "B.Paste", ""), (35, "F.Paste", ""), (36, "B.SilkS", "B.Silkscreen"), (37, "F.SilkS", "F.Silkscreen"),
    (38, "B.Mask", ""), (39, "F.Mask", ""), (40, "Dwgs.User", "User.Drawings"), (41, "Cmts.User", "User.Comments"),
    (44, "Edge.Cuts", ""), (45, "Margin", ""), (46, "B.CrtYd", "B.Courtyard"), (47, "F.CrtYd", "F.Courtyard"),
    (48, "B.Fab", ""), (49, "F.Fab", ""),
)  # fmt: skip
_MOST_COPPER_LAYERS = 32
_BOTTOM = 31
# What KiCad's own dialogue refuses in a layer's name.
_FORBIDDEN = frozenset('\\/:*?"<>|%')


def node(name: str, *items: str) -> str:
    """One expression on one line: ``(name item item)``."""
    return f"({' '.join((name, *items))})"


def block(name: str, head: Iterable[str], children: Iterable[str]) -> str:
    """One expression with every child on lines of its own, two spaces further in."""
    lines = [f"({' '.join((name, *head))}"]
    for child in children:
        lines += [f"  {line}" for line in child.split("\n")]
    return "\n".join((*lines, ")"))


def on_layer(name: str) -> str:
    """Write the ``(layer …)`` of one of KiCad's layers."""
    return node("layer", quoted(name))


def quoted(text: str) -> str:
    r"""Text in quotes; backslashes, quotes and line ends are escaped.

    Examples
    --------
    >>> quoted('a "b"')
    '"a \\"b\\""'
    """
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n").replace("\r", "\\r")
    return f'"{escaped}"'


def nanometres(metres: npt.ArrayLike) -> IntArray:
    """Lengths in m as the nearest whole numbers of nanometres."""
    return np.rint(np.asarray(metres, dtype=np.float64) * _NANOMETRES).astype(np.int64)


def mm(nm: int) -> str:
    """Millimetres of a whole number of nanometres, exact.

    Examples
    --------
    >>> mm(-1_500_000), mm(100), mm(2_000_000)
    ('-1.5', '0.0001', '2')
    """
    whole, part = divmod(abs(nm), 1_000_000)
    digits = f"{whole}.{part:06d}".rstrip("0").rstrip(".")
    return f"-{digits}" if nm < 0 else digits


def length(metres: float) -> str:
    """Millimetres of a length in m, rounded to 1 nm."""
    return mm(int(nanometres(metres)))


def at(name: str, point: npt.ArrayLike) -> str:
    """Write a position, ``(name x y)``, of a point on the sheet in nm."""
    x, y = np.asarray(point).tolist()
    return node(name, mm(x), mm(y))


@dataclass(frozen=True)
class Drawing:
    """How a design is put into one file.

    `root` begins the identifiers of the file's pieces, `layers` are KiCad's names of the stack-up's copper layers, and
    `x0`, `y0` the origin of the design on the sheet, whose y axis points down, in nm.
    """

    root: str
    layers: dict[str, str]
    x0: int = 0
    y0: int = 0

    def points(self, xy: npt.ArrayLike) -> IntArray:
        """Points of the design, shape (…, 2) in m, on the sheet in nm."""
        return np.asarray(nanometres(xy) * np.array([1, -1]) + np.array([self.x0, self.y0]))

    def point(self, x: float, y: float) -> IntArray:
        """One point of the design in m on the sheet, shape (2,) in nm."""
        return self.points((x, y))

    def within(self, part: str) -> Drawing:
        """Return the same drawing for a part of the file, with identifiers of its own."""
        return replace(self, root=f"{self.root}/{part}")

    def layer(self, name: str) -> str:
        """Write the ``(layer …)`` of a copper layer of the stack-up."""
        return on_layer(self.layers[name])

    def identifier(self, *parts: object) -> str:
        """Write the ``(tstamp …)`` of the piece that the parts name; the same for the same design."""
        return node("tstamp", str(uuid.uuid5(_NAMESPACE, "/".join(map(str, (self.root, *parts))))))


def copper_names(stackup: Stackup) -> dict[str, str]:
    """KiCad's name of each copper layer, top to bottom: F.Cu, In1.Cu, …, B.Cu; only F.Cu where there is one layer.

    OutputError for an odd number of layers above one, more than 32, or a name that KiCad cannot hold.

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


_ALL_COPPER = frozenset({"F.Cu", "B.Cu", *(f"In{k}.Cu" for k in range(1, _BOTTOM))})


def copper_number(kicad_name: str) -> int:
    """KiCad's number of a copper layer: 0 for F.Cu, k for Ink.Cu, 31 for B.Cu."""
    if kicad_name == "F.Cu":
        return 0
    return _BOTTOM if kicad_name == "B.Cu" else int(kicad_name.removeprefix("In").removesuffix(".Cu"))
