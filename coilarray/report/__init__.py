"""The coupling report: one self-contained HTML page, and every number of it as CSV, JSON and netCDF."""

from coilarray.report.write import Report, write_report

__all__ = ["Report", "write_report"]
