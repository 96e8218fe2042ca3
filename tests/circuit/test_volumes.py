"""Field volumes and inductance matrices larger than memory, and `coilarray field --large`.

Who checks whom: the numbers on disk against those in memory, to the last bit for fields and to rounding for matrices,
with any workers, and after an interruption.
"""

import json

import numpy as np
import pytest
import xarray as xr
from support.command_line import runner
from support.lattices import hexagonal

import coilarray.circuit.field_volume as volumes
import coilarray.electromagnetics.large_matrix as large_matrix
from coilarray import couple_design, inductance_matrix, load_design, vary
from coilarray.circuit.field_volume import write_field_volume
from coilarray.circuit.operating_field import operating_field
from coilarray.compute.large_file import parts_folder
from coilarray.compute.memory import MemoryLimitError
from coilarray.compute.workers import workers
from coilarray.electromagnetics.large_matrix import write_inductance_matrix
from coilarray.errors import GeometryError, OutputError
from coilarray.geometry import Conductor

pytestmark = pytest.mark.slow

STARTER = load_design("starter")
GRID = [np.linspace(-20e-3, 20e-3, 29), np.linspace(-10e-3, 12e-3, 23), np.array([1e-3, 3e-3, 4e-3])]
run, refused = runner("field", "starter")


@pytest.fixture(scope="module")
def coupling():
    return couple_design(STARTER, ideal=True)


@pytest.fixture
def small_blocks(monkeypatch):
    """Blocks of 512 points: four of the grid of 2001."""
    monkeypatch.setattr(volumes, "_MOST_POINTS", 512)


class StopError(Exception):
    pass


def stop_after(blocks):
    def progress(done, total):
        if done == blocks:
            raise StopError

    return progress


def read(path):
    with xr.open_dataset(path, engine="h5netcdf") as volume:
        return volume.load()


@pytest.mark.parametrize(("processes", "options"), [(1, {}), (1, {"terminated": False, "current": 0.1}), (2, {})])
def test_a_volume_is_the_field_to_the_last_bit(coupling, small_blocks, tmp_path, processes, options):
    expected = operating_field(STARTER, coupling, "coil2", *GRID, **options)
    told, path = [], tmp_path / "v.nc"
    with workers(processes) as pool:
        progress = lambda *done: told.append(done)  # noqa: E731
        peak = write_field_volume(path, STARTER, coupling, "coil2", *GRID, pool, progress=progress, **options)
    assert told == [(1, 4), (2, 4), (3, 4), (4, 4)]
    assert read(path).identical(expected)
    assert peak == np.abs(expected.B.values[..., 2]).max()


def test_an_interrupted_volume_is_gone_on_with(coupling, small_blocks, tmp_path, monkeypatch):
    path, computed, whole = tmp_path / "v.nc", [], volumes.field_block
    monkeypatch.setattr(volumes, "field_block", lambda block: computed.append(block.start) or whole(block))
    with workers() as pool:
        with pytest.raises(StopError):
            write_field_volume(path, STARTER, coupling, "coil2", *GRID, pool, progress=stop_after(2))
        assert list(tmp_path.iterdir()) == [parts_folder(path)]
        with pytest.raises(OutputError, match="holds another unfinished file"):
            write_field_volume(path, STARTER, coupling, "coil1", *GRID, pool)
        told = []
        peak = write_field_volume(path, STARTER, coupling, "coil2", *GRID, pool, progress=lambda *d: told.append(d))
    assert computed == [0, 512, 1024, 1536]
    assert told == [(2, 4), (3, 4), (4, 4)]
    assert read(path).identical(expected := operating_field(STARTER, coupling, "coil2", *GRID))
    assert peak == np.abs(expected.B.values[..., 2]).max()


