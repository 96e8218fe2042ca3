"""The command line: what it prints, its exit codes, and one line for every mistake."""

import csv
import re
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from support.command_line import mistakes, runner, successes

from coilarray import couple_design, load_design, load_design_file, new_design
from coilarray.cli.compute import _print_report
from coilarray.cli.help import find_page
from coilarray.cli.main import COMMANDS, GROUPS, program, summary
from coilarray.cli.shared import lengths
from coilarray.compute.netcdf import save_dataset
from coilarray.compute.table import text_table
from coilarray.design.bundled import read
from coilarray.errors import ElastomerError, MissingDependencyError, OutputError
from coilarray.report.tables import matrix_tables
from coilarray.report.write import Report

pytestmark = pytest.mark.usefixtures("own_folder")
run, refused = runner()
good, answer = successes()


def test_help_shows_every_command_in_its_group_in_one_line(capsys):
    out = good(capsys)
    assert out == good(capsys, "--help")
    shown = dict(re.findall(r"^(\w+):\n((?:  .+\n)+)", out, re.MULTILINE))
    assert list(shown) == ["Options", *GROUPS]
    for group, commands in GROUPS.items():
        rows = [re.split(r"\s{2,}", line.strip(), maxsplit=1) for line in shown[group].splitlines()]
        assert rows == [[name, summary(name)] for name in commands]
    assert len(COMMANDS) == sum(map(len, GROUPS.values()))  # none in two groups


def test_no_command_has_more_options_than_a_person_reads():
    assert len({name.split()[0] for name in COMMANDS}) <= 20  # 18, `link` and `import`
    for name in COMMANDS:
        command = program(name)
        for word in name.split():
            command = command.commands[word]
        common = {"--out", "--force", "--json", "--all"}
        own = [one for one in command.params if one.param_type_name == "option" and not common & set(one.opts)]
        assert len(own) <= (16 if name == "init" else 10), name


def test_a_misspelt_command_gets_the_right_one_named(capsys):
    assert "No such command 'impedence'. Did you mean 'impedance'?" in refused(capsys, "impedence")


@pytest.fixture
def built(tmp_path):
    """Return a clone with built pages."""
    for page in ("index", "start/index", "start/first_report", "reference/commands/report"):
        path = tmp_path / "docs" / "_build" / "html" / f"{page}.html"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    return tmp_path


def test_pages_are_found_by_the_end_of_their_path(built):
    html = built / "docs" / "_build" / "html"
    assert find_page(built, "index") == html / "index.html"  # the one with the shortest path
    assert find_page(built, "start/index") == find_page(built, "start/index.html") == html / "start" / "index.html"
    assert find_page(built, "report") == html / "reference" / "commands" / "report.html"
    with pytest.raises(OutputError, match=r"art/index.*index"):
        find_page(built, "art/index")
    with pytest.raises(OutputError, match="coilarray docs"):
        find_page(built, "")
    with pytest.raises(OutputError, match="there is no page"):
        find_page(built, "../../../secret")
    (html / "index.html").unlink()
    with pytest.raises(MissingDependencyError, match=r"not built; in a clone of .* python -m sphinx docs docs/_build"):
        find_page(built, "index")


def test_docs_opens_a_page_or_prints_its_path(built, capsys, monkeypatch):
    opened = []
    monkeypatch.setattr("webbrowser.open", lambda url: opened.append(url) or True)
    monkeypatch.setattr("coilarray.cli.help.CLONE", built)
    page = built / "docs" / "_build" / "html" / "start" / "first_report.html"
    assert good(capsys, "docs", "first_report", "--print") == f"{page}\n"
    assert not opened
    assert good(capsys, "docs", "first_report") == f"{page}\n"
    assert opened == [page.as_uri()]
    monkeypatch.setattr("webbrowser.open", lambda url: False)
    assert run(capsys, "docs", "first_report")[0] == 2
    (built / "docs" / "_build" / "html" / "index.html").unlink()
    assert "the pages are not built" in refused(capsys, "docs")


