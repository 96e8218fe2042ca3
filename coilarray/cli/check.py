"""``coilarray check``."""

from __future__ import annotations

from typing import Annotated

import typer

from coilarray.cli.shared import AllowViolations, AsJson, DesignArgument, print_json, print_table


def check(
    design: DesignArgument = None,
    every: Annotated[bool, typer.Option("--all", help="Every margin, not only the ten smallest.")] = False,
    as_json: AsJson = False,
    allow_violations: AllowViolations = False,
) -> None:
    """Check a design against its fabrication rules.

    The exit code is 2 where one is broken.

    Example: coilarray check gast2020 --all
    """
    from coilarray.design import load_design
    from coilarray.geometry import check_rules, require_kept
    from coilarray.geometry.rules import KEPT_WITHIN
    from coilarray.report.tables import rules_table

    opened = load_design(design)
    margins = check_rules(opened.array, opened.rules)
    table = rules_table(margins)
    if as_json:
        print_json({"design": opened.name, "design_hash": opened.digest, "rules": table.records()})
    else:
        shown = table.cells() if every else table.cells()[:10]
        print_table(
            ("rule", "layer", "feature", "value", "limit", "margin", "x", "y"),
            [row[:-1] for row in shown],
            title="margins, the smallest first; lengths in mm",
            marked=[k for k, row in enumerate(shown) if row[-1] == "no"],
        )
        if len(shown) < len(table.rows):
            typer.echo(f"… and {len(table.rows) - len(shown)} larger margins (--all)")
    if not allow_violations:
        require_kept(margins)
    if not as_json:
        broken = sum(not row[-1] for row in table.rows)
        typer.echo(
            f"{broken} of {len(table.rows)} margins are broken"
            if broken
            else f"all margins are kept (to {KEPT_WITHIN * 1e6:g} µm)"
        )
