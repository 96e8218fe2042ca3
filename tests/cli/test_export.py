"""``coilarray export``: every format, names, sizes, and one line for every mistake with nothing left behind."""

from __future__ import annotations

import importlib.util
import json
import os
import sys
import zipfile
from pathlib import Path
from xml.etree import ElementTree as ET

import ezdxf
import pytest
import trimesh
from support.command_line import runner

from coilarray import export, load_design
from coilarray.cli.main import main

pytestmark = pytest.mark.usefixtures("own_folder")
run, refused = runner("export")

FORMATS = ("kicad", "gerber", "dxf", "svg", "step", "stl", "glb")
NAMES = {to: f"starter.{to}" for to in FORMATS} | {"kicad": "starter-kicad", "gerber": "starter-gerber.zip"}
NEEDS = {"step": "OCP", "gerber": "gerbonara", "dxf": "ezdxf"}
AVAILABLE = [
    pytest.param(
        to,
        marks=pytest.mark.skipif(
            to in NEEDS and importlib.util.find_spec(NEEDS[to]) is None, reason=f"no {NEEDS.get(to)}"
        ),
    )
    for to in FORMATS
]


ONE_LAYER = """
schema = 1
name = "one"
[stackup]
layers = ["top"]
copper_thickness_um = [35]
[coils.a]
shape = "circle"
segments_per_turn = 32
outer_diameter_mm = 10
turns_per_layer = 3
winding_layers = 1
trace_width_mm = 0.2
gap_mm = 0.2
leads = { length_mm = 2.0, spacing_mm = 1.5, pad_mm = 1.0, drill_mm = 0.5 }
[array]
lattice = "free"
placements = [
  { name = "A", coil = "a", layers = ["top"], x_mm = 0, y_mm = 0, rotation_deg = 30 },
  { name = "B", coil = "a", layers = ["top"], x_mm = 20, y_mm = 5, rotation_deg = -77.7 },
]
"""


