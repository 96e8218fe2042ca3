"""Gerber zip: grammar of the statements, copper against shapely, nets, holes, job file, two independent readers.

Readers: gerbonara (objects, names of files) and, where it is installed, gerbv (rendered area).
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import warnings
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from PIL import Image
from support.boards import (
    FOUR_LAYERS,
    SMALL,
    VIA,
    WOUND,
    drawn_copper,
    one_coil,
    small_board,
    stroked,
)
from support.refusals import refused

from coilarray.errors import OutputError, RuleViolationError
from coilarray.fabrication.gerber_reader import read_gerbers
from coilarray.fabrication.gerber_writer import write_gerbers
from coilarray.geometry import Array, Coil, Placement, path_coil
from coilarray.geometry.copper import board_outline, drills

gerbonara = pytest.importorskip("gerbonara")


def written(array: Array, folder: Path, name: str = "board") -> dict[str, str]:
    """Text of every file in the zip by its name."""
    path = folder / "board.zip"
    write_gerbers(array, path, name=name)
    with zipfile.ZipFile(path) as archive:
        return {entry: archive.read(entry).decode("utf-8") for entry in archive.namelist()}


def named(coil: Coil, name: str) -> Array:
    array = one_coil(coil)
    return array.with_placements([replace(array.placements[0], name=name)])


def file_function(text: str) -> tuple[str, ...]:
    return tuple(re.findall(r"TF\.FileFunction,([^*\n]*)", text)[0].split(","))


def gerber(text: str) -> gerbonara.GerberFile:
    """Read with gerbonara; its warnings are errors."""
    return gerbonara.GerberFile.from_string(text)


@pytest.mark.slow
def test_files_and_their_functions(tmp_path: Path) -> None:
    files = written(small_board(), tmp_path, "two coils")
    functions = {name: ",".join(file_function(text)) for name, text in files.items() if not name.endswith("job")}
    assert functions == {
        "two_coils-F_Cu.gbr": "Copper,L1,Top", "two_coils-In1_Cu.gbr": "Copper,L2,Inr",
        "two_coils-In2_Cu.gbr": "Copper,L3,Inr", "two_coils-B_Cu.gbr": "Copper,L4,Bot",
        "two_coils-F_Mask.gbr": "Soldermask,Top", "two_coils-B_Mask.gbr": "Soldermask,Bot",
        "two_coils-F_Silkscreen.gbr": "Legend,Top", "two_coils-Edge_Cuts.gbr": "Profile,NP",
        "two_coils-PTH.drl": "Plated,1,4,PTH",
    }  # fmt: skip
    assert set(files) - set(functions) == {"two_coils-job.gbrjob"}
    for name, text in files.items():
        polarity = "Negative" if "Mask" in name else "Positive"
        with_polarity = any(kind in name for kind in ("Cu.", "Mask", "Silk"))
        assert re.findall(r"%TF\.FilePolarity,(\w+)\*%", text) == [polarity] * with_polarity
    # gerbonara knows the layers by their names too
    with zipfile.ZipFile(tmp_path / "board.zip") as archive, warnings.catch_warnings():
        archive.extractall(tmp_path / "files")
        warnings.simplefilter("ignore", SyntaxWarning)  # on its own guesses
        stack = gerbonara.LayerStack.open(tmp_path / "files")
    assert {" ".join(key) for key in stack.graphic_layers} == {
        *("top copper", "inner_1 copper", "inner_2 copper", "bottom copper"),
        *("top mask", "bottom mask", "top silk", "mechanical outline"),
    }
    assert len(stack.drill_pth) == len(drills(small_board()))


def test_every_statement_is_whole(tmp_path: Path) -> None:
    """The grammar of the Gerber format, 2023: what a strict reader takes."""
    number, name = r"-?\d+", r"[._$a-zA-Z][._$a-zA-Z0-9]*"
    header = (r"%FSLAX46Y46\*%", r"%MOMM\*%", r"%LPD\*%", r"G75\*", r"G01\*")
    attributes = (r"G04 [^*%]*\*", rf"%T[FAO]{name}(,[^*%]*)*\*%", r"%TD\*%")
    objects = (r"%ADD[1-9]\d+C,\d+\.\d+\*%", r"D[1-9]\d+\*", rf"X{number}Y{number}D0[123]\*", r"M02\*")
    arcs = (r"G0[23]\*", rf"X{number}Y{number}I{number}J{number}D01\*")
    statements = (*header, *attributes, *objects, *arcs)
    for entry, text in written(WOUND["circle"], tmp_path).items():
        if not entry.endswith(".gbr"):
            continue
        lines = text.splitlines()
        assert [line for line in lines if not any(re.fullmatch(form, line) for form in statements)] == [], entry
        assert lines[-1] == "M02*"
        drawing = next(k for k, line in enumerate(lines) if line.endswith(("D01*", "D02*", "D03*")))
        for needed in ("%FSLAX46Y46*%", "%MOMM*%", "G01*", "G75*"):
            assert lines.index(needed) < drawing
        # attributes are taken off apertures and objects again before others are put on
        assert sum(line.startswith("%TA") for line in lines) <= lines.count("%TD*%")


@pytest.mark.parametrize("through_holes", [True, False])
def test_drills(through_holes: bool, tmp_path: Path) -> None:
    array = small_board(through_holes=through_holes)
    files = {name: text for name, text in written(array, tmp_path).items() if name.endswith(".drl")}
    spans = {name: file_function(text) for name, text in files.items()}
    blind = {f"board-PTH-L{k}-L{k + 1}.drl": ("Plated", str(k), str(k + 1), "Blind") for k in (1, 3)}
    assert spans == ({"board-PTH.drl": ("Plated", "1", "4", "PTH")} if through_holes else blind)
    for text in files.values():
        assert text.startswith("M48\n")
        assert text.endswith("\nM30\n")
    # a terminal that reaches one layer only is a pad without a hole
    found = [item for text in files.values() for item in gerbonara.ExcellonFile.from_string(text).objects]
    assert len(found) == sum(hole.drilled for hole in drills(array))
    # buried ones
    array = Array(FOUR_LAYERS, (Placement("A", SMALL, ("L2", "L3"), 0, 0),), through_holes=False)
    assert file_function(written(array, tmp_path)["board-PTH-L2-L3.drl"]) == ("Plated", "2", "3", "Buried")


def test_masks_are_open_over_terminals_only(tmp_path: Path) -> None:
    array = small_board()
    files = written(array, tmp_path)
    terminals = [hole for hole in drills(array) if hole.kind == "terminal"]
    expected = shapely.union_all([shapely.Point(h.x, h.y).buffer(h.pad / 2, quad_segs=32) for h in terminals])
    vias = [shapely.Point(h.x, h.y).buffer(h.pad / 2) for h in drills(array) if h.kind == "via"]
    for name in ("board-F_Mask.gbr", "board-B_Mask.gbr"):
        read = drawn_copper(gerber(files[name]))
        # places are rounded to 1 nm: at most 0.7 nm of shift, 4/π · 0.7 nm of a diameter of 1 mm
        assert read.symmetric_difference(expected).area < 2e-6 * expected.area
        assert not shapely.intersects(vias, read).any()
    blind = written(small_board(through_holes=False), tmp_path)
    tops, bottoms = (gerber(blind[f"board-{side}_Mask.gbr"]).objects for side in "FB")
    assert (len(tops), len(bottoms)) == (1, 1)  # A begins on L1, B ends on L4; the other ends lie inside


def test_silk_has_the_names_upright_within_the_board_and_off_the_pads(tmp_path: Path) -> None:
    strokes = gerber(written(named(SMALL, "L"), tmp_path)["board-F_Silkscreen.gbr"]).objects
    ends = np.array([(s.x1, s.y1, s.x2, s.y2) for s in strokes])
    low = ends[np.isclose(ends[:, 1], ends[:, [1, 3]].min()) & np.isclose(ends[:, 1], ends[:, 3])]
    assert len(low) == 1  # the foot of the L lies below
    assert np.ptp(ends[:, [1, 3]]) == pytest.approx(1.0, rel=0.05)  # 1 mm letters
    ink = drawn_copper(gerber(written(small_board(), tmp_path)["board-F_Silkscreen.gbr"]))
    assert board_outline(small_board()).contains(ink)
    assert not any(ink.intersects(shapely.Point(h.x, h.y).buffer(h.pad / 2)) for h in drills(small_board()))
    # names without room or glyphs do no harm
    tiny = path_coil([[(0, 0), (1e-3, 0)]], 0.2e-3, 0.2e-3, VIA)
    long_name = "a name that is far too long for so small a coil"
    assert gerber(written(named(tiny, long_name), tmp_path)["board-F_Silkscreen.gbr"]).objects == []
    assert gerber(written(named(SMALL, "Ω\u00a0\U0001f9f2"), tmp_path)["board-F_Silkscreen.gbr"]).objects


def test_the_job_file_lists_the_files_and_the_size(tmp_path: Path) -> None:
    """Its stack-up and the edge of the board are those of test_round_trip.py."""
    array = small_board()
    files = written(array, tmp_path)
    job = json.loads(files["board-job.gbrjob"])
    listed = {entry["Path"]: entry["FileFunction"] for entry in job["FilesAttributes"]}
    assert listed == {name: ",".join(file_function(text)) for name, text in files.items() if "job" not in name}
    assert job["GeneralSpecs"]["BoardThickness"] == pytest.approx(array.stackup.thickness * 1e3)
    x_min, y_min, x_max, y_max = array.bounds
    assert job["GeneralSpecs"]["Size"] == pytest.approx({"X": (x_max - x_min) * 1e3, "Y": (y_max - y_min) * 1e3})


def test_equal_designs_give_equal_bytes(tmp_path: Path) -> None:
    paths = [tmp_path / f"{k}.zip" for k in range(3)]
    for path, name in zip(paths, ("board", "board", "other"), strict=True):
        write_gerbers(small_board(), path, name=name)
    first, again, other = (path.read_bytes() for path in paths)
    assert first == again != other
    with zipfile.ZipFile(paths[0]) as archive:
        text = archive.read("board-F_Cu.gbr").decode()
    assert "CreationDate" not in text
    (guid, revision) = re.findall(r"%TF\.ProjectId,board,([0-9a-f-]{36}),(\w+)\*%", text)[0]
    assert (len(guid), revision) == (36, "1")


def test_names_with_signs_of_the_format_come_back(tmp_path: Path) -> None:
    name = "a,b*c%d\\e é"
    files = written(named(SMALL, name), tmp_path, name="50%, *new*")
    assert all(entry.startswith("50_new_-") for entry in files)
    assert "%TO.N,a\\u002Cb\\u002Ac\\u0025d\\u005Ce é*%" in files["50_new_-F_Cu.gbr"]
    board = read_gerbers(tmp_path / "board.zip")
    assert {track.net for track in board.tracks} == {name}


@pytest.mark.skipif(shutil.which("gerbv") is None, reason="gerbv is not installed")
def test_gerbv_renders_the_same_copper(tmp_path: Path) -> None:
    array = small_board()
    files = written(array, tmp_path)
    # gerbv draws strokes as wide as whole pixels: at 100 pixels a mm ours are 20
    per_inch, pixel = 2540, 1e-5
    for name, layer in (("board-F_Cu.gbr", "L1"), ("board-B_Cu.gbr", "L4")):
        (tmp_path / name).write_text(files[name], encoding="utf-8")
        picture = tmp_path / f"{layer}.png"
        command = ["gerbv", "-x", "png", "-a", "-D", str(per_inch), "-B", "0", "-b", "#000000", "-f", "#FFFFFFFF"]
        # it knows no X2 attributes and says so
        subprocess.run([*command, "-o", str(picture), str(tmp_path / name)], capture_output=True, check=True)
        with Image.open(picture) as image:
            light = np.asarray(image.convert("L"), dtype=np.float64) / 255
        expected = shapely.union_all(stroked(array, layer))
        assert light.sum() * pixel**2 == pytest.approx(expected.area, rel=1e-3)  # anti-aliasing, 2e-4 measured
        x_min, y_min, x_max, y_max = expected.bounds
        row, column = np.nonzero(light > 0.5)
        size = (np.ptp(column) + 1) * pixel, (np.ptp(row) + 1) * pixel
        assert size == pytest.approx((x_max - x_min, y_max - y_min), abs=2 * pixel)


def test_a_project_without_a_name(tmp_path: Path) -> None:
    message = r"the project must have a name; got ' '"
    refused(OutputError, message, write_gerbers, small_board(), tmp_path / "board.zip", name=" ")


def test_a_failed_or_refused_export_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "board.zip"
    path.write_bytes(b"old")

    def refuse(board: Path) -> None:
        assert zipfile.is_zipfile(board)
        raise RuleViolationError("not this one")

    def fail(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    refused(RuleViolationError, "not this one", write_gerbers, small_board(), path, name="board", check=refuse)
    monkeypatch.setattr(zipfile.ZipFile, "writestr", fail)
    refused(OutputError, "No space left on device", write_gerbers, small_board(), path, name="board")
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]
