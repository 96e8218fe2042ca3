"""Page one of a report, its figures as parts of a page, and two designs beside each other."""

import json
import re
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.figure import Figure
from support import plot_results as results
from xarray import DataArray

from coilarray import viz
from coilarray.compute.table import Column, Table, html_text
from coilarray.design.boards import check_boards, made_verdict
from coilarray.design.fabs import load_profile
from coilarray.design.model import load_design_file, parse_design_file
from coilarray.errors import DesignError, MissingDependencyError
from coilarray.geometry import Sheet
from coilarray.geometry.rules import Margin
from coilarray.report import pdf
from coilarray.report.beside import write_beside
from coilarray.report.first_page import cards, verdict_lines
from coilarray.report.order import citations, order_table
from coilarray.report.page import draw
from coilarray.report.position import paper_table

LINE = """
schema = 1
name = "NAME"
author = "A. Person"
revision = "B"
[stackup]
layers = ["top"]
copper_thickness_um = [35]
[readout]
converter = "none"
[coils.one]
shape = "path"
trace_width_mm = 0.2
gap_mm = 0.2
lines_mm = [[[0, 0], [SIZE, 0], [SIZE, 4], [0, 4]]]
[array]
lattice = "free"
placements = [{ name = "a", coil = "one", layers = ["top"], x_mm = 0, y_mm = 0 }]
"""


def written(name, size):
    return parse_design_file(LINE.replace("NAME", name).replace("SIZE", str(size)), name)


def summary(*rows):
    """Rows of a summary: key, quantity, least, most, unit and place."""
    ends = Column("least", unit="1"), Column("most", unit="1")
    columns = (Column("key"), Column("quantity"), *ends, Column("unit"), Column("where"))
    return Table("summary", "Summary", columns, rows)


def test_cards_have_as_many_digits_as_are_known():
    found = summary(
        ("open_inductance", "L", 93.1391e-6, 93.6431e-6, "H", ""), ("frequency", "f", 1.39291e6, 1.40374e6, "Hz", ""),
        ("effective_inductance", "L_eff", 107.1329e-6, 108.8034e-6, "H", ""),
        ("largest_coupling", "largest |k|", "", 2.1e-5, "1", "a and b"),
        ("peak_delta", "peak δ, 1 mm deep", 1.11972e-3, 1.4647e-3, "1", ""),
        ("sigma_x_half", "σ of x, half of coils", 5.312e-6, "", "m", ""),
        ("sigma_x_most", "σ of x, 95 % of coils", 1.07e-4, "", "m", ""),
        ("sigma_y_half", "σ of y, half of coils", 1.07e-4, "", "m", ""),
        ("y_not_determined", "y not determined", 0.091, "", "1", ""),
    )  # fmt: skip
    shown = {card.name: (card.value, card.remark) for card in cards(found, written("line", 9).design)}
    assert shown["Inductance"] == ("93.1–93.6 µH", "L_eff 107–109 µH")
    assert shown["Frequency"][0] == "1.393–1.404 MHz"
    assert shown["Coupling"] == ("|k| < 0.0001", "a and b")
    assert shown["Response δ"] == ("0.11–0.15 %", "1 mm deep")
    assert shown["Position"] == ("σ_x 5.3 µm, σ_y 0.11 mm", "median; y unknown on 9.1 % of area")
    assert len(shown) == 6


def test_the_verdicts_name_the_tightest_place_and_what_is_assumed():
    file = load_design_file("charger_receiver")
    kept = Margin("drill", "L1", "a", 0.0, 0.2e-3, 0.2e-3, 1e-3, -2e-3)
    first, second, *_ = verdict_lines(file, [kept], summary(), ())
    assert (first.kind, second.kind) == ("ok", "warn")  # no converter is set
    assert load_profile("multi-cb-35um").title in first.text
    assert "drill 0.2 mm, exactly at its limit, of a on L1 at (1.0, −2.0) mm" in first.text
    broken = Margin("drill", "L1", "a", -0.1e-3, 0.2e-3, 0.1e-3, 1e-3, -2e-3)
    bad, *_ = verdict_lines(file, [broken, kept], summary(), ())
    assert bad.kind == "bad"
    assert "1 of 2" in bad.text
    assert "0.1 mm; its limit is 0.2 mm" in bad.text