def broken_design():
    """Three coils that share one layer pair and overlap."""
    main(["init", "d.toml"])
    text = Path("d.toml").read_text(encoding="utf-8")
    Path("d.toml").write_text(text.replace('[["L1", "L2"], ["L3", "L4"]]', '[["L1", "L2"]]'), encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("to", AVAILABLE)
def test_every_format_is_written_and_named_after_the_design(capsys, to):
    code, out, err = run(capsys, "starter", "--to", to)
    assert (code, err) == (0, "")
    assert [entry.name for entry in Path().iterdir()] == [NAMES[to]]
    made = sorted(str(path) for path in Path().rglob("*") if path.is_file())
    lines = out.splitlines()
    if to in ("kicad", "gerber"):
        assert lines.pop() == "net check of the copper as written: 3 coils, each whole and by itself"
    assert sorted(line.removeprefix("wrote ").rpartition(" (")[0] for line in lines) == made
    assert all(line.endswith((" kB)", " MB)")) for line in lines)
    # again: refused, and replaced on demand
    before = {path: Path(path).read_bytes() for path in made}
    assert f"{NAMES[to]} exists; --force replaces" in refused(capsys, "starter", "--to", to)
    assert before == {path: Path(path).read_bytes() for path in made}
    code, out, _ = run(capsys, "starter", "--to", to, "--force", "--json")
    assert code == 0
    data = json.loads(out)
    assert data["design_hash"] == load_design("starter").digest
    assert data["format"] == to
    assert {file["path"]: file["bytes"] for file in data["files"]} == {path: Path(path).stat().st_size for path in made}


@pytest.mark.slow
@pytest.mark.parametrize(("to", "writer"), [("kicad", "kicad.write_kicad"), ("gerber", "gerber.write_gerbers")])
def test_copper_that_is_not_the_coils_is_reported(capsys, monkeypatch, to, writer):
    """An exporter that loses the last coil, as it stands on its layers."""
    module, name = f"coilarray.geometry.export.{writer}".rsplit(".", 1)
    true = getattr(importlib.import_module(module), name)

    def losing(array, path, **options):
        return true(array.with_placements(array.placements[:-1]), path, **options)

    assert run(capsys, "starter", "--to", to)[0] == 0
    before = {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()}
    monkeypatch.setattr(f"{module}.{name}", losing)
    line = refused(capsys, "starter", "--to", to, "--force")
    assert f"{NAMES[to]} is not written: its copper is not that of the coils" in line
    assert {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()} == before
    code, out, _ = run(capsys, "starter", "--to", to, "--force", "--allow-violations")
    assert code == 0
    assert "warning: " in out
    code, out, _ = run(capsys, "starter", "--to", to, "--force", "--allow-violations", "--json")
    assert "coil3" in " ".join(json.loads(out)["net_faults"])


@pytest.mark.slow
def test_a_segment_with_the_net_of_another_coil_is_reported(capsys, monkeypatch):
    from coilarray.geometry.export import kicad

    true = kicad.board_text

    def misnamed(array, name, title):
        head, segment, rest = true(array, name, title).partition("(segment ")
        return head + segment + rest.replace("(net 1)", "(net 2)", 1)

    monkeypatch.setattr(kicad, "board_text", misnamed)
    assert "of coil1 has the net coil2 at (" in refused(capsys, "starter", "--to", "kicad")


def test_from_python(tmp_path):
    design = load_design("starter")
    for name in ("a.dxf", "a.stl", "a.zip", "project"):
        exported = export(design, tmp_path / name, sheets=False)
        assert exported.net_faults == ()
        assert all(path.stat().st_size for path in exported.files)
    assert (tmp_path / "project" / "starter.kicad_pcb").is_file()


@pytest.mark.parametrize("to", ["kicad", "gerber"])
def test_a_board_of_one_layer(capsys, to):
    Path("one.toml").write_text(ONE_LAYER, encoding="utf-8")
    code, out, err = run(capsys, "one.toml", "--to", to)
    assert (code, err) == (0, "")
    assert "net check of the copper as written: 2 coils, each whole and by itself" in out


@pytest.mark.slow
def test_files_hold_the_board(capsys):
    Path("sub").mkdir()
    array = load_design("starter").array
    assert run(capsys, "starter", "--to", "dxf", "--out", "sub/a.DXF")[0] == 0
    assert "copper_L4" in ezdxf.readfile("sub/a.DXF").layers
    assert run(capsys, "starter", "--to", "svg", "-o", "sub/a.svg")[0] == 0
    assert ET.parse("sub/a.svg").getroot()[0].text == load_design("starter").title
    assert run(capsys, "starter", "--to", "glb", "--out", "a.glb")[0] == 0
    assert "sheet/base" in trimesh.load_scene("a.glb").geometry
    assert run(capsys, "starter", "--to", "glb", "--out", "b.glb", "--no-sheets")[0] == 0
    bare = set(trimesh.load_scene("b.glb").geometry)
    assert "board" in bare
    assert not [name for name in bare if name.startswith("sheet/")]
    assert run(capsys, "starter", "--to", "stl", "--out", "b.stl", "--no-sheets")[0] == 0
    assert trimesh.load_mesh("b.stl").extents[2] == pytest.approx(array.stackup.thickness * 1e3, rel=1e-6)  # float32


@pytest.mark.slow
def test_gerbers_are_named_after_the_design(capsys):
    pytest.importorskip("gerbonara", reason="no gerbonara")
    assert run(capsys, "starter", "--to", "gerber", "--out", "board.zip")[0] == 0
    with zipfile.ZipFile("board.zip") as files:
        assert files.testzip() is None
        assert all(Path(name).name.startswith("starter") for name in files.namelist())


@pytest.mark.slow
def test_kicad_writes_into_a_folder(capsys):
    Path("taken").mkdir()
    Path("taken/notes.txt").write_text("mine", encoding="utf-8")
    assert "taken exists; --force replaces the files in it" in refused(
        capsys, "starter", "--to", "kicad", "--out", "taken"
    )
    Path("empty").mkdir()
    assert run(capsys, "starter", "--to", "kicad", "--out", "empty")[0] == 0
    assert Path("empty/starter.kicad_pcb").read_text(encoding="utf-8").startswith("(kicad_pcb ")
    assert run(capsys, "starter", "--to", "kicad", "--out", "taken", "--force")[0] == 0
    assert Path("taken/starter.kicad_pcb").is_file()
    assert Path("taken/notes.txt").read_text(encoding="utf-8") == "mine"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("starter",), "Missing option '--to'"),
        (("starter", "--to", "pdf"), "'pdf' is not one of 'kicad', 'gerber', 'dxf'"),
        (("none.toml", "--to", "dxf"), "there is no design file none.toml"),
        (("starter", "--to", "dxf", "--out", "a.dwg"), "--out must end in .dxf; got a.dwg"),
        (("starter", "--to", "step", "--out", "a.stl"), "--out must end in .step or .stp; got a.stl"),
        (("starter", "--to", "gerber", "--out", "gerbers"), "--out must end in .zip; got gerbers"),
        (("starter", "--to", "svg", "--out", "no/a.svg"), "cannot write no/a.svg: there is no folder no"),
        (("starter", "--to", "kicad", "--out", "no/board"), "cannot write no/board: there is no folder no"),
        (("starter", "--to", "kicad", "--out", "a.kicad_pcb"), "--out must be a folder, in which kicad has several"),
        (("starter", "--to", "svg", "--out", "a" * 300 + ".svg"), "File name too long"),
    ],
)
def test_mistakes_are_one_line(capsys, arguments, message):
    assert message in refused(capsys, *arguments)
    assert list(Path().iterdir()) == []


