"""Entries of a design changed one by one: the same as writing them into the file, and refused in the same words.

Checked against each other: `vary` and the text of a changed file; a change and its way back; many at once and one
after the other.
"""

# ruff: noqa: E501 - each case is one line of input and one of output
import copy
import pickle
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.refusals import refused

from coilarray.design.bundled import names, read
from coilarray.design.model import build_design_file, load_design_file, parse_design_file
from coilarray.design.vary import vary, vary_document
from coilarray.errors import DesignError

FILE = load_design_file("gast2020")
GAST = FILE.design
DESCRIBES = ("assumed", "name", "title", "source", "schema")  # entries of no number


@pytest.mark.parametrize("name", names())
def test_a_design_is_made_again_of_its_document(name):
    design = load_design_file(name)
    again = build_design_file(pickle.loads(pickle.dumps(design.document)), name)
    assert (again.design.digest, again.values, again.given, again.assumed) == (
        design.design.digest, design.values, design.given, design.assumed,
    )  # fmt: skip


@pytest.mark.parametrize("name", names())
def test_every_entry_set_to_what_it_is_changes_nothing(name):
    design = load_design_file(name)
    entries = [key for key in design.given if key.partition(".")[0] not in DESCRIBES]
    assert len(entries) > 20
    assert vary(design, {key: design.values[key] for key in entries}).digest == design.design.digest


@pytest.mark.parametrize(("change", "old", "new"), [
    ({"array.pitch_mm": 12.5}, "pitch_mm = 13.28", "pitch_mm = 12.5"),
    ({"coils.hexagon.turns_per_layer": 29.5}, "turns_per_layer = 30", "turns_per_layer = 29.5"),
    ({"coils.hexagon.via.drill_mm": 0.25}, "drill_mm = 0.2\n", "drill_mm = 0.25\n"),
    ({"array.layers": [["L1", "L2"], ["L3", "L4"]]}, '[["L3", "L4"], ["L1", "L2"]]', '[["L1", "L2"], ["L3", "L4"]]'),
    ({"array.layers.0": ["L1", "L2"]}, '[["L3", "L4"], [', '[["L1", "L2"], ['),
    ({"elastomer.1.thickness_mm": 3}, "thickness_mm = 2.0", "thickness_mm = 3.0"),
    ({"indentation.depths_mm.0": 0.5}, "depths_mm = [1.0]", "depths_mm = [0.5]"),
    ({"circuit.terminations.coil2": "open"}, "[circuit]", '[circuit]\nterminations = { coil2 = "open" }'),
    ({"board.through_holes": False}, "through_holes = true", "through_holes = false"),
    ({"array.columns": 4.0}, "columns = 6", "columns = 4"),
    ({"array.columns": np.int64(4), "array.pitch_mm": np.float64(14)}, "columns = 6\npitch_mm = 13.28", "columns = 4\npitch_mm = 14"),
    ({"stackup.copper_thickness_um": np.full(4, 70.0)}, "[35, 35, 35, 35]", "[70, 70, 70, 70]"),
    ({"array.rotation_deg": 60}, "direction_deg = 0", "direction_deg = 0\nrotation_deg = 60"),
    ({"fab.max_layers": 4}, "[fab]", "[fab]\nmax_layers = 4"),
], ids=lambda value: next(iter(value)) if isinstance(value, dict) else "")  # fmt: skip
def test_a_change_is_the_same_in_the_file(change, old, new):
    text = read("gast2020")
    assert old in text
    changed = build_design_file(vary_document(FILE.document, change), "gast2020")
    written = parse_design_file(text.replace(old, new, 1), "gast2020")
    assert (changed.values, changed.given) == (written.values, written.given)
    digest = written.design.digest
    assert digest == changed.design.digest == vary(FILE, change).digest == vary(GAST, change).digest != GAST.digest


def test_default_tables_can_be_varied():
    """[circuit], [board] and the via of a coil may all be left out of a file."""
    text = """
schema = 1
name = "small"
stackup = { layers = ["top"], copper_thickness_um = [35] }
array = { lattice = "linear", coil = "round.1", columns = 2, pitch_mm = 30.0, layers = [["top"]] }
[coils."round.1"]
shape = "circle"
outer_diameter_mm = 20.0
turns_per_layer = 5
winding_layers = 1
trace_width_mm = 0.2
gap_mm = 0.2
"""
    small = parse_design_file(text)
    changes = {"circuit.capacitance_pF": 330, "board.margin_mm": 1.5, "coils.round.1.via.drill_mm": 0.3}
    changed = vary(small, changes)
    assert changed.circuit.capacitance == pytest.approx(330e-12)
    assert changed.array.board_margin == pytest.approx(1.5e-3)
    assert changed.array.placements[0].coil.via.drill == pytest.approx(0.3e-3)  # a coil's name may have dots
    assert build_design_file(vary_document(small.document, changes)).given == small.given | set(changes)
    ring = vary(small, {"array.lattice": "square", "array.rows": 2, "coils.round.1.outer_diameter_mm": 21.0})
    assert len(ring.array.placements) == 4
    assert np.ptp(ring.array.placements[0].coil.outline[:, 0]) == pytest.approx(21e-3, abs=2e-6)  # points beside arcs