@pytest.mark.parametrize(
    ("command", "option", "endings"),
    [
        ("check", "--picture", ".png, .svg or .pdf"), ("response", "--out", ".nc or .csv"),
        ("paper fit", "--out", ".json"), ("impedance", "--out", ".nc, .csv, .cir, .sub, .sNp or .inp"),
    ],
)  # fmt: skip
def test_a_file_that_cannot_be_written_is_refused_before_any_work(capsys, command, option, endings):
    first = endings.split(" or ")[0].split(", ")[0]
    assert f"{option} must end in {endings}; got a.txt" in refused(capsys, *command.split(), option, "a.txt")
    lost, taken = f"no/such/a{first}", Path(f"b{first}")
    assert f"cannot write {lost}: there is no folder no/such" in refused(capsys, *command.split(), option, lost)
    taken.mkdir()
    assert f"cannot write {taken}: it is a folder" in refused(capsys, *command.split(), option, taken)
    assert list(Path().rglob("*")) == [taken]


def test_lengths_are_a_rising_list_or_range():
    for text, mm in (("0.5", [0.5]), ("0.1,0.25", [0.1, 0.25]), ("-0.2:0.6:3", [-0.2, 0.2, 0.6])):
        assert lengths("--x-mm", text) == pytest.approx([value * 1e-3 for value in mm], rel=1e-12)
    refusal = (
        "--x-mm must be rising numbers of mm{}, such as 0.5,1 or START:STOP:COUNT with 2 to 1000 of them; got {!r}"
    )
    for text in (
        "1,0.5", "0.5,0.5", "0.1:0.5", "0:5:1", "0.1:0.5:2000", "0.1:0.5:2.5", "nan", "0.1,inf", "1e9", "", "deep",
    ):  # fmt: skip
        bound = ", at most 100000" if text in ("nan", "0.1,inf", "1e9") else ""
        with pytest.raises(ElastomerError, match=re.escape(refusal.format(bound, text))):
            lengths("--x-mm", text)


def test_version(capsys, monkeypatch):
    assert (told := good(capsys, "--version")).startswith("coilarray 0.")
    monkeypatch.setattr(sys, "argv", ["-m", "--version"])
    monkeypatch.delitem(sys.modules, "coilarray.__main__", raising=False)  # else runpy may warn
    with pytest.raises(SystemExit) as end:
        runpy.run_module("coilarray", run_name="__main__")
    assert (end.value.code, capsys.readouterr().out.strip()) == (0, told.strip())


@pytest.mark.slow
def test_init_copies_a_bundled_design(capsys):
    for folder in ("d", "gast2020"):  # are in nobody's way
        Path(folder).mkdir()
    assert "wrote d.toml\nnext: " in good(capsys, "init", "d", "--from", "gast2020")
    assert load_design("d.toml").name == "gast2020"
    assert "d.toml exists; --force replaces it" in refused(capsys, "init", "d.toml", "--from", "starter")
    assert load_design("d.toml").name == "gast2020"
    good(capsys, "init", "--force", "d.toml", "--from", "starter")
    assert Path("d.toml").read_text(encoding="utf-8") == read("starter")
    assert "no bundled design 'x'" in refused(capsys, "init", "y.toml", "--from", "x")
    line = refused(capsys, "init", "y.toml", "--from", "starter", "--coils", "1")
    assert "--from takes a design as it is; it cannot be given with other choices" in line


@pytest.mark.slow
def test_init_makes_a_design_that_other_commands_take(capsys):
    """Without any choice, as in a script: nothing is asked, and the file passes the check that the README names."""
    out = good(capsys, "init", "my_board.toml")
    assert "every limit of oshpark-2-layer is kept" in out
    assert "every limit of an LDC1614 is kept" in out
    assert Path("my_board.toml").read_text(encoding="utf-8").count(" # ") > 15  # commented
    file = load_design_file("my_board.toml")
    assert (file.design.name, len(file.design.array.names)) == ("my_board", 3)
    assert file.document == new_design("my_board").document  # the same defaults
    assert "limits" in good(capsys, "check", "my_board.toml")
    data = answer(capsys, "impedance", "my_board.toml", "--points", "2")
    inductance = float(re.search(r"inductance: (\S+) µH", out)[1])
    assert data["inductance_H"][0][0] * 1e6 == pytest.approx(inductance, rel=1e-3)  # which screening may err
    of_scan = data["windings"][0]
    said = re.search(r"resistance: (\S+) ohm at (\S+) MHz, (\S+) times that of direct current", out).groups()
    assert float(said[0]) == pytest.approx(of_scan["ac_resistance_ohm"], rel=0.05)  # of the coil with the most
    assert float(said[2]) > 1
    assert "layers:" not in out