def test_names_that_are_taken_by_the_wrong_kind(capsys):
    Path("folder.svg").mkdir()
    assert "folder.svg: it is a folder" in refused(capsys, "starter", "--to", "svg", "--out", "folder.svg", "--force")
    Path("starter-kicad").write_text("a file", encoding="utf-8")
    assert "a file has that name, and kicad needs a folder" in refused(capsys, "starter", "--to", "kicad", "--force")
    assert Path("starter-kicad").read_text(encoding="utf-8") == "a file"


@pytest.mark.slow
@pytest.mark.parametrize("to", AVAILABLE)
def test_a_broken_rule_is_refused_unless_allowed(capsys, to):
    broken_design()
    capsys.readouterr()
    line = refused(capsys, "d.toml", "--to", to)
    assert "clearance of coil1 – coil2" in line
    assert [entry.name for entry in Path().iterdir()] == ["d.toml"]
    assert run(capsys, "d.toml", "--to", to, "--allow-violations")[0] == 0
    assert Path(NAMES[to]).exists()


@pytest.mark.parametrize(("to", "module", "extra"), [("dxf", "ezdxf", "fab"), ("step", "OCP.STEPCAFControl", "step")])
def test_a_missing_extra_is_named(capsys, monkeypatch, to, module, extra):
    monkeypatch.setitem(sys.modules, module, None)
    if to == "step":
        monkeypatch.setitem(sys.modules, "OCP", None)
    assert f'pip install "coilarray[{extra}]"' in refused(capsys, "starter", "--to", to)
    assert list(Path().iterdir()) == []


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write everywhere")
def test_a_read_only_folder(capsys):
    folder = Path("locked")
    folder.mkdir(mode=0o555)
    assert "nothing may be written in the folder locked" in refused(
        capsys, "starter", "--to", "svg", "--out", "locked/a.svg"
    )
    assert list(folder.iterdir()) == []


def test_a_folder_without_permission(capsys, monkeypatch):
    # root may write everywhere, so the refusal of the system is played
    monkeypatch.setattr("coilarray.cli.export.os.access", lambda path, mode: False)
    assert "cannot write starter.svg: nothing may be written in the folder ." in refused(
        capsys, "starter", "--to", "svg"
    )
    assert "cannot write starter-kicad: nothing may be written in the folder ." in refused(
        capsys, "starter", "--to", "kicad"
    )
    assert list(Path().iterdir()) == []


@pytest.mark.slow
@pytest.mark.parametrize("to", AVAILABLE)
def test_a_full_disk_leaves_nothing(capsys, monkeypatch, to):
    def full(path, target):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    monkeypatch.setattr(Path, "rename", full)
    monkeypatch.setattr(os, "replace", full)
    monkeypatch.setattr(os, "rename", full)
    assert "No space left on device" in refused(capsys, "starter", "--to", to)
    assert list(Path().iterdir()) == []
