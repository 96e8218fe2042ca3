"""Fabrication data as boards: round trip of our own export, real KiCad plots, other dialects, every bad input."""

from __future__ import annotations

import itertools
import json
import math
import os
import re
import shutil
import subprocess
import sys
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support.board_text import square_spiral
from support.boards import FOUR_LAYERS, small_board
from support.kicad_tools import find_kicad
from support.refusals import refused

from coilarray.electromagnetics.inductance import inductance_matrix
from coilarray.errors import BoardError, MissingDependencyError
from coilarray.fabrication.board import BoardCopper
from coilarray.fabrication.gerber_reader import read_gerbers
from coilarray.fabrication.gerber_writer import write_gerbers
from coilarray.fabrication.kicad_writer import write_kicad
from coilarray.fabrication.nets import board_layers, check_nets
from coilarray.fabrication.tracing import trace_coils, traced_array
from coilarray.geometry import Array, FabRules, Stackup, drills

pytest.importorskip("gerbonara")


def export(array: Array, folder: Path) -> Path:
    path = folder / "board.zip"
    write_gerbers(array, path, name="board")
    return path


def unzipped(path: Path) -> dict[str, str]:
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name).decode("utf-8") for name in archive.namelist()}


def zipped(folder: Path, files: dict[str, str]) -> Path:
    path = folder / "board.zip"
    with zipfile.ZipFile(path, "w") as archive:
        for name, text in files.items():
            archive.writestr(name, text)
    return path


def read(folder: Path, files: dict[str, str], stackup: Stackup | None = None) -> BoardCopper:
    return read_gerbers(zipped(folder, files), stackup)


def inductances(board: BoardCopper, names: tuple[str, ...] | None) -> np.ndarray:
    traced = traced_array(board, trace_coils(board, names).coils)
    return inductance_matrix(traced.array.conductors())


# A small board of other make: two layers, coil A from a pad over L1, a via and L2 to another pad.


def gerber(function: str, *objects: str, apertures: tuple[str, ...] = ("C,0.2", "C,0.6", "R,1.2X1.6")) -> str:
    """Gerber file in mm; the apertures are D10, D11, …"""
    attribute = [f"%TF.FileFunction,{function}*%"] if function else []
    defined = [f"%ADD{k}{shape}*%" for k, shape in enumerate(apertures, start=10)]
    return "\n".join((*attribute, "%FSLAX46Y46*%", "%MOMM*%", "%LPD*%", "G01*", *defined, *objects, "M02*", ""))


def at(x: float, y: float) -> str:
    return f"X{round(x * 1e6)}Y{round(y * 1e6)}"


def stroke(x1: float, y1: float, x2: float, y2: float) -> str:
    return f"{at(x1, y1)}D02*\n{at(x2, y2)}D01*"


def flashes(*places: tuple[float, float]) -> str:
    return "\n".join(f"{at(*place)}D03*" for place in places)


def excellon(*holes: tuple[float, float], function: str = "Plated,1,2,PTH", header: str = "METRIC\nT1C0.3") -> str:
    attribute = [f"; #@! TF.FileFunction,{function}"] if function else []
    return "\n".join(("M48", *attribute, header, "%", "G05", "T1", *(f"X{x:.4f}Y{y:.4f}" for x, y in holes), "M30", ""))


HOLES = ((0, 0), (5, 0), (5, 5))
TOP = ("D10*", stroke(0, 0, 5, 0), "D11*", flashes(*HOLES))
BOTTOM = ("D10*", stroke(5, 0, 5, 5), "D11*", flashes(*HOLES))
ONE_LAYER = {"top.gbr": gerber("Copper,L1,Top", *TOP)}
BOARD = {**ONE_LAYER, "bottom.gbr": gerber("Copper,L2,Bot", *BOTTOM), "holes.drl": excellon(*HOLES)}
# What is assumed where nothing but the copper is given.
NO_STACKUP = {f"stackup.{key}" for key in ("copper_thickness_um", "dielectric_thickness_mm", "dielectric_epsilon_r")}


def lacking(name: str) -> dict[str, str]:
    return {other: text for other, text in BOARD.items() if other != name}


