"""Flat plots with matplotlib."""
