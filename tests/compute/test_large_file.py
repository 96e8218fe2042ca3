"""Files that are filled block by block, and what is left of them when a run ends early."""

import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from support.patience import PATIENCE

import coilarray.compute.large_file as large_file
from coilarray.compute.large_file import Variable, open_large, parts_folder
from coilarray.compute.netcdf import load_part
from coilarray.errors import OutputError

X, Y = np.linspace(0, 1, 5), np.array([2.0, 3.0, 7.0])
FRAME = xr.Dataset(
    coords={"x": ("x", X, {"units": "m"}), "y": ("y", Y, {"units": "m"}), "component": ["a", "b"]}, attrs={"of": "test"}
)
VARIABLES = [Variable("B", ("x", "y", "component"), "T", "flux density"), Variable("n", ("y",), "1", "number")]
VALUES = np.arange(30.0).reshape(5, 3, 2) + 0.1


class StopError(Exception):
    """Ends a run."""


def fill(path, numbers, key="one", blocks=5, end=False):
    """Fill some rows of B, a row a block; the first one fills n too."""
    with open_large(path, FRAME, VARIABLES, key, blocks) as file:
        for number in numbers:
            file.write("B", 6 * number, VALUES[number])
            if number == 0:
                file.write("n", 0, Y)
            file.finish(number, 10.0 * number)
        left = file.finished, file.missing
        if end:
            raise StopError
    return left


def test_a_file_that_is_filled_is_as_one_that_is_written_at_once(tmp_path):
    path = tmp_path / "a.nc"
    finished, missing = fill(path, [3, 0, 4, 2, 1])
    assert (finished, missing) == ({k: 10.0 * k for k in range(5)}, [])
    assert list(tmp_path.iterdir()) == [path]
    attributes = ({"units": "T", "long_name": "flux density"}, {"units": "1", "long_name": "number"})
    whole = FRAME.assign(B=(VARIABLES[0].dims, VALUES, attributes[0]), n=("y", Y, attributes[1]))
    assert load_part(path).identical(whole)


@pytest.mark.slow
def test_an_unfinished_file_is_gone_on_with(tmp_path):
    path = tmp_path / "a.nc"
    with suppress(StopError):
        fill(path, [1, 3], end=True)
    assert list(tmp_path.iterdir()) == [parts_folder(path)]
    fill(path, [4])  # and ends without an error before all are done
    assert not path.exists()
    with open_large(path, FRAME, VARIABLES, "one", 5) as file:
        assert file.finished == {1: 10.0, 3: 30.0, 4: 40.0}
        assert file.missing == [0, 2]
    fill(path, [0, 2])
    assert list(tmp_path.iterdir()) == [path]
    assert (load_part(path).B.values == VALUES).all()


def test_nothing_is_left_where_nothing_was_done_and_other_things_stay(tmp_path):
    path = tmp_path / "a.nc"
    path.write_text("before")
    with pytest.raises(StopError):
        fill(path, [], end=True)
    assert list(tmp_path.iterdir()) == [path]
    assert path.read_text() == "before"
    parts_folder(path).mkdir()
    (parts_folder(path) / "notes.txt").write_text("mine")
    fill(path, range(5))
    assert [one.name for one in parts_folder(path).iterdir()] == ["notes.txt"]


def test_an_unfinished_file_of_something_else_is_not_touched(tmp_path):
    path = tmp_path / "a.nc"
    fill(path, [2])
    message = r"a\.nc\.parts holds another unfinished file, for other inputs or from another version"
    for changed in ({"key": "two"}, {"blocks": 6}):
        with pytest.raises(OutputError, match=message):
            fill(path, [0], **changed)
    assert fill(path, [0])[0] == {0: 0.0, 2: 20.0}


@pytest.mark.slow
def test_a_lost_or_damaged_file_is_begun_again(tmp_path):
    path = tmp_path / "a.nc"
    fill(path, [2])
    (parts_folder(path) / "data.nc").unlink()
    assert fill(path, [1])[0] == {1: 10.0}
    (parts_folder(path) / "journal.db").write_bytes(b"no database" * 100)
    with pytest.raises(OutputError, match=r"cannot use .*journal\.db: file is not a database"):
        fill(path, [1])


def test_one_run_at_a_time(tmp_path):
    path = tmp_path / "a.nc"
    with open_large(path, FRAME, VARIABLES, "one", 5) as file:
        with pytest.raises(OutputError, match=r"another run is filling .*a\.nc\.parts; wait for it or give another"):
            fill(path, [0])
        file.finish(1)
    assert fill(path, [])[0] == {1: 0.0}


def test_too_little_room_is_told_before_anything_is_written(tmp_path, monkeypatch):
    monkeypatch.setattr(large_file.shutil, "disk_usage", lambda folder: SimpleNamespace(free=100))
    with pytest.raises(OutputError, match=r"a\.nc needs 2.64e-07 GB on the disk; 1e-07 GB are free"):
        fill(tmp_path / "a.nc", [0])
    assert not list(tmp_path.iterdir())


def test_places_that_cannot_be_written(tmp_path):
    with pytest.raises(OutputError, match="cannot make the folder"):
        fill(tmp_path / ("n" * 300 + ".nc"), [0])
    path = tmp_path / "a.nc"
    path.mkdir()
    with pytest.raises(OutputError, match=r"cannot write .*a\.nc: it is a folder"):  # before the work
        fill(path, range(5))
    path.rmdir()
    assert not list(tmp_path.iterdir())

    def numbers():
        yield from range(5)
        path.mkdir()  # while it is filled

    with pytest.raises(OutputError, match=r"cannot write .*a\.nc: Is a directory"):
        fill(path, numbers())
    path.rmdir()
    assert fill(path, [])[1] == []  # what was done is still there
    assert path.is_file()


SCRIPT = """
import signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)
from pathlib import Path
sys.path[:0] = {tests}
from test_large_file import FRAME, VALUES, VARIABLES
from coilarray.compute.large_file import open_large
with open_large(Path({path!r}), FRAME, VARIABLES, "one", 5) as file:
    for number in (0, 1, 2):
        file.write("B", 6 * number, VALUES[number])
        file.finish(number)
    file.write("B", 18, VALUES[0])  # not what belongs there
    print("half", flush=True)
    time.sleep(600)
"""


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT], ids=["SIGKILL", "SIGINT"])
def test_a_run_that_is_ended_within_a_block_loses_that_block(tmp_path, number):
    path = tmp_path / "a.nc"
    code = SCRIPT.format(tests=[str(p) for p in Path(__file__).parents[:2]], path=str(path))
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        assert process.stdout.readline() == b"half\n"
        process.send_signal(number)
        process.wait(PATIENCE)
    assert not path.exists()
    with open_large(path, FRAME, VARIABLES, "one", 5) as file:
        assert file.missing == [3, 4]
    fill(path, [3, 4])
    assert (load_part(path).B.values == VALUES).all()