def test_messages_point_to_the_line_and_a_folder_reads_as_its_zip(tmp_path: Path) -> None:
    path = export(small_board(), tmp_path)
    first, lines = read_gerbers(path), unzipped(path)["board-F_Cu.gbr"].splitlines()
    file, _, number = first.tracks[0].where.rpartition(":")
    assert file == f"{path}/board-F_Cu.gbr"
    assert [line[-4:] for line in lines[int(number) - 2 : int(number)]] == ["D02*", "D01*"]
    folder = tmp_path / "files" / "gerbers"
    folder.mkdir(parents=True)
    for name, text in unzipped(path).items():
        (folder / name).write_text(text, encoding="utf-8")
    (folder / "readme.txt").write_text("G04 is no gerber here")
    (folder / ".hidden.gbr").write_bytes(b"\0")
    second = read_gerbers(tmp_path / "files")
    assert first.stackup == second.stackup
    bare, again = ([replace(track, where="") for track in board.tracks] for board in (first, second))
    assert bare == again


def test_without_attributes_the_names_of_the_files_and_the_copper_itself_do(tmp_path: Path) -> None:
    """What a program that knows no X2 leaves: names as Altium gives them, no nets, no job file."""
    array = small_board()
    files = unzipped(export(array, tmp_path))
    names = {"F_Cu": "GTL", "In1_Cu": "GP1", "In2_Cu": "GP2", "B_Cu": "GBL", "F_Mask": "GTS", "Edge_Cuts": "GKO"}
    found = {f"coils.{new}": files[f"board-{old}.gbr"] for old, new in names.items()}
    found["coils.TXT"] = files["board-PTH.drl"]
    plain = {name: re.sub(r"%T[FAOD].*?\*%\n|; #@!.*\n", "", text) for name, text in found.items()}
    board = read(tmp_path, plain)
    assert {track.net for track in board.tracks} == {None}
    assert board.stackup.names == ("L1", "L2", "L3", "L4")
    assert set(board.assumed) == {"stackup.layers", *NO_STACKUP}
    assert board.stackup.thickness == pytest.approx(1.6e-3)
    assert board.edge == pytest.approx(array.bounds, abs=1e-9)
    # the mask is open over the terminals, so they are pads
    kinds = {(round(h.x, 8), round(h.y, 8)): "via" if h.kind == "via" else "pad" for h in drills(array)}
    assert {(round(h.x, 8), round(h.y, 8)): h.kind for h in board.holes} == kinds
    board = read(tmp_path, plain, given := replace(FOUR_LAYERS, names=("a", "b", "c", "d")))
    assert (board.stackup, board.assumed) == (given, {})
    # the copper without nets is found to be the same two coils, in the order of the file
    expected = inductance_matrix(array.conductors())
    assert inductances(board, None) == pytest.approx(expected, rel=1e-6)


def test_a_stackup_that_is_given_wins_over_the_job_file(tmp_path: Path) -> None:
    thick = replace(FOUR_LAYERS, copper_thickness=(70e-6,) * 4)
    board = read_gerbers(export(small_board(), tmp_path), thick)
    assert (board.stackup, board.assumed) == (thick, {})
    message = r"board\.zip: has 2 copper layers and the given stack-up 4"
    refused(BoardError, message, read, tmp_path, BOARD, FOUR_LAYERS)


def test_boards_of_one_and_two_layers(tmp_path: Path) -> None:
    board = read(tmp_path, BOARD)
    tracks = [("L1", (0, 0), (5e-3, 0), 0.2e-3, None), ("L2", (5e-3, 0), (5e-3, 5e-3), 0.2e-3, None)]
    assert [(t.layer, t.start, t.end, t.width, t.net) for t in board.tracks] == tracks
    places = [(x * 1e-3, y * 1e-3) for x, y in HOLES]
    holes = [(*place, 0.3e-3, 0.6e-3, ("L1", "L2"), "via") for place in places]
    assert [(h.x, h.y, h.drill, h.pad, h.layers, h.kind) for h in board.holes] == holes
    assert board.edge is None
    # one layer needs no holes
    board = read(tmp_path, ONE_LAYER)
    assert board.holes == ()
    assert [(pad.x, pad.y, pad.layer, pad.size) for pad in board.pads] == [(*at, "L1", 0.6e-3) for at in places]
    # a hole that joins nothing is left out
    board = read(tmp_path, {**BOARD, "holes.drl": excellon(*HOLES, (9, 9))})
    assert len(board.holes) == len(HOLES)
    assert board.notes == ("1 plated hole without a pad left out.",)


