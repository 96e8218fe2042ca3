"""Pages made from the code: keys, commands and results have meanings and units, and links lead somewhere."""

import json
import pkgutil
import re
import shlex
import sys
from pathlib import Path

import matplotlib
import pytest

DOCS = Path(__file__).parent.parent / "docs"
sys.path.insert(0, str(DOCS / "extensions"))
pytest.importorskip("sphinx_gallery", reason="the extra docs is not installed")

import command_pages  # noqa: E402 - from the folder above
import figures  # noqa: E402
import file_pages  # noqa: E402
import link_check  # noqa: E402
import name_pages  # noqa: E402
import pyvista  # noqa: E402
import report_pages  # noqa: E402
import result_pages  # noqa: E402
import validation_pages  # noqa: E402
import xarray as xr  # noqa: E402
from matplotlib import pyplot  # noqa: E402
from sphinx.errors import ExtensionError  # noqa: E402

import coilarray as ca  # noqa: E402
from coilarray.cli.main import COMMANDS  # noqa: E402


@pytest.mark.parametrize("kind", file_pages.FILES, ids=lambda kind: kind[0])
def test_every_key_has_a_meaning(kind):
    rows = [line.split(" | ") for line in file_pages.page(*kind[1:]).splitlines() if line.startswith("| `")]
    assert rows
    without = [key for key, *_, meaning in rows if not meaning.strip(" |")]
    assert not any("at least 2 of them, at most 2 of them" in allowed for _, _, allowed, *_ in rows)
    assert not without, f"{kind[0]}: no meaning of {', '.join(without)}"


@pytest.mark.parametrize("kind", file_pages.FILES, ids=lambda kind: kind[0])
def test_every_key_that_ends_with_a_unit_shows_it(kind):
    rows = [line.split(" | ") for line in file_pages.page(*kind[1:]).splitlines() if line.startswith("| `")]
    ends = re.findall(r"\w+", "m mm um s us Hz kHz MHz F pF H uH nH Pa kPa ohm V K deg")
    assert [key for key, unit, *_ in rows if key.strip("| `").rpartition("_")[2] in ends and not unit.strip()] == []


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_a_page_with_an_example(name):
    page = command_pages.page(name)
    assert name_pages._Links._command.fullmatch(f"coilarray {name} --help")[1] == name  # which links lead to
    assert f"```sh\ncoilarray {name}" in page
    options = [line for line in page.splitlines() if line.startswith("| ``")]
    assert options
    assert all(line.removesuffix(" |").rsplit("|", 1)[1].strip() for line in options), "an option without a meaning"


ROOMS = ("coilarray", "geometry", "viz", "hardware")
RETURNING = {name: one for name, *one in name_pages.returning()}
SHAPE = re.compile(r"shape|scalar|\((\w+, ?)+(\w+)?\)")  # (n, 3)
UNIT = re.compile(
    r"\bin (m|mm|m²|1/m|s|µs|Hz|F|H|Ω|Pa|A|1/K|T)\b|per A|[Rr]elative|[Rr]atio|[Ww]ithout unit|[Dd]imensionless"
    r"|the unit|[Ss]tandard deviation of δ|[Cc]hanges?.* of δ|noise of δ"
)


@pytest.mark.parametrize("name", RETURNING)
def test_everything_public_says_what_it_returns_with_shape_and_unit(name):
    is_property, kind, text = RETURNING[name]
    if not is_property and re.fullmatch(r"coilarray\.[a-z]\w*", name):  # functions of the top level
        text = re.search(r"^(?:Returns|Yields)\n-+\n(.*?)(?=\n\n\w+\n---|\Z)", text, re.MULTILINE | re.DOTALL)
        assert text, "no section Returns"
        text = text[1]
    assert text
    if re.search(r"\b(Float|Int|ND)\w*Array", kind):
        assert SHAPE.search(text), text
    if re.search("float|complex|Float|Complex", kind):
        assert UNIT.search(text), text


def test_everything_public_says_what_its_parameters_are():
    unnamed = [
        f"{name}({one})"
        for name, parameters, text in name_pages.taking()
        for one in parameters
        if not re.search(rf"\b{one}\b", text)
    ]
    assert unnamed == []


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("coilarray.load_design", "coilarray.load_design"),
        ("ca.load_design()", "coilarray.load_design"),
        ("load_design", "coilarray.load_design"),
        ("coilarray.design.model.load_design", "coilarray.load_design"),
        ("coilarray.elastomer.contact.indent", "coilarray.indent"),
        ("Array.bounds", "coilarray.Array.bounds"),
        ("deviance", "coilarray.localize.inverse.deviance"),
        ("locate", None),  # a command too
        ("coilarray.absent", None),
        ("worst_k", None),
    ],
)
def test_text_that_names_something_public_leads_to_its_page(text, name):
    assert name_pages.public_name(text) == name


