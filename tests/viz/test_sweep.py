"""Figures of sweeps: every number at its place, in lines, maps and dots."""

import numpy as np
import pytest
import xarray as xr
from matplotlib.collections import QuadMesh

from coilarray.viz.plots.studies import MOST_PANELS, sweep_figure

PITCH = ("array.pitch_mm", [10.0, 12.0, 14.0, 16.0], {"units": "mm", "design_value": 13.0})
COLUMNS = ("array.columns", [2, 3, 6], {"units": "1", "design_value": 9})
TANK = ("circuit.tank", np.array(["coil", "converter"], dtype=object), {"design_value": "coil"})


def result(*axes, quantities=("worst_k", "span_mm"), sampled=False):
    """A made-up sweep, its values counting up."""
    dims = ("sample",) if sampled else tuple(name for name, _, _ in axes)
    shape = (len(axes[0][1]),) if sampled else tuple(len(values) for _, values, _ in axes)
    numbers = np.arange(float(np.prod(shape))).reshape(shape)
    variables = {
        name: (dims, numbers + 100 * k, {"units": "mm" if name.endswith("_mm") else "1"})
        for k, name in enumerate(quantities)
    }
    reason = (dims, np.full(shape, "", dtype=object))
    coordinates = {name: ("sample" if sampled else name, values, attrs) for name, values, attrs in axes}
    return xr.Dataset({**variables, "reason": reason}, coordinates)


def line(ax, k=0):
    return np.column_stack(ax.lines[k].get_data())


def test_one_entry_is_a_line_a_quantity_with_the_designs_own_value():
    first, second = sweep_figure(result(PITCH)).axes
    np.testing.assert_array_equal(line(first), [[10, 0], [12, 1], [14, 2], [16, 3]])
    np.testing.assert_array_equal(line(second)[:, 1], [100, 101, 102, 103])
    assert line(first, 1)[:, 0].tolist() == [13.0, 13.0]
    assert (first.get_ylabel(), second.get_ylabel()) == ("worst_k", "span_mm (mm)")
    swept = result(PITCH)
    swept["worst_k"][1] = np.nan
    ax = sweep_figure(swept).axes[0]
    assert np.isnan(line(ax)[1, 1])
    assert len(sweep_figure(result(COLUMNS)).axes[0].lines) == 1
    ax = sweep_figure(result(TANK)).axes[0]
    np.testing.assert_array_equal(line(ax), [[0, 0], [1, 1]])
    assert [text.get_text() for text in ax.get_xticklabels()] == ["coil", "converter"]
    assert len(ax.lines) == 1


def crosses(ax):
    found = [line.get_xydata() for line in ax.lines if line.get_marker() == "x"]
    return sorted(np.concatenate(found).tolist()) if found else []


@pytest.mark.parametrize("sampled", [False, True])
def test_points_that_break_rules_are_crossed_out(sampled):
    swept = result(PITCH, sampled=sampled)
    broken = swept.worst_k.copy(data=[2.0, 0.0, np.nan, 1.0])  # rules, of points with a result
    figure = sweep_figure(swept.assign(fab_broken=broken))
    first, second = figure.axes  # no panel of its own
    assert (crosses(first), crosses(second)) == ([[10, 0], [16, 3]], [[10, 100], [16, 103]])
    assert figure.get_supxlabel().startswith("×  breaks fabrication rules")
    assert "×" not in sweep_figure(swept.assign(fab_broken=0 * broken)).get_supxlabel()
    assert [ax.get_ylabel() for ax in sweep_figure(swept.assign(fab_broken=broken)[["fab_broken"]]).axes] == [
        "fab_broken"
    ]


@pytest.mark.parametrize("axes", [(PITCH, TANK), (TANK, PITCH)])
def test_a_number_and_a_text_are_a_line_a_text(axes):
    swept = result(*axes)
    ax = sweep_figure(swept).axes[0]
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    assert labels == ["coil", "converter"]
    for k, tank in enumerate(labels):
        np.testing.assert_array_equal(line(ax, k)[:, 1], swept.worst_k.sel({"circuit.tank": tank}))
    assert ax.get_xlabel() == "array.pitch_mm (mm)"


@pytest.mark.parametrize("descending", [False, True])
def test_two_numbers_are_a_map_grey_where_there_is_no_result(descending):
    pitch = (PITCH[0], PITCH[1][::-1] if descending else PITCH[1], PITCH[2])
    own = ("array.columns", [2, 3, 6], {"units": "1", "design_value": 3})
    swept = result(pitch, own)
    swept["worst_k"].loc[{"array.pitch_mm": 12.0, "array.columns": 3}] = np.nan
    ax = sweep_figure(swept).axes[0]
    (mesh,) = (artist for artist in ax.collections if isinstance(artist, QuadMesh))
    shown = mesh.get_array()
    assert shown.shape == (3, 4)
    assert np.ma.getmaskarray(shown)[1, 1]
    for k, columns in enumerate((2, 3, 6)):
        for j, at in enumerate((10.0, 12.0, 14.0, 16.0)):
            if (k, j) != (1, 1):
                assert shown[k, j] == swept.worst_k.sel({"array.pitch_mm": at, "array.columns": columns})
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("array.pitch_mm (mm)", "array.columns")
    np.testing.assert_array_equal(line(ax), [[13.0, 3.0]])  # the design's own place


@pytest.mark.slow
@pytest.mark.parametrize("sampled", [False, True])
def test_samples_and_larger_grids_are_dots_over_every_entry(sampled):
    if sampled:
        tanks = (TANK[0], np.array(["coil", "coil", "converter", "coil"], dtype=object), TANK[2])
        swept = result(PITCH, tanks, sampled=True)
    else:
        swept = result(PITCH, COLUMNS, TANK)
    figure = sweep_figure(swept)
    entries = 2 if sampled else 3
    assert len(figure.axes) == 2 * entries
    for ax, name in zip(figure.axes, ["worst_k"] * entries + ["span_mm"] * entries, strict=True):
        assert ax.get_ylabel().startswith(name)
    last = figure.axes[entries - 1]
    at, values = line(last).T
    table = swept.to_dataframe().reset_index()
    for text, place in (("coil", 0.0), ("converter", 1.0)):
        np.testing.assert_array_equal(
            np.sort(values[at == place]), np.sort(table.worst_k[table["circuit.tank"] == text])
        )


def test_resonances_share_a_panel():
    names = ("frequency_MHz[coil1]", "self_resonance_MHz[coil1]", "q[coil1]")
    swept = result(PITCH, quantities=names)
    swept[names[0]] = swept[names[0]] + 1.0  # no resonance is at zero
    swept[names[1]] = 10.0 * swept[names[0]]
    resonances, quality = sweep_figure(swept).axes
    assert [text.get_text() for text in resonances.get_legend().get_texts()] == list(names[:2])
    assert (resonances.get_ylabel(), resonances.get_yscale()) == ("resonance (MHz)", "log")
    np.testing.assert_array_equal(line(resonances, 1)[:, 1], swept[names[1]])
    assert quality.get_ylabel() == "q[coil1]"


def test_too_many_panels_are_refused():
    many = [f"quantity{k}" for k in range(MOST_PANELS + 1)]
    with pytest.raises(ValueError, match=f"1 to {MOST_PANELS} panels; it would have {MOST_PANELS + 1}"):
        sweep_figure(result(PITCH, quantities=many))
    with pytest.raises(ValueError, match="it would have 0"):
        sweep_figure(result(PITCH, quantities=()))
