"""``coilarray init``, with the questions that it asks, ``check`` and ``export``."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain, combinations, pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

import typer

from coilarray import viz
from coilarray.cli import shared
from coilarray.compute.display_units import number_text
from coilarray.compute.files import write_text, writing
from coilarray.compute.table import Column, Table, text_table
from coilarray.compute.threads import Progress
from coilarray.design.export import SUFFIXES, Format
from coilarray.errors import CoilarrayError, DesignError, OutputError

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from coilarray.circuit.converter_limits import Limit
    from coilarray.design.model import Board, Design, DesignFile
    from coilarray.geometry import Margin

Shape = Literal["hexagon", "square", "circle", "rectangle", "racetrack"]  # not imported: help must stay quick
Overlap = Literal["none", "decoupled"]
Side = Literal["right", "top", "left", "bottom"]
Part = Literal["ADG714", "ADG738", "ADG739"]
_MANY_LAYERS = 8  # of copper, above which boards are special orders
_MET = 5e-3  # of the wanted inductance: as near as is not worth a word
_HELPS = {  # remedies for a converter's broken limit, by name and side
    ("sensor frequency", "high"): "; a larger --capacitance-pF or --inductance-uH lowers it",
    ("frequency over self-resonance", "high"): "; a larger --capacitance-pF lowers it",
    ("R_p", "low"): "; larger coils, more inductance or less capacitance raise it",
    ("R_p", "high"): "; a larger --capacitance-pF lowers it",
    ("amplitude with the smallest drive current", "high"): "; a larger --capacitance-pF lowers it",
    ("quality factor", "low"): "; larger coils and less capacitance raise it",
}
_SAME = 9  # decimals of m or of a ratio, to which layers that are drawn alike have the same
_CLEARANCE = (Column("board"), Column("other"), Column("clearance", unit="m"))


def ask_for_choices(shapes: Sequence[str], edges: Sequence[str]) -> dict[str, Any]:
    """Ask for a new design's choices, and check each answer."""
    from coilarray.design import fabs
    from coilarray.studies.create import LONG_SHAPES, Choices, read_arrangement

    chosen: dict[str, Any] = {}

    def ask(question: str, default: str, key: str, **words: dict[str, str]) -> None:
        while True:
            answer = typer.prompt(question, default=default).strip()
            if (found := words.get(answer.replace(" ", "_"))) is not None:
                chosen.update(found)
                return
            try:
                value = float(answer) if key in ("inductance_uH", "pitch_mm") else answer
                checked = Choices(**in_si({**chosen, key: value}))
                _ = checked.arrangement, checked.layers_of_fab  # which check coils and board house
            except (ValueError, CoilarrayError) as error:
                shared.say(f"  {error}")
            else:
                chosen[key] = value
                return

    shared.say("A new design. Press Return for the value in brackets.")
    ask("Coils: 1, 6 (a row), 4x4 (columns by rows), 3-hex or 7-hex", str(Choices.coils), "coils")
    ask(f"Shape: {', '.join(shapes)}", Choices.shape, "shape")
    sides = "Width x height" if chosen["shape"] in LONG_SHAPES else "Width"
    usual = "x".join(f"{side * 1e3:g}" for side in dict.fromkeys(Choices(shape=chosen["shape"]).sides))
    ask(f"{sides} of a coil in mm", usual, "size_mm")
    ask("Inductance in µH, or as many turns as fit", "fit", "inductance_uH", fit={})
    if read_arrangement(chosen["coils"]).lattice != "single":
        how = "Pitch in mm, side by side, or decoupled by overlap"
        ask(how, "side by side", "pitch_mm", side_by_side={}, decoupled={"overlap": "decoupled"})
    ask(f"Leads of all coils to a connector at an edge: none, {', '.join(edges)}", "none", "connector", none={})
    ask(f"Board house: any, {', '.join(fabs.names())}", "any", "fab", any={})
    chosen["elastomer"] = typer.confirm("A magnetic elastomer on the board", default=Choices.elastomer)
    return chosen


