"""Design files: what is read, and one clear line for everything that cannot be."""

# ruff: noqa: E501 - each case is one line of input and one of output
from __future__ import annotations

import math
import tomllib

import pytest

from coilarray import load_design, parse_design
from coilarray.designs import names, read
from coilarray.errors import DesignError

BASE = read("starter")


def changed(old, new):
    assert old in BASE
    return BASE.replace(old, new, 1)


@pytest.mark.parametrize("name", names())
def test_bundled_designs_are_read(name):
    design = load_design(name)
    assert design.name == name
    assert set(design.assumed) <= set(design.values)


def test_gast2020():
    design = load_design()
    array = design.array
    assert len(array.placements) == 6
    assert [place.layers for place in array.placements[:3]] == [("L1", "L2"), ("L3", "L4"), ("L1", "L2")]
    assert array.centres[1, 0] - array.centres[0, 0] == pytest.approx(13.28e-3, rel=1e-12)
    outline = array.placements[0].coil.outline
    # corners on ±y, 23 mm apart; flats towards the neighbours
    assert outline[:, 1].max() - outline[:, 1].min() == pytest.approx(23e-3, rel=1e-12)
    assert outline[:, 0].max() - outline[:, 0].min() == pytest.approx(23e-3 * math.sqrt(3) / 2, rel=1e-12)
    assert design.circuit.capacitance == pytest.approx(120e-12)
    assert design.circuit.terminations == ("short",) * 6
    assert [(s.name, s.thickness) for s in design.sheets] == [("base", 6e-3), ("magnetic", 2e-3)]
    # two coil planes half a millimetre apart, as in Table 1 of the paper
    heights = [array.stackup.centre(layer) for layer in array.stackup.names]
    assert (heights[0] + heights[1]) / 2 - (heights[2] + heights[3]) / 2 == pytest.approx(0.5e-3, rel=1e-9)


@pytest.mark.parametrize("name", ["gast2020", "gast_fem"])
def test_every_value_of_a_published_board_is_given_by_its_paper_or_assumed(name):
    """A value of the file that is not marked as assumed must be one of the papers' own."""
    from_the_papers = {
        "schema", "name", "title", "source",
        "coils.hexagon.shape", "coils.hexagon.sides", "coils.hexagon.turns_per_layer", "coils.hexagon.winding_layers",
        "array.lattice", "array.coil", "array.columns", "array.placements.0.name", "array.placements.0.coil",
        "elastomer.0.name", "elastomer.0.thickness_mm", "elastomer.0.relative_permeability",
        "elastomer.1.name", "elastomer.1.thickness_mm", "elastomer.1.relative_permeability",
        "circuit.capacitance_pF", "circuit.default_termination",
    }  # fmt: skip
    design = load_design(name)
    assert design.given - set(design.assumed) <= from_the_papers | {f"assumed.{key}" for key in design.assumed}
    assert all(design.assumed.values())


def test_digest_is_of_values_not_of_text():
    base = parse_design(BASE)
    assert parse_design(BASE + "\n# a comment\n").digest == base.digest
    assert parse_design(changed("gap_mm = 0.15", "gap_mm = 0.150")).digest == base.digest
    assert parse_design(changed("gap_mm = 0.15", "gap_mm = 0.16")).digest != base.digest
    # a default that is written out is the same design
    assert parse_design(changed('winding = "ccw"', "")).digest == base.digest


def test_flats_and_corners_and_circle():
    flats = parse_design(BASE)
    corners = parse_design(
        changed("outer_across_flats_mm = 16.0", f"outer_across_corners_mm = {16.0 / math.cos(math.pi / 6)!r}")
    )
    a, b = (d.array.placements[0].coil.lines[0] for d in (flats, corners))
    assert a == pytest.approx(b, abs=1e-12)
    text = changed('shape = "polygon"', 'shape = "circle"').replace("sides = 6\n", "")
    circle = parse_design(text.replace("outer_across_flats_mm", "outer_diameter_mm"))
    assert len(circle.array.placements[0].coil.lines[0]) > 12 * 96


