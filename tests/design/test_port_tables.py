"""Ports in design files: read, written, varied, and refused by their keys."""

from dataclasses import replace

import pytest
from support.refusals import refused

from coilarray import load_design, load_design_file, vary
from coilarray.design.bundled import DESIGNS
from coilarray.design.model import build_design, build_design_file, parse_design
from coilarray.design.ports import Port
from coilarray.design.write import design_document, design_text
from coilarray.errors import DesignError

PORTS = """
[circuit]
link_frequency_MHz = 13.56

[[circuit.ports]]
coil = "coil1"
source_ohm = 50.0
series_pF = 33.0
parallel_pF = 220.0
capacitor_quality = 400.0

[[circuit.ports]]
coil = "coil6"
load_ohm = 10.0
parallel_pF = 100.0
parallel_at = "terminals"
"""
FIRST = Port("coil1", 50.0, None, 33e-12, 220e-12, "coil", 400.0)
SECOND = Port("coil6", None, 10.0, None, 100e-12, "terminals")


def document():
    circuit = DESIGNS.parse(PORTS, "ports")["circuit"]
    plain = dict(load_design_file("gast2020").document)
    return plain | {"circuit": plain["circuit"] | circuit}


def test_ports_are_read_written_and_known():
    design = build_design(document())
    assert design.circuit.ports == (FIRST, SECOND)
    assert design.circuit.link_frequency == 13.56e6
    for again in (build_design(design_document(design)), parse_design(design_text(design))):
        assert again.digest == design.digest
        assert again.circuit.ports == design.circuit.ports
    assert "# Internal resistance of the source" in design_text_with_comments(design)


def design_text_with_comments(design):
    from coilarray.design.write import with_comments

    return with_comments(design_text(design))


@pytest.mark.parametrize(
    "change",
    [
        {"circuit.ports.0.source_ohm": 51.0},
        {"circuit.ports.0.series_pF": 34},
        {"circuit.ports.1.parallel_pF": 101},
        {"circuit.ports.1.parallel_at": "coil"},
        {"circuit.ports.0.capacitor_quality": 500},
        {"circuit.ports.1.coil": "coil5"},
        {"circuit.link_frequency_MHz": 6.78},
        {"circuit.ports.coil6.load_ohm": 11},
    ],
)
def test_every_key_of_a_port_can_be_varied_and_counts(change):
    file = build_design_file(document())
    assert vary(file, change).digest != file.design.digest


def test_without_ports_a_design_is_what_it_was():
    design = load_design("gast2020")
    assert replace(design, circuit=replace(design.circuit, link_frequency=1e6)).digest == design.digest


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("circuit.ports.0.coil", "coil9", r"circuit\.ports\.0\.coil .*'coil9'"),
        ("circuit.ports.1.coil", "coil1", r"circuit\.ports\.1\.coil .*'coil1'"),
        ("circuit.ports.0.series_pF", -3.0, r"circuit\.ports\.0\.series_pF .*-3"),
        ("circuit.ports.0.parallel_pF", 0.0, r"circuit\.ports\.0\.parallel_pF .*0"),
        ("circuit.ports.1.load_ohm", 0.0, r"circuit\.ports\.1\.load_ohm .*0"),
        ("circuit.ports.1.source_ohm", 3.0, r"port at coil6 .*source.*3 .*load.*10"),
        ("circuit.ports.1.parallel_at", "middle", r"circuit\.ports\.1\.parallel_at .*middle"),
        ("circuit.ports.0.capacitor_quality", -1, r"circuit\.ports\.0\.capacitor_quality .*-1"),
        ("circuit.link_frequency_MHz", 0, r"circuit\.link_frequency_MHz .*0"),
        ("circuit.ports.0.inductance_uH", 1, r"inductance_uH"),
    ],
)
def test_bad_entries_are_refused_by_key_and_value(key, value, words):
    refused(DesignError, words, vary, build_design_file(document()), {key: value})


def test_ports_without_a_frequency_are_refused():
    plain = document()
    plain["circuit"] = {key: value for key, value in plain["circuit"].items() if key != "link_frequency_MHz"}
    refused(DesignError, "circuit.link_frequency_MHz", build_design, plain)
