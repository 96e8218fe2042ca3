"""Files of several boards: assemblies have every board at its pose, and each board is fabricated by itself."""

import importlib.util
import math
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from support.refusals import refused

from coilarray import Array, Board, Design, Pose, Spiral, export
from coilarray.errors import OutputError
from coilarray.geometry import Bend, Sheet, Zone, solids

ROW = Array.row(Spiral(4, 8e-3, 2, 0.3e-3, 0.3e-3), 2, pitch=12e-3)
ONE = Array.row(Spiral(6, 10e-3, 2, 0.3e-3, 0.3e-3), 1)
COVERED = Design(ONE, sheets=(Sheet("cover", 0.5e-3),), name="one")
TILTED = Pose(x=4e-3, y=-1e-3, z=12e-3, turn=(math.pi, 0.4, 0.2))
PAIR = Design(ROW, boards=(Board(COVERED, TILTED, "lid"),), name="pair")
STEP = importlib.util.find_spec("OCP") is not None


def corners(array, sheets, pose):
    """Lowest and highest corner of a placed board in m."""
    points = np.vstack([pose.apply(np.asarray(solid.vertices)) for solid in solids(array, sheets).values()])
    return np.array([points.min(axis=0), points.max(axis=0)])


def test_the_assembly_has_each_solid_once_at_its_pose(tmp_path):
    export(PAIR, tmp_path / "pair.glb")
    scene = trimesh.load(tmp_path / "pair.glb")
    scene.apply_transform(trimesh.transformations.rotation_matrix(math.pi / 2, (1, 0, 0)))  # y is up in glTF
    read = {name: scene.geometry[scene.graph[name][1]].copy().apply_transform(scene.graph[name][0])
            for name in scene.graph.nodes_geometry}  # fmt: skip
    own, lid = solids(ROW), solids(ONE, COVERED.sheets)
    assert {"copper/L1/coil2", "copper/L1/lid/coil1", "board", "board/lid", "sheet/lid/cover"} <= set(read)
    assert len(read) == len(own) + len(lid)
    for name, solid, pose in (
        ("copper/L1/coil2", own["copper/L1/coil2"], Pose()),
        ("copper/L1/lid/coil1", lid["copper/L1/coil1"], TILTED),
        ("board/lid", lid["board"], TILTED),
        ("sheet/lid/cover", lid["sheet/cover"], TILTED),
    ):
        # glTF has numbers of 32 bits: 6e-8 of 20 mm, and some times more of a volume
        assert read[name].volume == pytest.approx(solid.volume, rel=1e-4)
        np.testing.assert_allclose(read[name].center_mass, pose.apply(solid.center_mass), atol=1e-7)
        placed = pose.apply(np.asarray(solid.vertices))
        np.testing.assert_allclose(read[name].bounds, [placed.min(axis=0), placed.max(axis=0)], atol=1e-8)


def test_the_assembly_has_bent_boards_and_stl_is_in_mm(tmp_path):
    bent = ONE.bent(Bend((Zone(10e-3),)))
    export(Design(ROW, boards=(Board(bent, TILTED, "lid"),)), tmp_path / "pair.stl")
    both = np.array([corners(ROW, (), Pose()), corners(bent, (), TILTED)])
    expected = 1e3 * np.array([both[:, 0].min(axis=0), both[:, 1].max(axis=0)])
    np.testing.assert_allclose(trimesh.load(tmp_path / "pair.stl").bounds, expected, atol=1e-5)  # mm, of 32 bits
    refused(OutputError, "STEP", export, Design(ROW, boards=(Board(bent, TILTED),)), tmp_path / "pair.step")
    assert [file.name for file in tmp_path.iterdir()] == ["pair.stl"]


@pytest.mark.slow
@pytest.mark.skipif(not STEP, reason="no Open CASCADE (extra step)")
def test_step_has_the_boards_at_their_poses(tmp_path):
    from OCP.Bnd import Bnd_Box
    from OCP.BRepBndLib import BRepBndLib
    from OCP.BRepGProp import BRepGProp
    from OCP.GProp import GProp_GProps
    from OCP.STEPControl import STEPControl_Reader

    export(PAIR, tmp_path / "pair.step", sheets=False)
    reader = STEPControl_Reader()
    reader.ReadFile(str(tmp_path / "pair.step"))
    reader.TransferRoots()
    box, properties = Bnd_Box(), GProp_GProps()
    BRepBndLib.AddOptimal_s(reader.OneShape(), box, False, False)
    BRepGProp.VolumeProperties_s(reader.OneShape(), properties)
    read = [[one.X(), one.Y(), one.Z()] for one in (box.CornerMin(), box.CornerMax())]
    both = np.array([corners(ROW, (), Pose()), corners(ONE, (), TILTED)])
    # the reader's boxes are wider by its tolerance of 1e-7 mm; circles of pads are polygons in the solids
    np.testing.assert_allclose(read, 1e3 * np.array([both[:, 0].min(axis=0), both[:, 1].max(axis=0)]), atol=1e-3)
    volume = sum(solid.volume for array in (ROW, ONE) for solid in solids(array).values())
    assert properties.Mass() == pytest.approx(1e9 * volume, rel=1e-3)


def test_every_board_has_fabrication_files_of_its_own(tmp_path):
    written = export(PAIR, tmp_path / "pair.svg").files
    assert [file.name for file in written] == ["pair.svg", "pair-lid.svg"]
    alone = export(COVERED, tmp_path / "one.svg").files[0]
    assert written[1].read_bytes() == alone.read_bytes()
    kicad = export(PAIR, tmp_path / "pair-kicad").files
    boards = [file.relative_to(tmp_path).as_posix() for file in kicad if file.suffix == ".kicad_pcb"]
    assert boards == ["pair-kicad/pair/pair.kicad_pcb", "pair-kicad/lid/lid.kicad_pcb"]
    assert all(file.exists() for file in kicad)
    again = export(PAIR, tmp_path / "pair-kicad").files  # the same files in the same folders
    assert again == kicad


def test_all_files_of_boards_are_written_or_none(tmp_path):
    (tmp_path / "pair-lid.svg").mkdir()
    refused(OutputError, "pair-lid.svg", export, PAIR, tmp_path / "pair.svg")
    assert [file.name for file in tmp_path.iterdir()] == ["pair-lid.svg"]
    alike = replace(PAIR, boards=(Board(ONE, TILTED, "lid"), Board(ONE, Pose(z=30e-3), "LID")))
    refused(OutputError, "LID", export, alike, tmp_path / "pair.dxf")
    ring = replace(ONE, placements=(replace(ONE.placements[0], name="coil3"),))
    loops = Design(ROW, boards=(Board(ring, TILTED, ""),), name="helmet")
    refused(OutputError, "helmet", export, loops, tmp_path / "helmet.svg")
    export(loops, tmp_path / "helmet.glb")
    assert not any(name.startswith("board") for name in trimesh.load(tmp_path / "helmet.glb").geometry)
