"""The store and the version of the code: what is kept is found again, and nothing else; locks have one holder."""

import copy
import dataclasses
import json
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

from coilarray.compute import store as versions
from coilarray.compute.store import FOLDER_VARIABLE, content_key, locked_database, open_store
from coilarray.errors import OutputError
from coilarray.geometry import Sheet

NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | NUMBERS | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=8,
)
KEY = "ab" + 62 * "0"


def files(cache):
    return sorted(path for path in cache.folder.rglob("*") if path.is_file())


@pytest.fixture(scope="module")
def shared(tmp_path_factory):
    return open_store(tmp_path_factory.mktemp("points"))


@pytest.mark.slow
@given(outcome=st.dictionaries(st.text(), NUMBERS) | st.text())
def test_an_outcome_comes_back_to_the_last_bit(shared, outcome):
    shared.put(KEY, outcome)
    again = shared.get(KEY)
    assert again == outcome
    if isinstance(outcome, dict):
        assert list(again) == list(outcome)
        assert [value.hex() for value in again.values()] == [value.hex() for value in outcome.values()]  # −0.0 too


def test_an_unreadable_entry_counts_as_none_and_is_written_anew(tmp_path):
    cache = open_store(tmp_path)
    cache.put(KEY, {"a": 1.0})
    (path,) = files(cache)
    path.unlink()
    path.mkdir()  # whoever made it
    assert cache.get(KEY) is None
    path.rmdir()
    for entry in (b"", b"{", b'{"values": {"a": 1.0}', b"null", b"\x00" * 40, b"\xff\xfe{}"):
        path.write_bytes(entry)
        assert cache.get(KEY) is None
        cache.put(KEY, {"a": 2.0})
        assert cache.get(KEY) == {"a": 2.0}


def test_a_dataset_is_computed_once_and_again_where_it_is_damaged_or_the_code_is_another(tmp_path, monkeypatch):
    store, made = open_store(tmp_path / "store"), []

    def kept(*parts):
        def compute():
            made.append(parts)
            return xr.Dataset({"a": ("n", [1.0, 2.0])})

        assert store.dataset(parts, compute).a.values.tolist() == [1.0, 2.0]
        return len(made)

    assert [kept("part"), kept("part")] == [1, 1]
    (path,) = files(store)
    for number, damage in enumerate((b"", path.read_bytes()[:200], b"not netCDF"), start=2):
        path.write_bytes(damage)
        assert [kept("part"), kept("part")] == [number, number]
    assert kept("part", np.zeros(2)) == 5
    first = store.keys()
    assert len(first) == 2
    monkeypatch.setattr("coilarray.compute.store.code_version", lambda: "0.2")
    assert [kept("part"), kept("part")] == [6, 6]
    (store.folder / "notes.txt").touch()
    store.discard(store.keys() - first)
    assert store.keys() == first
    store.discard(first)
    assert [path.name for path in store.folder.iterdir()] == ["notes.txt"]  # not the store's
    (store.folder / "notes.txt").unlink()
    store.discard(())
    assert not store.folder.exists()


def test_arrays_and_dataclasses_are_part_of_a_key_by_their_values():
    one = Sheet("base", 6e-3)
    parts = [
        np.zeros(2),
        np.zeros((2, 1)),
        np.zeros(2, complex),
        np.ones(2),
        one,
        dataclasses.replace(one, thickness=5e-3),
    ]
    keys = {content_key(part) for part in parts}
    assert len(keys) == len(parts)
    assert {content_key(copy.deepcopy(part)) for part in parts} == keys
    assert content_key(np.float64(2.5)) == content_key(2.5)
    with pytest.raises(TypeError, match=r"a \w*Path cannot be part of a key\."):
        content_key(Path())


LOCK = """
import sys, time
from pathlib import Path
from coilarray.compute.store import locked_database
with locked_database(Path(sys.argv[1]), "busy."):
    print("locked", flush=True)
    time.sleep(600)
"""


