"""``coilarray import``: boards of other programs become designs."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from coilarray import viz
from coilarray.cli import shared
from coilarray.compute.display_units import number_text
from coilarray.compute.files import write_text
from coilarray.compute.table import Table, text_table
from coilarray.errors import BoardError

if TYPE_CHECKING:
    from coilarray.compute.threads import Progress
    from coilarray.fabrication.board import BoardCopper
    from coilarray.fabrication.tracing import LeftOut, TracedArray, Tracing

_NO_FAB = (
    "board files have no fabrication rules, so the design has no [fab]: check uses its defaults, which belong to no "
    "board house."
)
_MOST_LEFT_OUT = 12  # pieces of copper that are no coils, in a table


def import_board(
    board: Annotated[
        Path,
        typer.Argument(metavar="BOARD", help="KiCad's .kicad_pcb or .kicad_mod, or Gerber files (.zip or folder)."),
    ],
    file: Annotated[Path, typer.Argument(metavar="NAME", help="File to write, .toml.")] = Path("design.toml"),
    nets: Annotated[
        str | None, typer.Option(help="Nets that are coils, as A,B; by default all copper with turns.")
    ] = None,
    first: Annotated[
        str | None, typer.Option("--from", metavar="PAD", help="Pad where the current enters, as U1.3 or x,y in mm.")
    ] = None,
    last: Annotated[str | None, typer.Option("--to", metavar="PAD", help="Pad where it leaves, as C4.1.")] = None,
    layer: Annotated[
        list[str] | None, typer.Option(help="Gerber file of a copper layer, as L1=top.ger; for each layer.")
    ] = None,
    drill_format: Annotated[
        str | None, typer.Option(metavar="FORMAT", help="Numbers of drill files that do not say: 4.4,mm or 2.4,inch.")
    ] = None,
    stackup: Annotated[
        str | None, typer.Option(metavar="DESIGN", help="Design whose [stackup] is taken for that of the board.")
    ] = None,
    only_list: Annotated[bool, typer.Option("--list", help="Only list what was found, with an estimate of L.")] = False,
    picture: Annotated[
        Path | None, shared.plot_option("the board's copper, its coils and where others fail", "--picture")
    ] = None,
    force: shared.Force = False,
    as_json: shared.AsJson = False,
) -> None:
    """Make a design of the coils of an existing board.

    Copper is connected where it overlaps, and through plated holes. A coil is the way of the
    current through it that makes a turn or more, between the pads, branches or ends next to its
    winding. What leads on is left out and named.

    Example: coilarray import board.kicad_pcb --list

    Example: coilarray import board.zip coils.toml --nets coil1,coil2

    Example: coilarray import nfc.kicad_pcb --from U1.3 --to C4.1

    Example: coilarray import gerbers --layer L1=top.ger --layer L2=bottom.ger
    """
    from coilarray.design.model import Design, parse_design
    from coilarray.design.write import design_text
    from coilarray.fabrication.tracing import NoCoilError, Tracing, trace_coils, traced_array

    target = file if file.suffix else file.with_suffix(".toml")
    shared.check_file("NAME", target, (".toml",))
    if not only_list:
        shared.require_new(target, force=force)
    if (first is None) != (last is None):
        raise BoardError("--from and --to are given together: the pads at both ends of the coil.")
    wanted = None if nets is None else [net.strip() for net in nets.split(",") if net.strip()]
    if wanted == []:
        raise BoardError(f"{board}: --nets must name at least one net; got {nets!r}.")
    with shared.progress_bar("files") as progress:
        copper = _read(board, stackup, layer or [], drill_format, progress)
    ends = None if first is None or last is None else (first, last)
    failed = None
    try:
        with shared.progress_bar("copper") as progress:
            tracing = trace_coils(copper, wanted, ends, progress)
    except NoCoilError as error:
        failed, tracing = error, Tracing((), error.left_out)
    places = [(each.name, each.at) for each in tracing.left_out if each.at is not None]
    shared.draw(picture, partial(viz.copper_figure, copper, tracing.coils, places))
    if failed is not None:
        if only_list and not as_json and failed.left_out:
            shared.say(_left_out_table(failed.left_out))
        see = f"The picture {picture} shows the place. " if picture else "--picture board.png shows the place. "
        advice = "What can be tried: --nets NAME for a path without turns, --from and --to for its ends."
        raise BoardError(f"{failed} {see if failed.left_out else ''}{advice}")
    traced = traced_array(copper, tracing.coils)
    records = _records(tracing, traced, estimate=only_list)
    notes = [*traced.notes, _NO_FAB]
    lines: list[str | Table] = [_table(records, board.name, estimate=only_list)]
    lines += ["", _left_out_table(tracing.left_out)] if tracing.left_out else []
    data = {
        "board": str(board), "coils": records, "assumed": traced.assumed, "notes": notes,
        "left_out": {each.name: each.reason for each in tracing.left_out},
    }  # fmt: skip
    if not only_list:
        design = Design(traced.array, name=board.stem, source=f"imported from {board.name}")
        text = design_text(design, traced.assumed)
        parse_design(text, origin=str(board))  # what no design can be is refused here, not by the next command
        write_text(target, text)
        lines += [f"assumed: {key}: {reason}" for key, reason in traced.assumed.items()]
        lines += [*(f"note: {note}" for note in notes), f"wrote {target}"]
        quoted = shlex.quote(str(target))
        lines.append(f"next: coilarray check {quoted}, coilarray report {quoted}")
        data = {"design": str(target), **data}
    shared.print_result(data, as_json=as_json, lines=lines, files=(picture,))


def _table(records: Sequence[Mapping[str, Any]], name: str, *, estimate: bool) -> Table:
    """Make the table of the coils that were found."""
    headers = ["coil", "net", "shape", "layers", "turns", "length", "trace width", "vias", "x", "y"]
    rows = []
    for record in records:
        widths = [f"{width * 1e3:.4g}" for width in record["trace_widths_m"]]
        width = widths[0] if len(widths) == 1 else f"{widths[0]} to {widths[-1]}"
        turns = " ".join(number_text(pole["turns"], 2) for pole in record["poles"])
        where = (number_text(record[key] * 1e3, 3) for key in ("x_m", "y_m"))
        words = (record["name"], record["net"] or "–", record["shape"], " ".join(record["layers"]), turns)
        row = [*words, f"{record['length_m'] * 1e3:.1f}", width, str(record["vias"]), *where]
        rows.append([*row[:5], number_text(record["inductance_H"] * 1e6, 3), *row[5:]] if estimate else row)
    headers = [*headers[:5], "L", *headers[5:]] if estimate else headers
    unit = ", L in µH without the copper of others" if estimate else ""
    return text_table(headers, rows, f"coils of {name}; lengths in mm{unit}, turns anticlockwise positive")


def _left_out_table(left_out: Sequence[LeftOut]) -> Table:
    """Make the table of copper that is no coil, first that which looks most like one."""
    rows = [
        (each.name, number_text(each.turns, 2) if each.turns else "–", f"{each.length * 1e3:.1f}", each.reason)
        for each in left_out[:_MOST_LEFT_OUT]
    ]
    more = f"; {len(left_out) - _MOST_LEFT_OUT} more" if len(left_out) > _MOST_LEFT_OUT else ""
    return text_table(("net", "turns", "length", "why it is no coil"), rows, f"other copper{more}; lengths in mm")


def _read(
    board: Path, stackup: str | None, layers: Sequence[str], drill_format: str | None, progress: Progress
) -> BoardCopper:
    from coilarray.design.model import load_design
    from coilarray.fabrication.gerber_reader import NoLayerError, read_gerbers
    from coilarray.fabrication.kicad_reader import read_kicad

    known = None if stackup is None else load_design(stackup).array.stackup
    if board.suffix.lower() in (".kicad_pcb", ".kicad_mod"):
        if layers or drill_format:
            raise BoardError("--layer and --drill-format are for Gerber files.")
        return read_kicad(board, known)
    if board.suffix.lower() in (".pcbdoc", ".schdoc", ".prjpcb", ".pcb", ".brd", ".dsn"):
        raise BoardError(
            f"{board}: files of this program are not read; export Gerber and drill files, and import their folder."
        )
    given = dict(one.split("=", 1) for one in layers if "=" in one)
    if len(given) < len(layers):
        raise BoardError(f"--layer must be as L1=top.ger; got {', '.join(layers)}.")
    try:
        return read_gerbers(board, known, given, drill_format, progress)
    except NoLayerError as error:
        if not (error.names and sys.stdin.isatty() and sys.stdout.isatty()):
            raise
        given = _asked(error.names)
    return read_gerbers(board, known, given, drill_format, progress)


def _asked(names: Sequence[str]) -> dict[str, str]:
    """Ask on a terminal which files are copper."""
    shared.say("No file says that it is copper. Type 1 for the top layer, 2 for the next, and Return for others.")
    answers = {name: typer.prompt(name, default="").strip() for name in names}
    return {f"L{answer}": name for name, answer in answers.items() if answer.isdecimal()}


def _records(tracing: Tracing, traced: TracedArray, *, estimate: bool) -> list[dict[str, Any]]:
    """Return the known properties of every coil, in SI, with an estimate of L if wanted."""
    from coilarray.design.write import design_names, shape_names
    from coilarray.electromagnetics.inductance import inductance_matrix

    names, shapes = design_names(traced.array.names), shape_names(traced.array)
    of_shape = dict(zip(shapes, traced.array.conductors(), strict=True)) if estimate else {}
    L = {
        shape: {"inductance_H": float(inductance_matrix([conductor], accuracy="screen", allow_overlaps=True)[0, 0])}
        for shape, conductor in of_shape.items()
    }
    return [
        {
            "name": names[coil.name], "net": coil.net, "shape": shape, "layers": list(coil.layers),
            "turns": coil.turns, "poles": [asdict(pole) for pole in coil.poles], "length_m": coil.length,
            "trace_widths_m": sorted({float(width) for line in coil.widths for width in line}),
            "vias": len(coil.vias), "x_m": placement.x, "y_m": placement.y, **L.get(shape, {}),
        }
        for coil, placement, shape in zip(tracing.coils, traced.array.placements, shapes, strict=True)
    ]  # fmt: skip
