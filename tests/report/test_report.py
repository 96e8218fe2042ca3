"""The report: complete, self-contained, and every number of the page also in the files."""

import csv
import html.parser
import io
import json
import math
import re
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr
from matplotlib.image import imread
from support import browser
from support.active_coil import active_coil
from support.contacts import coarse_maps, few_turns
from support.patience import until
from support.plot_results import distortion

from coilarray import (
    couple_design,
    coupling_matrix,
    indent,
    magnetic_field,
    parse_design,
    write_report,
)
from coilarray.design.bundled import read
from coilarray.design.model import Board, Circuit, Design, parse_design_file
from coilarray.design.scan_states import Switches
from coilarray.errors import DesignError, LocalizeError
from coilarray.geometry import Array, Pose, Spiral, check_rules
from coilarray.paper.ellipse import fit_ellipses
from coilarray.paper.ellipse_model import ellipse_model, locate_x, published_map
from coilarray.report.position import map_positions
from coilarray.report.summary import summary_table
from coilarray.response.dataset import coils_outside, in_ellipse_window, on_board
from coilarray.studies.link import link, pose_grid

pytestmark = pytest.mark.slow


# of small strain, which is quick; the single coil has a contact of finite strain, on a coarse mesh
LINEAR = few_turns("gast2020").replace("[indentation]", '[indentation]\nstrain = "linear"')
BOARD = parse_design_file(LINEAR, "gast2020")
SINGLE = parse_design_file(few_turns("gast_fem"), "gast_fem")
FEW = read("starter").replace("turns_per_layer = 12", "turns_per_layer = 4").replace("columns = 3", "columns = 2")
FEW = FEW.replace('strain = "finite"', 'strain = "linear"')


def causes_of(design):
    """A made-up result of `coilarray paper distortion` for a design, with the errors of a calibration."""
    causes = distortion().assign_attrs(design_hash=design.digest)
    causes = causes.assign(rms=causes.rms.assign_attrs(units="m")).assign_coords(indenter=["without"])
    return causes.assign({f"{name}_std": 0.1 * causes[name] for name in ("x0", "effect", "rms")})


def written_report(design, folder, *, drawn=False, **options):
    """Write a report without 3-D rendering; its plots are made, and drawn in pixels only where that is wanted."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COILARRAY_THREADS", "1")  # pictures are drawn in this process
        patch.setattr("coilarray.viz.rendering_problem", lambda: "no rendering in this test")
        patch.setattr("coilarray.report.page._DPI", 40)
        patch.setattr("coilarray.report.page._LAYOUTS", 1)  # perhaps cut at their edges
        if not drawn:
            patch.setattr("coilarray.report.page.image_of", lambda *_: plt.close("all") or ('<img src="">', ""))
        patch.setattr("coilarray.report.sections._SWEEP_POINTS", 8)
        return write_report(design, folder, **options)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The report of the paper's board, drawn without 3-D rendering (tests/viz/test_scenes.py renders)."""
    return written_report(BOARD, tmp_path_factory.mktemp("report"), drawn=True, distortion=causes_of(BOARD.design))


TABLES = (
    "summary", "coils", "pairs", "neighbours", "design", "rules", "field_line", "windings", "states", "state_currents",
    "ldc1614", "ldc1614_drive", "sweep", "indentation", "response", "ellipses", "polynomials", "map_positions",
    "residuals", "causes", "paper",
)  # fmt: skip


def table(made, name):
    with (made.folder / f"{name}.csv").open(encoding="utf-8", newline="") as lines:
        return list(csv.DictReader(lines))


class _Links(html.parser.HTMLParser):
    def __init__(self):
        super().__init__()
        self.sources, self.tags, self.text, self.cells = [], [], [], []
        self._cell = False

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.sources += [value for key, value in attrs if key in ("src", "href", "srcset", "action")]
        self._cell = self._cell or tag == "td"
        self.cells += [""] * (tag == "td")

    def handle_endtag(self, tag):
        self._cell = self._cell and tag != "td"

    def handle_data(self, data):
        self.text.append(data)
        if self._cell:
            self.cells[-1] += data


