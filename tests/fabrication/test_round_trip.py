"""Boards written as KiCad projects and as Gerber files, and read back: tracks, holes, nets, stack-up, coils.

Who checks whom: the readers against the writers. The writers are checked by KiCad itself, gerbonara and gerbv, and the
readers by boards of other make.
"""

import re
import sys
import zipfile
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np
import pytest
import shapely
from support.boards import VIA, arcs_board, many_layers, one_coil, reference_board, small_board
from support.refusals import refused

from coilarray.electromagnetics.inductance import inductance_matrix
from coilarray.electromagnetics.resistance import dc_resistance
from coilarray.errors import MissingDependencyError, OutputError
from coilarray.fabrication.drawings import write_dxf, write_svg
from coilarray.fabrication.gerber_reader import read_gerbers
from coilarray.fabrication.gerber_writer import write_gerbers
from coilarray.fabrication.kicad_reader import read_kicad
from coilarray.fabrication.kicad_writer import write_kicad
from coilarray.fabrication.nets import board_layers, check_nets
from coilarray.fabrication.solid_files import PlacedArray, write_step
from coilarray.fabrication.tracing import trace_coils, traced_array
from coilarray.geometry import Array, FabRules, Placement, PlatedHole, copper_by_layer, drills, path_coil
from coilarray.geometry.arcs import CHORD_ERROR

TERMINAL = PlatedHole(0.5e-3, 1e-3)
BACK_AGAIN = [[(0, 0), (4e-3, 0), (4e-3, 2e-3)], [(4e-3, 2e-3), (0, 2e-3)], [(0, 2e-3), (0, 4e-3)]]
TAPERED = path_coil(BACK_AGAIN, [[3e-4, 2e-4], [2e-4], [5e-4]], 2e-4, VIA, TERMINAL)
BOARDS = {
    "through": small_board(),
    "blind": small_board(through_holes=False),
    "one layer": one_coil(path_coil([[(0, 0), (5e-3, 0), (5e-3, 5e-3)]], 0.3e-3, 0.3e-3, VIA, TERMINAL)),
    "changing widths": Array(many_layers(2), (Placement("A", TAPERED, ("L1", "L2", "L1"), 0, 0),)),
    "arcs": arcs_board(),
}


def kicad(array, folder):
    return write_kicad(array, folder / "project", name="board", rules=FabRules())[0]


def gerbers(array, folder):
    write_gerbers(array, folder / "board.zip", name="board")
    return folder / "board.zip"


@pytest.fixture(params=[*list(BOARDS)[:-1], pytest.param("arcs", marks=pytest.mark.slow)], scope="module")
def array(request):
    return BOARDS[request.param]


@pytest.fixture(params=[(kicad, read_kicad), (gerbers, read_gerbers)], ids=["kicad", "gerber"], scope="module")
def read(request, array, tmp_path_factory):
    write, reader = request.param
    return reader(write(array, tmp_path_factory.mktemp("board")))


def test_tracks_holes_nets_and_stackup_come_back(array, read):
    names = array.stackup.names
    assert read.stackup.names[: len(names)] == names  # KiCad gives a board of one layer a back
    for field in ("copper_thickness", "dielectric_thickness", "epsilon_r"):
        wanted = getattr(array.stackup, field)
        assert getattr(read.stackup, field)[: len(wanted)] == pytest.approx(wanted, rel=1e-9)  # 1 nm in mm
    assert (read.assumed, read.notes, read.areas) == ({}, (), ())
    assert read.edge == pytest.approx(array.bounds, abs=1e-9)
    if array is not BOARDS["arcs"]:
        tracks = [((t.net, t.layer), (*t.start, *t.end, t.width)) for t in read.tracks]
        expected = [
            ((placement.name, layer), (*start, *end, width))
            for placement in array.placements
            for line, widths, layer in placement.traces()
            for (start, end), width in zip(pairwise(line.tolist()), widths.tolist(), strict=True)
        ]
        order = {places: number for number, (places, _) in enumerate(expected)}
        tracks, expected = (sorted(each, key=lambda track: order[track[0]]) for each in (tracks, expected))
        for one, other in zip(tracks, expected, strict=True):
            assert one[0] == other[0]
            assert one[1] == pytest.approx(other[1], abs=1.1e-9)  # rounded to 1 nm
    kinds = {"via": "via", "terminal": "pad"}
    holes = sorted((h.net, h.kind, h.layers[: len(names)], h.x, h.y, h.drill, h.pad) for h in read.holes)
    drilled = [hole for hole in drills(array) if hole.drilled]
    wanted = sorted((h.net, kinds[h.kind], h.layers, h.x, h.y, h.diameter, h.pad) for h in drilled)
    for one, other in zip(holes, wanted, strict=True):
        assert one[:3] == other[:3]
        assert one[3:] == pytest.approx(other[3:], abs=1.1e-9)
    ends = {(pad.net, pad.number): (pad.x, pad.y) for pad in (*read.holes, *read.pads) if pad.number}
    for placement in array.placements:
        for number, place in zip("12", placement.to_board(placement.coil.terminal_points).tolist(), strict=True):
            assert ends[placement.name, number] == pytest.approx(tuple(place), abs=1.1e-9)