def test_the_design_and_its_document_stay_as_they_are():
    before = copy.deepcopy(FILE.document)
    changed = vary_document(FILE.document, {"elastomer.0.thickness_mm": 5.0, "array.layers.1": ["L4", "L3"]})
    assert FILE.document == before
    assert changed["elastomer"][0]["thickness_mm"] == 5
    assert changed["elastomer"][1] is FILE.document["elastomer"][1]  # what did not change is shared, not copied
    assert changed["coils"] is FILE.document["coils"]


@pytest.mark.slow
@settings(max_examples=20)
@given(
    changes=st.fixed_dictionaries(
        {
            "array.pitch_mm": st.floats(12.0, 20.0), "coils.hexagon.turns_per_layer": st.integers(5, 30),
            "array.columns": st.integers(1, 4), "circuit.default_termination": st.sampled_from(["short", "open"]),
        }
    )
)  # fmt: skip
def test_many_at_once_one_after_the_other_and_back(changes):
    once = vary(vary(GAST, {"indentation.origin": "coil1"}), changes)
    stepwise = vary(GAST, {"indentation.origin": "coil1"})
    for key, value in reversed(changes.items()):
        stepwise = vary(stepwise, {key: value})
    assert stepwise.digest == once.digest
    back = vary(once, {key: FILE.values[key] for key in (*changes, "indentation.origin")})
    assert back.digest == GAST.digest


BAD = {
    "unknown key": ({"array.pich_mm": 1}, "gast2020: array has no key 'pich_mm'; did you mean pitch_mm?"),
    "unknown coil shape": ({"coils.hexagn.gap_mm": 1}, "gast2020: coils.hexagn.gap_mm names no coil shape; did you mean coils.hexagon? [coils] has hexagon."),
    "nothing like it": ({"coils.q.gap_mm": 1}, "gast2020: coils.q.gap_mm names no coil shape; [coils] has hexagon."),
    "a table": ({"array": 1}, "gast2020: array is a table; name one of its entries, such as array.lattice."),
    "a coil": ({"coils.hexagon": {}}, "gast2020: coils.hexagon is a table; name one of its entries, such as coils.hexagon.shape."),
    "all coils": ({"coils": {}}, "gast2020: coils is a table; name one of its entries, such as coils.hexagon."),
    "a list of tables": ({"elastomer": []}, "gast2020: elastomer is a table; name one of its entries, such as elastomer.0.name."),
    "a table of a list": ({"elastomer.1": {}}, "gast2020: elastomer.1 is a table; name one of its entries, such as elastomer.1.name."),
    "past the end": ({"elastomer.2.thickness_mm": 1}, "gast2020: elastomer.2.thickness_mm must have a number from 0 to 1 or a name (base, magnetic) for '2'."),
    "an unknown name": ({"elastomer.top.thickness_mm": 1}, "gast2020: elastomer.top.thickness_mm must have a number from 0 to 1 or a name (base, magnetic) for 'top'."),
    "beyond a value": ({"array.pitch_mm.x": 1}, "gast2020: array.pitch_mm.x goes beyond an entry whose value is 13.28."),
    "assumed": ({"assumed.array": "so"}, "gast2020: assumed.array cannot be varied: [assumed] says why values are as they are."),
    "name": ({"name": "b"}, "gast2020: name cannot be varied: it names the design and changes no number."),
    "schema": ({"schema": 2}, "gast2020: schema cannot be varied: it says how the file is to be read."),
    "unknown coil": ({"circuit.terminations.coil9": "open"}, "gast2020: circuit.terminations.coil9 names no coil; there are coil1"),
    "a text for a number": ({"array.pitch_mm": "13"}, "gast2020: array.pitch_mm must be a number; got '13'."),
    "a part of a column": ({"array.columns": 2.5}, "gast2020: array.columns must be a whole number; got 2.5."),
    "not finite": ({"array.pitch_mm": float("nan")}, "gast2020: array.pitch_mm must be a finite number; got nan."),
    "negative": ({"array.pitch_mm": -1.0}, "gast2020: array.pitch_mm must be greater than 0; got -1."),
    "empty": ({"": 1}, "gast2020: the file has no key ''"),
    "a table for a number": ({"array.pitch_mm": {"mm": 3}}, "gast2020: array.pitch_mm must be a number; got {'mm': 3}."),
    "too many turns": ({"coils.hexagon.turns_per_layer": 90, "coils.hexagon.gap_mm": 0.07}, "gast2020: coils.hexagon: 90 turns of 0.1 mm trace and 0.07 mm gap do not fit"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_is_one_clear_line(case):
    changes, message = BAD[case]
    refused(DesignError, f"^{re.escape(message)}", vary, GAST, changes)
