"""Field, inductance, resistance and capacitance of current paths in air."""
