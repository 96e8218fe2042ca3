"""The coupling report: one self-contained HTML page, and every number of it as CSV, JSON and netCDF."""
