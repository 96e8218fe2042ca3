"""Optimization of a design: goals, the search, its results."""

from __future__ import annotations

from coilarray.studies.optimize.derive import derive_goal, load_goal
from coilarray.studies.optimize.goal import Goal, Trial, front_of, parse_goal
from coilarray.studies.optimize.run import Optimization, optimize_design, optimize_with, write_optimization

__all__ = [
    "Goal", "Optimization", "Trial", "derive_goal", "front_of", "load_goal", "optimize_design",
    "optimize_with", "parse_goal", "write_optimization",
]  # fmt: skip
