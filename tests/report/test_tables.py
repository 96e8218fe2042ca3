"""Tables of datasets: names, units and digits come from the attributes, SI in the files."""

import re
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import coilarray as ca
from coilarray.circuit.board_circuit import board_circuit
from coilarray.cli import shared
from coilarray.compute.display_units import PER_MILLION, DisplayUnit, display_unit
from coilarray.compute.table import Column, Table, dataset_table
from coilarray.metal.finite_plates import worst_attributes
from coilarray.report import summary
from coilarray.report.response_tables import plate_table, response_table


@pytest.mark.parametrize(("unit", "numbers", "texts"), [
    (display_unit("H"), [58.0294e-6, -3e-12], ["58.0294", "0.0000"]),  # no minus zero
    (display_unit("Hz"), [1.9072405e6], ["1.9072"]), (display_unit("Pa"), [101325.5], ["101326"]),
    (display_unit(""), [12.0, 3.0], ["12", "3"]),
    (display_unit("1"), [0.05132, -0.00123, float("nan")], ["0.05132", "−0.00123", "nan"]),
    (display_unit("1"), [0.0], ["0"]), (PER_MILLION, [7.862349e-4], ["786.23"]),
    (DisplayUnit(digits=3, significant=True), [1.23456e-7, 98765.0], ["1.23·10⁻⁷", "9.88·10⁴"]),
])  # fmt: skip
def test_numbers_have_as_many_digits_as_people_need(unit, numbers, texts):
    assert unit.texts(numbers) == texts


def test_rows_are_the_combinations_of_the_coordinates():
    dataset = xr.Dataset(
        {
            "impedance": (("state", "frequency"), [[1.0, 2.0], [3.0, np.nan]], {"units": "ohm", "long_name": "Re Z"}),
            "count": ("state", [4, 5]),
            "kept": ("state", [True, False]),
        },
        {"frequency": ("frequency", [1e6, 2e6], {"units": "Hz"}), "state": ["a", "b"]},
    )
    columns = ("frequency", "state", "impedance", "count", "kept")
    table = dataset_table("t", "T", dataset, columns, {"count": PER_MILLION})
    assert table.headers == ["frequency (MHz)", "state", "Re Z (Ω)", "count (10⁻⁶)", "kept"]
    assert table.csv().splitlines() == [
        "frequency_Hz,state,impedance_ohm,count,kept",
        "1000000.0,a,1.0,4,True", "1000000.0,b,3.0,5,False", "2000000.0,a,2.0,4,True", "2000000.0,b,,5,False",
    ]  # fmt: skip
    assert table.records()[3]["impedance_ohm"] == ""
    assert table.cells()[3] == ["2.0000", "b", "", "5000000.00", "no"]


def test_csv_has_the_minus_sign_of_ascii():
    table = Table("t", "T", (Column("name"), Column("x", unit="m")), (("x0 − Table A1", -1e-3),))
    assert table.csv() == "name,x_m\nx0 - Table A1,-0.001\n"
    assert table.cells() == [["x0 − Table A1", "−1.000"]]


