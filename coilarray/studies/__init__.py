"""Sweeps, optimizations, tolerances and calibrations of a design."""
