"""Report of a board: HTML page, CSV, JSON and netCDF."""
