"""KiCad project folders: board, rules and footprints."""

import json
import math
import re
import tempfile
import uuid
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from coilarray.compute.arrays import IntArray
from coilarray.compute.files import hidden_prefix, make_folder, remove_left
from coilarray.errors import OutputError
from coilarray.fabrication.drawings import Label, silk_labels
from coilarray.geometry.arcs import pieces_of
from coilarray.geometry.array import Array, Placement
from coilarray.geometry.copper import drills_of
from coilarray.geometry.rules import FabRules
from coilarray.geometry.stackup import Stackup

FILE_VERSION = "20211014"  # of KiCad 6, the oldest with a stack-up in today's form; later versions read it too
GENERATOR = "coilarray"  # named in every file
_NANOMETRES = 1e9
_NAMESPACE = uuid.uuid5(uuid.NAMESPACE_URL, "coilarray")  # of identifiers
# The layers of a board beside its copper: number, name, and the shown name if it differs.
OTHER_LAYERS = (
    (34, "B.Paste", ""), (35, "F.Paste", ""), (36, "B.SilkS", "B.Silkscreen"), (37, "F.SilkS", "F.Silkscreen"),
    (38, "B.Mask", ""), (39, "F.Mask", ""), (40, "Dwgs.User", "User.Drawings"), (41, "Cmts.User", "User.Comments"),
    (44, "Edge.Cuts", ""), (45, "Margin", ""), (46, "B.CrtYd", "B.Courtyard"), (47, "F.CrtYd", "F.Courtyard"),
    (48, "B.Fab", ""), (49, "F.Fab", ""),
)  # fmt: skip
_MOST_COPPER_LAYERS = 32
BOTTOM = 31
_FORBIDDEN = frozenset('\\/:*?"<>|%')  # in a layer's name, by KiCad's dialogue
_FAB_LETTERS = 1e-3  # m, height of letters that are not printed
_STROKE = 0.15  # width over the height of a letter, KiCad's own
_NO_PART = ("exclude_from_pos_files", "exclude_from_bom")  # a coil is not bought or placed


def node(name: str, *items: str) -> str:
    """Write an expression on one line: ``(name item item)``."""
    return f"({' '.join((name, *items))})"


def block(name: str, head: Iterable[str], children: Iterable[str]) -> str:
    """Write an expression with indented children, each on its lines."""
    lines = [f"({' '.join((name, *head))}"]
    for child in children:
        lines += [f"  {line}" for line in child.split("\n")]
    return "\n".join((*lines, ")"))


def on_layer(name: str) -> str:
    """Write the ``(layer …)`` of one of KiCad's layers."""
    return node("layer", quoted(name))


def quoted(text: str) -> str:
    """Text in quotes, with escaped backslashes, quotes and newlines."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n").replace("\r", "\\r")
    return f'"{escaped}"'


def nanometres(metres: npt.ArrayLike) -> IntArray:
    """Round lengths in m to whole numbers of nanometres."""
    return np.rint(np.asarray(metres, dtype=np.float64) * _NANOMETRES).astype(np.int64)


def mm(nm: int) -> str:
    """Write a whole number of nanometres in mm, exactly."""
    whole, part = divmod(abs(nm), 1_000_000)
    digits = f"{whole}.{part:06d}".rstrip("0").rstrip(".")
    return f"-{digits}" if nm < 0 else digits


def length(metres: float) -> str:
    """Write a length in m as mm to 1 nm."""
    return mm(int(nanometres(metres)))


def at(name: str, point: npt.ArrayLike) -> str:
    """Write the position ``(name x y)`` of a point in nm."""
    x, y = np.asarray(point).tolist()
    return node(name, mm(x), mm(y))


@dataclass(frozen=True)
class Drawing:
    """Mapping of a design into one file."""

    root: str  # beginning of all identifiers
    layers: dict[str, str]  # KiCad's names
    x0: int = 0  # origin in nm on the sheet, whose y points down
    y0: int = 0

    def points(self, xy: npt.ArrayLike) -> IntArray:
        """Transform points (…, 2) in m to the sheet in nm."""
        return np.asarray(nanometres(xy) * np.array([1, -1]) + np.array([self.x0, self.y0]))

    def identifier(self, *parts: object) -> str:
        """Write the ``(tstamp …)`` of a piece, equal for equal designs."""
        return node("tstamp", str(uuid.uuid5(_NAMESPACE, "/".join(map(str, (self.root, *parts))))))


def copper_names(stackup: Stackup) -> dict[str, str]:
    """KiCad's name of each copper layer, F.Cu, In1.Cu, …, B.Cu."""
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