@pytest.mark.slow
def test_init_warns_of_coils_that_the_converter_cannot_read(capsys):
    coil = ("--coils", "1", "--shape", "circle", "--no-elastomer", "--capacitance-pF")
    assert "coil1 has no resonance" in refused(capsys, "init", "slow", *coil, "1e6")
    lines = good(capsys, "init", "slow", *coil, "1e4").splitlines()
    words = r"✖ an LDC1614 cannot read coil1: R_p is .* it must be 1 kΩ .*; larger coils, more inductance or less"
    assert re.match(words, lines[-2])
    assert load_design("slow.toml").circuit.capacitance == pytest.approx(1e-8)


@pytest.mark.slow
def test_init_asks_on_a_terminal(capsys, monkeypatch):
    """Answers that cannot be are asked for again; Return takes the default."""
    answers = iter(
        ["9-hex", "2", "square", "wide", "20x12", "-5", "8", "nan", "", "8.5 mm", "0", "11", "", "aisler-4-layer", "n"]
    )
    asked = []

    def prompt(question, default):
        asked.append(question)
        return next(answers) or default

    monkeypatch.setattr("sys.stdin.isatty", lambda: True)
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    monkeypatch.setattr("typer.prompt", prompt)
    monkeypatch.setattr("typer.confirm", lambda question, default: next(answers) == "y")
    out = good(capsys, "init", "two")
    file = load_design_file("two.toml")
    assert len(asked) == 14  # some of them again
    assert "coils must be as 1, 6 (a row)" in out
    assert "size must be a width, as 16, or width and height, as 20x12; got 'wide'" in out
    assert "size must be one number for a square; got 20 × 12 mm" in out
    assert "size must be positive and finite; got −5 mm" in out
    assert "inductance must be positive and finite; got nan µH" in out
    assert "pitch must be positive and finite; got 0 mm" in out
    assert "could not convert string to float: '8.5 mm'" in out
    assert file.document["array"] == {
        "lattice": "linear", "columns": 2, "coil": "square", "pitch_mm": 11,
        "layers": [["L1", "L2", "L3", "L4"]],  # what that service makes
    }  # fmt: skip
    assert file.document["coils"]["square"]["outer_across_flats_mm"] == 8
    assert file.values["fab.profile"] == "aisler-4-layer"
    assert file.design.indentation is None


def test_a_page_of_the_user_is_not_replaced_by_a_report(capsys):
    Path("report.html").write_text("mine", encoding="utf-8")
    assert "report.html exists and is not a report of coilarray" in refused(capsys, "report", "starter")
    assert Path("report.html").read_text(encoding="utf-8") == "mine"


@pytest.mark.parametrize(
    ("command", "file"),
    [
        ("response starter", "response.nc"),
        ("board calibrate run.sqlite", "board.toml"),
        ("export starter --to svg", "starter.svg"),
    ],
)
def test_a_file_of_the_user_is_not_replaced_under_a_default_name(capsys, command, file):
    Path(file).write_text("mine", encoding="utf-8")
    assert f"{file} exists" in refused(capsys, *command.split())
    assert Path(file).read_text(encoding="utf-8") == "mine"


@pytest.mark.slow
def test_matrices(capsys):
    data = answer(capsys, "impedance", "starter", "--points", "2")
    expected = couple_design(load_design("starter"))
    np.testing.assert_allclose(data["inductance_H"], expected.inductance, rtol=1e-12)
    np.testing.assert_allclose(data["coupling"], expected.coupling, rtol=1e-12)
    assert len(data["pairs"]) == 6
    assert f"{float(expected.inductance[0, 0]) * 1e6:.3f}" in good(capsys, "impedance", "starter", "--points", "2")
    for suffix, beginning in ((".cir", "* starter"), (".inp", "* starter"), (".s3p", "!")):  # for other programs
        good(capsys, "impedance", "starter", "--points", "2", "--out", f"m{suffix}")
        assert Path(f"m{suffix}").read_text(encoding="utf-8").startswith(beginning)


def test_matrices_have_the_digits_that_are_known():
    """L and M to 1e-4 of L, with one more digit, and k to 1e-4."""
    L_and_M, k = matrix_tables(["a", "b"], np.array([[93.1391e-6, -0.1118e-6], [-0.1118e-6, 93.64312e-6]]))
    assert L_and_M.cells() == [["a", "93.139", "−0.112"], ["b", "−0.112", "93.643"]]
    assert k.cells()[0] == ["a", "1.0000", "−0.0012"]


