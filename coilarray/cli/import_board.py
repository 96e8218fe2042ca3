"""``coilarray import``."""

from __future__ import annotations

import stat
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from coilarray.cli import shared
from coilarray.errors import BoardError

if TYPE_CHECKING:
    from coilarray.fabrication.board import BoardCopper
    from coilarray.fabrication.tracing import TracedArray, Tracing

_NO_FAB = (
    "board files have no fabrication rules, so the design has no [fab]: check uses its defaults, which belong to no "
    "board house."
)


def import_board(
    board: Annotated[
        Path, typer.Argument(metavar="BOARD", help="KiCad board (.kicad_pcb), or Gerber files (a .zip or a folder).")
    ],
    nets: Annotated[
        str | None,
        typer.Option(help="Names of the nets that are coils, such as A,B; by default every net that has turns."),
    ] = None,
    stackup: Annotated[
        str | None, typer.Option(metavar="DESIGN", help="Design whose [stackup] is taken for that of the board.")
    ] = None,
    out: Annotated[Path, shared.out_option("Design file to write: .toml.", ".toml")] = Path("design.toml"),
    force: shared.Force = False,
    as_json: shared.AsJson = False,
) -> None:
    """Make a design file from an existing board.

    Each coil must be a net that runs over tracks and vias from one end to the other without a branch.

    Example: coilarray import board.kicad_pcb --nets coil1,coil2 --out board.toml
    """
    from coilarray.compute.files import write_text
    from coilarray.design.model import Design, parse_design
    from coilarray.design.write import design_text
    from coilarray.fabrication.tracing import trace_coils, traced_array

    copper = _read(board, stackup)
    wanted = None if nets is None else [net.strip() for net in nets.split(",") if net.strip()]
    if wanted == []:
        raise BoardError(f"{board}: --nets must name at least one net; got {nets!r}.")
    tracing = trace_coils(copper, wanted)
    traced = traced_array(copper, tracing.coils)
    design = Design(traced.array, name=board.stem, source=f"imported from {board.name}")
    text = design_text(design, traced.assumed)
    parse_design(text, origin=str(board))  # what no design can be is refused here, not by the next command
    write_text(out, text)
    records = _records(tracing, traced)
    notes = [*traced.notes, _NO_FAB]
    headers = ("coil", "net", "shape", "layers", "turns", "length", "trace width", "vias", "x", "y")
    title = f"coils of {board.name}; lengths in mm, turns anticlockwise positive"
    lines = [shared.table_text(headers, [_cells(record) for record in records], title)]
    lines += ["\nnets with tracks that are not coils"] if tracing.left_out else []
    lines += [f"  {net}: {reason}" for net, reason in tracing.left_out.items()]
    lines += [f"assumed: {key}: {reason}" for key, reason in traced.assumed.items()]
    lines += [*(f"note: {note}" for note in notes), f"wrote {out}; next: coilarray check {out}"]
    data = {
        "board": str(board), "design": str(out), "coils": records, "left_out": tracing.left_out,
        "assumed": traced.assumed, "notes": notes,
    }  # fmt: skip
    shared.print_result(data, as_json=as_json, lines=lines)


def _read(board: Path, stackup: str | None) -> BoardCopper:
    from coilarray.design.model import load_design
    from coilarray.fabrication.gerber_reader import read_gerbers
    from coilarray.fabrication.kicad_reader import read_kicad

    try:
        is_folder = stat.S_ISDIR(board.stat().st_mode)
    except (FileNotFoundError, NotADirectoryError):
        raise BoardError(f"{board}: there is no such file or folder.") from None
    except OSError as error:
        raise BoardError(f"{board}: cannot be read: {error.strerror}.") from None
    layers = None if stackup is None else load_design(stackup).array.stackup
    if board.suffix == ".kicad_pcb":
        return read_kicad(board, layers)
    if is_folder or board.suffix.lower() == ".zip":
        return read_gerbers(board, layers)
    raise BoardError(f"{board}: not a board; it must be a .kicad_pcb file, or Gerber files in a .zip or a folder.")


def _records(tracing: Tracing, traced: TracedArray) -> list[dict[str, Any]]:
    """Return what is known of every coil, in SI."""
    from coilarray.design.write import design_names, shape_names

    names = design_names(traced.array.names)
    return [
        {
            "name": names[coil.name], "net": coil.net, "shape": shape, "layers": list(coil.layers),
            "turns": coil.turns, "poles": [asdict(pole) for pole in coil.poles], "length_m": coil.length,
            "trace_widths_m": sorted({float(width) for line in coil.widths for width in line}),
            "vias": len(coil.vias), "x_m": placement.x, "y_m": placement.y,
        }
        for coil, placement, shape in zip(
            tracing.coils, traced.array.placements, shape_names(traced.array), strict=True
        )
    ]  # fmt: skip


def _cells(record: dict[str, Any]) -> list[str]:
    from coilarray.compute.display_units import number_text

    widths = [f"{width * 1e3:.4g}" for width in record["trace_widths_m"]]
    return [
        record["name"],
        record["net"] or "–",
        record["shape"],
        " ".join(record["layers"]),
        " ".join(number_text(pole["turns"], 2) for pole in record["poles"]),
        f"{record['length_m'] * 1e3:.1f}",
        widths[0] if len(widths) == 1 else f"{widths[0]} to {widths[-1]}",
        str(record["vias"]),
        *(number_text(record[key] * 1e3, 3) for key in ("x_m", "y_m")),
    ]