def _winding(array: Array, alike: Sequence[Placement]) -> str:
    """Library footprint of equal coils, named after the first of them."""
    # Vias are pads V1, V2, … without a net, under the solder mask, through the whole board. As a net tie, it may
    # have different nets at its terminals, pads 1 and 2, in KiCad's check.
    name = alike[0].name
    placement = replace(alike[0].at_origin(), name="REF**")
    single = replace(array, placements=(placement,), through_holes=True)
    drawing = Drawing(f"footprint/{name}", copper_names(array.stackup))
    users = ", ".join(user.name for user in alike)
    # without courtyard, as coils may overlap
    corners = node("pts", *(at("xy", point) for point in drawing.points(placement.coil.outline)))
    style = (on_layer("F.Fab"), node("width", "0.1"), node("fill", "none"), drawing.identifier("outline"))
    vias = [hole for hole in drills_of(single, placement) if hole.kind == "via"]
    through = node("layers", _through(array.stackup))
    children = [
        node("descr", quoted(f"winding of {users} on {', '.join(placement.layers)}")),
        # how the format of KiCad 6 marks a net tie. Later versions read it as a group of all pads
        node("tags", quoted("net tie planar coil")),
        *_words(placement, silk_labels(single)[0], name, drawing),
        node("fp_poly", corners, *style),
        *(
            node(f"fp_{'line' if len(ends) == 2 else 'arc'}", *ends, layer, width, drawing.identifier("line", k))
            for k, (ends, width, layer) in enumerate(tracks(placement, drawing))
        ),
    ]
    for k, via in enumerate(vias):
        rest = (node("drill", length(via.diameter)), through, drawing.identifier("via", k))
        children.append(_pad(f"V{k + 1}", "thru_hole", drawing.points((via.x, via.y)), via.pad, *rest))
    children += _terminal_pads(single, placement, (), drawing)
    head = (quoted(name), node("version", FILE_VERSION), node("generator", GENERATOR), on_layer("F.Cu"))
    return block("footprint", head, children) + "\n"


def tracks(placement: Placement, drawing: Drawing) -> Iterator[tuple[tuple[str, ...], str, str]]:
    """Yield (start …), the (mid …) of an arc and (end …), (width …) and (layer …) of every piece."""
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
                yield ends, node("width", length(widths[piece.first])), on_layer(drawing.layers[layer])


def _words(placement: Placement, label: Label | None, value: str, drawing: Drawing, *attributes: str) -> Iterator[str]:
    """Yield the attributes of a footprint, its name, on silk if it fits, and its value."""
    kind = "smd" if placement.coil.terminal is None else "through_hole"
    yield node("attr", kind, *attributes, *_NO_PART)
    name = ("reference", placement.name, (0, 0), "F.Fab", _FAB_LETTERS)
    if label is not None:
        x, y = (drawing.points((label.x, label.y)) - drawing.points((placement.x, placement.y))).tolist()
        name = ("reference", placement.name, (x, y), "F.SilkS", label.size)
    for kind, text, place, layer, height in (name, ("value", value, (0, 2_000_000), "F.Fab", _FAB_LETTERS)):
        font = node("font", node("size", *[length(height)] * 2), node("thickness", length(_STROKE * height)))
        rest = (on_layer(layer), node("effects", font), drawing.identifier(kind))
        yield node("fp_text", kind, quoted(text), at("at", place), *rest)


def _terminal_pads(array: Array, placement: Placement, net: Sequence[str], drawing: Drawing) -> Iterator[str]:
    """Yield pads 1 and 2 at the path's ends, that of a bare end as wide as its trace."""
    coil = placement.coil
    origin = drawing.points((placement.x, placement.y))
    ends = drawing.points(placement.to_board(coil.terminal_points)) - origin
    layers = (placement.layers[0], placement.layers[-1])
    widths = (coil.widths[0][0], coil.widths[-1][-1])
    holes = [hole for hole in drills_of(array, placement) if hole.kind == "terminal"]
    for k, (end, layer, width) in enumerate(zip(ends, layers, widths, strict=True)):
        number, rest = str(k + 1), (*net, drawing.identifier("terminal", k))
        copper = drawing.layers[layer]
        if not holes:
            yield _pad(number, "smd", end, width, node("layers", quoted(copper)), *rest)
        elif holes[k].drilled:
            drill = node("drill", length(holes[k].diameter))
            both = node("layers", _through(array.stackup), quoted("*.Mask"))
            yield _pad(number, "thru_hole", end, holes[k].pad, drill, both, *rest)
        else:
            mask = () if copper.startswith("In") else (quoted(copper.replace(".Cu", ".Mask")),)
            yield _pad(number, "smd", end, holes[k].pad, node("layers", quoted(copper), *mask), *rest)


