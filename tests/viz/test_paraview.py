"""Files for ParaView: read back they are the parts of the scene with all their arrays, and they replace as a whole."""

import numpy as np
import pytest
import pyvista

from coilarray.errors import OutputError
from coilarray.viz.datasets.field import field_grid
from coilarray.viz.scenes.paraview import save_vtk
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
    written = save_vtk(scene(), tmp_path / "parts")
    assert [path.name for path in written] == ["copper_L1.vtp", "B_box.vtr", "cut.vtp"]
    for path, part in zip(written, scene().parts, strict=True):
        same(pyvista.read(path), part)
    assert sorted(entry.name for entry in (tmp_path / "parts").iterdir()) == sorted(path.name for path in written)


def test_written_again_it_is_the_new_scene_and_names_are_kept_apart(tmp_path):
    for name in ("board.vtm", "parts"):
        save_vtk(scene(), tmp_path / name)
        save_vtk(scene(top=5.0), tmp_path / name)
    assert pyvista.read(tmp_path / "board.vtm")["copper L1"].bounds[5] == 5.0
    assert pyvista.read(tmp_path / "parts" / "copper_L1.vtp").bounds[5] == 5.0
    both = Scene((Part("a b", pyvista.Box()), Part("a/b", pyvista.Box((0, 1, 0, 1, 0, 7)))))
    written = save_vtk(both, tmp_path / "parts")
    assert len(set(written)) == 2
    assert pyvista.read(written[1]).bounds[5] == 7.0


def test_what_cannot_be_written_is_one_line(tmp_path):
    (tmp_path / "taken").write_text("a file")
    with pytest.raises(OutputError, match="a file has that name"):
        save_vtk(scene(), tmp_path / "taken")
    with pytest.raises(OutputError, match=r"cannot write into .*nowhere: No such file"):
        save_vtk(scene(), tmp_path / "nowhere" / "board.vtm")
    assert [entry.name for entry in tmp_path.iterdir()] == ["taken"]
