"""Readers of a scan, direct or through a microcontroller."""
