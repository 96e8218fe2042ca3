"""Tables and figure of a tolerance analysis, of numbers that are known."""

import csv
import io

import numpy as np
import pytest
import xarray as xr
from support.tolerance_boards import loops

from coilarray.report import studies as tables
from coilarray.studies.tolerance import Spread, Tolerances, analyse
from coilarray.studies.tolerance.tolerances import Limit
from coilarray.viz.plots.studies import tolerance_figure

K, L = "k[upper,lower]", "inductance_uH[upper]"
SPREADS = {"etch": Spread(board=1e-6, layer=2e-6), "dielectric": Spread("uniform", board=0.01)}


@pytest.fixture(scope="module")
def linear():
    return analyse(loops(), Tolerances(SPREADS, {"etch": "a guess"}), samples=0, quantities=[K, L])


@pytest.fixture(scope="module")
def sampled():
    limits = (Limit(K, at_most=0.255), Limit(L, at_least=0.0))
    return analyse(loops(), Tolerances(SPREADS, limits=limits), samples=16, quantities=[K, L])


def rows_of(table):
    return {row[0]: dict(zip([column.key for column in table.columns], row, strict=True)) for row in table.rows}


@pytest.mark.slow
def test_tables_have_the_numbers_of_the_analysis(sampled, linear):
    """The command's files are held against the library in tests/cli/test_tolerance.py."""
    rows = rows_of(tables.spread_table(sampled))
    for name in (K, L):
        assert (rows[name]["low"], rows[name]["high"]) == tuple(sampled.percentiles.sel(output=name).values.tolist())
        shares = [row[3] for row in tables.share_table(linear).rows if row[0] == name]
        assert shares == sorted(shares, reverse=True)
        assert sum(shares) == pytest.approx(1, rel=1e-12)
    assert rows[K]["largest"].startswith("dielectric, board ")
    assert "nan" not in tables.spread_table(linear).csv().lower()
    assert tables.yield_table(linear).rows == ()
    rows = rows_of(tables.error_table(linear))
    assert [rows[name]["assumed"] for name in ("etch, board", "dielectric, board")] == ["a guess", ""]
    given = tables.given_table(linear).cells()
    assert given == [["etch", "normal", "1", "2", "µm", "a guess"], ["dielectric", "uniform", "1", "", "%", ""]]
    yields = {name: row["sample_yield"] for name, row in rows_of(tables.yield_table(sampled)).items()}
    assert list(yields) == [f"{K} ≤ 0.255", f"0 ≤ {L}", "all limits"]
    assert yields["all limits"] == yields[f"{K} ≤ 0.255"] < yields[f"0 ≤ {L}"] == 1
    read = list(csv.DictReader(io.StringIO(tables.sample_table(sampled).csv())))
    assert len(read) == 16
    assert float(read[3][K]) == sampled.value.sel(output=K).values[3]
    assert float(read[3]["etch, board (m)"]) == sampled.error.values[3, 0]
    hard = Tolerances({"etch": Spread(board=12e-6)})  # some boards cannot be made
    rows = tables.sample_table(analyse(loops(), hard, samples=32, quantities=[K])).records()
    failed = [row for row in rows if row["failure"]]
    assert failed
    assert all(row[K] == "" and "no board" in row["failure"] for row in failed)


def test_bars_end_at_all_of_the_variance(linear):
    figure = tolerance_figure(linear)
    (ax,) = figure.axes
    ends = {}
    for bar in ax.patches:
        row = round(bar.get_y() + bar.get_height() / 2)
        ends[row] = max(ends.get(row, 0.0), bar.get_x() + bar.get_width())
    assert ends == pytest.approx({0: 100.0, 1: 100.0}, rel=1e-9)
    assert [text.get_text() for text in ax.get_yticklabels()] == [K, L]
    only = analyse(loops(), Tolerances({"capacitance": Spread(board=0.01)}), samples=0, quantities=[K])
    assert isinstance(only, xr.Dataset)
    (ax,) = tolerance_figure(only).axes
    assert {bar.get_width() for bar in ax.patches} == {0.0}


def test_every_drawn_output_has_a_histogram_with_its_limits(sampled):
    figure = tolerance_figure(sampled)
    _, first, second = figure.axes
    assert [ax.get_xlabel() for ax in (first, second)] == [K, L]
    # densities over all boards
    areas = [sum(bar.get_width() * bar.get_height() for bar in ax.patches) for ax in (first, second)]
    assert areas == pytest.approx([1, 1], rel=1e-9)
    vertical = [line.get_xdata()[0] for line in first.lines if len(set(line.get_xdata())) == 1]
    assert vertical == [0.255]
    curve = first.lines[0]
    deviation = float(sampled.linear_deviation.sel(output=K))
    # a normal density has its peak at 1/(σ √(2π)); 200 points miss it by little
    assert max(curve.get_ydata()) == pytest.approx(1 / (deviation * np.sqrt(2 * np.pi)), rel=1e-3)
    assert len(tolerance_figure(sampled, [L]).axes) == 2


@pytest.mark.parametrize(("outputs", "message"), [(["nothing"], "no output 'nothing'"), ([], "got none")])
def test_other_outputs_are_refused(sampled, outputs, message):
    with pytest.raises(ValueError, match=message):
        tolerance_figure(sampled, outputs)
