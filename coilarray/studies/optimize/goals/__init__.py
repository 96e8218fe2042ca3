"""Goals that fit any design: by name, by a wish, or from a file."""

from __future__ import annotations

from coilarray.studies.optimize.goals.named import (
    NAMES,
    DerivedGoal,
    adjusted,
    derive_goal,
    is_named,
    keeping_rules,
    load_goal,
    unfit_goals,
)

__all__ = ["NAMES", "DerivedGoal", "adjusted", "derive_goal", "is_named", "keeping_rules", "load_goal", "unfit_goals"]
