"""Planar coil arrays: geometry, inductance and coupling matrices, grounded neighbours, reports."""