@pytest.mark.parametrize(("mode", "quarters"), [("G03", (2, 1, 4)), ("G02", (-2, -3, -4))])
@pytest.mark.parametrize(("k", "end"), [(0, (-4, 0)), (1, (0, 4)), (2, (4, 0))])
def test_arcs_are_divided_on_their_circle(mode, quarters, k, end, tmp_path: Path) -> None:
    arc = (f"G75*\n{at(4, 0)}D02*", f"{mode}*", f"{at(*end)}I-4000000J0D01*")
    board = read(tmp_path, {"top.gbr": gerber("Copper,L1,Top", "D10*", *arc)})
    points = np.array([board.tracks[0].start, *(track.end for track in board.tracks)])
    assert all(a.end == b.start for a, b in zip(board.tracks, board.tracks[1:], strict=False))
    assert np.abs(np.hypot(*points.T) - 4e-3).max() < 1e-6
    assert points[0] == pytest.approx([4e-3, 0])
    assert points[-1] == pytest.approx(np.array(end) * 1e-3)
    angle = np.unwrap(np.arctan2(points[:, 1], points[:, 0]))
    if mode == "G03" or end != (4, 0):  # a whole circle covers the same either way round
        assert angle[-1] - angle[0] == pytest.approx(quarters[k] * math.pi / 2)


def test_inches_commented_attributes_idle_transformations_and_old_encodings(tmp_path: Path) -> None:
    top = gerber("", "D10*", "G04 #@! TO.N,coil\\u002Cone*", "%LMN*%", "%LR0.0*%", "%LS1.0*%", stroke(0, 0, 0.1, 0.2))
    top = top.replace("%MOMM*%", "%MOIN*%\nG04 #@! TF.FileFunction,Copper,L1,Top*").replace("C,0.2", "C,0.01")
    (track,) = read(tmp_path, {"top.gbr": top}).tracks
    assert (track.net, track.width) == ("coil,one", pytest.approx(0.254e-3))
    assert track.end == pytest.approx((2.54e-3, 5.08e-3))
    text = BOARD["top.gbr"].replace("%LPD*%", "G04 Größe µm*\n%LPD*%")
    (tmp_path / "top.gbr").write_bytes(text.encode("latin-1"))
    assert len(read_gerbers(tmp_path).tracks) == 1


def test_pads_that_are_not_round_dots_and_marks(tmp_path: Path) -> None:
    rectangle, dot = ("D12*", flashes((0, 0))), ("D11*", stroke(5, 0, 5, 0))  # 1.2 × 1.6 around the hole; for a pad
    marks = ("D10*", flashes((0, 0), (5, 0)))  # of the drill
    top = gerber("Copper,L1,Top", *rectangle, *dot, *marks, "D10*", stroke(0, 0, 5, 0))
    drilled = {"top.gbr": top, "holes.drl": excellon((0, 0), (5, 0))}
    for aperture, sizes in (("D11*", [0.6e-3, 0.6e-3]), ("D12*", [1.2e-3, 0.6e-3])):
        bottom = gerber("Copper,L2,Bot", aperture, flashes((0, 0), (5, 0)))
        board = read(tmp_path, {**drilled, "bottom.gbr": bottom})
        assert [h.x for h in board.holes] == [0, 5e-3]
        assert [h.pad for h in board.holes] == pytest.approx(sizes)
        assert board.pads == ()
    # pads keep their shapes
    top = gerber("Copper,L1,Top", "D12*", flashes((0, 0), (9, 9)), "D10*", stroke(0, 0, 5, 0), "D11*", flashes((5, 0)))
    board = read(tmp_path, {**BOARD, "top.gbr": top, "holes.drl": excellon((0, 0), (5, 0))})
    (pad,) = [pad for pad in board.pads if pad.layer == "L1"]
    assert pad.shape.bounds == pytest.approx((8.4e-3, 8.2e-3, 9.6e-3, 9.8e-3))
    hole = board.holes[0]
    assert hole.copper["L1"].area == pytest.approx(1.2 * 1.6e-6)
    assert hole.copper["L2"].area == pytest.approx(math.pi * 0.3e-3**2, rel=1e-3)  # a polygon of 128 corners


