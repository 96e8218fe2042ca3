"""Calibration of a design by measurements of its board."""

from coilarray.studies.calibrate.calibration import Calibration, calibrate
from coilarray.studies.calibrate.plan import Plan, load_plan

__all__ = ["Calibration", "Plan", "calibrate", "load_plan"]