def _through(stackup: Stackup) -> str:
    """Copper layers of a hole through the board, whose back stays empty if it has one layer."""
    return quoted("*.Cu" if len(stackup.names) > 1 else "F.Cu")


def _pad(number: str, kind: str, point: IntArray, diameter: float, *rest: str) -> str:
    size = node("size", length(diameter), length(diameter))
    return node("pad", quoted(number), kind, "circle", at("at", point), size, *rest)


# Names allowed in design files, which become names of files, nets and parts.
_NAME = re.compile(r"[A-Za-z0-9_.+][A-Za-z0-9_.+-]*")
# Sheets of paper, landscape, and the sides of the largest sheet that KiCad takes, in mm.
_PAPERS = {"A4": (297, 210), "A3": (420, 297), "A2": (594, 420), "A1": (841, 594), "A0": (1189, 841)}
_LARGEST_SHEET = 1219
_SHEET_MARGIN = 40  # mm around the board; A4's title block is 34 mm high
# KiCad has no board of one copper layer: below it, this much laminate in m and an empty layer.
_BACKING, _BACKING_EPSILON_R = 1.5e-3, 4.5


def write_kicad(
    array: Array,
    path: Path,
    *,
    name: str,
    rules: FabRules,
    title: str = "",
    check: Callable[[Path], None] | None = None,
) -> tuple[Path, ...]:
    """Write a KiCad project folder for KiCad 6 and later, and return its files.

    It was tried with 6.0.11 and 9.0.2. Other files of the folder stay. `rules` are the limits of
    KiCad's own check. `title` stands on the sheet, by default the name. `check` is called with the
    path of the finished board before any file is moved to its place: if it raises, nothing is
    changed.

    The origin of the design is the drill origin of the board and of its grid. Lengths are rounded
    to 1 nm. Each coil is a net with its name, of tracks and vias, and its ends are the pads 1 and 2
    of a footprint. The same design gives the same bytes.

    A board of one copper layer gets an empty B.Cu, because KiCad requires two. With blind holes, a
    terminal on an inner layer is a pad there, of which KiCad 9 warns ("SMD pad has no outer
    layers").
    """
    if path.exists() and not path.is_dir():
        raise OutputError(f"cannot make the folder {path}: a file has that name.")
    for what, text in (("project", name), *(("coil", coil) for coil in array.names)):
        if not _NAME.fullmatch(text):
            raise OutputError(
                f"the name of a {what} for KiCad must be letters, digits, _ . + - and not begin with -; got {text!r}."
            )
    # with its table KiCad finds the footprints of the project, in a library with the project's name
    library = {"name": name, "type": "KiCad", "uri": f"${{KIPRJMOD}}/{name}.pretty", "options": ""}
    library["descr"] = "windings of the coils"
    row = node("lib", *(node(key, quoted(value)) for key, value in library.items()))
    texts = {
        f"{name}.kicad_pcb": board_text(array, name, title or name),
        f"{name}.kicad_pro": _project_text(array, name, rules),
        "fp-lib-table": block("fp_lib_table", (), (row,)) + "\n",
    }
    alike: dict[tuple[int, tuple[str, ...]], list[Placement]] = {}  # coils that differ in place and rotation only
    for placement in array.placements:
        alike.setdefault((id(placement.coil), placement.layers), []).append(placement)
    texts |= {f"{name}.pretty/{one[0].name}.kicad_mod": _winding(array, one) for one in alike.values()}
    try:
        remove_left(path.parent)
        with tempfile.TemporaryDirectory(prefix=hidden_prefix(path.name), dir=path.parent) as temporary:
            staged = Path(temporary) / "project"
            for file, text in texts.items():
                (staged / file).parent.mkdir(parents=True, exist_ok=True)
                (staged / file).write_text(text, encoding="utf-8", newline="\n")
            if check is not None:
                check(staged / next(iter(texts)))
            if path.exists():
                for folder in dict.fromkeys((path / file).parent for file in texts):
                    make_folder(folder)
                for file in texts:
                    (staged / file).replace(path / file)
            else:
                staged.rename(path)
    except OSError as error:
        place = error.filename2 or path  # the target of a file that could not be moved
        raise OutputError(f"cannot write {place}: {error.strerror or error}.") from None
    return tuple(path / file for file in texts)


