"""``coilarray check``."""

from __future__ import annotations

from typing import Annotated

import typer

from coilarray.cli.shared import AllowViolations, AsJson, DesignArgument, print_json


def check(
    design: DesignArgument = None,
    every: Annotated[bool, typer.Option("--all", help="Every margin, not only the ten smallest.")] = False,
    as_json: AsJson = False,
    allow_violations: AllowViolations = False,
) -> None:
    """Check a design against its fabrication rules; exit code 2 where one is broken.

    Example: coilarray check gast2020 --all
    """
    from rich.console import Console
    from rich.table import Table

    from coilarray.design import load_design
    from coilarray.geometry import check_rules, require_rules
    from coilarray.report.tables import rules_table

    opened = load_design(design)
    table = rules_table(check_rules(opened.array, opened.rules))
    if as_json:
        print_json({"design": opened.name, "design_hash": opened.digest, "rules": table.records()})
    else:
        shown = table.cells() if every else table.cells()[:10]
        rich_table = Table(show_edge=False, pad_edge=False)
        for column in table.columns:
            rich_table.add_column(column.header, justify="left" if column.scale == 1 else "right")
        for row in shown:
            rich_table.add_row(*row, style="bold red" if row[-1] == "no" else None)
        console = Console(soft_wrap=True, highlight=False)
        console.print(rich_table)
        if len(shown) < len(table.rows):
            console.print(f"… and {len(table.rows) - len(shown)} larger margins (--all)")
    if not allow_violations:
        require_rules(opened.array, opened.rules)
    if not as_json:
        broken = sum(not row[-1] for row in table.rows)
        typer.echo(f"{broken} of {len(table.rows)} margins are broken" if broken else "all margins are kept")
