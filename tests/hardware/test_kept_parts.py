"""Parts of a board's model that are kept: those of one design are never taken for another's."""

from dataclasses import replace

import pytest
from support.emulated_reader import settings_of

from coilarray import load_design
from coilarray.hardware.scan.settings import board_budget, board_network
from coilarray.hardware.scan.wiring import one_device_a_coil, wired_to_channels


def test_a_design_that_was_changed_in_python_gets_its_own_network():
    """The single coil of gast_fem has 97.12 µH under its magnetic sheet and 94.82 µH under air."""
    design = load_design("gast_fem")
    air = replace(design, sheets=tuple(replace(sheet, relative_permeability=1.0) for sheet in design.sheets))
    magnetic = board_network(design)
    fresh, kept = (board_network(air) for _ in range(2))
    assert magnetic.inductance[0, 0] == pytest.approx(97.12e-6, abs=0.005e-6)
    assert fresh.inductance[0, 0] == pytest.approx(94.82e-6, abs=0.005e-6)
    assert kept.inductance[0, 0] == fresh.inductance[0, 0]
    assert board_network(design).inductance[0, 0] == magnetic.inductance[0, 0]


def test_the_budget_of_a_board_is_that_of_its_settings_and_not_of_the_designs():
    """A crystal, a short conversion, and no switches where there are none; the design says 5 Ω and its own read-out."""
    design = load_design("gast_fem")
    circuit = replace(design.circuit, switches=replace(design.circuit.switches, on_resistance=2.5), part="ADG739")
    design, (coil,) = replace(design, circuit=circuit), design.array.names
    switched = settings_of(one_device_a_coil([coil]), rcount=2048)
    wired = settings_of(wired_to_channels([coil], [0]), rcount=2048, clock=40e6, external_clock=True)
    by_switches, by_channel = (board_budget(design, one, baseline_scans=4) for one in (switched, wired))
    assert board_network(design, wired=True).switches.on_resistance == 0.0
    sizes = [{cause.name: cause.size for cause in one.causes} for one in (by_switches, by_channel)]
    assert [one["resistance of the switches"] for one in sizes] == ["assumed", "none"]
    assert "jitter of the crystal oscillator" in sizes[1]
    # 8e-7 of f at RCOUNT 2048, twice that of L; one scan and a baseline of four; thermal noise is 1 % of it
    assert by_switches.noise == pytest.approx(1.6e-6 * (1 + 1 / 4) ** 0.5, rel=0.01)
    assert abs(by_channel.causes[4].drift[0]) < abs(by_switches.causes[4].drift[0]) / 5
