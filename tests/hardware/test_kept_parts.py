"""Parts of a board's model that are kept: those of one design are never taken for another's."""

from dataclasses import replace

import pytest

from coilarray import load_design
from coilarray.compute.store import Store
from coilarray.hardware.scan.board_network import board_network


def test_a_design_that_was_changed_in_python_gets_its_own_network(tmp_path):
    """The single coil of gast_fem has 97.12 µH under its magnetic sheet and 94.82 µH under air."""
    design = load_design("gast_fem")
    air = replace(design, sheets=tuple(replace(sheet, relative_permeability=1.0) for sheet in design.sheets))
    magnetic = board_network(design, Store(tmp_path))
    fresh, kept = (board_network(air, Store(tmp_path)) for _ in range(2))
    assert magnetic.inductance[0, 0] == pytest.approx(97.12e-6, abs=0.005e-6)
    assert fresh.inductance[0, 0] == pytest.approx(94.82e-6, abs=0.005e-6)
    assert kept.inductance[0, 0] == fresh.inductance[0, 0]
    assert board_network(design, Store(tmp_path)).inductance[0, 0] == magnetic.inductance[0, 0]
