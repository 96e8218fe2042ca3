"""``coilarray noise``."""

from __future__ import annotations

from coilarray.cli import shared


def noise(
    design: shared.DesignArgument = None,
    reference: shared.References = None,
    as_json: shared.AsJson = False,
    allow_violations: shared.AllowViolations = False,
) -> None:
    """Predict how much readings of δ scatter and drift, and why.

    Lists every cause: its noise in one scan, its drift per kelvin, its change since L_0 was read, whether it is common
    to all coils, and the source of the value. Values, settings and the change of temperature are in the table [readout]
    of the design. The σ of δ at the end is the noise that `locate`, the position errors and the ranges of targets
    assume. `coilarray board info --noise` compares a recording with it.

    Example: coilarray noise gast2020 --reference coil6
    """
    from coilarray.circuit.noise_budget import noise_budget
    from coilarray.report.noise_tables import budget_lines, budget_tables

    opened = shared.open_design(design, allow_violations=allow_violations)
    budget = noise_budget(opened)
    if reference:
        budget = budget.referenced(reference)
    shared.print_result(
        {**shared.design_record(opened), **budget.to_record()},
        as_json=as_json, tables=budget_tables(budget), titles=True, lines=budget_lines(budget),
    )  # fmt: skip
