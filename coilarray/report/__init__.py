"""Coupling report: a self-contained HTML page, with all numbers as CSV, JSON and netCDF."""
