"""KiCad projects: the board of a coil array, its design rules, and its windings as footprints."""

from __future__ import annotations

import json
import math
import re
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path

from coilarray.compute.files import announce, hidden_prefix, make_folder, remove_left
from coilarray.errors import OutputError
from coilarray.geometry.array import Array, Placement
from coilarray.geometry.export.kicad_text import (
    BOTTOM,
    FILE_VERSION,
    GENERATOR,
    OTHER_LAYERS,
    Drawing,
    at,
    block,
    copper_names,
    holes_of,
    length,
    library_footprints,
    node,
    on_layer,
    quoted,
    terminal_footprint,
    tracks,
)
from coilarray.geometry.export.silk import silk_labels
from coilarray.geometry.rules import FabRules
from coilarray.geometry.stackup import Stackup

# Names allowed in design files, which become names of files, nets and parts.
_NAME = re.compile(r"[A-Za-z0-9_.+][A-Za-z0-9_.+-]*")
# Sheets of paper, landscape, and the sides of the largest sheet that KiCad takes, in mm.
_PAPERS = {"A4": (297, 210), "A3": (420, 297), "A2": (594, 420), "A1": (841, 594), "A0": (1189, 841)}
_LARGEST_SHEET = 1219
# Least distance of the board from the sheet's edges in mm; A4's title block is 34 mm high.
_SHEET_MARGIN = 40
# KiCad has no board of one copper layer: below it, this much laminate in m and an empty layer.
_BACKING = 1.5e-3
_BACKING_EPSILON_R = 4.5


def write_kicad(
    array: Array,
    path: Path,
    *,
    name: str,
    rules: FabRules,
    title: str = "",
    check: Callable[[Path], None] | None = None,
) -> tuple[Path, ...]:
    """Write a KiCad project folder for KiCad 6 and later.

    It was tried with 6.0.11 and 9.0.2.

    Parameters
    ----------
    array : Array
        The board.
    path : Path
        The folder, made completely or not at all. In an existing folder the files of the project are replaced, all or
        none, and all other files stay.
    name : str
        Name of the project: letters, digits, ``_ . + -``, with ``-`` not first.
    rules : FabRules
        Limits of KiCad's own check.
    title : str
        Title on the sheet. By default it is the name.
    check : callable, optional
        Called with the path of the finished board before any file is moved to its place. If it raises, nothing is
        changed.

    Returns
    -------
    tuple of Path
        ``<name>.kicad_pcb``, ``<name>.kicad_pro``, ``fp-lib-table``, and a footprint ``<name>.pretty/<coil>.kicad_mod``
        for every coil shape and set of layers.

    Raises
    ------
    OutputError
        If the path cannot be written, the name is not allowed, the board is larger than any sheet, or KiCad cannot hold
        the copper layers: more than 32, an odd number above one, or refused names.

    Notes
    -----
    The origin of the design is the drill origin of the board (``aux_axis_origin``) and of its grid. KiCad's y points
    down. Lengths are rounded to 1 nm. Each coil is a net with its name. Its path consists of tracks and vias, and its
    ends are the pads 1 and 2 of a footprint whose reference is the coil's name. The same design gives the same bytes.

    A board of one copper layer gets an empty second layer, B.Cu, because KiCad requires two.

    With blind holes, a terminal on an inner layer is a pad on that layer. KiCad 9 warns of it ("SMD pad has no outer
    layers"), because nothing can be soldered there.

    Examples
    --------
    >>> from coilarray.geometry import PlatedHole, Placement, path_coil
    >>> coil = path_coil([[(0, 0), (1e-2, 0)]], 0.2e-3, 0.2e-3, PlatedHole(0.3e-3, 0.6e-3))
    >>> board = Array(Stackup(("top",), (35e-6,), (), ()), (Placement("A", coil, ("top",), 0, 0),))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     files = write_kicad(board, Path(folder) / "out", name="board", rules=FabRules())
    >>> [file.name for file in files]
    ['board.kicad_pcb', 'board.kicad_pro', 'fp-lib-table', 'A.kicad_mod']
    """
    if path.exists() and not path.is_dir():
        raise OutputError(f"cannot make the folder {path}: a file has that name.")
    for what, text in (("project", name), *(("coil", coil) for coil in array.names)):
        if not _NAME.fullmatch(text):
            raise OutputError(
                f"the name of a {what} for KiCad must be letters, digits, _ . + - and not begin with -; got {text!r}."
            )
    texts = {
        f"{name}.kicad_pcb": board_text(array, name, title or name),
        f"{name}.kicad_pro": _project_text(array, name, rules),
        "fp-lib-table": _library_table_text(name),
    }
    for footprint, text in library_footprints(array).items():
        texts[f"{name}.pretty/{footprint}.kicad_mod"] = text
    _write_folder(path, texts, check)
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
    children = [
        node("general", node("thickness", length(thickness))),
        node("paper", *paper),
        node("title_block", node("title", quoted(title))),
        _layer_table(layers),
        block("setup", (), setup),
        node("net", "0", quoted("")),
        *(node("net", str(k), quoted(net)) for k, net in enumerate(array.names, start=1)),
        *_coils(array, drawing),
        _edge(array, drawing),
    ]
    return block("kicad_pcb", (node("version", FILE_VERSION), node("generator", GENERATOR)), children) + "\n"


