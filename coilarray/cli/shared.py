"""Arguments and habits that every command shares."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Annotated, Any

import typer

from coilarray.errors import ElastomerError

if TYPE_CHECKING:
    from coilarray.compute.threads import Progress
    from coilarray.design.model import Design, DesignFile

DesignArgument = Annotated[
    str | None,
    typer.Argument(metavar="DESIGN", help="Design file (TOML) or name of a bundled design; gast2020 by default."),
]
AllowViolations = Annotated[
    bool, typer.Option("--allow-violations", help="Go on with a design that breaks a fabrication rule.")
]
AsJson = Annotated[bool, typer.Option("--json", help="Print the numbers as JSON in SI units, and nothing else.")]
Workers = Annotated[int | None, typer.Option("--workers", help="Local processes of one thread; one a core by default.")]
Cluster = Annotated[
    str | None, typer.Option("--cluster", help="Dask scheduler, tcp://host:port, whose workers compute instead.")
]

_MOST_LENGTHS, _LONGEST_MM = 1000, 100_000.0
_PIPE_WIDTH = 1000  # characters; output that is read by a program is never cut


def open_design(name: str | None, *, allow_violations: bool) -> Design:
    """Read a design and refuse it where it breaks a fabrication rule.

    Raises
    ------
    DesignError, RuleViolationError
        As `coilarray.load_design` and `coilarray.geometry.require_rules`.
    """
    return open_design_file(name, allow_violations=allow_violations).design


def open_design_file(name: str | None, *, allow_violations: bool) -> DesignFile:
    """As `open_design`, with what only the file says."""
    from coilarray.design.model import load_design_file
    from coilarray.errors import RuleViolationError
    from coilarray.geometry import require_rules

    file = load_design_file(name)
    if not allow_violations:
        try:
            require_rules(file.design.array, file.design.rules)
        except RuleViolationError as error:
            raise RuleViolationError(f"{file.design.name}: {error}") from None
    return file


def lengths(option: str, text: str) -> list[float]:
    """Rising lengths in m from a list or a range in mm, as 0.5,1 or START:STOP:COUNT.

    Raises
    ------
    ElastomerError
        Anything else.
    """
    import numpy as np

    parts = text.split(":")
    try:
        if len(parts) == 3:
            start, stop, count = float(parts[0]), float(parts[1]), int(parts[2])
            values = np.linspace(start, stop, count).tolist() if 2 <= count <= _MOST_LENGTHS else []
        else:
            values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    rising = all(low < high for low, high in itertools.pairwise(values))
    if not (0 < len(values) <= _MOST_LENGTHS and rising and np.abs(values).max() <= _LONGEST_MM):
        raise ElastomerError(
            f"{option} must be rising numbers of mm, as 0.5,1 or START:STOP:COUNT with 2 to {_MOST_LENGTHS} of them; "
            f"got {text!r}."
        )
    return [value * 1e-3 for value in values]


def print_json(data: Any) -> None:
    """Print a value as JSON; a number that is not finite is an error of ours, never NaN in the output."""
    typer.echo(json.dumps(data, indent=1, allow_nan=False))


def print_table(
    headers: Sequence[str], rows: Sequence[Sequence[str]], title: str = "", marked: Sequence[int] = ()
) -> None:
    """Print a table of text, numbers to the right; rows whose index is in `marked` are red."""
    typer.echo(table_text(headers, rows, title, marked))


def table_text(
    headers: Sequence[str], rows: Sequence[Sequence[str]], title: str = "", marked: Sequence[int] = ()
) -> str:
    """Return what `print_table` prints."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(title=title or None, title_justify="left", box=None, pad_edge=False, padding=(0, 2, 0, 0))
    for k, header in enumerate(headers):
        numeric = all(_is_number(row[k]) for row in rows)
        table.add_column(header, justify="right" if numeric else "left", no_wrap=True)
    for k, row in enumerate(rows):
        table.add_row(*map(Text, row), style="bold red" if k in marked else None)
    console = Console(highlight=False)
    if not console.is_terminal:
        console.width = _PIPE_WIDTH
    with console.capture() as captured:
        console.print(table)
    return "\n".join(line.rstrip() for line in captured.get().splitlines())


def _is_number(text: str) -> bool:
    try:
        float(text.replace("−", "-"))
    except ValueError:
        return False
    return True


@contextmanager
def progress_bar(text: str) -> Iterator[Progress]:
    """Show a progress bar on standard error while the block runs; none where that is no terminal."""
    from rich.console import Console
    from rich.progress import Progress as Bar

    console = Console(stderr=True)
    with Bar(console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(text, total=None)

        def update(done: int, total: int) -> None:
            bar.update(task, completed=done, total=total)

        yield update
