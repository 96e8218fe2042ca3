"""A winding without a model of its capacitance stops no command, and every one of them names what is missing."""

import pytest
from support.command_line import runner

run, _ = runner()

LOOP = """
schema = 1
name = "loop"
stackup = {layers = ["L1"], copper_thickness_um = [35], dielectric_thickness_mm = [], dielectric_epsilon_r = []}
array = {lattice = "single", coil = "c", layers = [["L1"]]}
circuit = {capacitance_pF = 3300}

[coils.c]
shape = "path"
lines_mm = [[[-6, -8], [-6, 6], [6, 6], [6, -6], [-4, -6], [-4, -8]]]
trace_width_mm = 0.3
gap_mm = 0.3
via = {drill_mm = 0.3, pad_mm = 0.6, plating_um = 25}
"""


@pytest.mark.slow
@pytest.mark.parametrize("command", [
    "impedance", "sweep --vary coils.c.trace_width_mm=0.2,0.3 -q q -q srf_margin --workers 1",
    "tolerance --samples 0 -q q --workers 1",
], ids=lambda command: command.split()[0])  # fmt: skip
def test_commands_go_on_without_capacitance_and_name_it(command, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "loop.toml").write_text(LOOP, encoding="utf-8")
    name, *options = command.split()
    code, out, _ = run(capsys, name, "loop.toml", *options)
    assert code == 0
    assert "capacitance of the windings" in out


@pytest.mark.slow
def test_init_names_it_and_says_how_far_the_limits_are_known(tmp_path, monkeypatch, capsys):
    """A coil of 0.2 m by a new design, in thin traces: its frequency is a quarter lower with its capacitance."""
    monkeypatch.chdir(tmp_path)
    code, out, _ = run(capsys, "init", "wide.toml", "--coils", "1", "--size-mm", "200", "--no-elastomer")
    assert code == 0
    assert "not in these numbers: capacitance of the windings: coil1" in out
    assert "converter: as far as these numbers go, every limit" in out
