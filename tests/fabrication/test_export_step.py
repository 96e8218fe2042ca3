"""STEP files, read back by Open CASCADE: parts, volumes, cylinders, colours, unit; and what cannot be written.

Volumes are compared with shapely's: of outlines whose circles have 4096 corners where there are circles.
"""

from __future__ import annotations

import importlib.util
import math
import os
from collections import Counter
from dataclasses import dataclass

import pytest
from support.boards import LEADS, SHEETS, VIA, WOUND, many_layers, one_coil, reference_board, round_spiral
from support.refusals import refused

from coilarray.errors import GeometryError
from coilarray.fabrication.solid_files import PlacedArray, faceted_prisms, write_step
from coilarray.geometry import Array, Placement, Sheet, drills, path_coil, solids
from coilarray.geometry.copper import board_prisms, sheet_prisms

pytestmark = pytest.mark.slow

needs_occt = pytest.mark.skipif(importlib.util.find_spec("OCP") is None, reason="no Open CASCADE (extra step)")

FLAT = 1e-9  # relative: volumes of flat faces in float64, 1e-7 mm apart at worst in the file
ROUND = 1e-6  # relative: a circle of 4096 corners has 4e-7 less area than the true one


BOARDS = {
    "reference": reference_board(count=2, turns=5),
    **WOUND,
    # few turns: the reader's check of a solid takes a time that grows with the square of its faces
    "circle": one_coil(round_spiral(6e-3, 1, 0.15e-3, 0.15e-3).coil(), rotation=-2.0),
    "no holes": one_coil(path_coil([[(0, 0), (8e-3, 0), (8e-3, 5e-3)]], 0.2e-3, 0.2e-3, VIA)),
}


@dataclass(frozen=True)
class Part:
    volume: float  # mm³
    heights: tuple[float, float]  # mm
    faces: dict[str, int]
    valid: bool
    colours: set[tuple[float, ...]]


def read_step(path):
    """Name of the assembly and its parts by name."""
    from OCP.STEPCAFControl import STEPCAFControl_Reader
    from OCP.TCollection import TCollection_ExtendedString
    from OCP.TDF import TDF_ChildIterator, TDF_Label
    from OCP.TDocStd import TDocStd_Document
    from OCP.XCAFDoc import XCAFDoc_DocumentTool, XCAFDoc_ShapeTool

    def children(label):
        return list(each(TDF_ChildIterator(label), TDF_ChildIterator.Value))

    document = TDocStd_Document(TCollection_ExtendedString("MDTV-XCAF"))
    reader = STEPCAFControl_Reader()
    reader.SetNameMode(True)
    reader.SetColorMode(True)
    reader.ReadFile(str(path))
    assert reader.Transfer(document)
    shapes = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    colours = XCAFDoc_DocumentTool.ColorTool_s(document.Main())
    (assembly,) = [label for label in children(shapes.Label()) if XCAFDoc_ShapeTool.IsFree_s(label)]
    parts = {}
    for component in children(assembly):
        product = TDF_Label()
        assert XCAFDoc_ShapeTool.GetReferredShape_s(component, product)
        assert name_of(component) == name_of(product)
        parts[name_of(product)] = part(XCAFDoc_ShapeTool.GetShape_s(product), colours)
    return name_of(assembly), parts


def each(iterator, current):
    while iterator.More():
        yield current(iterator)
        iterator.Next()


def name_of(label):
    from OCP.TDataStd import TDataStd_Name

    name = TDataStd_Name()
    assert label.FindAttribute(TDataStd_Name.GetID_s(), name)
    return name.Get().ToExtString()


def part(shape, colours):
    from OCP.Bnd import Bnd_Box
    from OCP.BRepAdaptor import BRepAdaptor_Surface
    from OCP.BRepBndLib import BRepBndLib
    from OCP.BRepCheck import BRepCheck_Analyzer
    from OCP.BRepGProp import BRepGProp
    from OCP.GProp import GProp_GProps
    from OCP.Quantity import Quantity_ColorRGBA
    from OCP.TopAbs import TopAbs_FACE, TopAbs_SOLID
    from OCP.TopExp import TopExp_Explorer
    from OCP.TopoDS import TopoDS
    from OCP.XCAFDoc import XCAFDoc_ColorSurf

    properties, box = GProp_GProps(), Bnd_Box()
    BRepGProp.VolumeProperties_s(shape, properties)
    BRepBndLib.Add_s(shape, box, False)
    to_face = getattr(TopoDS, "Face_s", None) or TopoDS.Face  # two names in the versions of the bindings
    found = each(TopExp_Explorer(shape, TopAbs_FACE), TopExp_Explorer.Current)
    faces = Counter(BRepAdaptor_Surface(to_face(face)).GetType().name for face in found)
    seen = set()
    for solid in each(TopExp_Explorer(shape, TopAbs_SOLID), TopExp_Explorer.Current):
        colour = Quantity_ColorRGBA()
        assert colours.GetColor(solid, XCAFDoc_ColorSurf, colour)
        seen.add((colour.GetRGB().Red(), colour.GetRGB().Green(), colour.GetRGB().Blue(), colour.Alpha()))
    heights = (box.CornerMin().Z(), box.CornerMax().Z())
    return Part(properties.Mass(), heights, faces, BRepCheck_Analyzer(shape).IsValid(), seen)


