"""Studies of a design: sweeps, optimisation, tolerances, and the quantities that they vary and compute."""
