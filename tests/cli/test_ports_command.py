"""Ports of a design: solved, printed, matched, written and pictured."""

import json
from concurrent.futures import Future
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import tomli_w
from support.command_line import runner, successes
from support.refusals import refused as refuses

from coilarray.circuit.network import coil_impedance
from coilarray.circuit.ports import design_ports, port_impedance, power_transfer, scattering, solve_ports
from coilarray.design.model import build_design, build_design_file
from coilarray.design.vary import vary
from coilarray.design.write import design_document
from coilarray.errors import GoalError, NetworkError
from coilarray.geometry import Array, Spiral
from coilarray.report.sections import SECTIONS
from coilarray.studies.quantities import evaluate

good, answer = successes("impedance")
run, refused = runner("impedance")

SOURCE, LOAD = {"coil": "coil1", "source_ohm": 50.0}, {"coil": "coil2", "load_ohm": 20.0, "capacitor_quality": 500.0}
CIRCUIT = {"link_frequency_MHz": 13.56, "default_termination": "open", "ports": [SOURCE, LOAD]}


@pytest.fixture(scope="module")
def document():
    """Two flat square coils beside each other, and a third that is open."""
    from coilarray import Design

    plain = design_document(Design(Array.row(Spiral(4, 20e-3, 3, 0.5e-3, 0.5e-3), 3, pitch=22e-3)))
    return plain | {"name": "link", "circuit": CIRCUIT}


@pytest.fixture
def file(document, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "link.toml").write_text(tomli_w.dumps(document), encoding="utf-8")
    return "link.toml"


@pytest.mark.slow
def test_a_design_is_solved_as_its_matrices_are(document):
    design = build_design(document)
    f = np.array([10e6, 13.56e6, 15e6])
    solved = solve_ports(design, f)
    there, network = design_ports(design, f)
    Z = port_impedance(there, coil_impedance(network, f), f)
    S = scattering(Z, [50.0, 20.0])
    np.testing.assert_array_equal(solved.s_real + 1j * solved.s_imag, S)
    np.testing.assert_array_equal(solved.efficiency, power_transfer(there, Z).efficiency)
    # without capacitors at the ports the efficiency is below that of the best load; every bound is below one
    assert (solved.efficiency.values < solved.best_efficiency.values).all()
    assert (solved.best_efficiency.values < 1).all()
    only = solve_ports(design)
    assert only.frequency.values.tolist() == [13.56e6]
    np.testing.assert_allclose(only.s_real[0], solved.s_real[1], rtol=1e-4)  # R(f) between samples


def test_links_are_quantities_of_sweeps(document):
    file = build_design_file(document)
    loads = [5.0, 20.0]
    values = [
        evaluate(vary(file, {"circuit.ports.coil2.load_ohm": load}), ["link_efficiency", "link_reflection"])
        for load in loads
    ]
    for load, found in zip(loads, values, strict=True):
        solved = solve_ports(vary(file, {"circuit.ports.1.load_ohm": load}))
        assert found["link_efficiency"] == solved.efficiency.item()
        S = np.hypot(solved.s_real, solved.s_imag).values[0]
        assert found["link_reflection"] == max(S[0, 0], S[1, 1])
    for key, words in (("ports", "circuit.ports with"), ("efficiency", "source_ohm and a load_ohm")):
        plain = CIRCUIT | {"ports": [SOURCE] if key == "efficiency" else []}
        design = build_design(document | {"circuit": plain})
        refuses(GoalError, words, evaluate, design, ["link_efficiency"])


def test_a_source_alone_has_no_efficiency(document):
    design = build_design(document | {"circuit": CIRCUIT | {"ports": [SOURCE]}})
    assert "efficiency" not in solve_ports(design)
    refuses(NetworkError, r"rising; got \[1 0\]|rising; got", solve_ports, design, [1.0, 0.0])


@pytest.mark.slow
def test_ports_are_printed_matched_and_written(capsys, file):
    data = answer(capsys, file, "--ports", "--match", "SS", "--series", "E96", "--points", 5, "--out", "s.csv")
    assert [row["port"] for row in data["ports"]] == ["coil1", "coil2"]
    assert [row["capacitor"] for row in data["capacitors"]] == ["series", "series"]
    exact, nearest, worst = (row["efficiency"] for row in data["results"])
    assert worst < nearest < 1
    assert data["links"][0]["efficiency"] == pytest.approx(exact, rel=1e-4)  # R(f) between samples
    assert (
        len(Path("s.csv").read_text(encoding="utf-8").splitlines()) == 1 + 4 * 6
    )  # five frequencies, and that of the link
    text = good(capsys, file, "--ports", "--match", "L", "--points", 3, "--out", "s.s2p", "--plot", "s.svg")
    assert "nearest of E24 (pF)" in text
    import skrf

    found = skrf.Network("s.s2p")
    assert found.nports == 2
    at_link = found.s[np.abs(found.f - 13.56e6).argmin()]
    assert abs(at_link[0, 0]) < 0.05  # matched with the 20 Ω of the load, and nearly so with 50 Ω
    assert at_link[0, 1] == pytest.approx(at_link[1, 0], rel=1e-9)


def test_the_report_has_a_section_of_ports(document):
    file = build_design_file(document)
    solved: Future = Future()
    solved.set_result(solve_ports(file.design))
    made = SECTIONS["Ports"](SimpleNamespace(design=file.design, linking=solved, plot=lambda *a, **o: solved))
    assert set(made.tables()) >= {"ports", "links", "s_parameters"}
    json.dumps([table.records() for table in made.tables().values()], allow_nan=False)
    nothing: Future = Future()
    nothing.set_result(None)
    assert SECTIONS["Ports"](SimpleNamespace(linking=nothing)) is None


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--match", "SS"), "--match is for --ports"),
        (("--ports", "--noise"), "give one of them"),
        (("--ports", "--out", "a.cir"), r"got a.cir"),
        (("--ports", "--match", "SX"), "SX"),
        (("--ports", "--from-MHz", "20", "--to-MHz", "10"), "got 20 and 10"),
    ],
)
def test_mistakes_are_refused(capsys, file, arguments, words):
    assert words in refused(capsys, file, *arguments)


def test_a_design_without_ports_is_refused(capsys):
    assert "[[circuit.ports]]" in refused(capsys, "gast2020", "--ports")