@pytest.fixture(scope="module")
def page(made):
    parser = _Links()
    parser.feed(made.page.read_text(encoding="utf-8"))
    return parser


def test_files(made):
    assert made.page.name == "report.html"
    arrays = ("coupling", "ellipses", "field", "impedance", "indentation", "position_bounds", "response", "scan")
    names = {"report.json", "tables.tex", *(f"{name}.nc" for name in arrays), *(f"{name}.csv" for name in TABLES)}
    assert {path.name for path in made.folder.iterdir()} == names


def test_the_causes_are_those_of_the_distortion(made):
    rows = {row["cause"]: row for row in table(made, "causes")}
    assert [rows["noise"][f"coil1_{key}_m"] for key in ("rms", "rms_std")] == ["0.0004", "4e-05"]
    first, second = table(made, "residuals")
    assert [first["residual_mean_m"], second["residual_mean_m"]] == ["0.001", ""]
    with pytest.raises(LocalizeError, match="the distortion is that of another design than gast_fem"):
        write_report(SINGLE, made.folder, distortion=causes_of(BOARD.design))


def test_page_needs_no_other_file(page, made):
    assert "link" not in page.tags
    assert page.sources
    assert len(made.page.read_bytes()) < 1.5e6  # six coils; a rendered picture is another 90 kB
    assert all(source.startswith(("data:image/png;base64,", "#")) for source in page.sources)
    own = re.sub(r"(?s)<script.*?</script>", "", made.page.read_text(encoding="utf-8"))  # the scene: test_page
    assert not re.search(r"@import|url\((?!#)", own)


def test_page_has_every_part(page):
    text = " ".join(page.text)
    parts = "Coils Coupling Field Circuit Indentation Position Copper Fabrication Design Provenance assumed"
    assert all(part in text for part in parts.split())
    # sizes, stack, 4 layers of copper, k, currents, line, two maps, L and R over frequency, force, dent,
    # circuit, responses, bell curve, σ of the position, ellipses over δ, two of them, error of x, what moves x0
    assert page.tags.count("figure") == page.tags.count("svg") == 24
    assert "What moves x0" in text
    assert "two standard deviations of the calibration" in text


def test_the_page_begins_with_a_summary_and_its_contents(made):
    """The least and most are those of the tables; broken limits have a line each, and every section a link."""
    rows = {row["quantity"]: row for row in made.data["summary"]}
    states = made.data["states"]
    for words, key in (("f with the tank", "frequency_Hz"), ("R_p of the resonator", "parallel_resistance_ohm")):
        values = [row[key] for row in states]
        assert (rows[words]["least"], rows[words]["most"]) == (min(values), max(values))
    peaks = [row["peak_delta"] for row in made.data["response"]]
    assert (rows["peak δ, 1 mm deep"]["least"], rows["peak δ, 1 mm deep"]["most"]) == (min(peaks), max(peaks))
    assert min(peaks) > 0.7 * max(peaks)  # the map covers the coils of both pairs of layers, all six
    (resolution,) = (row for words, row in rows.items() if words == "σ of x, best place")
    with xr.open_dataset(made.folder / "response.nc", engine="h5netcdf") as response:
        delta = response.delta.isel(depth=-1).transpose("y", "x", "state").values
        x, y, noise = response.x.values, response.y.values, response.attrs["noise"]
    with xr.open_dataset(made.folder / "position_bounds.nc", engine="h5netcdf") as bounds:
        over = bounds.over_coils.values.astype(bool)
        sigma = np.where(over, bounds.sigma_x.values, np.nan)
    # by differences instead of splines, which agree where δ is steep: the best place
    slopes = np.stack((np.gradient(delta, x, axis=1), np.gradient(delta, y, axis=0)), axis=-1) / noise
    bound = np.sqrt(np.linalg.pinv(slopes.swapaxes(-1, -2) @ slopes)[..., 0, 0])
    # six hexagons of 23 mm, the places of each in a row of 2 mm; they overlap, and the corners of the map are on none
    assert over[7].sum() == pytest.approx(1 + (5 * 13.28 + 23 * 2 / 3**0.5 * np.cos(np.pi / 6)) / 2, abs=2)
    assert not over[[0, 0, -1, -1], [0, -1, 0, -1]].any()
    within = bound[1:-1, 1:-1][over[1:-1, 1:-1]]
    assert resolution["least"] == pytest.approx(within[within > 0].min(), rel=0.3)
    assert resolution["least"] == np.nanmin(sigma)
    for share, words in ((0.5, "half"), (0.95, "95 %")):
        (part,) = (row for quantity, row in rows.items() if quantity == f"σ of x, {words} of coils")
        assert (sigma[over] <= part["least"]).mean() >= share > (sigma[over] < part["least"]).mean()
    lengths = [row["margin"] for row in made.data["rules"] if row["unit"] == "m" and row["feature"] != "board"]
    assert rows["tightest fabrication rule"]["least"] == min(lengths)
    page = made.page.read_text(encoding="utf-8")
    assert page.index("Keeps its own assumed limits") < page.index("<h3>Coupling</h3>") < page.index("<h2")
    assert re.findall(r'href="#(section-\d+)"', page) == re.findall(r'<h2 id="(.*?)"', page)


