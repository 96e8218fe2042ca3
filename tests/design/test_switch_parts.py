"""A part of the switches in ``[circuit]``: its values stand where none are given, and are said to be assumed."""

import math
import re
from typing import get_args

import pytest

from coilarray.design.bundled import read
from coilarray.design.model import parse_design, parse_design_file
from coilarray.design.scan_states import PARTS, PartName, Switches
from coilarray.design.write import design_text
from coilarray.errors import DesignError

KEYS = ("short_resistance_ohm", "switch_off_capacitance_pF", "terminal_capacitance_pF", "bus_capacitance_pF")
STARTER = read("starter")
BARE = re.sub(rf'^"?(circuit\.)?({"|".join(KEYS)})"? = .*\n', "", STARTER, flags=re.MULTILINE)


def with_part(name, *given):
    return parse_design_file(BARE.replace("[circuit]", "\n".join(["[circuit]", f'switches = "{name}"', *given])))


def test_every_part_has_eight_switches_once():
    assert set(PARTS) == set(get_args(PartName))
    for name, part in PARTS.items():
        assert part.name == name
        assert len(set(part.bits)) == len(part.bits) == 8
        assert not part.drains or sorted(sum(part.drains.values(), ())) == sorted(part.bits)
        assert {field for field in part.unverified if not hasattr(part, field)} == set()


@pytest.mark.parametrize(("name", "terminal", "bus"), [
    # by hand, for three coils: six ends with a switch to either side of the bus, and 4 pF of the converter's pin
    ("ADG739", 42, 6 * 13 + (48 - 42 - 13) + 4), ("ADG738", 85, 6 * 13 + (96 - 85 - 13) + 4),
    ("ADG714", 3 * 11, 6 * 11 + 0 + 4),  # no common pin: three switches, three pins
])  # fmt: skip
def test_values_of_the_part_stand_where_none_are_given(name, terminal, bus):
    file = with_part(name)
    switches = file.design.circuit.switches
    assert switches.on_resistance == 2.5
    assert (switches.terminal_capacitance, switches.bus_capacitance) == pytest.approx((terminal * 1e-12, bus * 1e-12))
    # the attenuation that the open switch then has into 50 Ω at 10 MHz
    through = 20 * math.log10(2 * math.pi * 10e6 * 50 * switches.off_capacitance)
    assert through == pytest.approx(-PARTS[name].off_isolation)
    shown = {key: file.values[f"circuit.{key}"] for key in KEYS}
    assert shown["short_resistance_ohm"] == 5
    assert shown["bus_capacitance_pF"] == pytest.approx(bus)
    for key in KEYS:
        assert file.assumed[f"circuit.{key}"].startswith(f"{name}: ")
    assert "not verified" in file.assumed["circuit.bus_capacitance_pF"]


def test_what_is_given_goes_before_the_part():
    file = with_part("ADG739", "bus_capacitance_pF = 0", "short_resistance_ohm = 1")
    switches = file.design.circuit.switches
    assert (switches.bus_capacitance, switches.on_resistance) == (0, 0.5)
    assert switches.terminal_capacitance == pytest.approx(42e-12)
    assert "circuit.bus_capacitance_pF" not in file.assumed
    # and stays so when the design is written: a default beside a part is no default
    again = parse_design(design_text(file.design)).circuit
    assert (again.part, again.switches.bus_capacitance) == ("ADG739", 0)
    assert again.switches.terminal_capacitance == pytest.approx(42e-12)


def test_without_a_part_nothing_is_counted():
    assert parse_design(BARE).circuit.switches == Switches(tank_capacitance=330e-12)


def test_an_unknown_part_is_refused():
    with pytest.raises(DesignError, match=r"circuit.switches.*ADG714.*ADG738.*ADG739.*ADG708"):
        with_part("ADG708")


def test_the_numbers_of_the_reference_board_do_not_count_its_part():
    # the paper says about 2 MHz with 120 pF; more capacitance leads away from it
    circuit = parse_design(read("gast2020")).circuit
    assert circuit.part == "ADG739"
    assert circuit.switches.across_coil == circuit.capacitance == 120e-12