def test_free_array_and_path_coil():
    document = """
schema = 1
name = "two"
stackup = { layers = ["top", "bottom"], copper_thickness_um = [35, 35], dielectric_thickness_mm = [1.5], dielectric_epsilon_r = [4.4] }
[coils.zigzag]
shape = "path"
trace_width_mm = 0.2
gap_mm = 0.2
lines_mm = [[[0, 0], [5, 0], [5, 4]], [[5, 4], [0, 4], [0, 1]]]
[array]
lattice = "free"
placements = [
  { name = "a", coil = "zigzag", layers = ["top", "bottom"], x_mm = 0, y_mm = 0 },
  { name = "b", coil = "zigzag", layers = ["bottom", "top"], x_mm = 20, y_mm = 0, rotation_deg = 90 },
]
[circuit]
terminations = { b = "open" }
"""
    design = parse_design(document)
    assert design.array.names == ("a", "b")
    assert design.circuit.terminations == ("short", "open")
    assert design.array.conductors()[1].vertices[1, :2] == pytest.approx([20e-3, 5e-3])


def test_lattice_colours_keep_neighbours_apart():
    text = changed('lattice = "linear"', 'lattice = "hexagonal"').replace("columns = 3", "columns = 3\nrows = 3")
    text = text.replace('["L3", "L4"]]', '["L3", "L4"], ["L1", "L3"]]')
    array = parse_design(text).array
    for i, a in enumerate(array.placements):
        for b in array.placements[i + 1 :]:
            if math.hypot(a.x - b.x, a.y - b.y) < 11.1e-3:
                assert a.layers != b.layers


