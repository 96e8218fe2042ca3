"""What is measured: wiring, settings, switch states and readings."""
