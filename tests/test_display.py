"""How values show themselves where a terminal prints them and a notebook displays them."""

import base64
from dataclasses import replace
from html.parser import HTMLParser
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from coilarray import Readout, load_design_file
from coilarray.circuit.noise_budget import Cause, NoiseBudget
from coilarray.compute.table import html_table
from coilarray.localize.inverse import Location, Mode

EVIL = '<script>alert("a & b")</script>'
VOID = {"img", "br"}


@pytest.fixture(scope="module")
def file():
    """Return the design of the paper."""
    return load_design_file("gast2020")


class _Cells(HTMLParser):
    """Text of every cell, with a check that tags are closed in their order."""

    def __init__(self, text):
        super().__init__()
        self.cells, self.pictures, self._open = [], [], []
        self.feed(text)
        assert not self._open

    def handle_starttag(self, tag, attributes):
        assert tag != "script"
        if tag == "img":
            self.pictures.append(dict(attributes)["src"])
        elif tag not in VOID:
            self._open.append(tag)
        if tag in ("td", "th"):
            self.cells.append("")

    def handle_endtag(self, tag):
        assert self._open.pop() == tag

    def handle_data(self, data):
        if self._open and self._open[-1] in ("td", "th"):
            self.cells[-1] += data


def facts(value):
    """Return the rows of two cells that a value shows."""
    cells = _Cells(value._repr_html_()).cells
    return dict(zip(cells[::2], cells[1::2], strict=True))


def test_a_table_shows_text_as_it_is():
    parsed = _Cells(html_table(["a", EVIL], [[EVIL, "1 < 2"]]))
    assert parsed.cells == ["a", EVIL, EVIL, "1 < 2"]
    marked = html_table(["kept"], [["no"], ["yes"]], "no")
    assert marked.count('<tr class="mark"><td>no</td>') == marked.count("<tr><td>yes</td>") == 1
    assert 'class="many"' in html_table([""] * 14, [])
    assert "<thead>" not in html_table((), [("a", "b")])


def test_a_design_shows_itself_with_its_board(file):
    design = file.design
    assert repr(design).startswith("<Design gast2020: 6 hexagonal coils of ")
    assert facts(design)["hash"] == design.digest[:12]
    picture = _Cells(design._repr_html_()).pictures[0].removeprefix("data:image/svg+xml;base64,")
    drawing = ET.fromstring(base64.b64decode(picture))
    assert "coil6" in "".join(drawing.itertext())
    bare = replace(design, name=EVIL, title=EVIL, source=EVIL, sheets=(), indentation=None)
    assert EVIL in repr(bare)
    shown = facts(bare)
    assert shown["source"] == EVIL
    assert not {"elastomer", "pressed by", "metal"} & set(shown)  # there is none


def test_a_location_shows_every_position():
    # an information of 1/σ², with σ = 0.1, 0.2 and 0.05 mm, on a board that is symmetric in y
    modes = [Mode(1e-3, y, 5e-4, np.diag(np.array([1e-4, 2e-4, 5e-5]) ** -2.0), 0.5) for y in (2e-3, -2e-3)]
    words = [f"x = 1.00 ± 0.1 mm, y = {y} ± 0.2 mm, depth = 0.50 ± 0.05 mm" for y in ("2.00", "−2.00")]
    both = Location("found", modes=tuple(modes))
    assert repr(both) == f"<Location: Pressed at {words[0]}. Or pressed at {words[1]}.>"
    assert _Cells(both._repr_html_()).cells == [f"Pressed at {words[0]}.", f"Or pressed at {words[1]}."]
    assert EVIL not in Location("refused", EVIL)._repr_html_()


def test_a_budget_marks_what_is_assumed():
    """Two causes of 3e-6 and 4e-6 of one scan make 5e-6, in a reading and in an L_0 of one scan √2 as much."""
    names, nothing = ("coil1", "coil2"), np.zeros(2)
    causes = (
        Cause("counting", np.array([3e-6, 0.0]), nothing, nothing, False, EVIL, False),
        Cause("clock", np.array([4e-6, 0.0]), np.array([2e-5, -3e-5]), nothing, True, "data sheet", True),
    )
    budget = NoiseBudget(names, causes, Readout(averaged_scans=1, baseline_scans=1))
    noise = "7.1e-06"
    assert repr(budget) == f"<NoiseBudget of 2 states: at most σ of δ {noise}, of it noise {noise}; drift 3e-05 per K>"
    cells = _Cells(budget._repr_html_()).cells
    assert cells[4:8] == ["coil1", "7.07e-06", "2e-05", "7.07e-06"]
    assert cells[-6:] == ["counting", "known", EVIL, "clock", "assumed, not verified", "data sheet"]
    assert "<strong>NoiseBudget of δ less coil2</strong>" in budget.referenced(["coil2"])._repr_html_()
