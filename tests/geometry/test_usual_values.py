"""Unusual values: every key of a length, capacitance, resistance or frequency, slips of a unit, and no false alarms."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.command_line import runner
from support.refusals import refused

import coilarray as ca
from coilarray.design import bundled
from coilarray.design.keys import Table, entry_unit
from coilarray.design.model import Document, load_design_file
from coilarray.errors import GeometryError, UnusualValueWarning
from coilarray.geometry.usual_values import USUAL, slip, unusual_values

# places, which may lie anywhere, and lists of them
PLACES = {
    "x_mm", "y_mm", "z_mm", "at_mm", "corners_mm", "holes_mm", "lines_mm", "outline_mm", "origin_mm", "sample_x_mm",
    "sample_y_mm", "bend_neutral_mm", "points_mm", "x_positions_mm", "y_positions_mm", "ellipse_x_mm",
    "ellipse_y_mm",
}  # fmt: skip


def every_key(of=Table):
    """Keys of lengths, capacitances, inductances, resistances and frequencies of all tables of a design file."""
    for table in of.__subclasses__():
        if table.__module__.startswith("coilarray.design"):
            units = {"mm", "µm", "pF", "nH", "ohm", "ohm m", "MS/m", "MHz", "kPa"}
            yield from (
                key
                for key in table.model_fields
                if entry_unit(key) in units or key.endswith(("epsilon_r", "permittivity"))
            )
        yield from every_key(table)


def test_every_key_has_a_usual_range():
    assert Document.model_fields  # which loads all tables
    assert set(every_key()) - PLACES == set(USUAL)


@given(st.sampled_from(sorted(USUAL)), st.floats(0, 1), st.sampled_from([1e-3, 1.0, 1e3]))
def test_a_slip_by_a_thousand_is_told_only_where_it_is_likelier(key, where, factor):
    least, most = USUAL[key]
    usual = least * (most / least) ** where
    value = usual * factor
    words = slip(f"any.{key}.0", value)
    # told where the value is outside, and then what was meant is a thousandth or the thousandfold of it
    assert bool(words) == (not least <= value <= most and least <= value / factor <= most)
    if words:
        assert float(words.split(": ")[1].split(" ")[0].rstrip("?")) == pytest.approx(usual, rel=1e-3)  # four digits


@pytest.mark.parametrize("name", bundled.names())
def test_bundled_designs_are_usual(name):
    assert load_design_file(name).unusual == ()


def test_a_file_with_a_slip_is_read_and_told_once(tmp_path, capsys):
    path, text = tmp_path / "slip.toml", bundled.read("starter")
    path.write_text(text.replace("gap_mm = 0.15", "gap_mm = 0.00015"), encoding="utf-8")
    with pytest.warns(UnusualValueWarning) as told:
        ca.load_design(path)
    line = f"{path}: coils.hexagon.gap_mm of 0.00015 mm is unusual: 0.15 mm?"
    assert [str(one.message) for one in told] == [line]
    run, _ = runner("check")
    code, out, err = run(capsys, path, "--json", "--allow-violations")
    assert (code, err) == (0, f"coilarray: warning: {line}\n")
    assert json.loads(out)["design"] == "starter"


def test_values_of_python_in_millimetres():
    with pytest.warns(UnusualValueWarning, match="trace_width of 150 mm is unusual: 0.15 mm"):
        ca.Spiral(6, 0.8, 1, 0.15, 0.15e-3)
    refused(GeometryError, "a coil must be at most 10 m wide; got 20 m.*0.02 m", ca.Spiral, 6, 20, 10, 0.15, 0.15)
    refused(GeometryError, "at most 10 m wide", ca.RoundedSpiral, 20.0, 1.0, 1, 1e-3, 1e-3)
    copper = ("L1", "L2"), (35e-6, 0.035e-6), (1e-3,), (4.5,)
    refused(GeometryError, "copper thickness must be at least 1 µm; got 0.035 µm: 35 µm?", ca.Stackup, *copper)
    board = ("L1", "L2"), (35e-6, 35e-6), (1.53,), (4.5,)
    refused(GeometryError, "dielectric thickness must be at most 50 mm; got 1530 mm: 1.53 mm?", ca.Stackup, *board)


def test_unusual_values_of_lists_and_tables():
    document = {
        "target": {"distances_mm": [0.001, 1, 0.001]},
        "elastomer": [{"thickness_mm": 3}, {"thickness_mm": 3e3}],
    }
    assert unusual_values(document) == [
        "target.distances_mm of 0.001 mm is unusual: 1 mm?",
        "elastomer.1.thickness_mm of 3000 mm is unusual: 3 mm?",
    ]