def _sheet(array: Array, name: str, layers: dict[str, str]) -> tuple[tuple[str, ...], Drawing]:
    """Choose the smallest sheet and centre the board on it.

    The sheet is named as in KiCad.
    """
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


def _layer_table(layers: dict[str, str]) -> str:
    """Make the table of the board's layers."""
    table = [(BOTTOM if kicad == "B.Cu" else k, kicad, "signal", own) for k, (own, kicad) in enumerate(layers.items())]
    if len(layers) == 1:
        table.append((BOTTOM, "B.Cu", "signal", "B.Cu"))
    table += [(number, kicad, "user", shown) for number, kicad, shown in OTHER_LAYERS]
    rows = (
        node(str(number), quoted(kicad), kind, *([quoted(shown)] if shown not in ("", kicad) else []))
        for number, kicad, kind, shown in table
    )
    return block("layers", (), rows)


def _stackup(stackup: Stackup, layers: dict[str, str]) -> str:
    """Make the stack-up of a board."""
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
    # no (dielectric_constraints yes): it would put permittivities into KiCad's job file, and order impedance control
    return block("stackup", (), lines)


def _stackup_layer(name: str, kind: str, *properties: str) -> str:
    return node("layer", quoted(name), node("type", quoted(kind)), *properties)


def _coils(array: Array, drawing: Drawing) -> Iterator[str]:
    """Yield the footprints, tracks and vias of all coils."""
    for number, (placement, label) in enumerate(zip(array.placements, silk_labels(array), strict=True), start=1):
        own = drawing.within(placement.name)
        net = node("net", str(number))
        yield terminal_footprint(array, placement, label, node("net", str(number), quoted(placement.name)), own)
        for k, (ends, width, layer) in enumerate(tracks(placement, own)):
            kind = "segment" if len(ends) == 2 else "arc"
            yield node(kind, *ends, width, layer, net, own.identifier("track", k))
        yield from _vias(array, placement, net, own)


def _vias(array: Array, placement: Placement, net: str, drawing: Drawing) -> Iterator[str]:
    """Yield the vias of one coil."""
    for k, (hole, point) in enumerate(holes_of(array, placement, "via", drawing)):
        through = hole.layers == array.stackup.names
        ends = (drawing.layers[hole.layers[0]], drawing.layers[hole.layers[-1]])
        sizes = (node("size", length(hole.pad)), node("drill", length(hole.diameter)))
        rest = (at("at", point), *sizes, node("layers", *map(quoted, ends)), net, drawing.identifier("via", k))
        yield node("via", *(() if through else ("blind",)), *rest)


def _edge(array: Array, drawing: Drawing) -> str:
    x_min, y_min, x_max, y_max = array.bounds
    corners = (at("start", drawing.point(x_min, y_max)), at("end", drawing.point(x_max, y_min)))
    style = (on_layer("Edge.Cuts"), node("width", "0.05"), node("fill", "none"))
    return node("gr_rect", *corners, *style, drawing.identifier("edge"))


