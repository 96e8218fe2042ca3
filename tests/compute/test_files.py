"""Files that are read and written: devices, pipes, sizes, and what killed programs leave."""

import errno
import os
import subprocess
import sys

import pytest

from coilarray.compute import files
from coilarray.compute.files import bytes_of_file, hidden_prefix, remove_left, write_text
from coilarray.design.model import load_design_file
from coilarray.errors import DesignError


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (f"schema = {'9' * 5000}", "a number of thousands of digits"),
        (f"[array]\nrows = 0x{'f' * 9000}", "array.rows must be a number of at most 1024 bits"),
        (f"{'.'.join(['a'] * 2000)} = 1", "is nested too deeply"),
        (f"[{'.'.join(['a'] * 2000)}]\nb = 1", "is nested too deeply"),
        (f"a = {'[' * 2000}{']' * 2000}", "nested too deeply"),
        (f"a = {'{b = ' * 2000}1{'}' * 2000}", "nested too deeply"),
    ],
)
def test_numbers_and_tables_without_end_are_refused_in_one_line(tmp_path, text, message):
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(DesignError, match=message) as caught:
        load_design_file(str(tmp_path / "a.toml"))
    assert len(str(caught.value)) < 400


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes and devices as Unix has them")
def test_devices_and_large_files_are_refused_and_pipes_are_read(tmp_path):
    with pytest.raises(OSError, match="neither a file nor a pipe") as caught:
        bytes_of_file(files.Path("/dev/zero"))
    assert caught.value.errno == errno.EINVAL
    large = tmp_path / "large.toml"
    with large.open("wb") as file:
        file.truncate(10_000_001)
    with pytest.raises(DesignError, match="at most 10000000 bytes"):
        load_design_file(str(large))
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    assert bytes_of_file(pipe) == b""  # nobody writes into it
    writer = os.open(pipe, os.O_RDWR)
    os.write(writer, b"x" * 100)
    with pytest.raises(OSError, match="at most 50 bytes"):
        bytes_of_file(pipe, 50)
    os.close(writer)


@pytest.mark.skipif(os.name != "posix", reason="elsewhere nobody can be asked whether a process lives")
def test_what_a_killed_program_left_is_deleted_and_nothing_else(tmp_path):
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    mine = hidden_prefix("board")
    left = mine.replace(str(os.getpid()), str(dead.pid))
    folder = tmp_path / f"{left}abcdefgh"
    (folder / "project").mkdir(parents=True)
    stay = [f"{mine}abcdefgh", ".board-abcdefgh", "board.toml", f"{left}short"]
    for name in (f"{left}abcdefgh.toml", *stay):
        (tmp_path / name).write_text("")
    remove_left(tmp_path)
    assert sorted(os.listdir(tmp_path)) == sorted(stay)
    (tmp_path / f"{left}abcdefgh.nc").write_text("")
    write_text(tmp_path / "new.txt", "text")
    assert sorted(os.listdir(tmp_path)) == sorted([*stay, "new.txt"])