def test_blocks_of_another_version_are_not_gone_on_with(coupling, coils, small_blocks, tmp_path, monkeypatch):
    # the package's version stays the same where somebody edits the code or updates numpy
    monkeypatch.setattr(large_matrix, "_PATHS", 2)
    volume, matrix = tmp_path / "v.nc", tmp_path / "L.nc"
    with workers() as pool:
        with pytest.raises(StopError):
            write_field_volume(volume, STARTER, coupling, "coil2", *GRID, pool, progress=stop_after(2))
        with pytest.raises(StopError):
            write_inductance_matrix(matrix, coils, pool, progress=stop_after(2))
        monkeypatch.setattr("coilarray.compute.store.code_version", lambda: "1.0+edited")
        with pytest.raises(OutputError, match="for other inputs or from another version"):
            write_field_volume(volume, STARTER, coupling, "coil2", *GRID, pool)
        with pytest.raises(OutputError, match="for other inputs or from another version"):
            write_inductance_matrix(matrix, coils, pool)
    assert [path.exists() for path in (volume, matrix)] == [False, False]


def test_blocks_take_some_seconds_whatever_the_number_of_paths():
    path = Conductor(np.column_stack((np.arange(100_001.0), *np.zeros((2, 100_001)))))
    axes = [np.arange(1000.0), np.arange(1000.0), np.arange(10.0)]
    # multiples of what is summed at once, 512 points or 2e10 pairs of a point and a segment
    assert [volumes._blocks([path] * count, axes)[0][1] for count in (1, 100, 400)] == [390 * 512, 3 * 512, 512]
    assert volumes._blocks([Conductor(path.vertices[:11])], axes)[1] == (2**18, 2**19)


def test_what_cannot_be_is_refused_before_anything_is_made(coupling, tmp_path, monkeypatch):
    with workers() as pool:
        with pytest.raises(OutputError, match=r"a volume is written as \.nc; got .*v\.vtr"):
            write_field_volume(tmp_path / "v.vtr", STARTER, coupling, "coil2", *GRID, pool)
        with pytest.raises(GeometryError, match="x, y and z must be finite, one value or more each"):
            write_field_volume(tmp_path / "v.nc", STARTER, coupling, "coil2", [np.nan], [0], [0], pool)
        with pytest.raises(GeometryError, match="there is no coil 'coil9'"):
            write_field_volume(tmp_path / "v.nc", STARTER, coupling, "coil9", *GRID, pool)
        monkeypatch.setenv("COILARRAY_MEMORY_GB", "1e-4")
        needed = r"a volume with 1 blocks in flight needs about 0.0008 GB .* take fewer"
        with pytest.raises(MemoryLimitError, match=needed):
            write_field_volume(tmp_path / "v.nc", STARTER, coupling, "coil2", *GRID, pool)
    assert not list(tmp_path.iterdir())


@pytest.fixture(scope="module")
def coils():
    lattice = vary(hexagonal(4, 3, turns=4), {"array.pitch_mm": 32}).array.conductors()  # side by side
    shifts = [np.array([0.2 + 3e-4 * k**1.5, 0, 0]) for k in range(len(lattice))]
    moved = [Conductor(c.vertices + by, c.widths, c.thicknesses) for c, by in zip(lattice, shifts, strict=True)]
    return [*lattice, *moved]


def test_a_matrix_in_blocks_is_that_in_memory(coils, tmp_path, monkeypatch):
    monkeypatch.setattr("coilarray.electromagnetics.large_matrix._PATHS", 7)
    path, told = tmp_path / "L.nc", []
    with workers() as pool:
        with pytest.raises(StopError):
            write_inductance_matrix(path, coils, pool, progress=stop_after(4))
        write_inductance_matrix(path, coils, pool, progress=lambda *done: told.append(done))
    assert (told[0], told[-1]) == ((4, 10), (10, 10))
    L, expected = read(path).inductance, inductance_matrix(coils)
    assert (L.values == L.values.T).all()
    # other pairs stand for equal ones, which differ by 1e-12 of the board's extent, and sums are cut in other places
    assert np.abs(L.values - expected).max() < 1e-12 * expected.max()
    assert L.attrs["units"] == "H"


