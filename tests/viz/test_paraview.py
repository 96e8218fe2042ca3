"""Files for ParaView: read back they are the parts of the scene with all their arrays, and they replace as a whole."""

import numpy as np
import pytest
import pyvista

from coilarray.errors import OutputError
from coilarray.viz.datasets.results import field_grid
from coilarray.viz.scenes.pictures import save_vtk
from coilarray.viz.scenes.scene import Part, Scene


def scene(top=1.0):
    box = pyvista.Box((0, 1, 0, 2, 0, top))
    box.cell_data["v (V)"] = np.arange(6.0)
    grid = field_grid([0, 1e-3], [0, 1e-3], [0, 2e-3], np.ones((2, 2, 2, 3)))
    cut = pyvista.Box().clip("z")
    return Scene((Part("copper L1", box), Part("B / box", grid), Part("cut", cut)))


def same(found, part):
    assert type(found) is type(part.mesh)
    np.testing.assert_allclose(found.points, part.mesh.points)
    for mine, theirs in ((found.cell_data, part.mesh.cell_data), (found.point_data, part.mesh.point_data)):
        assert set(mine.keys()) == set(theirs.keys())
        for name in theirs:
            np.testing.assert_array_equal(mine[name], theirs[name])


def test_blocks_or_files_are_the_parts(tmp_path):
    written = save_vtk(scene(), tmp_path / "board.vtm")
    assert set(written) == {tmp_path / "board.vtm", tmp_path / "board"}
    blocks = pyvista.read(tmp_path / "board.vtm")
    assert blocks.keys() == ["copper L1", "B / box", "cut"]
    for part in scene().parts:
        same(blocks[part.name], part)
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["board", "board.vtm"]


def test_written_again_it_is_the_new_scene_and_names_are_kept_apart(tmp_path):
    path = tmp_path / "board.vtm"
    save_vtk(scene(), path)
    save_vtk(scene(top=5.0), path)
    assert pyvista.read(path)["copper L1"].bounds[5] == 5.0
    save_vtk(Scene((Part("a b", pyvista.Box()), Part("a/b", pyvista.Box((0, 1, 0, 1, 0, 7))))), path)
    assert sorted(entry.name for entry in (tmp_path / "board").iterdir()) == ["00_a_b.vtp", "01_a_b.vtp"]


def test_what_cannot_be_written_is_one_line(tmp_path):
    with pytest.raises(OutputError, match=r"cannot write into .*nowhere: No such file"):
        save_vtk(scene(), tmp_path / "nowhere" / "board.vtm")
    (tmp_path / "board").mkdir()
    with pytest.raises(OutputError, match="there is a folder"):
        save_vtk(scene(), tmp_path / "board.vtm")
    assert [entry.name for entry in tmp_path.iterdir()] == ["board"]
