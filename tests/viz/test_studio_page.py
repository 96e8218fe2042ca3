"""The studio in a real browser: what a user does on the page, and that the numbers there are the library's."""

import html
import os
import re
import shutil
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer
from threading import Thread
from urllib.parse import urlsplit

import numpy as np
import pytest
from support import browser
from support.browser import expect
from support.patience import until

from coilarray import load_design
from coilarray.circuit.coupling import design_circuit
from coilarray.circuit.network import resonate
from coilarray.design import bundled
from coilarray.design.model import build_design, load_design_file
from coilarray.design.vary import vary
from coilarray.electromagnetics.inductance import coupling_matrix
from coilarray.localize.forward import forward_model
from coilarray.viz.studio.metal import moved, target_table
from coilarray.viz.studio.numbers import numbers_of, reading_table, state_of

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("rendering", "chromium")]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("designs")


def served_page(**environment):
    """A page for most tests, and its studio."""

    @pytest.fixture(scope="module")
    def opened(chromium, folder):
        with browser.served("starter", "--folder", folder, **environment) as started:
            one = browser.Opened(chromium, started.url)
            yield one, started
            one.context.close()

    return opened


with_scenes, without_scenes = served_page(), served_page(COILARRAY_NO_RENDERING="1")
BOXES = "all => all.map(one => one.getBoundingClientRect()).map(one => [one.left, one.top, one.right, one.bottom])"
ALERTS = "[role=alert]:not(#scene-problem)"
# scenes cost more than all the rest: only tests with this mark have them
scenes = pytest.mark.parametrize("shared", ["with_scenes"], indirect=True)


@pytest.fixture
def shared(request):
    return request.getfixturevalue(getattr(request, "param", "without_scenes"))


@pytest.fixture
def studio(shared):
    return shared[1]


@pytest.fixture
def page(shared, request):
    """Each test begins with the design as it is and the first tab."""
    opened = shared[0]
    page = opened.page
    browser.at_rest(page)
    if page.locator(".v-overlay--active .v-card").count():  # a test that failed left a dialog open
        page.keyboard.press("Escape")
    page.click("#tab-numbers")
    if page.inner_text("#file") != "starter" or page.locator(ALERTS).count():
        page.evaluate("trame.trigger('open_design', ['starter', 'starter'])")
        page.wait_for_function(
            f"document.querySelector('#file').innerText === 'starter' && !document.querySelector('{ALERTS}')"
        )
    page.wait_for_function("document.querySelectorAll('#matrix td').length === 9")
    browser.at_rest(page)
    yield page
    browser.picture(page, request.node.name)
    wrong, opened.wrong[:] = list(opened.wrong), []
    assert wrong == []


def changed(**entries):
    """The starter design with other entries."""
    return vary(load_design("starter"), {key.replace("__", "."): value for key, value in entries.items()})


def k_of(design):
    return coupling_matrix(numbers_of(design).inductance)


def save(page, name):
    page.click("#save")
    page.fill("#save-name", name)
    page.click("#save-now")


def change(page, key, text):
    browser.enter(page, key, text)
    page.wait_for_selector("#changed")


def hold(page, selector, across=0.5, down=0.5):
    """Press the mouse on a part of the page; the place, and the part's width and height."""
    part = page.locator(selector).first
    part.scroll_into_view_if_needed()
    box = part.bounding_box()
    place = box["x"] + across * box["width"], box["y"] + down * box["height"]
    page.mouse.move(*place)
    page.mouse.down()
    return *place, box["width"], box["height"]