@pytest.mark.slow
def test_of_many_coils_the_couplings_are_by_kind_of_neighbour(capsys, monkeypatch):
    monkeypatch.setattr("coilarray.cli.compute._FEW", 2)
    short = "impedance", "starter", "--points", "2"
    out = good(capsys, *short)
    assert "Coupling by kind of neighbour" in out
    assert "L and M" not in out
    assert "L and M" in good(capsys, *short, "--all")
    design = load_design("starter")
    made = Report(Path("report.html"), Path("report"), couple_design(design), {}, None)
    for every in (False, True):
        _print_report(design, made, every=every)
        assert ("kind of neighbour" in capsys.readouterr().out) is not every


def test_a_fasthenry_file_has_no_plates(capsys):
    plate = '\n[[plate]]\nname = "shield"\nmaterial = "copper"\nthickness_mm = 0.1\nz_mm = -4.0\n'
    Path("p.toml").write_text(read("starter").replace("\n[field]", plate + "\n[field]"), encoding="utf-8")
    assert "--out .inp cannot hold [[plate]], which starter has; write .cir or .sNp" in refused(
        capsys, "impedance", "p.toml", "--out", "m.inp"
    )


@pytest.mark.slow
def test_field_plane_and_volume(capsys):
    data = answer(capsys, "view", "starter", "--spacing-mm", "2", "--out", "field.nc")
    with xr.open_dataset("field.nc", engine="h5netcdf") as saved:
        assert saved.B.dims == ("x", "y", "z", "component")
        assert saved.z.values == pytest.approx([3e-3])
        assert float(abs(saved.B.sel(component="z")).max()) == pytest.approx(data["peak_Bz_T"])
        assert saved.attrs["active_current_A"] == 1e-3
    arguments = ("--coil", "coil1", "--z-mm", "1:3", "--spacing-mm", "2", "--out", "f.vtr")
    assert "× 2 points, coil1 active" in good(capsys, "view", "starter", *arguments)
    import pyvista

    grid = pyvista.read("f.vtr")
    assert grid.bounds[4:] == pytest.approx((1, 3))  # mm


@pytest.mark.slow
def test_impedance(capsys):
    data = answer(capsys, "impedance", "starter", "--points", "5", "--out", "s.nc", "--plot", "s.svg")
    assert [row["state"] for row in data["states"]] == ["coil1", "coil2", "coil3"]
    assert len(data["sweep"]) == 15
    assert data["close_channels"]
    assert all(row["kept"] for row in data["ldc1614"])
    with xr.open_dataset("s.nc", engine="h5netcdf") as saved:
        low, *_, high = saved.frequency.values.tolist()
        f = [row["frequency_Hz"] for row in data["states"]]
        assert low == pytest.approx(0.1 * np.sqrt(min(f) * max(f)))
        assert high > max(row["self_resonance_Hz"] for row in data["windings"])
        assert float(saved.impedance_imag[0, 0]) == pytest.approx(data["sweep"][0]["impedance_imag_ohm"], rel=1e-12)
    assert Path("s.svg").read_text(encoding="utf-8").startswith("<?xml")
    out = good(capsys, "impedance", "starter", "--points", "2", "--out", "s.csv", "--from-MHz", "0.1", "--to-MHz", "10")
    assert "LDC1614: all limits are kept" in out
    assert "The resonances of 3 pairs of states are closer than 3 % (coil1 and coil3 by " in out
    assert "warning" not in out
    rows = list(csv.DictReader(Path("s.csv").read_text(encoding="utf-8").splitlines()))
    assert [float(row["frequency_Hz"]) for row in rows] == pytest.approx([1e5] * 3 + [1e7] * 3)


@pytest.mark.slow
@pytest.mark.parametrize("command", ["report", "impedance", "export"])
def test_a_broken_rule_is_refused_unless_allowed(capsys, command):
    text = read("starter").replace('[["L1", "L2"], ["L3", "L4"]]', '[["L1", "L2"]]')  # coils overlap on one layer pair
    Path("d.toml").write_text(text, encoding="utf-8")
    more = ("--to", "kicad") if command == "export" else ()
    # rule, nets, layer and margin
    wanted = r"clearance of coil1 – coil2 on layer L[12] is -.* mm at .* mm, margin -.* mm"
    assert re.search(wanted, refused(capsys, command, "d.toml", *more))
    assert sorted(path.name for path in Path().iterdir()) == ["d.toml"]
    if command in ("impedance", "export"):
        # crossing coils on one layer: the numbers are still finite
        good(capsys, command, "d.toml", *more, "--allow-violations")


