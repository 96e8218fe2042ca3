"""The web page of a scene: what Chromium shows of it without a network is what the scene holds, where it holds it."""

import io
import re
from pathlib import Path

import numpy as np
import pytest
import pyvista
from PIL import Image
from support import browser
from support.browser import expect
from support.patience import until

from coilarray.errors import MissingDependencyError
from coilarray.viz.offscreen import NO_RENDERING
from coilarray.viz.scenes.pictures import save_page
from coilarray.viz.scenes.scene import Part, Scale, Scene, Slider, Text

pytestmark = pytest.mark.slow

pytest.importorskip("trame_vtk", reason="trame-vtk is not installed")

WIDTH, HEIGHT = 900, 600
GREEN, RED, BLUE = [0, 158, 0], [213, 0, 0], [0, 0, 178]


def flat(x_min, x_max, z=0.0):
    return pyvista.Plane(center=((x_min + x_max) / 2, 5, z), i_size=x_max - x_min, j_size=10)


def scene():
    """A green plate, on its right half a red one, lines over both, and a plate coloured by a scale beside them."""
    coloured = flat(22, 30)
    coloured.cell_data["v (V)"] = np.full(coloured.n_cells, 2e-3)
    scale = Scale("v (V)", "voltage", "V", 0.0, 4e-3, "coolwarm")
    parts = (
        Part("plate", flat(0, 20), "plate", "#009e00", lit=False),
        Part("upper", flat(10, 20, 1.0), "upper <b>", "#d50000", lit=False),
        Part("rod", pyvista.Line((2, 5, 1), (8, 5, 1)), "upper <b>", "#0000b2", line_width=18.0, lit=False),
        Part("coloured", coloured, scale=scale, lit=False),
        Part("near", pyvista.Plane(center=(18, 9, 2), i_size=2, j_size=2), colour="#0000b2", lit=False, step=0),
        Part("far", pyvista.Plane(center=(12, 9, 2), i_size=2, j_size=2), colour="#0000b2", lit=False, step=1),
    )
    texts = (
        Text("left", (0.0, 0.0, 0.0)),
        Text("right & up", (20.0, 10.0, 1.0), 24.0, True, "upper <b>"),
        Text("behind", (0.0, 0.0, -30.0)),  # seen from above in the same place
        Text("above", (0.0, 10.0, 0.0), hidden_from=("front",)),
    )
    slider = Slider("distance", ("1 mm", "2 mm"), (("it is <near>",), ()))
    return Scene(parts, texts, ("first note", "a < b"), slider)


@pytest.fixture(scope="module")
def chromium():
    if (problem := browser.missing()) is not None:
        pytest.skip(problem)
    with browser.launched(*browser.SOFTWARE_GL) as started:
        yield started


@pytest.fixture(scope="module")
def opened(chromium, tmp_path_factory):
    """The page in a browser without a network, and what it asked for and complained of."""
    path = tmp_path_factory.mktemp("page") / "scene.html"
    save_page(scene(), path, title="six <coils>", side="top")
    context = browser.profile(chromium, offline=True, viewport={"width": WIDTH, "height": HEIGHT})
    page = context.new_page()
    asked, complaints = [], []
    page.on("request", lambda request: asked.append(request.url))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("console", lambda said: complaints.append(said.text) if said.type in ("error", "warning") else None)
    page.goto(path.as_uri())
    page.wait_for_selector("body[data-ready=yes]")
    yield page, asked, complaints, path
    context.close()


@pytest.fixture
def page(opened):
    return opened[0]


def pixels(page):
    return np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB")).astype(int)


def where(page, point):
    """Column and row of a point in mm, from the camera of vtk.js; seen from above without perspective."""
    x, y, _ = page.evaluate("scene.camera.getFocalPoint()")
    millimetre = HEIGHT / 2 / page.evaluate("scene.camera.getParallelScale()")
    return WIDTH / 2 + (point[0] - x) * millimetre, HEIGHT / 2 - (point[1] - y) * millimetre


def colour_at(page, point):
    column, row = where(page, point)
    return pixels(page)[round(row), round(column)].tolist()


def shows(page, point, colour):
    """Wait until a point has its colour, to a step or two of 256."""
    until(lambda: np.abs(np.subtract(colour_at(page, point), colour)).max() <= 3)


def middle(page, text):
    """Column and row of the middle of a word."""
    box = page.locator(".words span", has_text=text).bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def words_on(page):
    """The words that can be seen."""
    spans = page.locator(".words span")
    return {spans.nth(k).inner_text() for k in range(spans.count()) if spans.nth(k).is_visible()}


def test_it_asks_no_host_for_anything(opened):
    _, asked, complaints, path = opened
    assert asked == [path.as_uri()]
    assert [one for one in complaints if "GPU stall" not in one] == []
    text = path.read_text(encoding="utf-8")
    assert "default-src 'none'" in text
    # addresses that are left are comments of the library and never asked for
    assert not re.search(r"""(src|href)\s*=\s*["']?https?:""", text)


