"""Eddy currents in plates and balls near the coils."""
