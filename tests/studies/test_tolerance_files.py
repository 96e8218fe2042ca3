"""Tolerance files: units, defaults that are marked as assumed, and every mistake in one line."""

import math
import re
from collections import Counter

import pytest
from support.tolerance_boards import loops

from coilarray import load_design
from coilarray.errors import GoalError
from coilarray.studies.tolerance import (
    Limit,
    Positions,
    Spread,
    Tolerances,
    contributors,
    load_tolerances,
    parse_tolerances,
    typical_text,
)

EVERY_TABLE = """
schema = 1
others = "none"
quantities = ["worst_k", "rms_k"]
etch = { board_um = 5, layer_um = 2.5 }
registration = { distribution = "uniform", layer_um = 30 }
rotation = { layer_mrad = 0.2 }
dielectric = { board_percent = 3 }
copper = { layer_percent = 4 }
placement = { board_mm = 0.1 }
permeability = { board_percent = 5 }
elastomer = { layer_mm = 0.05 }
capacitance = { distribution = "uniform", board_percent = 5 }
plate_distance = { board_mm = 0.02, layer_mm = 0.03 }
plate_thickness = { layer_percent = 2 }
conductivity = { board_percent = 3 }
target_tilt = { board_mrad = 6 }
positions = { x_mm = [-26, 0], y_mm = [4], depth_mm = 1, noise = 2e-5 }
limit = [{ quantity = "worst_k", at_most = 0.06 }, { quantity = "rms_k", at_least = 0.0, at_most = 0.03 }]
assumed = { etch = "a guess" }
"""


def test_every_table_is_read_in_si():
    read = parse_tolerances(EVERY_TABLE)
    wanted = {
        "etch": Spread("normal", 5e-6, 2.5e-6), "rotation": Spread("normal", 0.0, 0.2e-3),
        "registration": Spread("uniform", 0.0, 30e-6 / math.sqrt(3)),  # a half width
        "dielectric": Spread("normal", 0.03, 0.0), "copper": Spread("normal", 0.0, 0.04),
        "placement": Spread("normal", 0.1e-3, 0.0), "permeability": Spread("normal", 0.05, 0.0),
        "elastomer": Spread("normal", 0.0, 0.05e-3), "capacitance": Spread("uniform", 0.05 / math.sqrt(3), 0.0),
        "plate_distance": Spread("normal", 0.02e-3, 0.03e-3), "plate_thickness": Spread("normal", 0.0, 0.02),
        "conductivity": Spread("normal", 0.03, 0.0), "target_tilt": Spread("normal", 6e-3, 0.0),
    }  # fmt: skip
    assert read.spreads.keys() == wanted.keys()
    for name, spread in wanted.items():
        found = read.spreads[name]
        assert found.distribution == spread.distribution
        # one product in floating point
        assert (found.board, found.layer) == pytest.approx((spread.board, spread.layer), rel=1e-15)
    assert read.quantities == ("worst_k", "rms_k")
    assert read.positions == Positions((-0.026, 0.0), (0.004,), 0.001, 2e-5)
    assert read.limits == (Limit("worst_k", at_most=0.06), Limit("rms_k", 0.0, 0.03))
    assert read.assumed == {"etch": "a guess"}


def test_typical_values_are_all_assumed():
    typical = load_tolerances()
    assert typical.spreads.keys() == typical.assumed.keys() == parse_tolerances(EVERY_TABLE).spreads.keys()
    assert all(typical.assumed.values())
    assert parse_tolerances(typical_text()).spreads == typical.spreads


def test_tables_that_are_not_given_are_typical_and_assumed_or_have_no_error(tmp_path):
    text, typical, etch = "schema = 1\n[etch]\nlayer_um = 1", load_tolerances(), {"etch": Spread("normal", 0.0, 1e-6)}
    read = parse_tolerances(text)
    assert read.spreads == {**typical.spreads, **etch}
    assert read.assumed == {key: reason for key, reason in typical.assumed.items() if key != "etch"}
    path = tmp_path / "etch.toml"
    path.write_text('others = "none"\n' + text, encoding="utf-8")
    alone = load_tolerances(path)
    assert (alone.spreads, alone.assumed) == (etch, {})


