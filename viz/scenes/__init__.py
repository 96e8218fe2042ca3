"""Scenes, and their pictures, windows, films and pages.

A scene defines the drawn parts, their colours and the direction of view. `design`, `metal` and
`touch` compute scenes of a design and load the physics. The other modules do not.
"""