@pytest.fixture(params=BOARDS.values(), ids=BOARDS.keys(), scope="module")
def read(request, tmp_path_factory):
    path = tmp_path_factory.mktemp("step") / "board.step"
    write_step([PlacedArray(request.param, SHEETS)], path, name="a board")
    name, parts = read_step(path)
    assert name == "a board"
    return request.param, parts, path


@needs_occt
def test_parts_are_those_of_the_solids_in_their_colours(read):
    array, parts, path = read
    assert set(parts) == set(solids(array, SHEETS))
    for name, found in parts.items():
        assert found.valid, name
    by_kind = {}
    for name, found in parts.items():
        by_kind.setdefault(name.split("/")[0], set()).update(found.colours)
    assert all(len(colours) == 1 for colours in by_kind.values())
    assert len(set.union(*by_kind.values())) == len(by_kind)
    assert "SI_UNIT(.MILLI.,.METRE.)" in path.read_text(encoding="ascii")


@needs_occt
def test_volumes_and_heights(read, monkeypatch):
    array, parts, _ = read
    monkeypatch.setattr("coilarray.geometry.copper._QUADRANT", 1024)
    finer = faceted_prisms(array) | sheet_prisms(array, SHEETS)
    for name, prism in board_prisms(array).items():  # larger pieces keep an arc's area but for their corners: 2.5e-4
        assert finer[name].shape.area == pytest.approx(prism.shape.area, rel=5e-4), name
    for name, prism in finer.items():
        tolerance = FLAT if name.startswith("sheet") or not drills(array) else ROUND
        expected = prism.shape.area * (prism.top - prism.bottom) * 1e9
        assert parts[name].volume == pytest.approx(expected, rel=tolerance), name
        # the reader's boxes are wider by its tolerance of 1e-7 mm
        assert parts[name].heights == pytest.approx((prism.bottom * 1e3, prism.top * 1e3), abs=1e-6)
    # barrels in closed form
    for net in array.names:
        for n, hole in enumerate(hole for hole in drills(array) if hole.net == net and hole.drilled):
            bottom, top = array.stackup.span(hole.layers[-1])[0], array.stackup.span(hole.layers[0])[1]
            wall = math.pi * hole.plating * (hole.diameter - hole.plating)
            assert parts[f"barrel/{net}/{n}"].volume == pytest.approx(wall * (top - bottom) * 1e9, rel=1e-9)


@needs_occt
def test_circles_are_true(read):
    array, parts, _ = read
    holes = drills(array)
    barrels = [found.faces for name, found in parts.items() if name.startswith("barrel/")]
    assert all(faces == {"GeomAbs_Cylinder": 2, "GeomAbs_Plane": 2} for faces in barrels)
    through = sum(hole.layers == array.stackup.names for hole in holes)
    if "board" in parts:
        assert parts["board"].faces.get("GeomAbs_Cylinder", 0) == through
    for layer in array.stackup.names:
        for net in array.names:
            own = [hole for hole in holes if hole.net == net and layer in hole.layers]
            if own:
                cylinders = parts[f"copper/{layer}/{net}"].faces["GeomAbs_Cylinder"]
                # each hole, and the edge of each pad, which a trace may cut in two
                drilled = sum(hole.drilled for hole in own)
                assert drilled + len(own) <= cylinders <= drilled + 2 * len(own)


@needs_occt
def test_the_file_stays_small_and_nothing_is_printed(tmp_path, capfd):
    path = tmp_path / "board.stp"
    write_step([PlacedArray(BOARDS["reference"])], path, name="reference")
    assert capfd.readouterr() == ("", "")
    # 1.0 MB as it is; 15 MB with polygons for circles, 37 MB with curves on every face as well
    assert path.stat().st_size < 1.5e6


@needs_occt
def test_a_name_that_is_not_utf_8(tmp_path):
    path = tmp_path / os.fsdecode(b"board\xff.step")
    write_step([PlacedArray(one_coil(path_coil([[(0, 0), (8e-3, 0)]], 0.2e-3, 0.2e-3, VIA)))], path, name="board")
    assert path.read_bytes().startswith(b"ISO-10303-21")


@needs_occt
def test_overlapping_holes_still_make_solids(tmp_path):
    """Two coils whose terminals are drilled into each other: arcs where they are left, edges where they are not."""
    coil = path_coil([[(0, 0), (5e-3, 0)]], 0.2e-3, 0.2e-3, VIA, LEADS.terminal)
    placements = (Placement("A", coil, ("L1",), 0, 0), Placement("B", coil, ("L2",), 0.3e-3, 0.1e-3))
    array = Array(many_layers(2), placements)
    write_step([PlacedArray(array)], tmp_path / "board.step", name="broken")
    _, parts = read_step(tmp_path / "board.step")
    for name, solid in solids(array).items():
        assert parts[name].valid, name
        # the polygons have 4e-4 less area than their circles; what is left of a drilled pad is a third of it
        assert parts[name].volume == pytest.approx(solid.volume * 1e9, rel=2e-3), name


@needs_occt
def test_sheets_of_one_name(tmp_path):
    array, path, twice = BOARDS["no holes"], tmp_path / "board.step", (Sheet("base", 1e-3),) * 2
    message = "sheet names must differ; got base, base"
    refused(GeometryError, message, write_step, [PlacedArray(array, twice)], path, name="board")
    assert list(tmp_path.iterdir()) == []