def test_a_lock_is_held_by_one_process_and_ends_with_it(tmp_path):
    path = tmp_path / "lock"
    with subprocess.Popen([sys.executable, "-c", LOCK, path], stdout=subprocess.PIPE) as process:
        assert process.stdout.readline() == b"locked\n"
        with pytest.raises(OutputError, match=r"^busy\.$"), locked_database(path, "busy."):
            pass
        process.kill()
    with locked_database(path, "busy.") as connection:
        connection.execute("CREATE TABLE t (x)")
        with pytest.raises(OutputError, match=r"^busy\.$"), locked_database(path, "busy."):
            pass
    path.write_bytes(b"no database" * 100)
    with pytest.raises(OutputError, match=r"cannot use .*lock: file is not a database"), locked_database(path, "busy."):
        pass
    for wrong in (tmp_path / "none" / "lock", Path("zero\0byte")):
        with pytest.raises(OutputError, match="cannot write "), locked_database(wrong, "busy."):
            pass


def test_several_writers_leave_whole_entries(tmp_path):
    """Every reader sees one of the outcomes, never a part: the file is replaced, not written into."""
    cache = open_store(tmp_path)
    outcomes = [{f"quantity{k}": float(n) for k in range(200)} for n in range(4)]
    cache.put(KEY, outcomes[0])
    writers = [threading.Thread(target=lambda one=one: [cache.put(KEY, one) for _ in range(30)]) for one in outcomes]
    for writer in writers:
        writer.start()
    while any(writer.is_alive() for writer in writers):
        assert cache.get(KEY) in outcomes
    assert len(files(cache)) == 1


def test_a_file_in_the_place_of_the_folder_is_one_line(tmp_path):
    (tmp_path / "points").write_text("mine", encoding="utf-8")
    with pytest.raises(OutputError, match="a file has that name"):
        open_store(tmp_path / "points")
    (tmp_path / "points").unlink()
    cache = open_store(tmp_path / "points")
    (cache.folder / KEY[:2]).write_text("mine", encoding="utf-8")
    with pytest.raises(OutputError, match="a file has that name"):
        cache.put(KEY, "why")


def test_the_folder_is_the_one_given_or_named_or_the_users(tmp_path, monkeypatch):
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "named"))
    monkeypatch.setattr("platformdirs.user_cache_dir", lambda name, appauthor: str(tmp_path / "user" / name))
    assert open_store(tmp_path / "given").folder == tmp_path / "given"
    assert open_store().folder == tmp_path / "named"
    monkeypatch.delenv(FOLDER_VARIABLE)
    assert open_store().folder == tmp_path / "user" / "coilarray"
    assert (tmp_path / "user" / "coilarray").is_dir()


@pytest.mark.slow
@given(one=PLAIN, other=PLAIN)
def test_keys_are_equal_exactly_for_equal_parts(one, other):
    same = json.dumps(one, sort_keys=True) == json.dumps(other, sort_keys=True)
    assert (content_key(one) == content_key(other)) == same
    assert len(content_key(one)) == 64


@pytest.fixture
def copied(tmp_path, monkeypatch):
    """A small package in a folder of its own, and its version, not remembered."""
    for name in ("coupling.py", "kernels/bars.py", "fabs/house.toml", "cli/sweep.py", "viz/plots.py"):
        path = tmp_path / "package" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(name, encoding="utf-8")
    monkeypatch.setattr(versions, "_ROOT", tmp_path / "package")
    return tmp_path / "package", versions.code_version.__wrapped__


def written(path):
    return path.write_text("other")


@pytest.mark.parametrize(("name", "change", "changes"), [
    ("coupling.py", written, True), ("kernels/bars.py", written, True), ("fabs/house.toml", written, True),
    ("new.py", Path.touch, True), ("coupling.py", lambda path: path.rename(path.with_name("circuit.py")), True),
    ("cli/sweep.py", written, False), ("viz/plots.py", written, False),  # they show numbers, compute none
    ("notes.txt", Path.touch, False), ("coupling.py", Path.touch, False),
])  # fmt: skip
def test_the_version_changes_with_the_source_of_what_computes(copied, name, change, changes):
    root, version = copied
    before = version()
    assert version() == before
    change(root / name)
    assert (version() != before) == changes