def test_a_small_matrix_is_one_block(coils, tmp_path):
    with workers() as pool:
        write_inductance_matrix(tmp_path / "L.nc", coils[:3], pool, accuracy="screen")
    assert (read(tmp_path / "L.nc").inductance.values == inductance_matrix(coils[:3], accuracy="screen")).all()


def test_matrices_that_cannot_be(coils, tmp_path, monkeypatch):
    with workers() as pool:
        with pytest.raises(OutputError, match=r"a matrix is written as \.nc"):
            write_inductance_matrix(tmp_path / "L.csv", coils, pool)
        with pytest.raises(GeometryError, match="thin filament is infinite"):
            write_inductance_matrix(tmp_path / "L.nc", [Conductor(coils[0].vertices)], pool)
        monkeypatch.setenv("COILARRAY_MEMORY_GB", "1e-5")
        with pytest.raises(MemoryLimitError, match="a matrix in blocks of 256 paths, 1 in flight, needs about"):
            write_inductance_matrix(tmp_path / "L.nc", coils, pool)
    assert not list(tmp_path.iterdir())


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


COARSE = ("--spacing-mm", "1", "--z-mm", "1:3")


def test_large_writes_what_the_command_writes_else(capsys, here, small_blocks):
    small = run(capsys, *COARSE, "--out", "a.nc", "--json")
    large = run(capsys, *COARSE, "--out", "b.nc", "--json", "--large", "--workers", "1")
    assert [(code, err) for code, _, err in (small, large)] == [(0, "")] * 2
    assert json.loads(large[1]) == {**json.loads(small[1]), "file": "b.nc"}
    assert read("a.nc").identical(read("b.nc"))
    assert sorted(path.name for path in here.iterdir()) == ["a.nc", "b.nc"]


def test_an_interrupted_command_says_how_to_go_on(capsys, here, small_blocks, monkeypatch):
    whole = volumes.field_block

    def interrupted(block):
        if block.start >= 1024:
            raise KeyboardInterrupt
        return whole(block)

    monkeypatch.setattr(volumes, "field_block", interrupted)
    code, out, err = run(capsys, *COARSE, "--large", "--workers", "1")
    assert (code, out) == (130, "")
    kept, last = err.splitlines()
    assert kept.startswith("coilarray: 2 of ")
    assert kept.endswith(" blocks are kept in field.nc.parts; the same command continues from there")
    assert last == "coilarray: interrupted"
    assert [path.name for path in here.iterdir()] == ["field.nc.parts"]
    monkeypatch.setattr(volumes, "field_block", whole)
    assert run(capsys, *COARSE, "--large", "--workers", "1")[0] == 0
    assert [path.name for path in here.iterdir()] == ["field.nc"]


def test_what_the_command_refuses(capsys, here, monkeypatch):
    assert "--large writes .nc; got f.vtr" in refused(capsys, "--large", "--out", "f.vtr")
    assert "--workers and --cluster are for --large" in refused(capsys, "--workers", "2")
    assert "cannot be given with --cluster" in refused(capsys, "--large", "--workers", "2", "--cluster", "tcp://a:1")
    line = refused(capsys, "--spacing-mm", "0.001")
    assert "at most 20000000 are allowed: widen the spacing, or write block by block with --large." in line
    assert "100000000000 are allowed: widen the spacing." in refused(capsys, "--spacing-mm", "0.0001", "--large")
    monkeypatch.setenv("COILARRAY_MEMORY_GB", "1e-4")
    line = refused(capsys, *COARSE, "--large", "--workers", "1")
    assert "a volume with 1 blocks in flight needs about" in line
    assert "0.0001 GB are allowed: take fewer workers" in line
    assert "a grid of" in (line := refused(capsys, *COARSE))
    assert "0.0001 GB are allowed: compute it in pieces" in line
    assert not list(here.iterdir())
