"""Network of coils, switches and tank, and its files."""