def test_drill_files_say_span_plating_and_kind(tmp_path: Path) -> None:
    tools = (
        "METRIC\n; #@! TA.AperFunction,Plated,PTH,ComponentDrill\nT1C0.3\n; #@! TA.AperFunction,NonPlated,NPTH,"
        "ComponentDrill\nT2C2.0\n; #@! TD\nT3C0.4"
    )
    mixed = excellon((0, 0), function="MixedPlating,1,3", header=tools)
    mixed = mixed.replace("M30", "T2\nX9.0Y9.0\nT3\nX5.0Y5.0\nM30")
    files = {
        "a.gbr": gerber("Copper,L1,Top", *TOP), "b.gbr": gerber("Copper,L2,Inr", *TOP),
        "c.gbr": gerber("Copper,L3,Bot", *BOTTOM), "mixed.drl": mixed,
        "blind.drl": excellon((5, 0), function="Plated,2,3,Blind"), "mounting-NPTH.drl": excellon((9, 9), function=""),
    }  # fmt: skip
    board = read(tmp_path, files)
    assert {(h.x, h.y): (h.layers, h.kind, h.drill) for h in board.holes} == {
        (5e-3, 0): (("L2", "L3"), "via", 0.3e-3),
        (0, 0): (("L1", "L2", "L3"), "pad", 0.3e-3),
        (5e-3, 5e-3): (("L1", "L2", "L3"), "via", 0.4e-3),
    }


def test_drills_in_gerber_form_and_slots(tmp_path: Path) -> None:
    drilled = gerber("Plated,1,2,PTH,Drill", "D10*", flashes((0, 0), (5, 0)), stroke(4.9, 5, 5.1, 5))
    routed = excellon((0, 0), (5, 0)).replace("M30", "G00X4.9Y5.0\nM15\nG01X5.1Y5.0\nM16\nM30")
    for name, text, size in (("holes.gbr", drilled, 0.2e-3), ("holes.drl", routed, 0.3e-3)):
        holes = read(tmp_path, {**lacking("holes.drl"), name: text}).holes
        assert [(h.x, h.y, h.drill) for h in holes] == [(x * 1e-3, y * 1e-3, size) for x, y in HOLES]


REGION = f"G36*\n{at(1, 1)}D02*\n{at(3, 1)}D01*\n{at(3, 3)}D01*\n{at(1, 3)}D01*\n{at(1, 1)}D01*\nG37*"


def test_regions_and_clear_shapes(tmp_path: Path) -> None:
    top = gerber("Copper,L1,Top", "%TO.N,GND*%", REGION, "%TD*%", "%LPC*%", "D11*", flashes((2, 2)), "%LPD*%", *TOP)
    board = read(tmp_path, {**BOARD, "top.gbr": top})
    (area,) = board.areas
    assert (area.layer, area.net, area.what) == ("L1", "GND", "a region")
    # the circle's polygon has 128 corners, 4e-4 less area
    assert area.shape.area == pytest.approx(4e-6 - math.pi * 0.3e-3**2, rel=1e-4)
    rounded = f"G36*\n{at(1, 1)}D02*\nG75*\nG03*\n{at(3, 1)}I1000000J0D01*\nG01*\n{at(1, 1)}D01*\nG37*"
    board = read(tmp_path, {"top.gbr": gerber("Copper,L1,Top", rounded)})
    assert board.areas[0].shape.area == pytest.approx(math.pi / 2 * 1e-6, rel=2e-3)  # chords within 1 µm
    array = small_board()
    # to the net check it is foreign
    files = unzipped(export(array, tmp_path))
    files["board-In2_Cu.gbr"] = files["board-In2_Cu.gbr"].replace("M02*", f"{REGION.replace('X', 'X-')}\nM02*")
    check = check_nets(array, *board_layers(read(tmp_path, files)))
    assert [(fault.kind, fault.layer) for fault in check] == [("foreign", "L3")]


