"""Effect of fabrication errors on coils and located positions."""

from __future__ import annotations

from coilarray.studies.tolerance.analysis import analyse, check_analysis, default_quantities
from coilarray.studies.tolerance.tolerances import (
    Contributor,
    Limit,
    Positions,
    Spread,
    Tolerances,
    contributors,
    draw,
    error_names,
    errors_of,
    load_tolerances,
    parse_tolerances,
    perturb,
    typical_text,
)

__all__ = [
    "Contributor", "Limit", "Positions", "Spread", "Tolerances", "analyse", "check_analysis", "contributors",
    "default_quantities", "draw", "error_names", "errors_of", "load_tolerances", "parse_tolerances", "perturb",
    "typical_text",
]  # fmt: skip
