"""``coilarray export``: every format, names, sizes, and one line for every mistake with nothing left behind."""

import functools
import importlib
import re
import sys
import zipfile
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree as ET

import ezdxf
import pytest
import trimesh
from support.boards import many_layers
from support.command_line import mistakes, runner, successes

from coilarray import Design, export, load_design
from coilarray.design.bundled import read
from coilarray.design.export import SUFFIXES
from coilarray.geometry import Array, Placement, Spiral

pytestmark = pytest.mark.usefixtures("own_folder")
_, refused = runner("export")
good, answer = successes("export")

NAMES = {to: f"starter.{to}" for to in SUFFIXES} | {"kicad": "starter-kicad", "gerber": "starter-gerber.zip"}
NEEDS = {"step": "OCP", "gerber": "gerbonara", "dxf": "ezdxf"}
AVAILABLE = [
    pytest.param(to, marks=pytest.mark.skipif(find_spec(NEEDS.get(to, "json")) is None, reason=f"no {NEEDS.get(to)}"))
    for to in SUFFIXES
]


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A file of the starter with few turns, which are written quickly."""
    path = tmp_path_factory.mktemp("small") / "small.toml"
    path.write_text(read("starter").replace("turns_per_layer = 12", "turns_per_layer = 4"), encoding="utf-8")
    return path


def files_here():
    """Every file below the folder of the test, with its content."""
    return {str(path): path.read_bytes() for path in sorted(Path().rglob("*")) if path.is_file()}


@pytest.mark.slow
@pytest.mark.parametrize("to", AVAILABLE)
def test_every_format_is_written_and_named_after_the_design(capsys, small, to):
    out = good(capsys, small, "--to", to)
    assert [entry.name for entry in Path().iterdir()] == [NAMES[to]]
    if to == "gerber":  # in the archive they are named after the design too
        with zipfile.ZipFile(NAMES[to]) as files:
            assert files.testzip() is None
            assert all(Path(name).name.startswith("starter") for name in files.namelist())
    made = files_here()
    lines = out.splitlines()
    if to in ("kicad", "gerber"):
        assert lines.pop() == "check of the copper as written: 3 coils, each in one piece and isolated"
    assert sorted(line.removeprefix("wrote ").rpartition(" (")[0] for line in lines) == list(made)
    assert all(line.endswith((" kB)", " MB)")) for line in lines)
    data = answer(capsys, small, "--to", to, "--force")
    assert (data["design_hash"], data["format"]) == (load_design(small).digest, to)
    assert {file["path"]: file["bytes"] for file in data["files"]} == {k: len(v) for k, v in files_here().items()}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("to", "writer"), [("kicad", "kicad_writer.write_kicad"), ("gerber", "gerber_writer.write_gerbers")]
)
def test_copper_that_is_not_the_coils_is_reported(capsys, small, monkeypatch, to, writer):
    """An exporter that loses the last coil, as it stands on its layers."""
    module, name = f"coilarray.fabrication.{writer}".rsplit(".", 1)
    true = getattr(importlib.import_module(module), name)

    def losing(array, path, **options):
        return true(array.with_placements(array.placements[:-1]), path, **options)

    good(capsys, small, "--to", to)
    before = files_here()
    monkeypatch.setattr(f"{module}.{name}", losing)
    line = refused(capsys, small, "--to", to, "--force")
    assert f"{NAMES[to]} is not written, as its copper would not be that of the coils" in line
    assert files_here() == before
    assert "warning: " in good(capsys, small, "--to", to, "--force", "--allow-violations")
    data = answer(capsys, small, "--to", to, "--force", "--allow-violations")
    assert "coil3" in " ".join(data["net_faults"])


def one_layer():
    """Two coils on a board of one layer, at angles of their own."""
    coil = Spiral(32, 8e-3, 3, 0.2e-3, 0.2e-3, layers=1).coil()
    places = (Placement("A", coil, ("L1",), 0, 0, 0.5), Placement("B", coil, ("L1",), 20e-3, 5e-3, -1.36))
    return Design(Array(many_layers(1), places), name="one")


@pytest.mark.parametrize("make", [one_layer, functools.partial(load_design, "starter")])
def test_from_python(tmp_path, make):
    design = make()
    for name in ("a.dxf", "a.stl", "a.zip", "project"):
        exported = export(design, tmp_path / name, sheets=False)
        assert exported.net_faults == ()
        assert all(path.stat().st_size for path in exported.files)
    assert (tmp_path / "project" / f"{design.name}.kicad_pcb").is_file()


@pytest.mark.slow
def test_files_hold_the_board(capsys, small):
    Path("sub").mkdir()
    for name in ("sub/a.DXF", "sub/a.svg", "a.glb", "b.glb", "b.stl"):
        bare = ("--no-sheets",) if name.startswith("b") else ()
        good(capsys, small, "--to", name[-3:].lower(), "--out", name, *bare)
    design = load_design(small)
    assert "copper_L4" in ezdxf.readfile("sub/a.DXF").layers
    assert ET.parse("sub/a.svg").getroot()[0].text == design.title
    whole, bare = (set(trimesh.load_scene(name).geometry) for name in ("a.glb", "b.glb"))
    assert "sheet/base" in whole
    assert bare == {name for name in whole if not name.startswith("sheet/")} > {"board"}
    height = design.array.stackup.thickness * 1e3
    assert trimesh.load_mesh("b.stl").extents[2] == pytest.approx(height, rel=1e-6)  # float32


@pytest.mark.slow
def test_kicad_writes_into_a_folder(capsys, small):
    Path("taken").mkdir()
    Path("taken/notes.txt").write_text("mine", encoding="utf-8")
    assert "taken exists; --force replaces it" in refused(capsys, small, "--to", "kicad", "--out", "taken")
    Path("empty").mkdir()
    good(capsys, small, "--to", "kicad", "--out", "empty")
    assert Path("empty/starter.kicad_pcb").read_text(encoding="utf-8").startswith("(kicad_pcb ")
    good(capsys, small, "--to", "kicad", "--out", "taken", "--force")
    assert Path("taken/starter.kicad_pcb").is_file()
    assert Path("taken/notes.txt").read_text(encoding="utf-8") == "mine"


test_mistakes_are_one_line = mistakes(
    refused,
    (("starter",), "Missing option '--to'"),
    (("starter", "--to", "pdf"), "'pdf' is not one of 'kicad', 'gerber', 'dxf'"),
    (("starter", "--to", "dxf", "--out", "a.dwg"), "--out must end in .dxf; got a.dwg"),
    (("starter", "--to", "step", "--out", "a.stl"), "--out must end in .step or .stp; got a.stl"),
    (("starter", "--to", "gerber", "--out", "gerbers"), "--out must end in .zip; got gerbers"),
    (("starter", "--to", "svg", "--out", "no/a.svg"), "cannot write no/a.svg: there is no folder no"),
    (("starter", "--to", "kicad", "--out", "a.kicad_pcb"), "--out must be a folder, as kicad has several"),
    (("starter", "--to", "svg", "--out", "a" * 300 + ".svg"), "File name too long"),
)


@pytest.mark.parametrize(("to", "module", "extra"), [("dxf", "ezdxf", "fab"), ("step", "OCP.STEPCAFControl", "step")])
def test_a_missing_extra_is_named(capsys, monkeypatch, to, module, extra):
    monkeypatch.setitem(sys.modules, module, None)
    if to == "step":
        monkeypatch.setitem(sys.modules, "OCP", None)
    assert re.search(rf'-m pip install .*\[{extra}\]"', refused(capsys, "starter", "--to", to))
    assert list(Path().iterdir()) == []


def test_a_folder_without_permission(capsys, monkeypatch):
    # root may write everywhere, so the refusal of the system is played
    monkeypatch.setattr("coilarray.cli.shared.os.access", lambda path, mode: False)
    for to in ("svg", "kicad"):
        assert "the folder . is not writable" in refused(capsys, "starter", "--to", to)
    assert list(Path().iterdir()) == []