def test_every_mesh_is_where_it_belongs_in_its_colour(page):
    for point, colour in (((3, 2), GREEN), ((15, 5), RED), ((5, 5), BLUE), ((5, 5.1), BLUE)):
        shows(page, point, colour)
    assert colour_at(page, (21, 5)) == [255, 255, 255]
    middle = Scale("v", "v", "V", 0.0, 1.0, "coolwarm").colours_of([0.5])[0]
    shows(page, (26, 5), middle)
    canvas = pixels(page)
    assert (canvas.std(axis=2) > 20).mean() > 0.05  # the plates fill a seventh of what legend and bar leave


def test_words_stand_over_their_places_and_on_no_others(page):
    for text, point in (("left", (0, 0)), ("right & up", (20, 10))):
        until(lambda text=text, point=point: np.abs(np.subtract(middle(page, text), where(page, point))).max() < 1.0)
    # and go with them
    above = middle(page, "left")
    page.click("button[data-side=right]")
    until(lambda: middle(page, "left") != above)
    page.click("button[data-side=top]")
    until(lambda: middle(page, "left") == above)
    page.click("button[data-side=front]")
    until(lambda: words_on(page) == {"left", "right & up", "behind"})
    page.click("button[data-side=right]")
    until(lambda: "above" in words_on(page))
    page.click("button[data-side=top]")
    until(lambda: words_on(page) == {"left", "right & up", "above"})


def test_switches_hide_and_show_their_group(page):
    box = page.get_by_label("upper <b>")
    box.uncheck()
    shows(page, (15, 5), GREEN)
    shows(page, (5, 5), GREEN)
    expect(page.locator(".words span", has_text="right & up")).to_be_hidden()
    expect(page.locator(".words span", has_text="left")).to_be_visible()
    box.check()
    shows(page, (15, 5), RED)
    expect(page.locator(".words span", has_text="right & up")).to_be_visible()


def test_a_slider_shows_the_parts_and_lines_of_one_position(page):
    slider = page.get_by_label("distance")
    for step, blue, red, lines in ((1, (12, 9), (18, 9), 2), (0, (18, 9), (12, 9), 3)):
        slider.fill(str(step))
        shows(page, blue, BLUE)
        shows(page, red, RED)
        until(lambda lines=lines: len(page.locator(".notes").inner_text().splitlines()) == lines)
        expect(page.locator(".slider span")).to_have_text(f"distance: {step + 1} mm")


def test_legend_bar_and_notes_say_what_is_seen_beside_all_of_it(page):
    expect(page).to_have_title("six <coils>")
    expect(page.locator(".panel h1")).to_have_text("six <coils>")
    expect(page.locator(".panel label")).to_have_text(["plate", "upper <b>"])
    swatch = page.locator(".panel i").nth(1).evaluate("(one) => getComputedStyle(one).backgroundColor")
    assert swatch == "rgb(213, 0, 0)"
    expect(page.locator("figcaption")).to_have_text(["voltage (mV)"])
    expect(page.locator(".bars b")).to_have_text(["0", "1", "2", "3", "4"])
    until(lambda: page.locator(".notes").inner_text().splitlines() == ["first note", "a < b", "it is <near>"])
    panel, bars = page.locator(".panel").bounding_box(), page.locator(".bars").bounding_box()
    left, _ = where(page, (0, 0))
    right, _ = where(page, (30, 10))
    assert panel["x"] + panel["width"] < left
    assert right < bars["x"]


def test_a_frame_that_gets_its_size_late_shows_the_scene(chromium, opened):
    context = browser.profile(chromium, offline=True, viewport={"width": WIDTH, "height": HEIGHT})
    page = context.new_page()
    page.set_content('<iframe sandbox="allow-scripts" style="display: none"></iframe>')
    page.locator("iframe").evaluate("(frame, text) => { frame.srcdoc = text; }", opened[3].read_text(encoding="utf-8"))
    scene = page.frame_locator("iframe")
    scene.locator("canvas").wait_for(state="attached")
    assert scene.locator("canvas").evaluate("one => one.clientWidth") == 0
    page.locator("iframe").evaluate("frame => { frame.style = 'width: 800px; height: 500px'; }")
    scene.locator("body[data-ready=yes]").wait_for()
    scene.locator("canvas").wait_for()
    until(lambda: (np.ptp(pixels(page), axis=2) > 150).mean() > 0.05)  # the plates have strong colours
    expect(scene.locator(".words span", has_text="left")).to_be_visible()
    context.close()


@pytest.mark.usefixtures("without_trame_vtk")
def test_without_trame_vtk_it_is_refused_in_one_line(tmp_path):
    with pytest.raises(MissingDependencyError, match=r'pages need trame-vtk, .* -m pip install .*\[3d\]"'):
        save_page(scene(), tmp_path / "scene.html")
    assert not list(tmp_path.iterdir())


def test_it_is_made_without_a_graphics_driver_and_not_with_an_unknown_viewer(tmp_path, monkeypatch):
    monkeypatch.setenv(NO_RENDERING, "1")
    save_page(scene(), tmp_path / "scene.html")
    assert [entry.name for entry in tmp_path.iterdir()] == ["scene.html"]
    other = tmp_path / "viewer.html"
    other.write_text("<html><body></body></html>", encoding="utf-8")
    monkeypatch.setattr("trame_vtk.tools.vtksz2html.HTML_VIEWER_PATH", Path(other))
    with pytest.raises(MissingDependencyError, match="whose viewer this version knows"):
        save_page(scene(), tmp_path / "scene.html")