def test_limits_that_nobody_gave_are_no_proof_that_a_board_can_be_made():
    kept = Margin("drill", "L1", "a", 0.0, 0.2e-3, 0.2e-3, 0.0, 0.0)
    loaded = {name: load_design_file(name) for name in ("gast2020", "starter", "charger")}
    house = load_profile("oshpark-4-layer")
    kinds = {name: made_verdict(file, [kept]).kind for name, file in loaded.items()}
    assert kinds == {"gast2020": "warn", "starter": "ok", "charger": "ok"}
    assert made_verdict(written("line", 9), [kept]).kind == "warn"  # all limits are defaults
    of_house = made_verdict(loaded["gast2020"], [kept], house)
    assert of_house.kind == "ok"
    assert house.title in of_house.text
    first, converter, *_ = verdict_lines(
        loaded["gast2020"], [kept], summary(
            ("quality_factor", "", 28.0, 29.0, "1", ""), ("loaded_quality_factor", "", 33.1, 34.3, "1", ""),
            ("parallel_resistance", "", 27e3, 28e3, "ohm", ""),
        ), (),
    )  # fmt: skip
    assert (first.kind, converter.kind) == ("warn", "ok")
    assert made_verdict(loaded["gast2020"], [kept]).text.partition(":")[0] in first.text
    assert "Q 33–34" in converter.text


def test_rows_that_are_alike_are_joined_and_their_places_left_out():
    columns = (Column("coil"), Column("x", unit="m"), Column("L", unit="H"))
    rows = (("c1", 0.0, 1e-6), ("c2", 1.0, 1.00001e-6), ("c3", 2.0, 2e-6))
    joined = Table("t", "T", columns, rows).alike("x")
    assert joined.rows == (("c1, 2", 1e-6), ("c3", 2e-6))
    apart = Table("t", "T", columns, rows[1:])
    assert apart.alike("x") is apart
    noted = Table("t", "T", columns, tuple((*row[:2], 1.5e-6) for row in rows)).with_common_note()
    assert (noted.headers, noted.notes) == (["coil", "x (mm)"], ("In all rows: L = 1.500 µH.",))
    text = Table("t", "L_1 & more", columns, rows, main=("coil", "L")).latex()
    assert r"\caption{L\_1 \& more}" in text
    assert text.count(r"\\") == 4
    assert "x (mm)" not in text
    page = Table("t", "T", columns, rows, main=("coil", "L")).html()
    assert page.count("class=more") == 4
    assert html_text("of L_eff, `L_eff`") == "of L<sub>eff</sub>, <code>L_eff</code>"


def test_a_figure_is_part_of_the_page_with_the_values_of_its_curves_and_maps():
    figure = Figure(figsize=(12.0, 4.0))
    left, right = figure.subplots(1, 2)
    left.plot([1, 10, 100], [0, 1, 4], label="one")
    left.set(xscale="log", xlabel="f (MHz)", ylabel="L (µH)")
    right.pcolormesh([0.0, 1.0, 2.0], [0.0, 1.0], np.array([[1.0, 2.0, 3.0], [4.0, np.nan, 6.0]]), shading="nearest")
    shown = draw("both", "Both, & more.", figure, width=6.0)
    ElementTree.fromstring(shown.image.replace("xlink:href", "href"))  # well formed
    assert float(re.search(r"width: (\d+)px", shown.image)[1]) <= 6.2 * 96
    assert ">f (MHz)</text>" in shown.image  # text that can be selected
    assert not re.search(r'id="(?!both-)|url\(#(?!both-)|[^(]#(202020|ffffff)[;"]', shown.image)
    curves, cells = json.loads(shown.axes)
    assert curves["x"] == {"ends": pytest.approx([0.794, 126], rel=1e-2), "log": True, "label": "f (MHz)"}
    ((group, name),) = curves["curves"]
    assert name == "one"
    assert f'id="both-{group}"' in shown.image
    assert cells["map"]["values"] == ["1 2 3", "4 nan 6"]
    assert (cells["map"]["x"], cells["map"]["y"]) == ([0.0, 2.0], [0.0, 1.0])


def test_cells_of_a_matrix_have_their_values_under_the_mouse():
    names = results.NAMES
    k = float(results.coupling().coupling[0, 1])
    (axis,) = json.loads(draw("coupling", "k", viz.plot_coupling(results.coupling())).axes)
    texts = {(x, y): text for x, y, text in axis["cells"]}
    assert texts[1, 0] == f"{names[0]}, {names[1]}: {k:.3f}".replace("-", "−")
    assert len(texts) == len(names) * (len(names) - 1)


def test_a_figure_of_too_many_paths_keeps_its_letters_and_takes_the_colour_of_the_page(monkeypatch):
    monkeypatch.setattr("coilarray.report.page._MOST_BYTES", 1000)
    image = draw("copper", "Copper.", viz.plot_copper(results.board(), "L1")).image
    assert "data:image/png" in image
    assert ">coil1</text>" in image
    assert "#ffffff" not in image.replace("var(--paper, #ffffff)", "")