def in_si(chosen: Mapping[str, Any]) -> dict[str, Any]:
    """Return choices by the names of `coilarray.new_design`, in SI."""
    from coilarray.design.keys import key_in_si
    from coilarray.studies.create import read_size

    choices = {}
    for key, value in chosen.items():
        name, scale = key_in_si(key)
        choices[name] = read_size(value) if key == "size_mm" else value if scale == 1 else value * scale
    return choices


def init(
    file: Annotated[Path, typer.Argument(metavar="NAME", help="File to write, .toml.")] = Path("design.toml"),
    coils: Annotated[
        str | None,
        typer.Option(
            help="Arrangement: 1, 6 (a row), 4x4 (columns by rows), 3-hex (a triangle), 7-hex or 19-hex; 3 by default."
        ),
    ] = None,
    shape: Annotated[Shape | None, typer.Option(help="Shape of the coils; hexagon by default.")] = None,
    size_mm: Annotated[
        str | None,
        typer.Option(
            help="Width of a coil's copper, of a hexagon across flats, of a circle the diameter at which its outer "
            "edge starts, 16 by default; width and height of a rectangle or racetrack, 20x12 by default."
        ),
    ] = None,
    inductance_uH: Annotated[
        float | None, typer.Option("--inductance-uH", help="Inductance to find turns and trace for.")
    ] = None,
    layers: Annotated[
        int | None, typer.Option(help="Copper layers of the board; by default those of --fab, or as many as needed.")
    ] = None,
    fab: Annotated[
        str | None, typer.Option(metavar="PROFILE", help="Board house to keep the limits of (check --list-fabs).")
    ] = None,
    pitch_mm: Annotated[
        float | None, typer.Option(help="Distance of neighbours; side by side with room for terminals by default.")
    ] = None,
    overlap: Annotated[
        Overlap | None, typer.Option(help="decoupled: neighbours overlap until they do not couple.")
    ] = None,
    frequency_MHz: Annotated[
        float | None, typer.Option("--frequency-MHz", help="Frequency to choose the tank's capacitance for.")
    ] = None,
    capacitance_pF: Annotated[
        float | None,
        typer.Option("--capacitance-pF", help="Capacitance of the tank; chosen for the converter by default."),
    ] = None,
    connector: Annotated[
        Side | None, typer.Option(help="Edge of the board to which the leads of all coils run.")
    ] = None,
    switches: Annotated[
        Part | None,
        typer.Option(help="Part of the switches that select the coils; ideal ones, without resistance, by default."),
    ] = None,
    elastomer: Annotated[
        bool | None,
        typer.Option(
            "--elastomer/--no-elastomer", help="A magnetic elastomer on the board, and what presses on it; by default."
        ),
    ] = None,
    source: Annotated[
        str | None,
        typer.Option("--from", help="Bundled design to copy."),
    ] = None,
    force: shared.Force = False,
    as_json: shared.AsJson = False,
) -> None:
    """Write a commented design file from a few choices.

    Turns, trace, layers, pitch, terminals and the tank's capacitance are found such that the board
    house can make the board and an LDC1614 can read it. On a terminal, without any choice, the
    choices are asked for. Everything else has the same default as in Python (coilarray.new_design).

    Existing boards become designs by `coilarray import`.

    Example: coilarray init pad.toml --coils 4x4 --shape square --size-mm 12

    Example: coilarray init flower.toml --coils 7-hex --overlap decoupled --inductance-uH 18

    Example: coilarray init strip.toml --coils 6 --connector bottom

    Example: coilarray init power.toml --coils 1 --shape circle --size-mm 40 --no-elastomer

    Example: coilarray init starter.toml --from starter
    """
    from coilarray.design import bundled

    with writing(file):
        if file.is_dir() and (file.suffix or file.name in ("", "..")):
            raise OutputError(f"{file} is a folder; name a file in it.")
    target = file if file.suffix else file.with_suffix(".toml")
    shared.check_file("NAME", target, (".toml",))
    shared.require_new(target, force=force)
    given = {
        "coils": coils, "shape": shape, "size_mm": size_mm, "inductance_uH": inductance_uH, "layers": layers,
        "fab": fab, "pitch_mm": pitch_mm, "overlap": overlap, "frequency_MHz": frequency_MHz,
        "capacitance_pF": capacitance_pF, "connector": connector, "switches": switches, "elastomer": elastomer,
    }  # fmt: skip
    chosen: dict[str, Any] = {key: value for key, value in given.items() if value is not None}
    if source is not None and chosen:
        raise DesignError("--from takes a design as it is; it cannot be given with other choices.")
    lines: list[str | Table]
    data: dict[str, Any]
    if source is not None:
        if source not in bundled.names():
            known = ", ".join(bundled.names())
            raise DesignError(f"no bundled design {source!r}; there are {known}. Boards are read by coilarray import.")
        write_text(target, bundled.read(source))
        lines, data = [f"wrote {target}"], {}
    else:
        from coilarray.design.write import design_names, save_design
        from coilarray.studies.create import new_design

        if not chosen and sys.stdin.isatty() and sys.stdout.isatty():
            chosen = ask_for_choices(get_args(Shape), get_args(Side))
        with shared.progress_bar("layers, winding, pitch, terminals and tank"):
            made = new_design(design_names([target.stem])[target.stem], **in_si(chosen))
        with shared.progress_bar("states") as progress:
            notes = _described(made, chosen, progress)  # with what is refused before it is written
        save_design(made, target)
        title = made.design.title
        lines, data = [f"wrote {target}: {title}", *notes], {"title": title, "notes": notes}
    quoted = shlex.quote(str(target))
    lines.append(f"next: coilarray check {quoted}, coilarray report {quoted}")
    shared.print_result({"design": str(target), **data}, as_json=as_json, lines=lines)