def test_the_copper_is_that_of_the_coils(array, read):
    layers, holes = board_layers(read)
    layers = {layer: layers[layer] for layer in array.stackup.names}
    holes = [replace(hole, layers=hole.layers[: len(array.stackup.names)]) for hole in holes]
    assert check_nets(array, layers, holes) == ()
    if array is not BOARDS["arcs"]:
        return
    for layer, nets in copper_by_layer(array).items():
        expected, copper = shapely.union_all(list(nets.values())), shapely.union_all(layers[layer])
        # pieces of both are within 0.9 µm of the arcs; the strokes' ends under pads are round, corners of leads are too
        assert copper.buffer(2 * CHORD_ERROR).contains(expected.buffer(-0.03e-3))
        assert copper.symmetric_difference(expected).area < 2e-3 * expected.area
        assert copper.area == pytest.approx(expected.area, rel=5e-4)


def test_the_coils_are_found_with_their_inductances(array, read):
    found = traced_array(read, trace_coils(read, array.names).coils).array
    assert [place.layers for place in found.placements] == [place.layers for place in array.placements]
    for new, old in zip(found.placements, array.placements, strict=True):
        if len(old.coil.lines) > 1:
            assert new.coil.via == old.coil.via
        assert (
            np.abs(np.vstack(new.to_board(new.coil.terminal_points) - old.to_board(old.coil.terminal_points))).max()
            < 2e-9
        )
    L, before = (inductance_matrix(each.conductors()) for each in (found, array))
    # places are off by 0.5 nm of gaps of 0.2 mm; arcs are pieces that keep their area
    rel = 1e-4 if array is BOARDS["arcs"] else 1e-6
    np.testing.assert_allclose(L, before, rtol=rel, atol=rel * np.diag(before).min())
    np.testing.assert_allclose(dc_resistance(found), dc_resistance(array), rtol=10 * rel)


@pytest.mark.parametrize(("write", "arc"), [(kicad, r"\(arc \(start .*\(mid "), (gerbers, r"(?m)^G0[23]\*$")])
def test_arcs_are_written_as_arcs(write, arc, tmp_path):
    file = write(BOARDS["arcs"], tmp_path)
    text = file.read_text(encoding="utf-8") if file.suffix != ".zip" else ""
    if not text:
        with zipfile.ZipFile(file) as archive:
            text = "".join(archive.read(name).decode() for name in archive.namelist() if "_Cu" in name)
    assert len(re.findall(arc, text)) == sum(len(a) for place in BOARDS["arcs"].placements for a in place.coil.arcs)


def test_equal_coils_are_one_shape(tmp_path):
    found = read_kicad(kicad(reference_board(count=3, turns=5), tmp_path))
    found = traced_array(found, trace_coils(found).coils)
    assert len({id(placement.coil) for placement in found.array.placements}) == 1
    np.testing.assert_allclose(np.diff(found.array.centres[:, 0]), 13.28e-3, atol=1e-15)
    assert found.array.placements[0].coil.gap == pytest.approx(0.1e-3, abs=1e-6)
    assert set(found.assumed) == {"coils.*.via.plating_um"}


@pytest.mark.parametrize(
    ("write", "suffix", "extra", "modules"),
    [
        (write_svg, "svg", "", ()),
        (write_dxf, "dxf", "fab", ("ezdxf",)),
        (partial(write_gerbers, name="board"), "zip", "fab", ("gerbonara", "gerbonara.newstroke")),
        (
            lambda array, path: write_step([PlacedArray(array)], path, name="board"),
            "step",
            "step",
            ("OCP", "OCP.STEPCAFControl"),
        ),
    ],
)
def test_what_cannot_be_written(write, suffix, extra, modules, tmp_path, monkeypatch):
    array = BOARDS["one layer"]
    for module in modules:
        pytest.importorskip(module)
    refused(OutputError, rf"the suffix must be \.{suffix}.*; got '\.rar'", write, array, tmp_path / "board.rar")
    refused(OutputError, "cannot write .*: No such file", write, array, tmp_path / "nowhere" / f"board.{suffix}")
    for module in modules:
        monkeypatch.setitem(sys.modules, module, None)
    if modules:
        refused(MissingDependencyError, rf"-m pip install .*\[{extra}\]", write, array, tmp_path / f"board.{suffix}")
    assert list(tmp_path.iterdir()) == []
