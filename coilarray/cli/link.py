"""The command ``coilarray link``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from coilarray import viz
from coilarray.cli import shared
from coilarray.cli.studies import extremes, records
from coilarray.compute.display_units import DisplayUnit, value_text
from coilarray.compute.store import open_store
from coilarray.compute.table import Table, text_table
from coilarray.errors import GoalError

if TYPE_CHECKING:
    import xarray as xr

    from coilarray.design.model import Design

_MOST_ROWS, _MOST_PAIRS = 48, 4  # of poses and pairs of coils, and pairs, whose numbers are printed one by one
_FRAMES = 36  # most pictures of a film, and positions of a slider
_MOST_VALUES = 10_000  # of an axis
_K = DisplayUnit("", 1.0, 4)  # as M is known to 1e-4 of L


def _values(option: str, text: str) -> list[float]:
    """Read a number, A,B,… or START:STOP:STEP."""
    parts = text.split(":")
    try:
        numbers = [float(part) for part in (parts if len(parts) == 3 else text.split(","))]
    except ValueError:
        numbers = []
    if len(parts) == 3 and numbers and all(map(math.isfinite, numbers)):
        start, stop, step = numbers
        steps = (stop - start) / step if step else -1.0
        numbers = [start + k * step for k in range(math.floor(steps + 1e-9) + 1)] if 0 <= steps < _MOST_VALUES else []
    if not numbers or len(set(numbers)) < len(numbers) or not all(math.isfinite(number) for number in numbers):
        raise GoalError(
            f"{option} must be different finite numbers, such as 5 or 1,2,5 or START:STOP:STEP with a step towards "
            f"STOP and at most {_MOST_VALUES} values; got {text!r}."
        )
    return [float(f"{number:.12g}") for number in numbers]


def link(
    design: shared.DesignArgument = None,
    move: Annotated[
        list[str] | None, typer.Option(help="Board that moves; further ones move along with the first.")
    ] = None,
    x_mm: Annotated[str | None, typer.Option("--x-mm", help="Places along x: START:STOP:STEP, A,B,… or one.")] = None,
    y_mm: Annotated[str | None, typer.Option("--y-mm", help="Places along y, in the same form.")] = None,
    z_mm: Annotated[str | None, typer.Option("--z-mm", help="Heights, in the same form.")] = None,
    turn_deg: Annotated[
        str | None, typer.Option("--turn-deg", help="Angles about x, y and z, three in this form: 0,0:90:5,180.")
    ] = None,
    frequency_mhz: Annotated[
        float | None, typer.Option("--frequency-MHz", help="Frequency; that of the design's ports by default.")
    ] = None,
    cache: shared.Cache = None,
    out: shared.NumbersFile = None,
    plot: Annotated[Path | None, shared.plot_option("k and efficiency over the poses")] = None,
    film: Annotated[
        Path | None, shared.file_option(("--film",), "Film, or a page with a slider.", (".gif", ".mp4", ".html"))
    ] = None,
    force: shared.Force = False,
    as_json: shared.AsJson = False,
) -> None:
    """Compute coupling and efficiency while boards move.

    The board takes all combinations of the given places and angles, from its place in the design.
    M and k are of all pairs of coils that move against each other. With a frequency there are also
    the voltage per ampere and the largest efficiency of each pair, with ports of the design their
    efficiency and the splitting of their resonances. Results are kept, so that the same command
    resumes an interrupted one. Boards that cut through each other at a pose are refused.

    Example: coilarray link reader.toml --move tag --z-mm 2:20:2 --plot k.png

    Example: coilarray link reader.toml --move tag --x-mm -20:20:1 --y-mm -20:20:1 --out map.nc
    """
    import numpy as np

    from coilarray.design.model import load_design
    from coilarray.studies import link as study

    given = {"x": x_mm, "y": y_mm, "z": z_mm}
    chosen = {name: _values(f"--{name}-mm", text) for name, text in given.items() if text is not None}
    if turn_deg is not None:
        angles = turn_deg.split(",")
        if len(angles) != 3:
            raise GoalError(f"--turn-deg must be three values or ranges START:STOP:STEP; got {turn_deg!r}.")
        chosen |= {axis: _values("--turn-deg", text) for axis, text in zip(study.AXES[3:], angles, strict=True)}
    if not move or not chosen:
        raise GoalError("a link needs --move BOARD and places or angles, such as --move receiver --z-mm 1:20:1.")
    for path in (out, plot, film):
        if path is not None:
            shared.require_new(path, force=force)
    opened = load_design(design)
    own = study.pose_of(opened, move[0])
    axes: dict[str, Any] = dict(zip(study.AXES, (*own.shift.tolist(), *own.turn), strict=True))
    for name, values in chosen.items():
        axes[name] = np.radians(values) if "turn" in name else np.array(values) * 1e-3
    poses = study.together(opened, move, study.pose_grid(**axes))
    count = poses[move[0]].size
    kept = open_store(cache)
    with (
        shared.resumable(lambda done: f"{done} of {count} poses are kept in {kept.folder}") as counting,
        shared.progress_bar(f"{count} poses") as show,
    ):
        frequency = None if frequency_mhz is None else frequency_mhz * 1e6
        found = study.link(opened, poses, frequency=frequency, keep=kept.folder, progress=counting(show))
    flat = study.columns(found)
    if out is not None and out.suffix.lower() == ".csv":
        shared.write_numbers(out, flat, lambda: flat.to_dataframe().to_csv(lineterminator="\n"))
    else:
        shared.write_numbers(out, found, str)
    shared.draw(plot, lambda: viz.link_figure(flat))
    if film is not None:
        _write_film(opened, poses, flat, film)
    data = {"file": out and str(out), **shared.design_record(opened), "moved": move, "poses": records(flat)}
    lines = [] if "best_efficiency" in found else [
        "no frequency: only M and k; --frequency-MHz, or ports in the design, add voltage and efficiency"
    ]  # fmt: skip
    if "resonances" in found and (silent := int((found["resonances"] == 0).sum())):
        lines.append(f"no port oscillates at {silent} of {count} poses, which have no resonance")
    tables = _tables(flat)
    if tables[0].name != "link":
        lines.append(f"{count} poses: smallest and largest values are shown")
    shared.print_result(data, as_json=as_json, tables=tables, lines=lines, files=[out, plot, film])


def _write_film(design: Design, poses: Mapping[str, xr.DataArray], flat: xr.Dataset, path: Path) -> None:
    import numpy as np

    from coilarray.studies.link import moved_boards
    from coilarray.viz.scenes.board import moving_scenes, room, scene_of_boards, scene_of_motion
    from coilarray.viz.scenes.scene import Slider

    count = next(iter(poses.values())).size
    numbers = np.unique(np.linspace(0, count - 1, _FRAMES).round().astype(int)).tolist()
    placed = [moved_boards(design, poses, number).placed for number in numbers]
    moves = [(board.name or "").split("/")[0] in poses for board in placed[0]]
    still = [board for board, moving in zip(placed[0], moves, strict=True) if not moving]
    moved = [[board for board, moving in zip(boards, moves, strict=True) if moving] for boards in placed]
    table = records(flat)
    rows = [table[number] for number in numbers]
    pairs = [name for name in map(str, flat.data_vars) if name.startswith("k[")][:_MOST_PAIRS]
    words = {str(name): (one.attrs["long_name"], one.attrs.get("units", "")) for name, one in flat.coords.items()}
    labels = tuple(
        ", ".join(f"{axis} = {value_text(row[name])} {unit}".strip() for name, (axis, unit) in words.items())
        for row in rows
    )
    notes = tuple(
        (label, *(f"{name} = {_K.texts([row[name]])[0]}" for name in pairs))
        for label, row in zip(labels, rows, strict=True)
    )
    if path.suffix.lower() == ".html":
        viz.save_page(scene_of_motion(still, moved, Slider("pose", labels, notes)), path, title=design.name)
    else:
        everywhere = room([at for boards in moved for board in boards for at in board.pieces.reshape(-1, 3)])
        viz.save_movie(scene_of_boards(still) + everywhere, moving_scenes(moved, notes), path)


def _tables(flat: xr.Dataset) -> list[Table]:
    from coilarray.report.tables import link_tables

    count, names = math.prod(flat.sizes.values()), [str(name) for name in flat.data_vars]
    pairs = [name for name in names if name.startswith("k[")]
    strongest = sorted(pairs, key=lambda name: -float(abs(flat[name]).max()))[:_MOST_PAIRS]
    shown = {name[1:] for name in strongest}
    names = [
        name for name in names if "[" not in name or name.startswith(("efficiency", "available"))
        or (name.startswith(("k[", "voltage", "best")) and name[name.index("[") :] in shown)
    ]  # fmt: skip
    if count * max(len(shown), 1) > _MOST_ROWS:
        flat = flat.assign(
            {name: flat[name].round(4) for name in names if name.startswith("k[") or "efficiency" in name}
        )
        rows = [extremes(flat, name, str(flat[name].attrs.get("units", ""))) for name in names]
        return [text_table(("quantity", "unit", "smallest", "where", "largest", "where"), rows)]
    return [replace(table, title="") for table in link_tables(flat[names])]