def test_contributors_are_the_parts_that_a_design_has():
    design = load_design("gast2020")
    found, layers, axes = contributors(design, load_tolerances()), 4, 2
    assert Counter(one.table for one in found) == {
        "etch": 1 + layers, "registration": axes * (1 + layers), "rotation": 1 + layers, "dielectric": 1 + layers - 1,
        "copper": 1 + layers, "placement": axes, "permeability": 1, "elastomer": 1 + 2, "capacitance": 1,
    }  # fmt: skip
    assert len({one.name for one in found}) == len(found)
    (board,) = [one for one in found if (one.table, one.part) == ("dielectric", "board")]
    assert board.targets == ("dielectric.L1-L2", "dielectric.L2-L3", "dielectric.L3-L4")
    # loops without elastomer have no placement, permeability or sheet
    found = contributors(loops(), load_tolerances())
    assert {one.table for one in found} == {"etch", "registration", "rotation", "dielectric", "copper", "capacitance"}
    with pytest.raises(GoalError, match="no error of loops has a spread"):
        contributors(loops(), Tolerances({"permeability": Spread(board=0.1)}))


HEAD = "schema = 1\n"


@pytest.mark.parametrize(("text", "message"), [
    ("", "schema is missing"), ("schema = 2", "schema must be at most 1; got 2"),
    (HEAD + 'others = "all"', "others must be 'typical' or 'none'; got 'all'"),
    (HEAD + "[etching]", "did you mean etch?"),
    (HEAD + "[etch]\nboard_mm = 1", "etch has no key 'board_mm'; did you mean board_um?"),
    (HEAD + "[etch]\nboard_um = -1", "etch.board_um must be at least 0; got -1"),
    (HEAD + "[etch]\nboard_um = nan", "etch.board_um must be a finite number"),
    (HEAD + '[etch]\nboard_um = "5"', "etch.board_um must be a number"),
    (HEAD + '[etch]\ndistribution = "flat"', "etch.distribution must be 'normal' or 'uniform'; got 'flat'"),
    (HEAD + "[placement]\nlayer_mm = 1", "placement has no key 'layer_mm'"),
    (HEAD + "[placement]", "placement.board_mm is missing"),
    (HEAD + "[dielectric]\nboard_percent = 101", "dielectric.board_percent must be at most 100; got 101"),
    (HEAD + "quantities = [3]", "quantities.0 must be a text"),
    (HEAD + "[positions]\nx_mm = [0]\ny_mm = [0]", "positions.depth_mm is missing"),
    (HEAD + "[positions]\nx_mm = [1, 0]\ny_mm = [0]\ndepth_mm = 1", "positions needs x_mm that rise"),
    (HEAD + "[positions]\nx_mm = []\ny_mm = [0]\ndepth_mm = 1", "positions.x_mm must have at least 1 entry"),
    (HEAD + "[positions]\nx_mm = [0]\ny_mm = [0]\ndepth_mm = 0", "positions.depth_mm must be greater than 0"),
    (HEAD + "[positions]\nx_mm = [0]\ny_mm = [0]\ndepth_mm = 1\nnoise = 0", "positions.noise must be greater than 0"),
    (HEAD + '[[limit]]\nquantity = "rms_k"', "limit.0 needs at_least, at_most or both"),
    (HEAD + '[[limit]]\nquantity = "rms_k"\nat_least = 2\nat_most = 1', "limit.0 needs at_least up to at_most"),
    (HEAD + "[[limit]]\nat_most = 1", "limit.0.quantity is missing"),
    (HEAD + '[assumed]\netch = "x"', "assumed.etch does not name a table of errors of the file"),
])  # fmt: skip
def test_mistakes_are_one_line_that_names_the_file(tmp_path, text, message):
    path = tmp_path / "fab.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(GoalError, match=rf"^{re.escape(str(path))}: .*{re.escape(message)}.*\Z"):
        load_tolerances(path)
    with pytest.raises(GoalError, match="there is no tolerance file"):  # the others are those of any design file
        load_tolerances(tmp_path / "missing.toml")
