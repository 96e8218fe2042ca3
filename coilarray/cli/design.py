"""``coilarray check`` and ``coilarray export``."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from coilarray import viz
from coilarray.cli import shared
from coilarray.compute.files import write_text
from coilarray.compute.table import Column, Table, text_table
from coilarray.design.export import SUFFIXES, Format
from coilarray.errors import DesignError, OutputError

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from coilarray.geometry import Margin


_SAME = 9  # decimals of m or of a ratio, to which layers that are drawn alike have the same


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
    from coilarray.design.fabs import load_profile
    from coilarray.design.model import load_design_file
    from coilarray.geometry import check_rules, require_kept
    from coilarray.geometry.array import array_words
    from coilarray.geometry.rules import KEPT_WITHIN
    from coilarray.report.tables import rules_table

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
    limits = load_profile(fab).rules if fab else opened.rules
    with shared.progress_bar(f"rules of {len(opened.array.names)} coils") as progress:
        margins = check_rules(opened.array, limits, progress=progress)
    first = {(margin.rule, margin.layer): margin for margin in reversed(margins)}  # margins are sorted, the worst first
    shown = [margin for margin in margins if every or margin is first[margin.rule, margin.layer]]
    alike: dict[object, list[Margin]] = {}
    for k, margin in enumerate(shown):
        same = (margin.rule, margin.unit, round(margin.value, _SAME), round(margin.limit, _SAME))
        alike.setdefault(k if every else same, []).append(margin)
    groups = list(alike.values())
    numbers = {id(margin): k + 1 for k, group in enumerate(groups) for margin in group}
    if out is not None:
        write_text(out, rules_table(margins).csv())
    shared.draw(picture, lambda: viz.check_figure(opened.array, shown, [numbers[id(margin)] for margin in shown]))
    names = opened.array.stackup.names
    worst = [replace(group[0], layer=_layers_text(names, {margin.layer for margin in group})) for group in groups]
    lines: list[str | Table] = [f"board: {array_words(opened.array)}"]
    shown_table = rules_table([replace(one, rule=f"{one.rule}, at most") if one.at_most else one for one in worst])
    whose = profile.title if profile else "the design"
    lines.append(
        replace(
            shown_table,
            title=f"margins to the limits of {whose}: the worst first, what is kept of the bare board last",
            columns=(Column("no."), *shown_table.columns),
            rows=tuple((str(k + 1), *row) for k, row in enumerate(shown_table.rows)),
        )
    )
    lines += [f"… and {len(margins) - len(shown)} more (--all)"] if len(shown) < len(margins) else []
    source = profile and {
        "profile": profile.name, "title": profile.title, "read": profile.read.isoformat(),
        "sources": [{"title": title, "url": url} for title, url in profile.sources], "assumed": dict(profile.assumed),
    }  # fmt: skip
    data = {**shared.design_record(opened), "fab": source, "rules": rules_table(margins).records()}
    shared.print_result(data, as_json=as_json, lines=lines, files=(out, picture))
    if not allow_violations:
        require_kept(margins)
    broken = sum(not margin.kept for margin in margins)
    if not as_json:
        kept = f"all rules are kept (to {KEPT_WITHIN * 1e6:g} µm)"
        typer.echo(f"{broken} of {len(margins)} rules are broken" if broken else kept)


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

    Example: coilarray export gast2020 --to gerber --out board.zip
    """
    from coilarray.design.export import export as write

    opened = shared.open_design(design, allow_violations=allow_violations)
    target = out or Path(
        {"kicad": f"{opened.name}-kicad", "gerber": f"{opened.name}-gerber.zip"}.get(to, f"{opened.name}.{to}")
    )
    if to != "kicad":
        shared.check_file("--out", target, SUFFIXES[to])
    elif target.suffix.startswith(".kicad"):
        raise OutputError(f"--out must be a folder, as kicad has several files; got {target}.")
    else:
        shared.check_folder(target)
    shared.require_new(target, force=force)
    exported = write(opened, target, to, sheets=not no_sheets, allow_faults=allow_violations)
    written, faults = exported.files, exported.net_faults
    sizes = [path.stat().st_size for path in written]
    lines = [f"wrote {path} ({_readable(size)})" for path, size in zip(written, sizes, strict=True)]
    lines += [f"warning: {fault}" for fault in faults]
    if to in ("kicad", "gerber") and not faults:
        count = len(opened.array.names)
        coils = "1 coil, in one piece" if count == 1 else f"{count} coils, each in one piece and isolated"
        lines.append(f"check of the copper as written: {coils}")
    files = [{"path": str(path), "bytes": size} for path, size in zip(written, sizes, strict=True)]
    shared.print_result(
        {**shared.design_record(opened), "format": to, "files": files, "net_faults": list(faults)},
        as_json=as_json,
        lines=lines,
    )


def _readable(size: int) -> str:
    return f"{size / 1e6:.1f} MB" if size >= 1e6 else f"{size / 1e3:.1f} kB"
