"""Designs of many coils for the tests: the winding of gast2020 on lattices."""

from coilarray.design.bundled import read
from coilarray.design.model import parse_design

_HEXAGONAL = {
    'lattice = "linear"': 'lattice = "hexagonal"',
    'layers = [["L1", "L2"], ["L3", "L4"]]': 'layers = [["L1", "L2"], ["L3", "L4"], ["L5", "L6"]]',
    'layers = ["L1", "L2", "L3", "L4"]': 'layers = ["L1", "L2", "L3", "L4", "L5", "L6"]',
    "[35, 35, 35, 35]": "[35, 35, 35, 35, 35, 35]",
    "[0.215, 0.215, 0.215]": "[0.215, 0.215, 0.215, 0.215, 0.215]",
    "[4.5, 4.5, 4.5]": "[4.5, 4.5, 4.5, 4.5, 4.5]",
}


def hexagonal(columns, rows, turns=30):
    """Return a design of columns × rows hexagonal coils that overlap on three pairs of layers, about the origin."""
    lines = [line for line in read("gast2020").splitlines() if not line.startswith(('"indentation.origin"', "origin"))]
    text = "\n".join(lines).replace("columns = 6", f"columns = {columns}\nrows = {rows}")
    text = text.replace("turns_per_layer = 30", f"turns_per_layer = {turns}")
    for old, new in _HEXAGONAL.items():
        assert old in text, old
        text = text.replace(old, new)
    return parse_design(text)
