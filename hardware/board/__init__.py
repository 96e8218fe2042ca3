"""Boards: the readers of a scan, direct or through a microcontroller."""