def test_the_job_file_of_another_program(tmp_path: Path) -> None:
    job = {
        "GeneralSpecs": {"BoardThickness": 1.2},
        "MaterialStackup": [
            {"Type": "Legend", "Name": "Top"}, {"Type": "Copper", "Thickness": 0.018, "Name": "Front"},
            {"Type": "Dielectric", "Thickness": 0.1, "DielectricConstant": 4.0},
            {"Type": "Dielectric", "Thickness": 0.3, "DielectricConstant": 3.0},
            {"Type": "Copper", "Thickness": 0.07, "Name": "Back"}, {"Type": "SolderMask", "Thickness": 0.01},
        ],
    }  # fmt: skip
    board = read(tmp_path, {**BOARD, "board-job.gbrjob": json.dumps(job)})
    assert board.stackup.names == ("Front", "Back")
    assert board.stackup.copper_thickness == pytest.approx((18e-6, 70e-6))
    assert board.stackup.dielectric_thickness == pytest.approx((0.4e-3,))
    assert board.stackup.epsilon_r == pytest.approx((0.4 / (0.1 / 4 + 0.3 / 3),))  # capacitors in series
    assert board.assumed == {}
    for layer in job["MaterialStackup"]:
        layer.pop("Thickness", None)
        layer.pop("DielectricConstant", None)
    board = read(tmp_path, {**BOARD, "board-job.gbrjob": json.dumps(job)})
    assert board.stackup.thickness == pytest.approx(1.2e-3)
    left = "the files do not say; equal parts of what is left of the given board thickness of 1.2 mm"
    assert board.assumed == {
        "stackup.copper_thickness_um": "the files do not say; standard 1 oz copper",
        "stackup.dielectric_thickness_mm": left,
        "stackup.dielectric_epsilon_r": "the files do not say; FR-4, 4.5",
    }