def _described(file: DesignFile, chosen: Mapping[str, Any], progress: Progress) -> list[str]:
    import numpy as np

    from coilarray.circuit.coupling import design_inductance, scan_design
    from coilarray.electromagnetics.inductance import coupling_matrix
    from coilarray.electromagnetics.resistance import dc_resistance
    from coilarray.geometry.array import copper_words
    from coilarray.studies.create import Choices, broken_limits, is_standard, neighbour_coupling

    design, values = file.design, file.values
    scan = scan_design(design, elastomer=False, accuracy="screen", progress=progress)
    coil = f"coils.{next(iter(file.document['coils']))}"
    turns, trace, gap, on = (
        values[f"{coil}.{key}"] for key in ("turns_per_layer", "trace_width_mm", "gap_mm", "winding_layers")
    )
    matrix = design_inductance(design, accuracy="screen")[0]
    L = np.diag(matrix) * 1e6
    span = f"{L.min():.4g}" if L.max() - L.min() < 5e-4 * L.max() else f"{L.min():.4g} to {L.max():.4g}"
    asked = ""
    if "inductance_uH" in chosen:
        wanted = chosen["inductance_uH"]
        off = float(np.abs(L / wanted - 1).max()) > _MET
        asked = f" ({wanted:g} wanted{_why_not_met(design) if off else ''})"
    size = " × ".join(f"{side * 1e3:g}" for side in dict.fromkeys(Choices(**in_si(chosen)).sides))
    copper = copper_words(design.array.unrouted.placements[0].coil)
    most = int(scan.ac_resistance.values.argmax())  # the coil with the largest resistance
    R, at_MHz = float(scan.ac_resistance[most]), float(scan.attrs["ac_resistance_frequency_Hz"]) * 1e-6
    ratio = R / float(dc_resistance(design.array)[most])
    lines = [
        f"coil: {size} mm{copper}, {turns:g} turns on each of {on} layers, trace {trace:g} mm, gap {gap:g} mm",
        f"inductance: {span} µH{asked}",
        f"resistance: {R:.3g} ohm at {at_MHz:.4g} MHz, {ratio:.2g} times that of direct current",
    ]
    if len(design.array.names) > 1:
        near = neighbour_coupling(design)
        worst = near[np.abs(near).argmax()]
        among = np.triu(coupling_matrix(matrix), 1).ravel()
        k, of_all = (number_text(value, 4, "+") for value in (worst, among[np.abs(among).argmax()]))
        lines.append(f"pitch: {values['array.pitch_mm']:g} mm; largest k of neighbours {k}, of any two coils {of_all}")
    low, high = (f"{float(f) * 1e-6:.4g}" for f in (scan.frequency.min(), scan.frequency.max()))
    f = low if low == high else f"{low} to {high}"
    C, beside_q = values["circuit.capacitance_pF"], design.circuit.switches.beside_q
    tuned = f" ({chosen['frequency_MHz']:g} wanted)" if "frequency_MHz" in chosen else ""
    standard = (
        ""
        if "frequency_MHz" not in chosen or is_standard(design.circuit.capacitance)
        else "; no standard value (E24) comes within 1 % of that"
    )
    lines.append(f"tank: {C:g} pF, {f} MHz{tuned}, Q {float(scan.quality_factor.min()):.3g}{beside_q}{standard}")
    x_min, y_min, x_max, y_max = (edge * 1e3 for edge in design.array.bounds)
    lines.append(
        f"board: {x_max - x_min:.4g} × {y_max - y_min:.4g} mm, {len(design.array.stackup.names)} copper layers; "
        f"every limit of {values['fab.profile']} is kept"
    )
    if (count := len(design.array.stackup.names)) > _MANY_LAYERS:
        lines.append(f"⚠ few board houses make {count} copper layers: ask for the price before you order")
    left_out = scan.attrs["left_out"]
    converter = _read_by_converter(broken_limits(scan), len(scan.state), whole=not left_out)
    return [*lines, *shared.left_out_lines(left_out), converter]