@contextmanager
def answering(port, text=b"here again"):
    """Another server where the studio was, or on a free port for 0; the port."""

    class Answer(BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(text)

        do_HEAD = do_GET  # noqa: N815 - the name that the base class calls

        def log_message(self, *_):
            pass

    with HTTPServer(("127.0.0.1", port), Answer) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield server.server_port
        server.shutdown()


def press_at(page, axis, text):
    page.fill(f"[data-axis={axis}] input", text)
    page.press(f"[data-axis={axis}] input", "Enter")


@scenes
def test_a_slider_changes_the_matrix_to_what_the_library_gives(page):
    page.evaluate("trame.trigger('open_design', ['gast2020'])")
    page.wait_for_function("document.querySelectorAll('#matrix td').length === 36")
    browser.at_rest(page)
    np.testing.assert_array_equal(browser.matrix(page), k_of(load_design("gast2020")))
    expect(browser.field(page, "array.pitch_mm")).to_have_value("13.28")
    clipped = "inputs => inputs.filter(one => one.scrollWidth > one.clientWidth).map(one => one.value)"
    shown = page.locator(".studio-entry input[type=text]:visible")
    until(lambda: shown.evaluate_all(clipped) == [])
    before = browser.drawn(page)
    page.locator("[data-key='array.pitch_mm'] [role=slider]").focus()
    page.keyboard.press("ArrowRight")
    page.wait_for_selector("#changed")
    browser.at_rest(page)
    pitch = float(browser.field(page, "array.pitch_mm").input_value())
    assert 13.28 < pitch < 13.5
    wider = vary(load_design("gast2020"), {"array.pitch_mm": pitch})
    np.testing.assert_array_equal(browser.matrix(page), k_of(wider))
    browser.redrawn(page, before)
    page.click("#show-L")
    page.wait_for_selector("#matrix td[title^=L]")
    np.testing.assert_array_equal(browser.matrix(page), numbers_of(wider).inductance)
    page.click("#show-k")


def test_dragging_a_slider_shows_rough_numbers_then_full_ones(page):
    # they may stand there for a moment only: what was there is written down, and the slider moves until it was
    page.evaluate(
        "window.told = []; window.telling = new MutationObserver(() => {"
        " const chip = document.querySelector('#accuracy'), pale = document.querySelectorAll('#coils.stale').length;"
        " told.push(chip?.dataset.accuracy);"
        " if (pale) told.push(`pale, ${chip?.innerText}`) });"
        "telling.observe(document.body,"
        " { attributes: true, subtree: true, attributeFilter: ['data-accuracy', 'class'] })"
    )
    x, y, *_ = hold(page, "[data-key='array.pitch_mm'] [role=slider]")

    def rough():
        for k in range(1, 8):
            page.mouse.move(x + 3 * k, y)
        return page.evaluate("told.includes('screen')")

    until(rough)
    page.evaluate("telling.disconnect()")
    page.mouse.up()
    page.wait_for_selector("#accuracy:has-text('full accuracy')")
    browser.at_rest(page)
    expect(page.locator(".stale")).to_have_count(0)
    told = set(page.evaluate("told"))
    assert "pale, computing" in told  # numbers of the board before are marked,
    assert "pale, full accuracy" not in told  # and never called accurate
    pitch = float(browser.field(page, "array.pitch_mm").input_value())
    assert pitch > 11.5
    np.testing.assert_array_equal(browser.matrix(page), k_of(changed(array__pitch_mm=pitch)))


def test_a_wrong_value_is_told_at_its_field_and_a_broken_rule_is_red(page):
    before = browser.matrix(page)
    browser.enter(page, "array.pitch_mm", "wide")
    line = page.locator("[data-key='array.pitch_mm'] [role=alert]")
    expect(line).to_have_text("pitch must be a number; got 'wide'.")
    expect(page.locator(ALERTS)).to_have_count(1)
    expect(browser.field(page, "array.columns")).to_have_value("3")
    expect(page.locator("#changed")).to_have_count(0)
    np.testing.assert_array_equal(browser.matrix(page), before)
    browser.enter(page, "array.columns", "2.5")
    page.wait_for_selector("[data-key='array.columns'] [role=alert]")
    expect(page.locator(ALERTS)).to_have_count(2)
    expect(page.locator("#held")).to_have_text("a field is wrong")
    browser.enter(page, "array.pitch_mm", "12")  # right again; the other one stays wrong, and as it was in the design
    page.wait_for_selector("[data-key='array.pitch_mm'] [role=alert]", state="detached")
    page.wait_for_selector("#changed")
    browser.at_rest(page)
    expect(browser.field(page, "array.columns")).to_have_value("2.5")
    np.testing.assert_array_equal(browser.matrix(page), k_of(changed(array__pitch_mm=12)))


def test_rules_that_break_are_red(page):
    expect(page.locator("#rules")).to_have_text("rules kept")
    expect(page.locator("#verdict")).to_contain_text("Every limit of the converter is kept.")
    browser.enter(page, "coils.hexagon.gap_mm", "0.05")
    page.wait_for_selector("#rules:has-text('rules broken')")
    browser.at_rest(page)
    expect(page.locator("#verdict")).to_have_count(0)
    expect(page.locator(".v-app-bar .v-chip.text-green")).to_have_count(0)  # nothing reads as if all were well
    expect(page.locator("#margins tr.mark").first).to_contain_text("spacing within net")
    page.click("#tab-build")
    page.wait_for_selector("#broken >> text=The board house's limit of spacing within net is broken at coil")
    place = page.locator("[data-coil=coil3] input").first
    place.fill(page.locator("[data-coil=coil1] input").first.input_value())  # where both have no inductances
    place.press("Enter")
    page.wait_for_selector("#broken [role=alert]:has-text('two coils are in the same place')")
    expect(page.locator("#accuracy")).to_have_text("not computed")
    page.click("#undo")  # until which there is no rest
    page.wait_for_selector("#broken [role=alert]", state="detached")


def cells_of(table):
    """Texts of all cells as a page shows them."""
    return [html.unescape(text) for text in re.findall(r"<td[^>]*>(.*?)</td>", table.html())]


@scenes
def test_switches_change_what_the_converter_sees_and_the_field(page):
    page.click("#tab-switches")
    page.wait_for_selector("#scene :text('magnitude of B')")
    assert page.locator("#scene :text('current as arrows')").count()
    before = browser.drawn(page)
    design = load_design("starter")
    network = design_circuit(design, ideal=True)
    settings = dict(zip(design.array.names, ("ground", "measure", "ground"), strict=True))

    def seen():
        table = reading_table(resonate(network, state_of(settings)))
        expect(page.locator("#switched tbody td")).to_have_text(cells_of(table))

    seen()
    for coil, setting in (("coil1", "measure"), ("coil3", "open")):
        page.click(f"[data-coil={coil}] button[value={setting}]")
        settings[coil] = setting
        seen()
    browser.redrawn(page, before)
    for coil in ("coil1", "coil2"):
        page.click(f"[data-coil={coil}] button[value=ground]")
    expect(page.locator("#switch-problem")).to_have_text("at least one coil must be measured.")


@scenes
def test_the_indenter_is_dragged_and_located(page):
    page.click("#tab-touch")  # a coarse map comes first, the full one by itself
    page.wait_for_selector("#indenter")
    page.wait_for_function("!document.querySelector('#touch-coarse')")
    x, y, width, height = hold(page, "#top-view", 0.4, 0.5)
    across = 0.62
    for part in np.linspace(0.0, 1.0, 6):
        page.mouse.move(x + part * (across - 0.4) * width, y - part * 0.05 * height)
    page.mouse.up()
    page.wait_for_function(
        "part => { const v = document.querySelector('#top-view').viewBox.baseVal;"
        " return Math.abs((document.querySelector('#indenter').cx.baseVal.value - v.x) / v.width - part) < 3e-3 }",
        arg=across,  # to a pixel or two
    )
    browser.heard(page)  # the last move and the end of the drag are one place, told twice
    place = [float(page.input_value(f"[data-axis={axis}] input")) for axis in ("x", "y", "depth")]
    model = forward_model(browser.bells(load_design_file("starter").document, "starter"))
    shown = [float(page.inner_text(f"[data-delta={name}] span:last-child").replace("−", "-")) for name in model.states]
    # the place is shown to 0.01 mm, half of which is some 5e-6 on the flank of a bell
    np.testing.assert_allclose(shown, model.delta(np.array(place) * 1e-3) * 1e6, atol=15.0)
    located = page.inner_text("#located").replace("−", "-")
    assert float(located.partition("Pressed at x = ")[2].split()[0]) == pytest.approx(place[0], abs=0.05)
    page.wait_for_selector("#scene :text('hemisphere')")
    assert page.locator("#scene.other").count() == 0  # legend and picture change together
    press_at(page, "depth", "deep")
    expect(page.locator("#place-error")).to_have_text("depth must be a number; got 'deep'.")
    press_at(page, "depth", "99")
    page.wait_for_selector("#place-error:has-text('mm; got 99.')")
    press_at(page, "depth", "0.3")
    page.wait_for_selector("#place-error", state="detached")
    browser.enter(page, "array.pitch_mm", "12")  # another board: the response is no longer its own
    page.wait_for_selector("#touch-note:has-text('computed anew')")
    expect(page.locator("#indenter")).to_have_count(0)


def test_a_design_is_saved_opened_and_kept_through_a_reload(page, folder):
    change(page, "array.pitch_mm", "12.5")
    save(page, "../outside.toml")
    expect(page.locator("#file-problem")).to_contain_text("plain, short name")
    page.fill("#save-name", "better.toml")
    page.click("#save-now")
    page.wait_for_selector("#file:has-text('better.toml')")
    page.wait_for_selector("#changed", state="detached")
    better = load_design_file(folder / "better.toml")
    # a copy is not called as what it was made of
    assert (better.values["array.pitch_mm"], better.design.name, better.values["title"]) == (12.5, "better", "")
    page.click("#save")
    page.fill("#save-title", "Twelve and a half")
    page.click("#save-now")
    page.wait_for_selector(".v-overlay--active .v-card", state="detached")
    assert load_design(folder / "better.toml").title == "Twelve and a half"
    (folder / "other.toml").write_text("another's", encoding="utf-8")
    save(page, "other.toml")
    expect(page.locator("#file-problem")).to_contain_text("other.toml is there already")
    assert (folder / "other.toml").read_text(encoding="utf-8") == "another's"
    page.click("#save-now:has-text('Replace')")
    page.wait_for_selector("#file:has-text('other.toml')")
    assert load_design_file(folder / "other.toml").values["array.pitch_mm"] == 12.5
    browser.field(page, "array.columns").fill("2")
    browser.field(page, "array.columns").press("Tab")  # to leave a field enters it too
    page.wait_for_selector("#changed")
    page.reload()
    browser.at_rest(page)
    expect(browser.field(page, "array.pitch_mm")).to_have_value("12.5")
    expect(browser.field(page, "array.columns")).to_have_value("2")
    expect(page.locator("#file")).to_contain_text("other.toml")
    np.testing.assert_array_equal(browser.matrix(page), k_of(changed(array__pitch_mm=12.5, array__columns=2)))
    page.click("#open")
    page.click("#shelf >> text=better.toml")
    page.wait_for_selector("#open-problem:has-text('The changes of other.toml are not saved')")
    expect(browser.field(page, "array.columns")).to_have_value("2")
    page.click("#discard")
    page.wait_for_selector("#changed", state="detached")
    expect(browser.field(page, "array.columns")).to_have_value("3")


def test_a_new_design_is_made_from_a_few_choices_and_asks_for_changes_first(page, folder):
    (folder / "there.toml").write_text("another's", encoding="utf-8")
    change(page, "array.pitch_mm", "12")
    page.click("#new")
    for name, problem in (("two words", "plain, short name"), ("there", "there.toml is there already")):
        page.fill("#new-name", name)
        page.click("#make")
        page.wait_for_selector(f"#new-problem:has-text('{problem}')")
    assert (folder / "there.toml").read_text(encoding="utf-8") == "another's"
    page.fill("#new-name", "pair")
    page.fill("#new-coils", "2")
    page.click("#make")
    page.wait_for_selector("#new-problem:has-text('The changes of starter are not saved')")
    page.click("#make:has-text('Discard and make')")
    page.wait_for_selector("#file:has-text('pair.toml')")
    page.wait_for_selector("#changed")  # it is in no file yet
    page.wait_for_function("document.querySelectorAll('#matrix td').length === 4")
    assert not (folder / "pair.toml").exists()
    page.wait_for_selector("#saved:has-text('pair.toml is not saved yet')")


def test_many_coils_leave_room_for_the_picture_in_small_windows(page):
    browser.enter(page, "array.columns", "16")
    page.wait_for_function("document.querySelectorAll('#matrix td').length === 256")
    try:
        for width, height in ((1280, 720), (1024, 700)):
            page.set_viewport_size({"width": width, "height": height})

            def roomy(width=width):
                scene, side = page.locator("#scene, .studio-side").evaluate_all(BOXES)
                apart = scene[2] <= side[0] or scene[3] <= side[1]  # neither lies over the other,
                # and all of it is in the window
                return apart and side[2] <= width and scene[2] - scene[0] > 400 and scene[3] - scene[1] > 300

            until(roomy)
        box = "#matrix", "one => [one.scrollWidth, one.parentElement.clientWidth]"
        until(lambda: np.less_equal(*page.eval_on_selector(*box)))  # the matrix as colours, all of it,
        expect(page.locator("#matrix tbody tr >> nth=0 >> td >> nth=1")).to_have_text("")
        page.click("#digits")  # and in numbers where they are asked for
        until(lambda: np.greater(*page.eval_on_selector(*box)))
        expect(page.locator("#matrix tbody tr >> nth=0 >> td >> nth=1")).not_to_have_text("")
        page.click("#digits")
    finally:
        page.set_viewport_size(browser.SIZE)


def test_dialogs_are_worked_by_keys_alone(page, folder):
    """Each begins in its field, does its work by Enter, and gives the focus back to its button."""
    focus = "name => document.activeElement.id === name"
    for name, first in (("save", "save-name"), ("new", "new-name"), ("open", None)):
        page.focus(f"#{name}")
        page.keyboard.press("Enter")
        page.wait_for_selector(".v-overlay--active .v-card")
        if first is not None:
            page.wait_for_function(focus, arg=first)
        page.keyboard.press("Escape")
        page.wait_for_function(focus, arg=name)
        page.wait_for_selector(".v-overlay--active .v-card", state="detached")
    pitch = browser.field(page, "array.pitch_mm")
    change(page, "array.pitch_mm", "12")  # which leaves the focus in the field
    page.keyboard.press("Control+z")
    page.wait_for_selector("#changed", state="detached")
    page.keyboard.press("Control+y")
    page.wait_for_selector("#changed")
    page.keyboard.type("3")
    expect(pitch).to_have_value("123")
    page.keyboard.press("Control+z")  # of its own text, until the design has it
    expect(pitch).to_have_value("12")
    page.keyboard.press("Control+s")
    page.wait_for_function(focus, arg="save-name")
    page.keyboard.press("Control+z")  # not of the design behind
    page.keyboard.press("Control+a")
    page.keyboard.type("keys.toml")
    page.keyboard.press("Enter")
    page.wait_for_selector("#file:has-text('keys.toml')")
    assert load_design_file(folder / "keys.toml").values["array.pitch_mm"] == 12
    browser.enter(page, "array.pitch_mm", "wide")
    page.keyboard.press("Control+s")
    page.wait_for_selector("#save-wrong")
    page.keyboard.press("Escape")


def test_goals_that_do_not_fit_say_why(page):
    page.click("#tab-runs")
    browser.enter(page, "array.columns", "1")
    page.wait_for_selector("#goal-words:has-text('The smallest board for its inductance')")  # not the first one
    expect(page.locator("#start-run")).to_be_enabled()
    page.click("div:has(> .v-field #goal)")
    offered = page.locator(".v-overlay--active .v-list")
    expect(offered).to_be_visible()
    expect(offered.locator(".v-list-item:not(.v-list-item--disabled) .v-list-item-title")).to_have_text(
        ["The smallest board for its inductance"]
    )
    expect(offered).to_contain_text("starter has only one coil, and so no coupling.")
    page.keyboard.press("Escape")


def test_runs_of_an_optimisation_are_shown_and_taken_over(page, folder, searched):
    result = searched[1]
    shutil.copytree(searched[0], folder / "found")
    page.click("#tab-runs")
    browser.heard(page)
    page.click("#run-folder-box .v-field")
    page.click(".v-overlay >> text=found")
    page.wait_for_selector("#pareto")
    expect(page.locator("#run-summary")).to_contain_text(f"{len(result.trials)} points computed")
    expect(page.locator("#front tbody tr")).to_have_count(len(result.front))
    shown = "['run_x', 'run_y'].map(name => trame.state.get(name)).join()"
    page.wait_for_function(f"{shown} === 'board_area_mm2,span_mm'")  # two that differ from point to point
    page.click("button:has(#pareto)")
    page.wait_for_selector("#large")
    page.keyboard.press("Escape")
    page.wait_for_selector("#large", state="detached")
    name = page.inner_text("#front tbody tr >> nth=0 >> td >> nth=0")
    (trial,) = (one for one in result.front if one.name == name)
    page.click("#front button >> nth=0")
    page.wait_for_selector("#preview:has-text('area covered by coils at least 500')")
    expect(page.locator("#changed")).to_have_count(0)  # it is only compared
    page.click("#take-over")
    page.wait_for_selector("#changed")
    browser.heard(page)
    expect(browser.field(page, "array.columns")).to_have_value(str(trial.changes["array.columns"]))
    pitch = float(browser.field(page, "array.pitch_mm").input_value())
    assert pitch == pytest.approx(trial.changes["array.pitch_mm"], rel=1e-11)  # shown with twelve digits
    page.click("#do-sweep")
    for part, text in (("first", "8"), ("last", "12"), ("count", "3")):
        page.fill(f"[data-sweep='0'] [data-part={part}] input", text)
    page.fill("#quantities", "span_mm")
    page.press("#quantities", "Enter")
    page.wait_for_selector(".v-chip:has-text('extent of the coils')")  # which moves the button
    until(lambda: page.click("#start-study") or page.locator("#job, #study").count())
    page.wait_for_selector("#study[data-ended=true] #study-picture")
    page.click("#study-rows button >> nth=2")
    page.wait_for_selector("#preview:has-text('12 mm')")
    page.click("#take-over")
    page.wait_for_selector("#study-line >> text=before it was changed")
    expect(browser.field(page, "array.pitch_mm")).to_have_value("12")
    until((folder / "starter-sweep.nc").exists)  # it is kept, and found again
    page.evaluate("trame.trigger('open_study', ['starter-sweep.nc'])")
    page.wait_for_selector("#study-line:has-text('starter-sweep.nc: 3 of 3 points')")


@scenes
def test_a_board_is_watched_held_zeroed_and_stopped(page, studio):
    before = set(studio.children())
    page.click("#tab-live")
    page.fill("#live-log", "../run.csv")
    page.click("#start-board")
    page.wait_for_selector("#live-problem:has-text('a file must have a plain, short name')")
    page.fill("#live-log", "")
    page.click("#start-board")
    page.wait_for_selector("#live-lines:has-text('Pressed at')")
    expect(page.locator("#live-line")).to_have_text("Emulated board")
    expect(page.locator("#live-line")).to_have_attribute("title", "[emulator] emulator: a stand-in")
    expect(page.locator("#live-lines")).to_contain_text("10.0 scans a second, none lost")
    expect(page.locator("#live-temperature")).to_have_text("25.50 °C")
    page.wait_for_selector("#scene :text('δ')")
    page.wait_for_selector("#live-presses tbody tr >> nth=1")
    page.wait_for_selector("#live-curves [data-press='1']")
    path = "#live-curves path[data-curve]"
    expect(page.locator(path)).to_have_count(3)
    page.click("#pause-board")
    page.wait_for_selector("#pause-board:has-text('Go on')")

    def is_held():
        before = page.get_attribute(path, "d")
        page.wait_for_timeout(500)  # five scans, or fewer where others compute
        return page.get_attribute(path, "d") == before

    until(is_held)
    held = page.get_attribute(path, "d")
    page.click("#live-span button:has-text('10 s')")  # which draws
    page.wait_for_function(f"held => document.querySelector('{path}').getAttribute('d') !== held", arg=held)
    page.click("#pause-board")
    page.keyboard.press("z")
    page.wait_for_selector("#live-lines:has-text('baseline: ')")
    (child,) = until(lambda: set(studio.children()) - before)
    box = page.get_attribute("#live-view", "viewBox")
    change(page, "array.pitch_mm", "13")  # the board that runs stays what it is
    page.wait_for_selector("#live-other")
    assert page.get_attribute("#live-view", "viewBox") == box
    page.click("#stop-board")
    page.wait_for_selector("#start-board")
    browser.wait_until_gone([child])
    expect(page.locator("#live-view")).not_to_have_attribute("viewBox", box)
    expect(page.locator("#live-lines")).to_have_text("")  # it was of another board


def test_a_report_is_written_beside_the_page_and_cancelled(page, studio, folder):
    before = set(studio.children())
    page.click("#report")
    page.wait_for_selector("#job [role=progressbar][aria-valuenow]")
    (child,) = until(lambda: set(studio.children()) - before)
    change(page, "array.pitch_mm", "12")  # the page goes on meanwhile
    page.reload()  # the job too, and all that can be undone
    page.wait_for_selector("#job [role=progressbar][aria-valuenow]")
    assert child in studio.children()
    expect(browser.field(page, "array.pitch_mm")).to_have_value("12")
    page.click("#undo")
    page.wait_for_selector("#changed", state="detached")
    page.click("#redo")
    page.wait_for_selector("#changed")
    page.click("#cancel")
    page.wait_for_selector("#job", state="detached")
    browser.wait_until_gone([child])
    assert not (folder / "starter-report").exists()
    (folder / browser.QUICK).touch()
    page.click("#report")
    page.wait_for_selector("#report-link")
    assert (folder / "starter-report" / "report.html").is_file()
    with page.context.expect_page() as opening:
        page.click("#report-link")
    report = opening.value
    report.wait_for_selector("text=A report.")
    expect(report).to_have_title("starter")  # its script has not run
    report.close()


ATTACK = """
window.failed = [];
const note = what => () => window.failed.push(what);
const studio = "%s";
for (const [tag, path] of [["script", "vue.global.js"], ["img", "files/planted.html"], ["iframe", ""]]) {
  const part = document.createElement(tag);
  part.onerror = note(tag);
  part.src = studio + path;
  document.body.append(part);
}
fetch(studio + "open/stolen", {method: "POST", mode: "no-cors"}).catch(note("post"));
new WebSocket(studio.replace("http", "ws") + "ws/" + "0".repeat(32)).onerror = note("socket");
"""


def test_a_page_of_another_origin_and_a_planted_one_reach_nothing(chromium, studio, folder):
    planted = folder / "planted.html"
    planted.write_text("<title>planted</title><script>document.title = 'ran'</script>", encoding="utf-8")
    (folder / "<img src=x onerror=alert(1)>.toml").write_text("schema = 1", encoding="utf-8")
    link = f"<a href='{studio.root}files/planted.html'>a link</a>"
    attack = f"<!doctype html><body>{link}<script>{ATTACK % studio.root}</script>"
    context = browser.profile(chromium)
    page, statuses, dialogs = context.new_page(), {}, []
    page.on("dialog", lambda dialog: dialogs.append(dialog.message))
    page.on("response", lambda one: statuses.update({one.url.removeprefix(studio.root): one.status}))
    with answering(0, attack.encode()) as port:
        page.goto(f"http://127.0.0.1:{port}/")
        page.wait_for_function("['script', 'img', 'post', 'socket'].every(one => failed.includes(one))")
        page.click("text=a link")
        page.wait_for_selector("text=a request from another page")
        assert [path for path, status in statuses.items() if status < 400] == [f"http://127.0.0.1:{port}/"]
    assert page.goto(f"{studio.root}files/planted.html").status == 403  # without the token
    assert page.goto(f"{studio.root}files/planted.html?{studio.query}").status == 404
    page.goto(studio.url)
    browser.at_rest(page)
    page.click("#open")
    page.wait_for_selector("#shelf >> text=starter")
    expect(page.locator("#shelf")).not_to_contain_text("onerror")
    hostile = "<img src=x onerror=alert(2)>{{ 6*7 }}"
    text = bundled.read("starter").replace("Three overlapping hexagonal coils", hostile)
    (folder / "hostile.toml").write_text(text, encoding="utf-8")
    page.keyboard.press("Escape")
    page.click("#open")
    page.click("#shelf >> text=hostile.toml")
    page.wait_for_selector("#file:has-text('hostile.toml')")
    expect(page.locator("#array-words")).to_have_attribute("title", hostile)
    assert dialogs == []
    context.close()


@scenes
def test_the_scene_is_turned_and_its_groups_are_hidden(page):
    first = browser.drawn(page)
    x, y, *_ = hold(page, "#board", 0.5, 0.97)  # beside the coils
    for k in range(6):
        page.mouse.move(x + 12 * k, y - 6 * k)
    page.mouse.up()
    turned = browser.redrawn(page, first)
    assert page.evaluate("boardView.moved")
    page.click("#scene button:has-text('copper L1')")
    page.wait_for_selector("#scene button.off:has-text('copper L1')")
    browser.redrawn(page, turned)
    page.click("#scene button:has-text('copper L1')")
    page.keyboard.press("f")
    assert not page.evaluate("boardView.moved")
    page.click("#scene button:has-text('top')")
    browser.still(page)

    def onto(name):
        """Place of a coil on the page."""
        box = page.locator("#board").bounding_box()
        plan = f"trame.state.get('plan').coils.find(one => one.name === '{name}').centre"
        x, y = page.evaluate(f"boardView.onPage({plan})")
        return box["x"] + x, box["y"] + y

    # the board fills its picture: the outlines of its corners reach near to two edges
    corners = page.evaluate("trame.state.get('plan').box.map(boardView.onPage)")
    size = page.locator("#board").bounding_box()
    extent = np.ptp(np.array(corners), axis=0) / (size["width"], size["height"])
    assert extent.max() > 0.7
    # a coil is picked in the picture, and its row and its cells are marked
    page.mouse.click(*onto("coil2"))
    page.wait_for_selector("#coils tr.picked:has-text('coil2')")
    expect(page.locator("#matrix td.hot")).to_have_count(5)
    # dragged it takes its couplings along, as one step of undo
    before = browser.matrix(page)
    x, y = onto("coil2")
    page.mouse.move(x, y)
    page.mouse.down()
    for k in range(1, 6):
        page.mouse.move(x, y + 3 * k)
    page.mouse.up()
    page.wait_for_selector("#changed")
    browser.at_rest(page)
    now = browser.matrix(page)
    assert now[0, 1] != before[0, 1]
    assert now[0, 2] == pytest.approx(before[0, 2], rel=1e-6)
    page.wait_for_selector("#matrix td .change")
    page.click("#undo")
    page.wait_for_selector("#changed", state="detached")
    browser.at_rest(page)
    np.testing.assert_array_equal(browser.matrix(page), before)
    page.keyboard.press("Escape")
    expect(page.locator("#coils tr.picked")).to_have_count(0)


@scenes
def test_a_picture_that_is_late_never_stands_for_the_new_design(page):
    browser.still(page)
    pale = "document.querySelector('#board').classList.contains('stale')"
    held, holding = [], [True]
    page.route("**/arrays/**", lambda route: held.append(route) if holding else route.continue_())
    browser.enter(page, "array.columns", "2")
    page.wait_for_function(pale)
    until(lambda: page.evaluate("true") and held)
    browser.at_rest(page)
    assert page.evaluate(pale)
    assert page.get_attribute("#scene", "data-rests") == "false"
    holding.clear()
    for one in held:
        one.continue_()
    browser.still(page)
    assert not page.evaluate(pale)
    assert page.evaluate("trame.state.get('scene').digest === trame.state.get('plan').digest")


# Texts in sight whose contrast to what is behind them is below that of WCAG's AA, with the ratio. Texts of disabled
# parts need none. Colours are laid over each other as the browser does, with the opacity of all that they are in.
FAINT = """() => {
  const parse = text => { const [r, g, b, a = 1] = text.match(/[\\d.]+/g).map(Number); return [r, g, b, a] };
  const over = (top, below) => [0, 1, 2].map(k => top[k] * top[3] + below[k] * (1 - top[3])).concat(1);
  const linear = v => v <= 10.3 ? v / 3295 : ((v / 255 + 0.055) / 1.055) ** 2.4;
  const light = rgb => rgb.slice(0, 3).map(linear)
    .reduce((sum, v, k) => sum + v * [0.2126, 0.7152, 0.0722][k], 0);
  const found = [], walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const text = walker.currentNode.textContent.trim(), part = walker.currentNode.parentElement;
    if (!/[\\p{L}\\p{N}]/u.test(text)) continue;
    if (!part.checkVisibility({ opacityProperty: true, visibilityProperty: true })) continue;
    if (part.closest("svg, style, script, .studio-skip, :disabled, .v-btn--disabled, .v-input--disabled")) continue;
    const line = [], style = getComputedStyle(part);
    for (let one = part; one; one = one.parentElement) line.unshift(one);
    let back = [255, 255, 255, 1], opacity = 1;
    for (const one of line) {
      const look = getComputedStyle(one), colour = parse(look.backgroundColor);
      opacity *= Number(look.opacity);
      back = over([...colour.slice(0, 3), colour[3] * opacity], back);
    }
    const ink = parse(style.color), front = over([...ink.slice(0, 3), ink[3] * opacity], back);
    const [a, b] = [light(front), light(back)], ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    const size = parseFloat(style.fontSize), large = size >= 24 || (size >= 18.66 && Number(style.fontWeight) >= 700);
    if (ratio < (large ? 3 : 4.5)) found.push(`${text.slice(0, 40)}: ${ratio.toFixed(2)}`);
  }
  return found;
}"""


def test_all_texts_have_contrast_in_the_light_and_in_the_dark(page):
    browser.enter(page, "coils.hexagon.gap_mm", "0.05")  # with words in red
    page.wait_for_selector("#rules:has-text('rules broken')")
    browser.enter(page, "array.columns", "2.5")
    page.wait_for_selector("#held")
    browser.at_rest(page)
    try:
        for scheme in ("light", "dark"):
            page.emulate_media(color_scheme=scheme)
            page.wait_for_function(f"document.querySelector('.v-app-bar').closest('.v-theme--{scheme}')")
            for tab in ("numbers", "build", "switches", "touch", "metal", "runs", "live"):
                page.click(f"#tab-{tab}")
                page.wait_for_function(f"trame.state.get('tab') === '{tab}'")
                page.wait_for_function("document.getAnimations().every(one => one.playState !== 'running')")
                assert page.evaluate(FAINT) == [], (scheme, tab)
    finally:
        page.emulate_media(color_scheme="light")


def test_results_are_two_keys_away_and_broken_places_are_shown(page):
    first = page.evaluate("document.querySelector('a[href], button, input, [tabindex]').id")
    assert first == "skip"  # the first key leads there
    page.focus("#skip")
    page.keyboard.press("Enter")
    expect(page.locator("#tab-numbers")).to_be_focused()
    browser.enter(page, "coils.hexagon.gap_mm", "0.05")
    page.wait_for_selector("#broken .studio-go")
    marks = page.evaluate("trame.state.get('marks').length")
    assert marks > 0
    change_of_row = page.locator("#margins tr.mark .change").first
    expect(change_of_row).to_contain_text("(−66.7 %)")  # of a gap of 0.15 mm before
    page.set_viewport_size({"width": 360, "height": 740})
    try:
        assert page.evaluate("document.documentElement.scrollWidth") <= 360
        expect(page.locator(".studio-fields")).to_be_hidden()
        expect(page.locator("#summary")).to_be_visible()
    finally:
        page.set_viewport_size(browser.SIZE)


def test_the_program_ends_when_the_page_is_closed(chromium, tmp_path):
    said = {"COILARRAY_CACHE": str(tmp_path / "cache"), "COILARRAY_NO_RENDERING": "1"}
    with browser.served("starter", "--linger", "0.5", program=True, cwd=tmp_path, **said) as started:
        with browser.opened(chromium, started.url) as page:
            page.click("#tab-touch")
            page.click("#compute-table")
            page.wait_for_selector("#job")
            children = until(started.children)
        assert started.wait() == 0
        browser.wait_until_gone([started.process.pid, *children])


def test_metal_is_added_moved_and_removed(page):
    page.click("#tab-metal")
    page.evaluate(
        "trame.trigger('add_body', [{kind: 'target', shape: 'sphere', material: 'steel', size: '8', distance: '1, 4'}])"
    )
    document = {**load_design_file("starter").document}
    document["target"] = {"shape": "sphere", "material": "steel", "diameter_mm": 8.0, "distances_mm": [1.0, 4.0]}
    expected = moved(build_design(document), None)
    last = len(expected.distances) - 1

    def shown(found, step):
        expect(page.locator("#target-table tbody td")).to_have_text(cells_of(target_table(found, step)))

    shown(expected, 0)
    page.evaluate(f"trame.trigger('move_target', [{last}])")
    page.wait_for_function("document.querySelector('#distance').innerText === 'target at 4 mm'")
    shown(expected, last)
    # another size: what stands there is pale, perhaps for a moment only, until it is that of the new one
    page.get_by_role("button", name="Target", exact=True).click()
    pale = "!!document.querySelector('#target-table.stale')"
    page.evaluate(
        f"window.pales = 0; new MutationObserver(() => {{ pales += {pale} }})"
        ".observe(document.body, { attributes: true, subtree: true, attributeFilter: ['class'] })"
    )
    browser.enter(page, "target.diameter_mm", "4")
    page.wait_for_function("pales > 0")
    page.wait_for_function(f"!{pale}")
    document["target"]["diameter_mm"] = 4.0
    shown(moved(build_design(document), None), last)
    page.locator("#body-form").get_by_label("distances").fill("far")
    page.click("#add-body")
    page.wait_for_selector("#body-problem")
    expect(page.locator("#body-problem")).to_have_text("distances_mm must be a number; got 'far'.")
    page.evaluate("trame.trigger('remove_body', ['target'])")
    page.wait_for_function("!document.querySelector('#target-table')")


@pytest.mark.skipif(os.name != "posix", reason="no Ctrl-C to be sent here")
def test_ctrl_c_ends_it_with_a_page_open_and_nothing_to_render(chromium, studio):
    """It ends the studio of the tests before."""
    context = browser.profile(chromium)
    page = context.new_page()
    page.goto(studio.url)
    page.wait_for_selector("#scene-problem:has-text('COILARRAY_NO_RENDERING')")
    said = studio.end()
    words = page.wait_for_selector("#gone").inner_text()
    assert words.startswith("The studio has ended, or cannot be reached.\nThis page comes back by itself")
    with answering(urlsplit(studio.url).port):
        page.wait_for_selector("text=here again")
    context.close()
    assert studio.process.returncode == 0, said