def test_every_number_of_the_page_stands_in_the_files(page, made):
    numbers = {value for name in TABLES for row in table(made, name) for value in row.values()}
    values = np.array([float(v) for v in numbers if re.fullmatch(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?", v)])
    scaled = np.outer([1, 100, 1e3, 1e6, 1e12, 1e-6, 1e-3], values)
    for cell in filter(re.compile("−?\\d+\\.\\d+").fullmatch, page.cells):
        half = 0.5 * 10.0 ** -len(cell.split(".")[1]) * (1 + 1e-9)
        assert (np.abs(scaled - float(cell.replace("−", "-"))) <= half).any(), cell


def test_json_repeats_the_tables(made):
    data = json.loads((made.folder / "report.json").read_text(encoding="utf-8"))
    for name in TABLES:
        assert [{key: str(value) for key, value in record.items()} for record in data[name]] == table(made, name)
    assert data["provenance"]["design_hash"] == BOARD.design.digest
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00", data["provenance"]["date"])
    assert data == json.loads(json.dumps(made.data))


def test_netcdf_gives_the_same_matrix(made):
    with xr.open_dataset(made.folder / "coupling.nc", engine="h5netcdf") as saved:
        rows = table(made, "coils")
        np.testing.assert_array_equal(saved.effective_inductance, [float(r["effective_inductance_H"]) for r in rows])
        assert saved.attrs["design_hash"] == BOARD.design.digest
        short, f = saved.attrs["short_resistance_ohm"], float(saved.ideal_frequency[2])
        state = active_coil(saved.inductance.values, saved.resistance.values, 2, f, short_resistance=short)
        C = saved.attrs["capacitance_F"]
    # the ideal beside it: Im Y = 0 of the closed form, the active coil's own switches in series
    assert (1 / (state.impedance + short)).imag == pytest.approx(-2 * np.pi * f * C, rel=1e-11)
    assert float(rows[2]["ideal_frequency_Hz"]) == f
    assert float(rows[2]["ideal_effective_inductance_H"]) == pytest.approx(1 / ((2 * np.pi * f) ** 2 * C), rel=1e-14)


def test_field_line_is_the_bell_of_the_paper(made):
    rows = table(made, "field_line")
    x = np.array([float(row["x_m"]) for row in rows])
    alone = np.array([float(row["Bz_others_open_T_per_A"]) for row in rows])
    operating = np.array([float(row["Bz_as_terminated_T_per_A"]) for row in rows])
    centre = float(table(made, "coils")[2]["x_m"])
    # highest over the coil's centre, to the step of the line
    assert x[alone.argmax()] == pytest.approx(centre, abs=x[1] - x[0])
    # passive neighbours, each with k = 0.08 of the current, take little from the peak, some 2 k² and what reaches it
    assert operating.max() == pytest.approx(alone.max(), rel=0.05)
    # the same field from the public function
    points = np.column_stack((x, np.zeros_like(x), np.full_like(x, 6e-3)))
    B = magnetic_field(BOARD.design.array, points, [0, 0, 1, 0, 0, 0])[:, 2]
    np.testing.assert_allclose(alone, B, rtol=0, atol=1e-12 * B.max())


def test_assumed_values_are_marked(made):
    rows = {row["key"]: row for row in table(made, "design")}
    for key, reason in BOARD.assumed.items():
        assert (rows[key]["origin"], rows[key]["reason"]) == ("assumed", reason)
    broken = [row for name in ("rules", "ldc1614") for row in table(made, name) if row["kept"] == "False"]
    marks = made.page.read_text(encoding="utf-8").count('<tr class="mark">')
    assert marks == len(BOARD.assumed) + len(broken)


def test_the_share_of_the_magnetic_sheets(made, page):
    coils, pairs = table(made, "coils"), table(made, "pairs")
    with xr.open_dataset(made.folder / "coupling.nc", engine="h5netcdf") as saved:
        by_sheets = saved.sheet_inductance.values
        bare = coupling_matrix(saved.inductance.values - by_sheets)
    np.testing.assert_array_equal([float(row["sheet_inductance_H"]) for row in coils], np.diag(by_sheets))
    beside = ~np.eye(6, dtype=bool)
    np.testing.assert_array_equal([float(row["sheet_inductance_H"]) for row in pairs], by_sheets[beside])
    np.testing.assert_allclose([float(row["bare_coupling"]) for row in pairs], bare[beside], rtol=1e-12)
    share = np.array([float(row["sheet_inductance_H"]) / float(row["open_inductance_H"]) for row in coils])
    text = f"make {100 * share.min():.2f} to {100 * share.max():.2f}\u00a0% of L"
    assert text in " ".join("".join(page.text).split(" "))
    assert made.data["sheet_share"] == {"least": pytest.approx(share.min()), "most": pytest.approx(share.max())}


def test_indentation_and_response_agree_with_the_library(made):
    design, setup, rows = BOARD.design, BOARD.design.indentation, table(made, "indentation")
    np.testing.assert_allclose([float(row["depth_m"]) for row in rows], np.arange(1, 9) * 0.125e-3, rtol=1e-12)
    alone = indent(design.sheets, setup.indenter, setup.depths, base=setup.base, strain=setup.strain)
    # another mesh, made for one depth: each force is right to about 0.1 %
    assert float(rows[-1]["force_N"]) == pytest.approx(float(alone.force[0]), rel=2e-3)
    with xr.open_dataset(made.folder / "indentation.nc", engine="h5netcdf") as saved:
        np.testing.assert_array_equal(saved.force, [float(row["force_N"]) for row in rows])
        assert saved.attrs["design_hash"] == design.digest
    with (
        xr.open_dataset(made.folder / "response.nc", engine="h5netcdf") as saved,
        xr.open_dataset(made.folder / "coupling.nc", engine="h5netcdf") as coupling,
    ):
        assert saved.delta.shape == (1, 15, 47, 6)
        assert saved.attrs["design_hash"] == design.digest
        # the same matrix, summed in another order of threads
        np.testing.assert_allclose(saved.inductance, coupling.inductance, rtol=1e-12)
        peaks = [float(row["peak_delta"]) for row in table(made, "response")]
        np.testing.assert_array_equal(saved.delta.max(("depth", "y", "x")), peaks)


def test_positions_of_the_ellipse_model_agree_with_the_library(made, page):
    rows = table(made, "map_positions")
    assert len(rows) == 7 * 27
    with xr.open_dataset(made.folder / "response.nc", engine="h5netcdf") as saved:
        response = saved.load()
    model = ellipse_model(fit_ellipses(response, float(response.depth[-1]))).with_semiaxis_addition(0.2e-3)
    errors = []
    origin = BOARD.design.indentation.origin_point  # of the paper, the centre of coil2; rows: the board
    for row in rows:
        x, y = float(row["x_m"]) - origin[0], float(row["y_m"]) - origin[1]
        delta = response.delta.isel(depth=-1).sel(x=x, y=y, method="nearest", tolerance=1e-9)
        try:
            position = locate_x(model, dict(zip(response.state.values, delta.values.tolist(), strict=True)))
        except LocalizeError:
            assert row["determined_x_m"] == row["error_m"] == ""
            continue
        # the fits are the same arithmetic on the same numbers
        assert float(row["determined_x_m"]) - origin[0] == pytest.approx(position.x, rel=0, abs=1e-12)
        errors.append(abs(position.x - x))
    text = " ".join("".join(page.text).split())
    assert f"gives a position at {len(errors)} of the grid's 189 places" in text
    assert f"the largest error of x there is {1e3 * max(errors):.2f} mm" in text
    assert {row["source"] for row in table(made, "polynomials")} == {"this map", "Table A1"}
    assert made.data["position"]["axis"] == "x from coil2 (mm)"
    # one coordinate system in all tables of places, the board's
    (centre,) = (float(row["x_m"]) for row in table(made, "coils") if row["coil"] == "coil3")
    peaks = {row["state"]: row for row in table(made, "response")}
    assert float(peaks["coil3"]["peak_x_m"]) == pytest.approx(centre, abs=1.1e-3)  # half a step
    assert not any(row.get("remark") for row in peaks.values())  # none of them peaks at the edge of the map
    assert made.data["coils_outside_map"] == []
    assert "leaves out the centre" not in text
    # a map of the paper's window alone says whose largest δ it does not have
    small = in_ellipse_window(on_board(response))
    assert coils_outside(small) == ["coil4", "coil5", "coil6"]
    coupling = couple_design(BOARD.design)
    peak = summary_table(coupling, None, (), small).records()[-1]
    assert (peak["least"], peak["most"]) == tuple(sorted(float(peaks[f"coil{k}"]["peak_delta"]) for k in (3, 2)))
    assert peak["where"] == "coil3; coil2; without coil4, coil5, coil6, which peak beyond the map"


def test_the_example_of_two_ellipses_is_beside_the_axis():
    positions = map_positions(published_map())
    place = positions.example()
    assert place[1] != 0.0
    assert positions.found[place].case == "two points"
    shown, found = positions.ellipses(place), positions.found[place]
    assert tuple(shown) == found.coils
    for ellipse in shown.values():
        assert abs(float(ellipse.distance(found.x, found.y))) < 1e-9  # m; a root of both equations, to rounding
    error = positions.error
    assert int(np.isfinite(error).sum()) == len(positions.found)
    assert float(np.abs(error).max()) == positions.largest_error()


@pytest.mark.parametrize("states", [["coil1"], ["coil2"]])
def test_one_coil_gives_no_position(states):
    with pytest.raises(LocalizeError, match=f"a position needs two coils; the map has only {states[0]}"):
        map_positions(published_map().sel(state=states))


def test_single_coil_report(tmp_path):
    with coarse_maps():
        made = written_report(SINGLE, tmp_path)
    (row,) = table(made, "coils")
    # nothing couples: terminated and open are the same
    assert float(row["frequency_Hz"]) == float(row["open_frequency_Hz"])
    assert table(made, "pairs") == []
    text = made.page.read_text(encoding="utf-8")
    assert not re.search("Coupling coefficient|pairs has", text)
    # sizes, stack, two layers, line, a map, circuit, L and R over frequency, force, dent, δ along x, and at every depth
    assert text.count("<img") == 13
    assert "Bz_alone_T_per_A" in table(made, "field_line")[0]
    coils = text[text.index(">Coils</h2>") : text.index(">Field</h2>")]
    assert not re.search("change by the others|others open|other coils", coils)  # of nothing
    assert made.data["sheet_share"]["least"] > 0
    # one coil has no position to tell, and no neighbours whose currents sheets change
    assert made.data["position_problem"] == "a position needs two coils; the map has only coil1."
    assert "<h2>Position</h2>" not in text
    assert not re.search("other coils|coupling report", text, re.IGNORECASE)


def test_a_winding_without_a_capacitance_model_still_has_a_report(tmp_path):
    hairpin = """
schema = 1
name = "hairpin"
stackup = { layers = ["top"], copper_thickness_um = [35] }
coils.pin = { shape = "path", trace_width_mm = 0.2, gap_mm = 0.2, lines_mm = [[[0, 0], [9, 0], [9, 4], [0, 4]]] }
array.lattice = "free"
array.placements = [{ name = "a", coil = "pin", layers = ["top"], x_mm = 0, y_mm = 0 }]
"""
    seen = []
    made = written_report(parse_design(hairpin), tmp_path, progress=lambda *step: seen.append(step))
    page = made.page.read_text(encoding="utf-8")
    assert seen == [(done, seen[0][1]) for done in range(1, seen[0][1] + 1)]
    assert "capacitance of the windings: the winding of a must have turns" in page
    # no elastomer, no indentation
    assert not re.search("Indentation|magnetic sheets", page)
    assert made.data["indentation_problem"] == ""
    assert not any((made.folder / name).exists() for name in ("response.nc", "indentation.nc"))


METAL = """
[[plate]]
name = "backplane"
material = "aluminium"
thickness_mm = 1.0
distance_mm = 3.0
side = "below"
[target]
shape = "plate"
material = "copper"
thickness_mm = 2.0
distances_mm = [2, 8]
[readout]
converter = "none"  # one would not read coils of so few turns
"""


def test_metal_has_a_section_with_its_numbers(tmp_path):
    with coarse_maps():
        made = written_report(parse_design(FEW + METAL), tmp_path)
    page = made.page.read_text(encoding="utf-8")
    assert ">Metal</h2>" in page
    assert "with the plate backplane of aluminium and a copper plate as target;" in page
    (plate,) = table(made, "plates")
    depth, f = float(plate["skin_depth_m"]), float(table(made, "coils")[0]["frequency_Hz"])
    assert depth == pytest.approx(0.0661 / np.sqrt(0.61 * f), rel=0.05)  # 66 µm of copper at 1 MHz: 61 % IACS
    assert float(plate["thickness_over_skin_depth"]) == pytest.approx(1e-3 / depth, rel=1e-12)
    for row in table(made, "beside_plates"):
        change = float(row["effective_inductance_H"]) / float(row["effective_inductance_without_H"]) - 1
        assert float(row["plate_change"]) == pytest.approx(change, rel=1e-9)
        assert change < -0.01  # a screen behind the coils takes flux
        assert float(row["quality_factor"]) < float(row["quality_factor_without"])
    ranges = {row["state"]: float(row["range_m"]) for row in table(made, "target_range")}
    assert all(2e-3 < distance <= 8e-3 for distance in ranges.values())
    deltas = [float(row["delta"]) for row in table(made, "target") if row["state"] == "coil1"]
    assert deltas == sorted(deltas)  # the nearer, the less inductance
    assert deltas[-1] < 0
    assert "target.nc" in {path.name for path in made.folder.iterdir()}
    assert made.data["target_problem"] == made.data["field_problem"] == made.data["indentation_problem"] == ""
    with xr.open_dataset(made.folder / "response.nc") as response:
        assert response.attrs["plate_frequency_Hz"] == pytest.approx(f, rel=0.05)
        assert float(response.delta.max()) > 1e-5
    summary = {row["quantity"]: row for row in table(made, "summary")}
    assert float(summary["L_eff by the plates"]["most"]) < -0.01
    assert float(summary["δ of target at 2 mm"]["least"]) == pytest.approx(min(
        float(row["delta"]) for row in table(made, "target")
    ), rel=1e-9)  # fmt: skip
    assert any(name.startswith("range of target") for name in summary)


@pytest.mark.parametrize(("old", "new", "problem", "dent"), [
    ("depths_mm = [0.3, 0.6]", "depths_mm = [0.3, 3.9]", "a hemisphere can be pressed in by at most its radius", False),
    ('shape = "hemisphere" ', 'shape = "cylinder_edge" ', "coils in space need dents about an axis", True),
])  # fmt: skip
def test_an_indentation_that_fails_is_reported(tmp_path, old, new, problem, dent):
    assert old in FEW
    made = written_report(parse_design(FEW.replace(old, new, 1)), tmp_path)
    assert problem in made.data["indentation_problem"]
    page = made.page.read_text(encoding="utf-8")
    assert f"Not computed: {problem}" in page
    assert (made.folder / "indentation.nc").exists() == dent
    assert ("in section" in page) == dent
    assert not (made.folder / "response.csv").exists()
    assert "Not computed: there is no response map." in page
    assert (made.folder / "coupling.nc").exists()  # the rest is there


PAD = """
schema = 1
name = "sixteen"
array = { lattice = "square", coil = "square", columns = 4, rows = 4, pitch_mm = 14, layers = [["L1", "L2"]] }
[stackup]
layers = ["L1", "L2"]
copper_thickness_um = [35, 35]
dielectric_thickness_mm = [1.5]
dielectric_epsilon_r = [4.5]
[coils.square]
shape = "polygon"
sides = 4
outer_across_flats_mm = 12
turns_per_layer = 2
winding_layers = 2
trace_width_mm = 0.5
gap_mm = 0.5
first_corner_deg = 45
via = { drill_mm = 0.3, pad_mm = 0.6 }
"""


def test_a_report_of_two_boards(tmp_path):
    """Every coil and board is in it, and what needs one flat board is left out by name."""
    lid = Board(Array.row(Spiral(6, 10e-3, 4, 0.2e-3, 0.2e-3), 1), Pose(z=-20e-3, turn=(math.pi, 0.3, 0.0)), "lid")
    design = replace(parse_design_file(FEW, "few").design, boards=(lid,), circuit=Circuit(switches=Switches(5.0)))
    with coarse_maps():
        report = written_report(design, tmp_path)
    sections = {section.title: section for section in report.sections}
    for title in ("Coils", "Coupling", "Field", "Circuit", "Response", "Boards", "Copper", "Fabrication rules"):
        assert title in sections
        assert "Not computed" not in str(sections[title].blocks[0])
    assert "lid" in str(sections["Position"].blocks[-1])
    assert "lid" in report.data["position_problem"]
    assert {row["coil"] for row in report.data["coils"]} == {"coil1", "coil2", "lid/coil1"}
    assert len(report.data["pairs"]) == 3 * 2
    np.testing.assert_allclose(report.coupling.inductance, couple_design(design).inductance)
    (_, placed) = report.data["boards"]
    assert placed["board"] == "lid"
    np.testing.assert_allclose([placed[f"{axis}_m"] for axis in "xyz"], [0.0, 0.0, -20e-3])
    np.testing.assert_allclose([placed[f"turn_{axis}_rad"] for axis in "xyz"], lid.pose.turn)
    own = [row for row in report.data["rules"] if not row["layer"].startswith("lid")]
    others = [row for row in report.data["rules"] if row["layer"].startswith("lid")]
    assert len(own) == len(check_rules(design.array, design.rules))
    assert len(others) == len(check_rules(lid.array, lid.design.rules))


@pytest.fixture(scope="module")
def sixteen(tmp_path_factory):
    """The report of sixteen coils of few turns, whose lists of names and pairs are long."""
    return written_report(parse_design(PAD), tmp_path_factory.mktemp("sixteen"))


def test_the_board_is_turned_in_the_page(made):
    """A button puts a scene in the picture's place, drawn without a network, and takes it away again."""
    if (problem := browser.missing()) is not None:
        pytest.skip(problem)
    with browser.launched(*browser.SOFTWARE_GL) as started:
        page = browser.profile(started, offline=True).new_page()
        page.set_viewport_size({"width": 1000, "height": 900})
        page.goto(made.page.as_uri())
        page.click("#turn button")
        scene = page.frame_locator("iframe")
        scene.locator("canvas").wait_for()
        browser.expect(scene.get_by_text("copper L4")).to_have_count(1)
        frame = page.locator("iframe")
        until(lambda: np.ptp(imread(io.BytesIO(frame.screenshot()))[200:500, 500:900, 0]) > 0.2)  # else it is all white
        page.emulate_media(media="print")
        browser.expect(frame).to_be_hidden()
        browser.expect(page.locator("#dimensions")).to_be_visible()
        page.emulate_media(media="screen")
        page.click("#turn button")
        browser.expect(frame).to_have_count(0)
        browser.expect(page.locator("#dimensions")).to_be_visible()


@pytest.fixture(params=["made", "sixteen"])
def opened(request, chromium):
    """A report in a browser without a network, all its folded parts unfolded."""
    context = browser.profile(chromium, offline=True)
    page = context.new_page()
    page.goto(request.getfixturevalue(request.param).page.as_uri())
    page.evaluate("document.querySelectorAll('details').forEach(part => { part.open = true; })")
    yield page
    context.close()


# what ends right of the page's edge, but for what lies in a box that scrolls by itself
_BEYOND = """() => {
    const edge = document.documentElement.clientWidth, scrolls = one => getComputedStyle(one).overflowX === "auto";
    const inside = one => one && (scrolls(one) || inside(one.parentElement));
    return [...document.querySelectorAll("body *:not(svg *)")].filter(one => !inside(one.parentElement))
        .filter(one => one.getBoundingClientRect().right > edge + 0.5).map(one => `${one.tagName} ${one.innerText}`);
}"""
# what is wider than its box
_CUT = """[...document.querySelectorAll("{}")].filter(one => one.scrollWidth > one.clientWidth + 1)
    .map(one => one.innerText)"""
A4 = round((210 - 2 * 12) / 25.4 * 96)  # pixels between the margins of the style's @page


def test_the_page_fits_a_telephone_and_paper(opened):
    """Rows of wide tables are stacked on a screen of 420 pixels: nothing scrolls, there nor on A4."""
    opened.set_viewport_size({"width": 420, "height": 800})
    assert imread(io.BytesIO(opened.screenshot()))[..., :3].std() > 0.05  # not a blank page
    assert opened.evaluate(_BEYOND) == []
    assert opened.evaluate("document.documentElement.scrollWidth") == 420
    assert opened.evaluate(_CUT.format(".wide")) == []
    opened.set_viewport_size({"width": A4, "height": 800})
    opened.emulate_media(media="print")
    scrolls = "[...document.querySelectorAll('.wide')].some(one => getComputedStyle(one).overflowX !== 'visible')"
    assert opened.evaluate(scrolls) is False
    assert opened.evaluate(_BEYOND) == []
    assert opened.evaluate(_CUT.format("th, td")) == []


def test_a_link_has_its_section_and_its_table(tmp_path):
    tag = Spiral(6, 12e-3, 4, 0.3e-3, 0.3e-3).as_array()
    pair = Design(Spiral(4, 20e-3, 3, 0.5e-3, 0.5e-3).as_array(), boards=(Board(tag, Pose(z=8e-3), "tag"),))
    found = link(pair, {"tag": pose_grid(z=[5e-3, 9e-3])}, frequency=1e6)
    made = written_report(pair, tmp_path, link=found)
    assert "Link over motion" in [section.title for section in made.sections]
    rows = table(made, "link")
    assert [float(row["z_mm"]) for row in rows] == [5.0, 9.0]
    assert [float(row["k[coil1,tag/coil1]"]) for row in rows] == pytest.approx(found.coupling.values[:, 0].tolist())
    with pytest.raises(DesignError, match="another design"):
        write_report(SINGLE, tmp_path, link=found)