def test_every_full_name_in_text_exists():
    root = DOCS.parent
    texts = [*(root / "docs").rglob("*.md"), *(path for room in ROOMS for path in (root / room).rglob("*.py"))]
    absent = []
    for path in texts:
        for name in re.findall(r"(?<!`)`(coilarray(?:\.\w+)+)(?:\(\))?`(?!`)", path.read_text(encoding="utf-8")):
            try:
                pkgutil.resolve_name(name)
            except (ImportError, AttributeError):
                absent.append(f"{path.relative_to(root)}: {name}")
    assert not absent


def test_a_class_that_a_function_returns_has_a_page():
    pages = {full for group in name_pages.names().values() for full in group}
    assert {"coilarray.report.write.Report", "coilarray.localize.inverse.Mode"} < pages


_PAGE = '<html><body><h1 id="top">Page</h1>{}</body></html>'


@pytest.mark.parametrize(
    ("body", "fault"),
    [
        ('<a href="other.html#here">there</a><a href="#top">up</a><a href="https://example.org">outside</a>', None),
        ('<a href="absent.html">gone</a>', "absent.html, which is missing"),
        ('<img src="absent.png"/>', "absent.png, which is missing"),
        ('<a href="other.html#elsewhere">there</a>', "other.html#elsewhere, where there is no such place"),
        ('<script src="https://example.org/code.js"></script>', "loads https://example.org/code.js"),
        ('<link rel="stylesheet" href="https://example.org/look.css"/>', "loads https://example.org/look.css"),
        ('<link rel="canonical" href="https://example.org/"/>', None),
    ],
)
def test_pages_that_need_a_network_or_a_missing_place_are_found(tmp_path, body, fault):
    (tmp_path / "page.html").write_text(_PAGE.format(body))
    (tmp_path / "other.html").write_text(_PAGE.format('<p id="here"></p>'))
    found = list(link_check.faults(tmp_path))
    assert len(found) == (fault is not None)
    assert fault is None or found[0].endswith(fault)


def test_speed_is_shown_against_every_other_program():
    results = json.loads((DOCS.parent / "benchmarks" / "results.json").read_text(encoding="utf-8"))
    ratios = dict(validation_pages.speed_ratios(results))
    others = ("magpylib", "cfsem", "simsopt", "FastHenry")
    assert [other for other in others if other not in " ".join(ratios)] == []
    assert all(ratio > 0 for ratio in ratios.values())


PAIRS = "B, exact segments"  # in million pairs a second


@pytest.mark.parametrize(
    ("page", "said", "figure"),
    [
        ("theory/index", r"([\d.]+) s for 10⁹ pairs", PAIRS),
        ("theory/index", r"([\d.]+) s for six coils of 2202", "L matrix of six coils, warm"),
        ("theory/index", r"([\d.]+) s for 1024 coils", "L matrix of 1024 coils on a lattice"),
        ("theory/index", r"([\d.]+) s for 189 positions", "response map, 27 × 7 positions, six coils, one depth, warm"),
        ("guide/large_arrays", r"would take ([\d.]+) times", "response of 256 coils against all coils"),
        ("guide/position", r"below ([\d.]+) mm and", "95 % of the x errors where allowed, noise 3e-07"),
        ("guide/position", r"mm and ([\d.]+) %\.", "95 % of the depth error there, noise 3e-07"),
    ],
)
def test_a_figure_in_prose_is_that_of_the_table(page, said, figure):
    """To a third: it is rounded to a digit or two, and times on a shared machine scatter."""
    results = json.loads((DOCS.parent / "benchmarks" / "results.json").read_text(encoding="utf-8"))
    (value,) = (row["value"] for row in results["speed"] if row["what"] == figure)
    (stated,) = re.findall(said, (DOCS / f"{page}.md").read_text(encoding="utf-8"))
    assert float(stated) == pytest.approx(1000 / value if figure == PAIRS else value, rel=1 / 3)


def test_every_reference_says_how_it_was_made():
    for section in validation_pages.references().split("\n## ")[1:]:
        name, _, text = section.partition("\n")
        assert len(text.split(":class: wrapped")[1].strip("`\n ")) > 100, name