@pytest.mark.parametrize("worst", [11e-3, 13e-3, np.inf])
def test_a_position_is_determined_to_less_than_the_size_of_a_coil(worst):
    """Of forty places one is beyond the coils of 12 mm, and two have a larger σ than all others."""
    sigma, over = np.linspace(1e-5, 38e-5, 38), np.arange(40) != 0
    sigma = np.concatenate(([1e-6], sigma, [worst]))[None]
    axes = {"y": [0.0], "x": np.arange(40) * 1e-3, "over_coils": (("y", "x"), over[None])}
    about = {"noise": [1e-6], "common_noise": [0.0], "coil_size": 12e-3}
    both = dict.fromkeys(("sigma_x", "sigma_y"), (("y", "x"), sigma))
    rows = list(summary._position_rows(xr.Dataset(both, axes, about)))
    least, half, most, *rest = rows[: len(rows) // 2]
    assert [row[2:] for row in rows[len(rows) // 2 :]] == [row[2:] for row in rows[: len(rows) // 2]]
    assert (least[2], least[-1]) == (1e-5, "at x 1, y 0 mm; noise of δ 1·10⁻⁶")
    assert (half[2], most[2]) == pytest.approx((20e-5, 38e-5))  # of 39 places 20 and 38, which is more than 95 %
    if worst < 12e-3:
        assert rest == []
        return
    ((_, _, share, _, _, where),) = rest
    assert share == pytest.approx(1 / 39)
    assert where == "of the coils' area: σ is above the 12 mm of a coil, as at x 39, y 0 mm"


def test_a_summary_has_the_least_and_most_of_what_is_finite():
    """A self-resonance that is not found is infinite, which neither JSON nor a person can read."""
    names = ["a", "b", "c"]
    of = {"least": [3e6, np.inf, 2e6], "one": [np.inf, 1e6, np.inf], "none": [np.inf] * 3}
    rows = [summary._row("f", words, names, np.array(values), "Hz") for words, values in of.items()]
    assert [row[1:] for row in rows] == [
        ("least", 2e6, 3e6, "Hz", "c; a"),
        ("one", 1e6, "", "Hz", "b"),
        ("none", "", "", "Hz", ""),
    ]


def test_a_largest_response_at_the_edge_or_of_nothing_is_said_to_be_that():
    x, y = np.linspace(-4e-3, 4e-3, 5), np.linspace(-2e-3, 2e-3, 3)
    across, up = np.meshgrid(x, y)
    inside = 1e-3 * np.exp(-(across**2 + up**2) / 4e-6)
    states = {"in": inside, "off": np.roll(inside, 2, axis=1), "none": np.zeros_like(inside)}
    delta = np.stack(list(states.values()), axis=-1)[None]
    of = xr.Dataset(
        {"delta": (("depth", "y", "x", "state"), delta)}, {"depth": [1e-3], "y": y, "x": x, "state": list(states)}
    )
    rows = response_table(of).records()
    assert [row["remark"] for row in rows] == ["", "at the edge of the map", "no response"]
    assert [row["peak_x_m"] for row in rows] == [0.0, 4e-3, ""]
    # a map of one line has no edge beside it
    assert response_table(of.isel(y=[1], state=[0])).records()[0].get("remark", "") == ""


def test_a_page_leaves_out_columns_that_say_nothing():
    columns = (
        *map(Column, ("coil", "f", "again", "zero", "kept", "empty", "share", "x", "y")),
        Column("ohm", unit="Ω"),
    )
    rows = (
        ("a", 1.0, 1.0, 0.0, False, "", 0.0, 1.0, 1.0, 1.0),
        ("b", 2.0, 2.0 * (1 + 1e-15), 0.0, False, "", 0.5, 2.0, 2.0, 2.0),
    )
    table = Table("t", "T", columns, rows).brief()
    assert [column.name for column in table.columns] == ["coil", "f", "kept", "share", "x", "y", "ohm"]
    assert table.rows[1] == ("b", 2.0, False, 0.5, 2.0, 2.0, 2.0)


@pytest.mark.slow
def test_plates_with_an_outline_say_what_their_model_errs():
    """A coin within the coils has its losses in its rim; a plate without end has no such error."""
    copper = ca.MATERIALS["copper"]
    back = ca.Plate("back", -6e-3, 1e-3, copper)
    coin = ca.FinitePlate("coin", ca.Disc(3e-3), (0.0, 0.0, -3.5e-3), 1e-3, copper)
    design = replace(ca.load_design("starter"), plates=(back, coin))
    first, second = plate_table(design, 2e6).records()
    assert (first["inductance_error"], first["resistance_error"]) == ("", "")
    assert second["thickness_over_skin_depth"] == pytest.approx(21.4, abs=0.1)
    assert 0 < second["inductance_error"] < 0.03
    assert 0.13 < second["resistance_error"] < 0.17
    assert "resistance_error" not in plate_table(replace(design, plates=(back,)), 2e6).records()[0]
    # the commands have both in one line
    (line,) = shared.plate_error_lines(worst_attributes([board_circuit(design).plate_errors(2e6)["coin"]]))
    assert re.search(r"up to [\d.]+ % of ΔL and 1[3456] % of ΔR \(.* 21 skin depths thick\)$", line)
    assert not shared.plate_error_lines({})