def _why_not_met(design: Design) -> str:
    if design.array.routing is not None:
        return " without the leads to the connector"
    if len({place.layers for place in design.array.placements}) > 1:
        return "; met on the topmost layers, and other distances on the others"
    return "; the nearest that whole turns, and traces that can be made, give"


def _read_by_converter(broken: Sequence[tuple[str, Limit]], states: int, *, whole: bool) -> str:
    if not broken:
        kept = "every limit of an LDC1614 is kept"
        return f"✔ converter: {kept if whole else f'as far as these numbers go, {kept}'}"
    state, limit = broken[0]
    too = "low" if limit.value < limit.low else "high"
    which = state if states == 1 else f"{len({name for name, _ in broken})} of {states} coils, as {state}"
    helps = _HELPS.get((limit.name.partition(" (")[0], too), "")
    return f"✖ an LDC1614 cannot read {which}: {limit.words}{helps}"


def check(
    design: shared.DesignArgument = None,
    every: Annotated[
        bool, typer.Option("--all", help="Print every margin, not only the smallest of each rule on each layer.")
    ] = False,
    fab: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Check against the limits of this board house's profile instead of the design's."
        ),
    ] = None,
    list_fabs: Annotated[bool, typer.Option("--list-fabs", help="Print the bundled profiles and exit.")] = False,
    picture: Annotated[Path | None, shared.plot_option("the worst places", "--picture")] = None,
    out: Annotated[Path | None, shared.out_option("Also write every margin: .csv.", ".csv")] = None,
    as_json: shared.AsJson = False,
    allow_violations: shared.AllowViolations = False,
) -> None:
    """Check a design against its fabrication rules.

    Prints the smallest margin of each rule on each layer, in one row where layers have the same:
    first the broken rules, then rules for lengths, for ratios, and for the bare board, each by
    rising margin. The exit code is 2 if a rule is broken. A picture shows the copper of every
    layer, with these places circled and numbered as in the table.

    Example: coilarray check gast2020 --fab oshpark-4-layer --picture worst.png
    """
    from coilarray.design import fabs
    from coilarray.design.boards import made_verdict, of_board
    from coilarray.design.fabs import load_profile
    from coilarray.design.model import load_design_file, one_board
    from coilarray.geometry import check_rules, require_kept
    from coilarray.geometry.array import array_words
    from coilarray.geometry.board_clearance import boards_apart
    from coilarray.geometry.rules import BEND_RATIO_SOURCE, KEPT_WITHIN, worst_first
    from coilarray.geometry.surface_array import Wrap
    from coilarray.report.tables import converter_line, rules_table

    if list_fabs:
        keys = ("min_trace_mm", "min_gap_mm", "min_drill_mm", "max_layers")
        rows = [
            [one.name, one.title, *(f"{one.limits.get(key, '')}" for key in keys), one.read.isoformat()]
            for one in map(load_profile, fabs.names())
        ]
        headers = ("profile", "board house", "trace", "gap", "drill", "layers", "read")
        table = text_table(headers, rows, "lengths in mm")
        shared.print_result({"profiles": table.records()}, as_json=as_json, tables=[table])
        return
    if fab is not None and fab not in fabs.names():
        raise DesignError(f"--fab must be one of {', '.join(fabs.names())}; got {fab!r}.")
    file = load_design_file(design)
    opened = file.design
    named = fab or file.values.get("fab.profile")
    profile = None if named is None else load_profile(str(named))
    if picture is not None:
        one_board(opened, "--picture")
    whose = profile.title if profile else "the design"
    lines: list[str | Table] = []
    margins: list[Margin] = []
    by_name: dict[str, list[Board]] = {}  # coils on a surface have boards of their own without names
    for board in opened.placed:
        by_name.setdefault(board.name or "", []).append(board)
    for boards in by_name.values():
        board, alike_boards = boards[0], boards[1:]
        limits, coils = profile.rules if fab and profile else board.design.rules, len(board.array.names)
        with shared.progress_bar(f"rules of {coils} coil{'s' * (coils > 1)}") as progress:
            found = check_rules(board.array, limits, progress=progress)
            more = [check_rules(one.array, limits if fab else one.design.rules) for one in alike_boards]
            found = worst_first(chain(found, *more)) if more else found
        # margins are sorted, the worst first
        first = {(margin.rule, margin.layer): margin for margin in reversed(found)}
        shown = [margin for margin in found if every or margin is first[margin.rule, margin.layer]]
        alike: dict[object, list[Margin]] = {}
        for k, margin in enumerate(shown):
            same = (margin.rule, margin.unit, round(margin.value, _SAME), round(margin.limit, _SAME))
            alike.setdefault(k if every else same, []).append(margin)
        groups = list(alike.values())
        numbers = {id(margin): k + 1 for k, group in enumerate(groups) for margin in group}
        if picture is not None:
            marks = [numbers[id(margin)] for margin in shown]
            shared.draw(picture, partial(viz.check_figure, board.array, shown, marks))
        names = board.array.stackup.names
        worst = [replace(group[0], layer=_layers_text(names, {one.layer for one in group})) for group in groups]
        beside = f", the first of {1 + len(alike_boards)} on a surface" if alike_boards else ""
        whose_board = f" {board.name or opened.name}" if len(by_name) > 1 else ""
        its = whose if fab or not board.name else "its own design"
        lines.append(f"board{whose_board}: {array_words(board.array)}{beside}")
        lines.append(
            _margin_table(
                worst,
                f"margins to the limits of {its} in mm, kept to {KEPT_WITHIN * 1e6:g} µm: "
                "the worst first, the bare board last",
            )
        )
        lines += [f"… and {len(found) - len(shown)} more (--all)"] if len(shown) < len(found) else []
        if isinstance(board.array.form, Wrap):
            lines.append("not checked: whether the coils can be laid onto the surface without folds")
        if limits.min_bend_ratio is None and any(margin.rule == "bend ratio" for margin in found):
            lines.append(f"assumed limit of the bend ratio: {BEND_RATIO_SOURCE}")
        margins += of_board(board, found)
    if out is not None:
        write_text(out, rules_table(margins).csv())
    source = profile and {
        "profile": profile.name, "title": profile.title, "read": profile.read.isoformat(),
        "sources": [{"title": title, "url": url} for title, url in profile.sources], "assumed": dict(profile.assumed),
    }  # fmt: skip
    data = {**shared.design_record(opened), "fab": source, "rules": rules_table(margins).records()}
    if len(by_name) > 1:
        pairs = [(one, other) for one, other in combinations(opened.placed, 2) if one.name or other.name]
        apart: list[tuple[str | float, ...]] = [
            (one.name or opened.name, other.name or opened.name, boards_apart(one.pieces, other.pieces))
            for one, other in pairs
        ]
        between = Table("board_clearances", "Clearance between boards", _CLEARANCE, tuple(apart))
        lines, data = [*lines, between], {**data, between.name: between.records()}
    lines += [without] if (without := converter_line(opened)) else []
    made = made_verdict(file, margins, profile if fab else None)
    lines.insert(0, f"{shared.MARKS[made.kind]} {made.text}")
    shared.print_result(data, as_json=as_json, lines=lines, files=(out, picture))
    if not allow_violations:
        require_kept(margins)


