"""Wiring, settings, switch states and readings of a scan."""