@pytest.fixture(scope="module")
def kicad_plots(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small board through KiCad: our project, its plots and drill files."""
    kicad = find_kicad()
    if isinstance(kicad, str):
        pytest.skip(kicad)
    folder = tmp_path_factory.mktemp("kicad")
    (board, *_) = write_kicad(small_board(), folder, name="small", rules=FabRules())
    plots = folder / "plots"
    plots.mkdir()
    kicad.plot(board, plots)
    _kicad_drills(board, plots)
    return plots


def _kicad_drills(board: Path, folder: Path) -> None:
    script = (
        "import pcbnew, sys; board = pcbnew.LoadBoard(sys.argv[1]); writer = pcbnew.EXCELLON_WRITER(board);"
        "writer.SetOptions(False, False, board.GetDesignSettings().GetAuxOrigin(), False); writer.SetFormat(True);"
        "writer.CreateDrillandMapFilesSet(sys.argv[2], True, False)"
    )
    command = [str(shutil.which("python3", path=os.defpath)), "-c", script, str(board), str(folder)]
    if program := shutil.which("kicad-cli"):
        command = [program, "pcb", "export", "drill", "--drill-origin", "plot", "-o", f"{folder}/", str(board)]
    subprocess.run(command, check=True, capture_output=True, timeout=600)


@pytest.mark.slow
def test_kicads_own_plots_of_a_design_are_its_copper_with_the_same_inductances(kicad_plots: Path) -> None:
    array = small_board()
    board = read_gerbers(kicad_plots, array.stackup)
    expected = inductance_matrix(array.conductors())
    assert inductances(board, array.names) == pytest.approx(expected, rel=1e-6)
    assert check_nets(array, *board_layers(board)) == ()


def test_paths_that_are_no_board_or_a_damaged_one(tmp_path: Path) -> None:
    (tmp_path / "text.zip").write_text("no zip")
    (tmp_path / "empty").mkdir()
    (tmp_path / "project").mkdir()
    (tmp_path / "project" / "pad.kicad_pcb").touch()
    for name, message in (
        ("project", r"among its 0 Gerber and Excellon files; did you mean .*project.pad\.kicad_pcb\?"),
        ("nowhere.zip", r"nowhere\.zip: there is no such file or folder"),
        ("text.zip", r"text\.zip: must be a folder or an intact zip of Gerber files"),
        ("empty", r"empty: has no copper layer among its 0 Gerber and Excellon files"),
    ):
        refused(BoardError, message, read_gerbers, tmp_path / name)
    mask = {"mask.gbr": gerber("Soldermask,Top", *TOP)}
    refused(BoardError, r"has no copper layer among its 1 Gerber", read, tmp_path, mask)
    # a damaged zip
    data = bytearray((path := zipped(tmp_path, BOARD)).read_bytes())
    data[data.index(b"D01*")] ^= 0xFF  # zipped() does not compress
    path.write_bytes(data)
    refused(BoardError, r"must be a folder or an intact zip of Gerber files; .Bad CRC-32", read_gerbers, path)


@given(name=st.sampled_from(sorted(BOARD)), cut=st.floats(0, 1))
@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
def test_a_truncated_file_is_refused(name: str, cut: float, tmp_path: Path) -> None:
    text = BOARD[name].rstrip("\n")
    shorter = text[: int(cut * (len(text) - 1))]
    refused(BoardError, f"^{tmp_path}/board.zip", read, tmp_path, {**BOARD, name: shorter})


TOP_NAME = r"board\.zip/top\.gbr"
DRILL_NAME = r"board\.zip/holes\.drl"


def top(*objects: str, **kwargs: tuple[str, ...]) -> dict[str, str]:
    return {**BOARD, "top.gbr": gerber("Copper,L1,Top", *objects, **kwargs)}


def changed(name: str, old: str, new: str) -> dict[str, str]:
    assert old in BOARD[name]
    return {**BOARD, name: BOARD[name].replace(old, new)}


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ({**BOARD, "top.gbr": "GIF89a"}, TOP_NAME + r": is neither a Gerber nor an Excellon file"),
        (lacking("top.gbr"), r"board\.zip: copper layers are missing: L1\.$"),
        (lacking("bottom.gbr") | {"in.gbr": gerber("Copper,L2,Inr", *BOTTOM)}, r"are missing: the bottom below L2\.$"),
        ({**BOARD, "other.gbr": BOARD["top.gbr"]}, r"/top\.gbr: is copper layer L1, and so is .*/other\.gbr"),
        ({**BOARD, "x.gbr": gerber("Copper,Lx,Inr")}, r"/x\.gbr: a copper layer must be L1, L2, …; got Copper,Lx,Inr"),
        (changed("holes.drl", "Plated,1,2", "Plated,2,5"), DRILL_NAME + r": holes must go from .* got Plated,2,5,PTH"),
        (changed("holes.drl", "T1C0.3", "T1F2.0"), DRILL_NAME + r":\d+: the tool has no diameter"),
        (changed("holes.drl", "T1C0.3", "T1C99999.0"), r":\d+: a diameter must be from 0 to 10 m; got 99\.999 m"),
        (top("%ADD20R,1e9X1*%", "D20*", flashes((9, 9))), r":\d+: an aperture must be at most 10 m wide; got"),
        (changed("holes.drl", "G05\nT1", "G05\nT7"), DRILL_NAME + r":7: Undefined tool index 7"),
        (changed("holes.drl", "M30", "Q85X1Y1\nM30"), DRILL_NAME + r":11: the statement is not supported"),
        (changed("holes.drl", ".0000", "7"), DRILL_NAME + r": the numbers have no decimal point, .* do the"),
        (changed("holes.drl", "M30", ""), DRILL_NAME + r": the file ends without M30, it is truncated"),
        (changed("top.gbr", "M02*", ""), TOP_NAME + r": the file ends without M02, it is truncated"),
        (changed("top.gbr", "%MOMM*%\n", ""), TOP_NAME + r":10: Gerber file does not contain a unit"),
        (changed("top.gbr", "D10*", "D99*"), TOP_NAME + r":9: Tried to access undefined aperture 99"),
        (changed("top.gbr", "ADD10C", "ADD10Q"), TOP_NAME + r":6: the statement is not supported \(ADD10Q,0\.2\)"),
        (changed("top.gbr", "FSLAX", "FSLIX"), TOP_NAME + r": incremental coordinates are not supported"),
        (top(flashes((0, 0)), *TOP), TOP_NAME + r":9: no aperture is selected"),
        (top("%AMNO*0 nothing*%", "%ADD20NO*%", "D20*", flashes((9, 9))), TOP_NAME + r":12: the aperture has no shape"),
        (top("%IPNEG*%", *TOP), TOP_NAME + r":9: the negative image is not supported"),
        (top("%IR90*%", *TOP), TOP_NAME + r":9: the rotation of the whole image is not supported"),
        (top("%MIA1B0*%", *TOP), TOP_NAME + r":9: the mirroring of the whole image is not supported"),
        (top("%SFA2B2*%", *TOP), TOP_NAME + r":9: the scaling of the whole image is not supported"),
        (top("%ASAYBX*%", *TOP), TOP_NAME + r":9: the exchange of the axes is not supported|the statement is not"),
        (top("%SRX99Y99I5.0J0*%", *TOP, "%SR*%"), TOP_NAME + r":9: step and repeat must have 1 to 1000 copies"),
        (top("%ABD20*%", "D10*", flashes((0, 0)), "%AB*%", *TOP), TOP_NAME + r":9: the statement is not supported"),
        (top("D13*", stroke(0, 0, 5, 0), apertures=("C,0.2",) * 3 + ("O,1X2",)), TOP_NAME + r":12: Non-circular"),
        ({**BOARD, "b.gbrjob": '{"Header": '}, r"b\.gbrjob:1: is not a complete Gerber job file"),
        ({**BOARD, "b.gbrjob": '{"MaterialStackup": [{"Type": "Copper"}]}'}, "has 1 copper layers and .* files for 2"),
        ({**BOARD, "b.gbrjob": '{"GeneralSpecs": {"BoardThickness": 0.01}}'}, r"b\.gbrjob: a board of 0\.01 mm"),
    ],
)
def test_bad_files_are_named(files: dict[str, str], message: str, tmp_path: Path) -> None:
    refused(BoardError, message, read, tmp_path, files)


def test_clear_shapes_over_tracks_bare_holes_and_wide_strokes(tmp_path: Path) -> None:
    cut = read(tmp_path, top(*TOP, "%LPC*%", "D11*", flashes((2, 0))))
    assert len(cut.areas) == 2  # a track in two
    assert "L1" not in {track.layer for track in cut.tracks}
    # the barrel of a hole without a pad joins the track that ends in it
    board = read(tmp_path, top(*TOP[:2]) | {"bottom.gbr": gerber("Copper,L2,Bot", *BOTTOM[:2])})
    assert {(hole.x, hole.y) for hole in board.holes} == {(0, 0), (5e-3, 0), (5e-3, 5e-3)}
    # a rectangle of 1.2 × 1.6 mm is 1.6 mm wide across a stroke along x
    (track,) = read(tmp_path, {"top.gbr": gerber("Copper,L1,Top", "D12*", stroke(0, 0, 5, 0))}).tracks
    assert track.width == pytest.approx(1.6e-3)


SPIRAL = square_spiral()
COIL = ("D10*", *(stroke(*a, *b) for a, b in itertools.pairwise(SPIRAL)))


def coils_in(folder: Path, files: dict[str, str], **options: object) -> list[tuple[float, float]]:
    """Turns and centres in mm of the coils of a board."""
    board = read_gerbers(zipped(folder, files), **options)  # type: ignore[arg-type]
    return [(abs(coil.turns), round(coil.centre[0] * 1e3)) for coil in trace_coils(board).coils]


def test_step_and_repeat_zero_sets_and_layers_without_copper(tmp_path: Path) -> None:
    three = pytest.approx(3, abs=0.1)
    repeated = gerber("Copper,L1,Top", "%SRX2Y1I20.0J0*%", *COIL, "%SR*%")
    assert coils_in(tmp_path, {"t.gbr": repeated}) == [(three, 0), (three, 20)]
    empty = {"t.gbr": gerber("Copper,L1,Top", *COIL), "b.gbr": gerber("Copper,L2,Bot")}
    assert coils_in(tmp_path, empty) == [(three, 0)]
    x, y = SPIRAL[-1]
    both = {
        "t.gbr": gerber("Copper,L1,Top", *COIL, "D11*", flashes((x, y))),
        "b.gbr": gerber("Copper,L2,Bot", "D10*", stroke(x, y, x, y - 9), "D11*", flashes((x, y))),
    }
    for text in (f"G92\n{excellon((x, y))}", excellon((x, y)).replace("METRIC", "METRIC,TZ")):
        board = read(tmp_path, {**both, "d.drl": text})
        assert trace_coils(board).coils[0].layers == ("L1", "L2")


def test_arcs_of_single_quadrants(tmp_path: Path) -> None:
    """Twelve quarters of circles of 8 to 5 mm, with four steps inwards; 0.1894 µH by the path of its arcs."""
    way, place = ["D10*", "G74*", "G01*", f"{at(8, 0)}D02*"], 1 + 0j
    for radius in (8, 7, 6, 5):
        for _ in range(3):
            centre, place = -radius * place, 1j * place
            i, j = (round(abs(each) * 1e6) for each in (centre.real, centre.imag))
            way.append(f"G03*\n{at(radius * place.real, radius * place.imag)}I{i}J{j}D01*\nG01*")
        way.append(f"{at((radius - 1) * place.real, (radius - 1) * place.imag)}D01*")
    board = read(tmp_path, {"t.gbr": gerber("Copper,L1,Top", *way, apertures=("C,0.3",))})
    coils = trace_coils(board).coils
    assert coils[0].length == pytest.approx((26 * 3 * math.pi / 2 + 4) * 1e-3, rel=1e-4)
    L = inductance_matrix(traced_array(board, coils).array.conductors())
    assert L[0, 0] * 1e6 == pytest.approx(0.1894, abs=1e-4)


@pytest.mark.parametrize(("digits", "unit", "zeros"), [(3, "mm", "leading"), (4, "inch", "leading")])
def test_missing_formats_of_drills_are_found_on_the_pads(tmp_path: Path, digits: int, unit: str, zeros: str) -> None:
    scale = 10**digits / (1 if unit == "mm" else 25.4)
    rows = [f"X{round(x * scale)}Y{round(y * scale)}" for x, y in HOLES]
    size = 0.3 if unit == "mm" else 0.3 / 25.4
    text = "\n".join(("M48", f"T1C{size:.4f}", "%", "T1", *rows, "M30", ""))
    holes = read(tmp_path, {**BOARD, "holes.drl": text}).holes
    assert [(hole.x * 1e3, hole.y * 1e3) for hole in holes] == HOLES_APPROX
    given = read_gerbers(zipped(tmp_path, {**BOARD, "holes.drl": text}), None, None, f"2.{digits},{unit},{zeros}")
    assert len(given.holes) == len(HOLES)
    message = "the drill format must be as 4.4,mm"
    refused(BoardError, message, read_gerbers, zipped(tmp_path, {**BOARD, "holes.drl": text}), None, None, "x")


HOLES_APPROX = [pytest.approx(place, abs=1e-3) for place in HOLES]


NAMES = [
    ("b.GTL", "b.GKO"), ("b-F_Cu.gbr", "b-Edge_Cuts.gbr"), ("TOP.art", "OUTLINE.art"), ("Top.gbr", "BoardOutline.gbr"),
    ("b.cmp", "b.dim"), ("copper_top.gbr", "profile.gbr"), ("Gerber_TopLayer.GTL", "Gerber_BoardOutlineLayer.GKO"),
    ("art001.pho", "drl.pho"), ("Board - Top Copper.gbr", "Board - Outline.gbr"), ("top.ger", "outline.ger"),
]  # fmt: skip


@pytest.mark.parametrize("names", NAMES, ids=lambda names: names[0])
def test_names_of_other_programs(tmp_path: Path, names: tuple[str, str]) -> None:
    edge = gerber("", "D10*", stroke(-9, -9, 9, 9))
    plain = dict(zip(names, (gerber("", *COIL), edge), strict=True))
    assert coils_in(tmp_path, plain) == [(pytest.approx(3, abs=0.1), 0)]


def test_layers_that_the_user_names(tmp_path: Path) -> None:
    files = {"a.gbr": gerber("", *COIL), "b.gbr": gerber("", "D10*", stroke(-9, -9, 9, 9))}
    message = r"no copper layer among its 2 .*; say which it is as --layer L1=FILE, of a\.gbr, b\.gbr"
    refused(BoardError, message, read, tmp_path, files)
    assert coils_in(tmp_path, files, layers={"L1": "a.gbr"}) == [(pytest.approx(3, abs=0.1), 0)]
    refused(BoardError, "--layer must be L1=FILE", read_gerbers, zipped(tmp_path, files), None, {"L1": "c.gbr"})


def test_files_and_folders_that_cannot_be_read_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "top.gbr").write_text(BOARD["top.gbr"])
    (tmp_path / "inner").mkdir()

    def refusing(call, name):
        def refuse(path):
            if str(path).endswith(name):
                raise PermissionError(13, "Permission denied", str(path))
            return call(path)

        return refuse

    with monkeypatch.context() as patch:
        patch.setattr(Path, "read_bytes", refusing(Path.read_bytes, "top.gbr"))
        refused(BoardError, r"/top\.gbr: cannot be read: Permission denied", read_gerbers, tmp_path)
    monkeypatch.setattr(os, "listdir", refusing(os.listdir, "inner"))
    refused(BoardError, r"/inner: cannot be read: Permission denied", read_gerbers, tmp_path)


def test_a_broken_or_missing_gerbonara_says_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gerbonara.rs274x", None)
    message = r"which cannot be loaded: import of gerbonara\.rs274x"
    refused(MissingDependencyError, message, read, tmp_path, BOARD)
    monkeypatch.setitem(sys.modules, "gerbonara", None)
    refused(MissingDependencyError, r"-m pip install .*\[fab\]\"", read, tmp_path, BOARD)
    (project := tmp_path / "project").mkdir()  # of KiCad, without a Gerber file
    (project / "pad.kicad_pcb").touch()
    refused(BoardError, r"did you mean .*pad\.kicad_pcb\?", read_gerbers, project)