@pytest.mark.parametrize("missing", ["long_name", "units"])
def test_a_variable_of_a_result_without_unit_or_meaning_ends_the_build(missing):
    """Of the real results, each time that the pages are built."""
    said = {"long_name": "inductance", "units": "H"}
    whole = xr.Dataset({"L": ("coil", [1e-6], said), "name": ("coil", ["a"], {"long_name": "name"})})
    assert "| `L` | coil | H | inductance |" in result_pages.table(whole)
    del whole.L.attrs[missing]
    with pytest.raises(ExtensionError, match=f"a file of results has the variable L without {missing}"):
        result_pages.table(whole)


@pytest.mark.parametrize("folder", ["start", "theory"])
def test_every_page_of_start_and_theory_has_a_picture_that_is_made_as_it_is_built(folder):
    for page in (DOCS / folder).glob("*.md"):
        text = page.read_text(encoding="utf-8")
        assert figures._PROGRAM.search(text) or f"](../{report_pages.FOLDER}/" in text, page.name
        assert not figures._BROKEN.search(text), page.name


SPACE = ("a_reader_and_tag", "b_charger", "c_finger_strip", "y_helmet")


@pytest.mark.parametrize("name", SPACE)
def test_a_tutorial_of_coils_in_space_shows_its_film(name):
    (code,) = figures.films_of((DOCS / "tutorials" / f"plot_{name}.py").read_text(encoding="utf-8"))
    if code.startswith("coilarray "):
        command, design, *options = shlex.split(code)[1:]
        assert (command, options[0], options[-2]) == ("link", "--move", "--film")
        assert options[1] in ca.load_design(design).board_names
    else:
        compile(code, name, "exec")
        assert "save_movie" in code


def test_a_film_is_taken_from_the_folder_that_its_program_writes_it_to(tmp_path):
    figures.film_of("from pathlib import Path\nPath('a.gif').write_bytes(b'GIF')  # ends", tmp_path / "kept.gif")
    assert [path.name for path in tmp_path.iterdir()] == ["kept.gif"]


GALLERY = sorted((DOCS / "gallery").rglob("plot_*.py"))
# each of these takes more than a second, and tests of what it calls take it too
DEAR = {
    "01_geometry/plot_connector", "01_geometry/plot_new_design", "03_coupling/plot_sweep_map",
    "04_circuits/plot_self_resonance", "04_circuits/plot_trace_width", "05_elastomer/plot_map",
    "05_elastomer/plot_contact", "05_elastomer/plot_profile", "09_boards/plot_channels",
    "05_elastomer/plot_two_dimensional", "06_position/plot_ellipses", "06_position/plot_error_map",
    "06_position/plot_locate", "07_metal/plot_backplane", "07_metal/plot_behind", "07_metal/plot_proximity",
    "08_fabrication/plot_shares", "09_boards/plot_allan", "00_pictures/plot_10_arcs", "00_pictures/plot_08_dent",
    "00_pictures/plot_03_currents", "00_pictures/plot_14_closing",
    *(f"00_pictures/plot_{name}" for name in ("01_touch", "02_field", "04_helmet", "09_charger", "12_grounded")),
}  # fmt: skip


def example(path):
    return f"{path.parent.name}/{path.stem}"


def test_the_examples_that_are_left_to_the_build_of_the_pages_exist():
    assert {example(path) for path in GALLERY} > DEAR


@pytest.mark.slow
@pytest.mark.parametrize("path", [path for path in GALLERY if example(path) not in DEAR], ids=example)
def test_an_example_of_the_gallery_runs_and_draws_its_picture(path, tmp_path, monkeypatch, request):
    """The checks build the pages without the gallery, which takes minutes with all its pages."""
    scenes = []
    if path.parent.name.endswith("pictures"):
        request.getfixturevalue("rendering")
        monkeypatch.setattr(pyvista, "OFF_SCREEN", True)
        monkeypatch.setattr(pyvista.Plotter, "show", lambda plotter: scenes.append(plotter.screenshot(None)))
    monkeypatch.chdir(tmp_path)
    try:
        with matplotlib.rc_context({"backend": "agg"}):
            drawn = figures.figures_of(path.read_text(encoding="utf-8"))
        for figure in drawn:
            figure.draw_without_rendering()
    finally:
        pyplot.close("all")
    assert drawn or any(scene.std() > 0 for scene in scenes)