def _margin_table(margins: Sequence[Margin], title: str) -> Table:
    from coilarray.report.tables import rules_table

    named = [replace(one, rule=f"{'✖ ' * (not one.kept)}{one.rule}{', at most' * one.at_most}") for one in margins]
    rows = []
    for number, (*numbers, _, x, y, _) in enumerate(rules_table(named).cells(), start=1):
        rows.append((str(number), *numbers, f"{x},\u00a0{y}" if x else ""))
    headers = ("no.", "rule", "layer", "feature", "value", "limit", "margin", "at x, y")
    return replace(text_table(headers, rows, title), mark="✖")


def _layers_text(names: Sequence[str], layers: Collection[str]) -> str:
    """Name layers in the board's order, as L1–L4, L6."""
    runs: list[list[str]] = []
    for before, name in pairwise([None, *names]):
        if name is not None and name in layers:
            if before in layers:
                runs[-1].append(name)
            else:
                runs.append([name])
    return ", ".join(f"{run[0]}–{run[-1]}" if len(run) > 2 else ", ".join(run) for run in runs)


def export(
    design: shared.DesignArgument = None,
    *,
    to: Annotated[Format, typer.Option("--to", help="Format to write.")],
    out: Annotated[
        Path | None, shared.out_option("File to write (a folder for kicad); named after the design by default.")
    ] = None,
    no_sheets: Annotated[
        bool, typer.Option("--no-sheets", help="Leave the elastomer out of step, stl and glb.")
    ] = False,
    force: shared.Force = False,
    as_json: shared.AsJson = False,
    allow_violations: shared.AllowViolations = False,
) -> None:
    """Write a board for fabrication or for another program.

    kicad: a project with board and footprints. gerber: a zip of Gerber X2 and Excellon files for a
    board house. Both are read back and checked before they replace anything: every coil must be in
    one piece and isolated from the others. dxf, svg: drawings in mm. step, stl: solids in mm. glb:
    a scene for viewers.

    Of a design of several boards, step, stl and glb have all of them where they are. The other
    formats make a folder or a file for each board, with its name.

    Example: coilarray export gast2020 --to gerber --out board.zip
    """
    from coilarray.design.export import board_targets
    from coilarray.design.export import export as write

    opened = shared.open_design(design, allow_violations=allow_violations, boards=True)
    target = out or Path(
        {"kicad": f"{opened.name}-kicad", "gerber": f"{opened.name}-gerber.zip"}.get(to, f"{opened.name}.{to}")
    )
    if to != "kicad":
        shared.check_file("--out", target, SUFFIXES[to])
    elif target.suffix.startswith(".kicad"):
        raise OutputError(f"--out must be a folder, as kicad has several files; got {target}.")
    else:
        shared.check_folder(target)
    for place in dict.fromkeys((target, *board_targets(opened, target, to))):
        shared.require_new(place, force=force)
    exported = write(opened, target, to, sheets=not no_sheets, allow_faults=allow_violations)
    written, faults = exported.files, exported.net_faults
    sizes = [path.stat().st_size for path in written]
    lines = [
        f"wrote {path} ({f'{size / 1e6:.1f} MB' if size >= 1e6 else f'{size / 1e3:.1f} kB'})"
        for path, size in zip(written, sizes, strict=True)
    ]
    lines += [f"warning: {fault}" for fault in faults]
    if to in ("kicad", "gerber") and not faults:
        count = len(opened.coil_names)
        coils = "1 coil, in one piece" if count == 1 else f"{count} coils, each in one piece and isolated"
        lines.append(f"check of the copper as written: {coils}")
    files = [{"path": str(path), "bytes": size} for path, size in zip(written, sizes, strict=True)]
    shared.print_result(
        {**shared.design_record(opened), "format": to, "files": files, "net_faults": list(faults)},
        as_json=as_json,
        lines=lines,
    )