BAD = {
    "unknown key": (changed("gap_mm", "gap_um"), r"coils.hexagon has no key 'gap_um'; did you mean gap_mm\?.*Allowed"),
    "unknown table": (BASE + "\n[magnet]\nx = 1\n", "the design has no key 'magnet'"),
    "unknown key deep down": (changed("drill_mm = 0.25", "dril_mm = 0.25"), "coils.hexagon.via has no key 'dril_mm'"),
    "wrong unit": (changed("pitch_mm = 11.0", "pitch_cm = 1.1"), "array has no key 'pitch_cm'"),
    "wrong type": (
        changed("turns_per_layer = 12", 'turns_per_layer = "12"'),
        "coils.hexagon.turns_per_layer must be a number; got '12'",
    ),
    "boolean for a number": (changed("gap_mm = 0.15", "gap_mm = true"), "coils.hexagon.gap_mm .*; got True"),
    "zero": (changed("gap_mm = 0.15", "gap_mm = 0"), "coils.hexagon.gap_mm must be greater than 0; got 0"),
    "negative": (changed("trace_width_mm = 0.15", "trace_width_mm = -1"), "trace_width_mm must be greater than 0; got -1"),
    "nan": (changed("pitch_mm = 11.0", "pitch_mm = nan"), "array.pitch_mm must be a finite number; got nan"),
    "infinite": (changed("pitch_mm = 11.0", "pitch_mm = inf"), "array.pitch_mm must be a finite number; got inf"),
    "two sides": (changed("sides = 6", "sides = 2"), "coils.hexagon.sides must be at least 3; got 2"),
    "missing": (changed("pitch_mm = 11.0", ""), "array.pitch_mm is missing"),
    "no shape": (changed('shape = "polygon"', ""), "coils.hexagon.shape must be 'polygon', 'circle' or 'path'; got nothing"),
    "wrong shape": (changed('"polygon"', '"star"'), "coils.hexagon.shape must be .*; got 'star'"),
    "wrong lattice": (changed('"linear"', '"cubic"'), "array.lattice must be .*; got 'cubic'"),
    "two sizes": (
        changed("outer_across_flats_mm = 16.0", "outer_across_flats_mm = 16.0\nouter_across_corners_mm = 17.0"),
        "coils.hexagon needs exactly one of outer_across_flats_mm and outer_across_corners_mm",
    ),
    "too many turns": (
        changed("turns_per_layer = 12", "turns_per_layer = 40"),
        r"coils.hexagon: 40 turns of 0.15 mm trace and 0.15 mm gap do not fit into 8 mm from edge to centre; at most",
    ),
    "odd fraction of a turn": (changed("turns_per_layer = 12", "turns_per_layer = 12.1"), "turns must be a multiple of 1/6"),
    "no room for the via": (changed("turns_per_layer = 12", "turns_per_layer = 26"), "coils.hexagon: there is no room for a pad of 0.5 mm"),
    "old schema": (changed("schema = 1", "schema = 7"), "schema must be at most 1; got 7"),
    "layer not there": (changed('["L3", "L4"]]', '["L3", "L9"]]'), "there is no copper layer 'L9'; the stack-up has L1, L2"),
    "layers do not match": (changed('["L3", "L4"]]', '["L3"]]'), "coil2 has 2 conducting layers and must be given as many"),
    "coil not there": (changed('coil = "hexagon"', 'coil = "octagon"'), "array.coil names no coil shape; .*got 'octagon'"),
    "stack-up lengths": (changed("[4.5, 4.5, 4.5]", "[4.5]"), "4 copper layers need 3 dielectric permittivities; got 1"),
    "assumed key": (BASE.replace('"circuit.short_resistance_ohm"', '"circuit.short_resistance"'), "did you mean circuit.short_resistance_ohm"),
    "termination of no coil": (
        changed('default_termination = "short"', 'default_termination = "short"\nterminations = { coil9 = "open" }'),
        "circuit.terminations.coil9 names no coil; there are coil1, coil2, coil3",
    ),
    "name": (changed('name = "starter"', 'name = "a b"'), "name may have letters, digits"),
    "names": (changed("columns = 3", 'columns = 3\nnames = ["a", "b"]'), "array.names must have 3 names"),
    "equal names": (changed("columns = 3", 'columns = 3\nnames = ["a", "b", "a"]'), "coil names must differ"),
    "far too large": (changed("pitch_mm = 11.0", "pitch_mm = 1e300"), "array.pitch_mm must be at most 10000; got 1e.300"),
    "far too high": (changed("height_mm = 3.0", "height_mm = 1e300"), "field.height_mm must be at most 100000; got 1e.300"),
    "far too many layers": (changed("winding_layers = 2", "winding_layers = 100000"), "winding_layers must be at most 64; got 100000"),
    "far too many sides": (changed("sides = 6", f"sides = {10**40}"), "sides must be at most 1000; got 1000"),
    "far too many coils": (changed("columns = 3", "columns = 1000000000"), "columns must be at most 1000; got"),
    "too many segments": (
        changed("sides = 6", "sides = 1000").replace("turns_per_layer = 12", "turns_per_layer = 900").replace("_width_mm = 0.15", "_width_mm = 0.001").replace("gap_mm = 0.15", "gap_mm = 0.001"),
        "coils.hexagon: a coil may have 100000 segments; this one has 1800000",
    ),
    "a long number": (changed("pitch_mm = 11.0", f"pitch_mm = 1{'0' * 300}"), "array.pitch_mm must be at most 10000; got 10*…"),
    "boolean schema": (changed("schema = 1", "schema = true"), "schema must be a whole number; got True"),
    "key with a space": (BASE.replace("[coils.hexagon", '[coils."a b"'), "coils.a b may have letters, digits"),
    "no layers": (changed('[["L1", "L2"], ["L3", "L4"]]', "[]"), r"array.layers must have at least 1 entries; got \[\]"),
    "equal sheets": (BASE + '\n[[elastomer]]\nname = "base"\nthickness_mm = 1.0\n', "elastomer sheets must have different names"),
    "thick plating": (changed("plating_um = 25", "plating_um = 200"), "coils.hexagon: plating must be below half the drill of 0.25 mm; got 0.2 mm"),
    "thirds of a turn": (changed("turns_per_layer = 12", "turns_per_layer = 11.33"), "for example 11.3333333333; got 11.33"),
    "nested too deeply": (BASE + "\nx = " + "[" * 5000, "not valid TOML"),
    "unknown coil in a scan": (BASE + '\n[[scan]]\nname = "s"\nmeasure = ["coil9"]\n', "state s names the coil 'coil9'; there are coil1"),
    "unknown state in a scan": (BASE + '\n[[scan]]\nname = "s"\nmeasure = ["coil1"]\nothers = "loose"\n', "scan.0.others must be 'ground', 'ground one end', 'ground other end', 'open' or 'load'; got 'loose'"),
    "scan states of one name": (BASE + 2 * '\n[[scan]]\nname = "s"\nmeasure = ["coil1"]\n', "scan must name each state differently"),
    "not TOML": (BASE + "\n[[[", "not valid TOML"),
    "empty": ("", "schema is missing"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_designs_are_one_clear_line(case):
    text, message = BAD[case]
    with pytest.raises(DesignError, match=message) as caught:
        parse_design(text, origin="file.toml")
    line = str(caught.value)
    assert line.startswith("file.toml: ")
    assert "\n" not in line
    assert "pydantic" not in line


def test_self_crossing_path():
    text = """
schema = 1
name = "knot"
stackup = { layers = ["top"], copper_thickness_um = [35] }
[coils.knot]
shape = "path"
trace_width_mm = 0.2
gap_mm = 0.2
lines_mm = [[[0, 0], [4, 0], [4, 4], [2, 4], [2, -2]]]
[array]
lattice = "free"
placements = [{ name = "a", coil = "knot", layers = ["top"], x_mm = 0, y_mm = 0 }]
"""
    with pytest.raises(
        DesignError, match=r"coils.knot: layer 0 of a coil crosses itself: segments 0 and 3 .*\(2, 0\) mm"
    ):
        parse_design(text)


def test_scan_plan():
    default = parse_design(BASE).circuit.plan
    assert [state.name for state in default] == ["coil1", "coil2", "coil3"]
    text = changed('default_termination = "short"', 'default_termination = "short"\nterminations = { coil3 = "open" }')
    assert dict(parse_design(text).circuit.plan[0].exceptions) == {"coil3": "open"}
    scan = '\n[[scan]]\nname = "pair"\nmeasure = ["coil1", "-coil2"]\nconnection = "parallel"\nothers = "load"\nload_ohm = 75\n'
    (state,) = parse_design(BASE + scan).circuit.plan
    assert state.measured == (("coil1", 1), ("coil2", -1))
    assert (state.connection, state.others, state.load_resistance) == ("parallel", "load", 75)


def test_byte_order_mark(tmp_path):
    path = tmp_path / "notepad.toml"
    path.write_text(BASE, encoding="utf-8-sig")
    assert load_design(path).name == "starter"


def test_unreadable_files(tmp_path):
    with pytest.raises(DesignError, match="must not be empty"):
        load_design("")
    with pytest.raises(DesignError, match=r"cannot read 'a.x00b'"):
        load_design("a\0b")
    with pytest.raises(DesignError, match=r"there is no design file .*nor a bundled design"):
        load_design(tmp_path / "none.toml")
    with pytest.raises(DesignError, match=r"cannot read .*: Is a directory"):
        load_design(tmp_path)
    binary = tmp_path / "b.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(DesignError, match="is no text file in UTF-8"):
        load_design(binary)


def test_values_and_given():
    design = parse_design(BASE)
    assert design.values["coils.hexagon.gap_mm"] == 0.15
    assert design.values["array.rows"] == 1
    assert "array.rows" not in design.given
    document = tomllib.loads(BASE)
    assert "coils.hexagon.via.drill_mm" in design.given
    assert document["name"] == design.name