def test_a_design_named_without_its_ending_is_hinted_at(capsys):
    Path("pad.toml").write_text("", encoding="utf-8")
    assert refused(capsys, "check", "pad").endswith("starter); did you mean pad.toml?")


test_mistakes_are_one_line = mistakes(
    refused,
    (("repot",), "No such command 'repot'"),
    (("report", "none.toml"), "there is no design file none.toml"),
    (("impedance", "starter", "--out", "m.xlsx"), "--out must end in .nc, .csv, .cir, .sub, .sNp or .inp; got m.xlsx"),
    (("view", "starter", "--out", "f.nc", "--coil", "coil9"), "--coil must be one of coil1, coil2, coil3; got coil9"),
    (("view", "starter", "--out", "f.nc", "--spacing-mm", "0"), "--spacing-mm must be 1e-06 to 100000; got 0"),
    (("view", "starter", "--out", "f.nc", "--z-mm", "0:90000"), "points; at most 20000000 are allowed"),
    (("check", ""), "the name of a design file must not be empty"),
    (("view", "starter", "--out", "f.nc", "--z-mm", "3:1"), "FROM:TO with FROM below TO, at most 100000; got '3:1'"),
    (("impedance", "starter", "--from-MHz", "5", "--to-MHz", "1"), "--from-MHz must be at least 1e-06 and below"),
    (("impedance", "starter", "--points", "1"), "--points must be 2 to 10000; got 1"),
    (("impedance", "starter", "--out", "m.s2p"), "a Touchstone file of 3 ports must end in .s3p; got m.s2p"),
    (("init", "."), ". is a folder; name a file in it"),
    (("init", "d.txt"), "NAME must end in .toml; got d.txt"),
    (("init", "d", "--size-mm", "1x2x3"), "size must be a width, as 16, or width and height, as 20x12"),
    (("init", "d", "--shape", "rectangle", "--size-mm", "20xnan"), "size must be positive and finite; got nan mm"),
    (("init", "d", "--shape", "star"), "Invalid value for '--shape': 'star' is not one of 'hexagon', 'square'"),
    (("init", "d", "--coils", "5-hex"), "coils must be as 1, 6 (a row), 4x4"),
)


def test_a_report_wants_the_result_of_distortion(capsys):
    save_dataset(xr.Dataset({"delta": 1.0}), Path("map.nc"))
    line = refused(capsys, "report", "starter", "--distortion", "map.nc")
    assert "map.nc must have effects and ellipses over cause" in line
    assert "there is no file n.nc" in refused(capsys, "report", "starter", "--distortion", "n.nc")
    assert "map.nc must have mutual inductances" in refused(capsys, "report", "starter", "--link", "map.nc")
    assert not Path("report.html").exists()


def test_a_folder_that_cannot_be_written(capsys):
    for name in ("taken", "taken.toml"):
        Path(name).write_text("a file, not a folder", encoding="utf-8")
        assert f"cannot make the folder {name}: a file has that name" in refused(
            capsys, "report", "starter", "--out", name
        )
        assert Path(name).read_text(encoding="utf-8") == "a file, not a folder"


@pytest.mark.slow
def test_two_coils_in_one_place(capsys):
    text = read("gast_fem")
    first = text[text.index("[[array.placements]]") : text.index("[board]")]
    text = text.replace(first, first + first.replace('"coil1"', '"coil2"'))
    Path("d.toml").write_text(text, encoding="utf-8")
    assert "clearance of coil1 – coil2" in refused(capsys, "impedance", "d.toml")
    assert "must be positive definite" in refused(capsys, "impedance", "d.toml", "--allow-violations")


@pytest.mark.slow
def test_the_installed_program():
    """The program in a process of its own: geometry alone loads no physics; exit code, no traceback.

    NumPy must not be there before `main` says how many threads its algebra gets: with two instead of one the circuit
    of 64 coils takes five times as long.
    """
    heavy = {"vtk", "pyvista", "serial", "numba", "matplotlib", "scipy", "xarray", "pandas"}
    script = "import sys, coilarray; from coilarray.cli.main import main; early = 'numpy' in sys.modules"
    script += "; main(['check', '--allow-violations']); sys.exit('early') if early else None"
    script += f"; bad = {heavy} & set(sys.modules); sys.exit(str(bad) if bad else main(['report', 'none.toml']))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 2, done.stderr
    assert done.stderr.startswith("coilarray: error: there is no design file none.toml")


