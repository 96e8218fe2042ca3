"""Metal near the coils: plates and balls that carry eddy currents."""
