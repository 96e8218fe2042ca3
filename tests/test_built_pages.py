"""The pages in a browser, as they were built: in the folder of COILARRAY_PAGES, or in docs/_build/html."""

import os
from pathlib import Path

import pytest
from support import browser

BUILT = Path(os.environ.get("COILARRAY_PAGES") or Path(__file__).parents[1] / "docs" / "_build" / "html")
# pages that are alike, of which one in so many is looked at: of single names, and of programs without their pictures
ALIKE = {"coilarray.*.html": 15, "made/gallery/**/plot_*.html": 3}

# boxes around the page's heading that scroll sideways: the theme's article does, so that the page itself does not
_SIDEWAYS = """() => {
    const found = [];
    for (let box = document.querySelector("h1"); box; box = box.parentElement)
        if (box.scrollWidth > box.clientWidth + 1) found.push(`${box.tagName}.${box.className}: ${box.scrollWidth} px`);
    return found;
}"""
# links of running text that look like the words beside them
_LIKE_TEXT = """[...document.querySelectorAll(".bd-article :is(p, li, td) > a:not(.headerlink, .sd-stretched-link)")]
    .filter(one => one.checkVisibility() && !one.querySelector("img, code"))
    .filter(one => !getComputedStyle(one).textDecorationLine.includes("underline")).map(one => one.innerText)"""

# numbers in programs that Python could not read
_NO_NUMBERS = """[...document.querySelectorAll(".highlight :is(.mf, .mi)")].map(one => one.textContent)
    .filter(text => !/^[\\w.+-]+$/.test(text))"""


def pages():
    """The pages that are looked at."""
    every = [path for path in sorted(BUILT.rglob("*.html")) if "_static" not in path.parts]
    alike = {kind: sorted(BUILT.rglob(kind)) for kind in ALIKE}
    others = [path for path in every if not any(path in group for group in alike.values())]
    return others + [path for kind, group in alike.items() for path in group[:: ALIKE[kind]]]


@pytest.fixture(scope="module")
def opened(chromium):
    """A page of a browser without a network."""
    context = browser.profile(chromium, offline=True, reduced_motion="reduce")
    yield context.new_page()
    context.close()


@pytest.mark.slow
@pytest.mark.skipif(not (BUILT / "index.html").exists(), reason="the pages have not been built")
def test_no_page_scrolls_sideways_links_look_like_links_and_programs_are_as_they_were(opened):
    """At 400 and 1400 pixels; wide tables, formulas and programs scroll by themselves, each in its box."""
    wrong = {}
    for path in pages():
        opened.goto(path.as_uri())
        for width in (400, 1400):
            opened.set_viewport_size({"width": width, "height": 900})
            opened.evaluate(browser.TWO_FRAMES)
            if found := opened.evaluate(_SIDEWAYS):
                wrong[f"{path.relative_to(BUILT)} at {width}"] = found
        if found := opened.evaluate(_LIKE_TEXT):
            wrong[f"{path.relative_to(BUILT)}, links"] = found
        if found := opened.evaluate(_NO_NUMBERS):
            wrong[f"{path.relative_to(BUILT)}, numbers"] = found
    assert wrong == {}