def test_every_value_of_a_design_has_its_key(capsys):
    known = {key["key"]: key for key in answer(capsys, "keys")}
    assert all(key["meaning"] for key in known.values())
    for name, value in load_design_file("starter").values.items():
        parts = ["N" if part.isdecimal() else part for part in name.split(".")]
        parts[1:2] = ["NAME"] if parts[0] == "coils" else parts[1:2]
        assert value == [] or ".".join(parts) in known
    assert known["coils.NAME.via.pad_mm"] == {
        "key": "coils.NAME.via.pad_mm", "kinds": [], "unit": "mm", "allowed": "number, above 0, at most 10\u202f000",
        "default": "0.45", "meaning": "Diameter of the copper around it.",
    }  # fmt: skip


def test_a_word_chooses_keys_by_name_or_meaning(capsys):
    assert [key["key"] for key in answer(capsys, "keys", "Oscillator")] == ["readout.external_clock"]
    assert {key["key"] for key in answer(capsys, "keys", "sides")} > {"coils.NAME.sides", "indentation.sample_x_mm"}
    line = next(line for line in good(capsys, "keys", "capacitance_pF").splitlines() if line.startswith("circuit.cap"))
    assert line.split()[:2] == ["circuit.capacitance_pF", "pF"]
    assert "did you mean pitch_mm?" in refused(capsys, "keys", "pitch_m_m")


LOOP = """
schema = 1
name = "loop"
stackup = {layers = ["L1"], copper_thickness_um = [35], dielectric_thickness_mm = [], dielectric_epsilon_r = []}
array = {lattice = "single", coil = "c", layers = [["L1"]]}
circuit = {capacitance_pF = 3300}

[coils.c]
shape = "path"
lines_mm = [[[-6, -8], [-6, 6], [6, 6], [6, -6], [-4, -6], [-4, -8]]]
trace_width_mm = 0.3
gap_mm = 0.3
via = {drill_mm = 0.3, pad_mm = 0.6, plating_um = 25}
"""


@pytest.mark.slow
@pytest.mark.parametrize("command", [
    "impedance", "sweep --vary coils.c.trace_width_mm=0.2,0.3 -q q -q srf_margin --workers 1",
    "tolerance --samples 0 -q q --workers 1",
], ids=lambda command: command.split()[0])  # fmt: skip
def test_commands_go_on_without_capacitance_and_name_it(capsys, command):
    Path("loop.toml").write_text(LOOP, encoding="utf-8")
    name, *options = command.split()
    code, out, _ = run(capsys, name, "loop.toml", *options)
    assert (code, "capacitance of the windings" in out) == (0, True)


@pytest.mark.slow
def test_init_names_it_and_says_how_far_the_limits_are_known(capsys):
    """A coil of 0.2 m by a new design, in thin traces: its frequency is a quarter lower with its capacitance."""
    _, out, _ = run(capsys, "init", "wide.toml", "--coils", "1", "--size-mm", "200", "--no-elastomer")
    assert "not in these numbers: capacitance of the windings: coil1" in out
    assert "converter: as far as these numbers go, every limit" in out


@pytest.mark.parametrize("width", [30, 64, 100, 200])
def test_a_table_cuts_nothing_on_a_narrow_terminal(width):
    """Headings were cut within words, and names of coils to "coi…"."""
    headers = ["coil", "AC resistance (Ω)", "model of the AC resistance", "self-resonance (MHz)", "capacitance (pF)"]
    rows = [[f"coil{k}", f"{k}.356", "section filaments", f"1{k}.3046", f"{k}.81"] for k in range(3)]
    text = text_table(headers, rows, "coils").text(width)
    assert max(map(len, text.splitlines())) <= width
    assert "…" not in text
    tables = text.split("\n\n")
    assert (len(tables) == 1) is (width >= 64)
    assert text.count("coil1") == len(tables)
    words, cells = (" ".join(part).split() for part in (headers[1:], [" ".join(row[1:]) for row in rows]))
    assert sorted(text.split()) == sorted([*words, *cells, "coils", *len(tables) * ["coil", *(row[0] for row in rows)]])