def board_text(array: Array, name: str, title: str) -> str:
    """Text of the ``.kicad_pcb`` file of `write_kicad`."""
    layers = copper_names(array.stackup)
    paper, drawing = _sheet(array, name, layers)
    origin = (drawing.x0, drawing.y0)
    thickness = array.stackup.thickness  # of KiCad's board
    if len(layers) == 1:
        thickness += _BACKING + array.stackup.copper_thickness[0]
    setup = (
        _stackup(array.stackup, layers),
        node("pad_to_mask_clearance", "0"),
        at("aux_axis_origin", origin),
        at("grid_origin", origin),
        # plot from the drill origin: Gerbers have the coordinates of the design
        node("pcbplotparams", node("useauxorigin", "true")),
    )
    table = [(BOTTOM if kicad == "B.Cu" else k, kicad, "signal", own) for k, (own, kicad) in enumerate(layers.items())]
    if len(layers) == 1:
        table.append((BOTTOM, "B.Cu", "signal", "B.Cu"))
    table += [(number, kicad, "user", shown) for number, kicad, shown in OTHER_LAYERS]
    rows = (
        node(str(number), quoted(kicad), kind, *([quoted(shown)] if shown not in ("", kicad) else []))
        for number, kicad, kind, shown in table
    )
    x_min, y_min, x_max, y_max = array.bounds
    corners = (at("start", drawing.points((x_min, y_max))), at("end", drawing.points((x_max, y_min))))
    style = (on_layer("Edge.Cuts"), node("width", "0.05"), node("fill", "none"))
    children = [
        node("general", node("thickness", length(thickness))),
        node("paper", *paper),
        node("title_block", node("title", quoted(title))),
        block("layers", (), rows),
        block("setup", (), setup),
        node("net", "0", quoted("")),
        *(node("net", str(k), quoted(net)) for k, net in enumerate(array.names, start=1)),
        *_coils(array, drawing),
        node("gr_rect", *corners, *style, drawing.identifier("edge")),
    ]
    return block("kicad_pcb", (node("version", FILE_VERSION), node("generator", GENERATOR)), children) + "\n"


def _sheet(array: Array, name: str, layers: dict[str, str]) -> tuple[tuple[str, ...], Drawing]:
    """Choose the smallest sheet and centre the board on it."""
    x_min, y_min, x_max, y_max = (1e3 * edge for edge in array.bounds)
    width, height = x_max - x_min + 2 * _SHEET_MARGIN, y_max - y_min + 2 * _SHEET_MARGIN
    if max(width, height) > _LARGEST_SHEET:
        raise OutputError(
            f"a board for KiCad must be at most {_LARGEST_SHEET - 2 * _SHEET_MARGIN} mm wide and high; "
            f"got {x_max - x_min:.4g} mm x {y_max - y_min:.4g} mm."
        )
    # a sheet of its own size if no paper fits
    sheet = (math.ceil(width), math.ceil(height))
    paper: tuple[str, ...] = (quoted("User"), *map(str, sheet))
    for known, (w, h) in reversed(_PAPERS.items()):
        if width <= w and height <= h:
            sheet, paper = (w, h), (quoted(known),)
    # to whole micrometres, for readable numbers
    x0 = round((sheet[0] - x_min - x_max) / 2 * 1e3) * 1000
    y0 = round((sheet[1] + y_min + y_max) / 2 * 1e3) * 1000
    return paper, Drawing(name, layers, x0, y0)


