"""Scenes: what is drawn, in which colour, seen from where; and how it is shown: pictures, windows, films and pages.

`of_design` and `touch` compute scenes of a design and load the physics; the other modules do not.
"""