def _project_text(array: Array, name: str, rules: FabRules) -> str:
    """Text of a ``.kicad_pro`` file.

    The first coil gives the sizes that KiCad offers for new tracks and vias.

    The text is JSON without severities, so KiCad's own severities hold. KiCad has no limit for turns of one net, so
    `FabRules.min_gap` holds between nets only. The distance of foreign copper to a hole's wall has the same limit.
    """

    def mm(metres: float) -> float:
        return round(metres * 1e3, 6)  # to 1 nm

    coil = array.placements[0].coil
    gap = mm(rules.min_gap)
    limits = {
        "allow_blind_buried_vias": not array.through_holes,
        "allow_microvias": False,
        "min_clearance": gap,
        "min_copper_edge_clearance": mm(rules.min_edge_clearance),
        "min_hole_clearance": gap,
        "min_hole_to_hole": mm(rules.min_hole_spacing),
        "min_through_hole_diameter": mm(rules.min_drill),
        "min_track_width": mm(rules.min_trace),
        "min_via_annular_width": mm(rules.min_annular_ring),
        "min_via_diameter": mm(rules.min_drill + 2 * rules.min_annular_ring),
    }
    default_class = {
        "name": "Default",
        "clearance": gap,
        "track_width": mm(coil.trace_width),
        "via_diameter": mm(coil.via.pad),
        "via_drill": mm(coil.via.drill),
    }
    project = {
        "board": {"design_settings": {"meta": {"version": 2}, "rules": limits}},
        "meta": {"filename": f"{name}.kicad_pro", "version": 1},
        "net_settings": {"classes": [default_class], "meta": {"version": 2}},
    }
    return json.dumps(project, indent=2) + "\n"


def _library_table_text(name: str) -> str:
    """Text of the project's ``fp-lib-table``.

    With it KiCad finds the footprints of the project. The library has the project's name.
    """
    folder = f"${{KIPRJMOD}}/{name}.pretty"
    fields = {"name": name, "type": "KiCad", "uri": folder, "options": "", "descr": "windings of the coils"}
    library = node("lib", *(node(key, quoted(value)) for key, value in fields.items()))
    return block("fp_lib_table", (), (library,)) + "\n"


def _write_folder(path: Path, texts: Mapping[str, str], check: Callable[[Path], None] | None) -> None:
    """Write files and move them into a folder.

    The folder is made beside `path` and renamed, or its files are moved into an existing folder. If OutputError is
    raised, a new folder does not remain, and an existing folder is unchanged.
    """
    try:
        remove_left(path.parent)
        with tempfile.TemporaryDirectory(prefix=hidden_prefix(path.name), dir=path.parent) as temporary:
            staged = Path(temporary) / "project"
            for file, text in texts.items():
                (staged / file).parent.mkdir(parents=True, exist_ok=True)
                (staged / file).write_text(text, encoding="utf-8", newline="\n")
            if check is not None:
                check(staged / next(iter(texts)))
            for file in texts:
                announce(staged / file, path / file)
            if path.exists():
                _replace_files(path, staged, texts, Path(temporary) / "before")
            else:
                staged.rename(path)
    except OSError as error:
        place = error.filename2 or path  # the target of a file that could not be moved
        raise OutputError(f"cannot write {place}: {error.strerror or error}.") from None


def _replace_files(path: Path, staged: Path, files: Iterable[str], before: Path) -> None:
    """Move files into a folder, and undo it on failure.

    `before` holds the copies of the replaced files, which are put back.
    """
    made: list[Path] = []
    replaced: list[str] = []
    try:
        for file in files:
            folder = (path / file).parent
            if not folder.is_dir():
                make_folder(folder)
                made.append(folder)
            if (path / file).exists():
                make_folder((before / file).parent)
                shutil.copy2(path / file, before / file)
        for file in files:
            (staged / file).replace(path / file)
            replaced.append(file)
    except BaseException:
        for file in replaced:
            if (before / file).exists():
                (before / file).replace(path / file)
            else:
                (path / file).unlink()
        for folder in made:
            folder.rmdir()
        raise