def _stackup(stackup: Stackup, layers: dict[str, str]) -> str:
    copper = [(kicad, thickness) for kicad, thickness in zip(layers.values(), stackup.copper_thickness, strict=True)]
    slabs = list(zip(stackup.dielectric_thickness, stackup.epsilon_r, strict=True))
    if len(layers) == 1:
        copper.append(("B.Cu", stackup.copper_thickness[0]))
        slabs.append((_BACKING, _BACKING_EPSILON_R))
    # KiCad drops the whole stack-up if it lacks a layer of the board, such as its paste
    outer = (("SilkS", "Silk Screen"), ("Paste", "Solder Paste"), ("Mask", "Solder Mask"))
    lines = [_stackup_layer(f"F.{layer}", f"Top {kind}") for layer, kind in outer]
    for k, (kicad, thickness) in enumerate(copper):
        lines.append(_stackup_layer(kicad, "copper", node("thickness", length(thickness))))
        if k < len(slabs):
            # cores and prepregs alternate, with a core in the middle
            kind = "core" if (k - len(slabs) // 2) % 2 == 0 else "prepreg"
            epsilon = node("epsilon_r", repr(float(slabs[k][1])))
            lines.append(_stackup_layer(f"dielectric {k + 1}", kind, node("thickness", length(slabs[k][0])), epsilon))
    lines += [_stackup_layer(f"B.{layer}", f"Bottom {kind}") for layer, kind in reversed(outer)]
    # no (dielectric_constraints yes): it would put permittivities into KiCad's job file, and order
    # impedance control
    return block("stackup", (), lines)


def _stackup_layer(name: str, kind: str, *properties: str) -> str:
    return node("layer", quoted(name), node("type", quoted(kind)), *properties)


def _coils(array: Array, drawing: Drawing) -> Iterator[str]:
    for number, (placement, label) in enumerate(zip(array.placements, silk_labels(array), strict=True), start=1):
        own = replace(drawing, root=f"{drawing.root}/{placement.name}")
        net = node("net", str(number))
        # of no library, as the tracks of the board are the winding
        children = [
            own.identifier("footprint"),
            at("at", own.points((placement.x, placement.y))),
            *_words(placement, label, "coil", own, "board_only"),
            *_terminal_pads(array, placement, (node("net", str(number), quoted(placement.name)),), own),
        ]
        yield block("footprint", (quoted("coil_terminals"), on_layer("F.Cu")), children)
        for k, (ends, width, layer) in enumerate(tracks(placement, own)):
            kind = "segment" if len(ends) == 2 else "arc"
            yield node(kind, *ends, width, layer, net, own.identifier("track", k))
        for k, hole in enumerate(hole for hole in drills_of(array, placement) if hole.kind == "via"):
            through = hole.layers == array.stackup.names
            ends = quoted(own.layers[hole.layers[0]]), quoted(own.layers[hole.layers[-1]])
            sizes = (node("size", length(hole.pad)), node("drill", length(hole.diameter)))
            rest = (*sizes, node("layers", *ends), net, own.identifier("via", k))
            yield node("via", *(() if through else ("blind",)), at("at", own.points((hole.x, hole.y))), *rest)


def _project_text(array: Array, name: str, rules: FabRules) -> str:
    """Text of a ``.kicad_pro`` file, with the first coil's sizes for new tracks."""
    # KiCad has no limit for turns: `FabRules.min_gap` holds between nets, and from holes.

    def in_mm(metres: float) -> float:
        return round(metres * 1e3, 6)  # to 1 nm

    coil = array.placements[0].coil
    gap = in_mm(rules.min_gap)
    limits = {
        "allow_blind_buried_vias": not array.through_holes,
        "allow_microvias": False,
        "min_clearance": gap,
        "min_copper_edge_clearance": in_mm(rules.min_edge_clearance),
        "min_hole_clearance": gap,
        "min_hole_to_hole": in_mm(rules.min_hole_spacing),
        "min_through_hole_diameter": in_mm(rules.min_drill),
        "min_track_width": in_mm(rules.min_trace),
        "min_via_annular_width": in_mm(rules.min_annular_ring),
        "min_via_diameter": in_mm(rules.min_drill + 2 * rules.min_annular_ring),
    }
    default_class = {
        "name": "Default",
        "clearance": gap,
        "track_width": in_mm(coil.trace_width),
        "via_diameter": in_mm(coil.via.pad),
        "via_drill": in_mm(coil.via.drill),
    }
    project = {
        "board": {"design_settings": {"meta": {"version": 2}, "rules": limits}},
        "meta": {"filename": f"{name}.kicad_pro", "version": 1},
        "net_settings": {"classes": [default_class], "meta": {"version": 2}},
    }
    return json.dumps(project, indent=2) + "\n"
