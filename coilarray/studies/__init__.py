"""Studies of a design: sweeps, optimization, tolerances, and the quantities that they vary and compute."""