def test_an_order_has_the_sizes_of_the_board_and_marks_what_is_assumed():
    file = load_design_file("gast2020")
    rows = {(row["part"], row["property"]): row for row in order_table(file, check_boards(file.design)).records()}
    assert rows["board", "size"]["order"] == "93.34 × 32.90 mm"
    assert rows["board", "copper"]["order"] == "4 layers of 35 µm (1 oz)"
    assert (rows["board", "copper"]["origin"], rows["board", "smallest trace"]["order"]) == ("assumed", "0.1 mm")
    for words in ("trace", "gap", "hole", "annular ring"):
        assert rows["board", f"smallest {words}"]["origin"] == "assumed"
    assert rows["board", "smallest gap"]["order"] == "0.067 mm"
    assert rows["indenter", "shape"]["order"] == "hemisphere, radius 2.5 mm"
    assert rows["tank", "capacitor"]["order"] == "120 pF, one, at the converter"
    assert rows["elastomer", "magnetic"]["order"].startswith("2 mm thick, 93.34 × 32.90 mm, to cover the board")
    file = load_design_file("charger")  # two boards, and capacitors of ports
    rows = {(row["part"], row["property"]): row for row in order_table(file, check_boards(file.design)).records()}
    assert rows["board receiver", "size"]["origin"] == ""
    assert rows["port of middle", "series capacitor"]["order"] == "220 nF"


def test_the_paper_is_compared_where_it_prints_a_number():
    one, two, three = (
        paper_table(DataArray([1.393e6, 1.404e6]), None).rows,
        paper_table(None, None).rows,
        citations(paper=True),
    )
    assert one == (("resonance (MHz)", "about 2", "1.39–1.40"),)
    assert two == ()
    assert "9 (2020), 319–326" in three[1]


def test_a_view_measures_the_board_and_a_section_has_every_layer():
    board = results.board()
    ax = viz.plot_board(board)
    x_min, y_min, x_max, y_max = np.multiply(board.bounds, 1e3)
    texts = [text.get_text() for text in ax.texts]
    assert {f"{x_max - x_min:.2f}", f"{y_max - y_min:.2f}", f"{1e3 * board.least_distance:.2f}"} <= set(texts)
    ax = viz.plot_stack(board.stackup, (Sheet("soft", 2e-3), Sheet("filled", 1e-3, 2.5)), pressed="ball")
    rows = {text.get_text(): text.get_position()[1] for text in ax.texts}
    names = ["ball", "filled", "soft", *(f"copper {name}" for name in board.stackup.names)]
    assert [rows[name] for name in names] == sorted((rows[name] for name in names), reverse=True)
    assert "1 mm, µr 2.5" in rows


@pytest.mark.slow
def test_two_designs_beside_each_other(tmp_path, pictures_of_nothing, monkeypatch):
    monkeypatch.setenv("COILARRAY_THREADS", "1")
    monkeypatch.setattr("coilarray.viz.rendering_problem", lambda: "no rendering in this test")
    monkeypatch.setattr("coilarray.report.page.board_page", lambda design: None)
    short, long = written("short", 9), written("long", 12)
    steps = []
    reports = write_beside([short, long], tmp_path, lambda *step: steps.append(step))
    assert [report.page for report in reports] == [tmp_path / name / "report.html" for name in ("short", "long")]
    assert steps[-1][0] == steps[-1][1]
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert page.count("<h3>Inductance</h3>") == page.count("<h3>Board</h3>") == 2
    assert 'href="long/report.html"' in page
    change = reports[1].data["coils"][0]["open_inductance_H"] / reports[0].data["coils"][0]["open_inductance_H"] - 1
    assert f"<td>+{100 * change:.1f} %</td>" in page
    assert "coils.one.lines_mm" in page[page.index("Inputs that differ") :]
    own = reports[0].page.read_text(encoding="utf-8")
    assert "revision B · A. Person" in own
    with pytest.raises(DesignError, match="different names; both are short"):
        write_beside([short, short], tmp_path)


def test_a_pdf_needs_a_browser(monkeypatch):
    monkeypatch.setattr("shutil.which", lambda name: None)
    with pytest.raises(MissingDependencyError, match="needs Chromium, Chrome or Edge, and none is installed"):
        pdf.browser()


@pytest.mark.slow
def test_a_page_is_printed(tmp_path):
    page = tmp_path / "report.html"
    page.write_text("<p>A page.</p>", encoding="utf-8")
    try:
        program = pdf.browser()
    except MissingDependencyError as error:
        pytest.skip(str(error))
    assert pdf.write_pdf(page, program).read_bytes().startswith(b"%PDF")
