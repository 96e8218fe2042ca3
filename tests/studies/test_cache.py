"""The cache of points and the version of the code: what is kept is found again, and nothing else."""

from __future__ import annotations

import functools
import json
import os
import stat
import threading

import pytest
from hypothesis import given
from hypothesis import strategies as st

from coilarray.compute import code_version as versions
from coilarray.errors import OutputError
from coilarray.studies.cache import FOLDER_VARIABLE, PointCache, open_cache, point_key

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
    return open_cache(tmp_path_factory.mktemp("points"))


@given(outcome=st.dictionaries(st.text(), NUMBERS) | st.text())
def test_an_outcome_comes_back_to_the_last_bit(shared, outcome):
    shared.put(KEY, outcome)
    again = shared.get(KEY)
    assert again == outcome
    if isinstance(outcome, dict):
        assert list(again) == list(outcome)
        assert [value.hex() for value in again.values()] == [value.hex() for value in outcome.values()]  # −0.0 too


def test_what_is_not_there_is_none(tmp_path):
    cache = open_cache(tmp_path)
    cache.put(KEY, {"a": 1.0})
    assert cache.get("ab" + 62 * "1") is None
    assert PointCache(tmp_path / "no" / "such").get(KEY) is None
    assert len(files(cache)) == 1  # one small file a point, nothing beside it
    assert files(cache)[0].stat().st_size < 100


@pytest.mark.parametrize(
    "text",
    [
        "", "{", '{"values": {"a": 1.0}', "null", "[]", '{"values": [1.0]}', '{"values": {"a": "1"}}',
        '{"values": {"a": true}}', '{"values": {"a": 1}}', '{"reason": 3}', '{"other": {}}', "\x00" * 40,
    ],
)  # fmt: skip
def test_an_unreadable_entry_counts_as_none_and_is_written_anew(tmp_path, text):
    cache = open_cache(tmp_path)
    cache.put(KEY, {"a": 1.0})
    (path,) = files(cache)
    path.write_text(text, encoding="utf-8")
    assert cache.get(KEY) is None
    cache.put(KEY, {"a": 2.0})
    assert cache.get(KEY) == {"a": 2.0}


def test_bytes_that_are_no_text_and_a_folder_in_the_place_count_as_none(tmp_path):
    cache = open_cache(tmp_path)
    cache.put(KEY, "why")
    (path,) = files(cache)
    path.write_bytes(b"\xff\xfe{}")
    assert cache.get(KEY) is None
    path.unlink()
    path.mkdir()
    assert cache.get(KEY) is None


def test_several_writers_leave_whole_entries(tmp_path):
    """Every reader sees one of the outcomes, never a part: the file is replaced, not written into."""
    cache = open_cache(tmp_path)
    outcomes = [{f"quantity{k}": float(n) for k in range(200)} for n in range(4)]
    cache.put(KEY, outcomes[0])
    writers = [threading.Thread(target=lambda one=one: [cache.put(KEY, one) for _ in range(30)]) for one in outcomes]
    for writer in writers:
        writer.start()
    while any(writer.is_alive() for writer in writers):
        assert cache.get(KEY) in outcomes
    for writer in writers:
        writer.join()
    assert len(files(cache)) == 1


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="the superuser may write everywhere")
def test_a_folder_without_permission_is_one_line(tmp_path):
    cache = open_cache(tmp_path / "points")
    cache.folder.chmod(stat.S_IRUSR | stat.S_IXUSR)
    with pytest.raises(OutputError, match="cannot make the folder"):
        cache.put(KEY, "why")


def test_a_file_in_the_place_of_the_folder_is_one_line(tmp_path):
    (tmp_path / "points").write_text("mine", encoding="utf-8")
    with pytest.raises(OutputError, match="a file has that name"):
        open_cache(tmp_path / "points")
    (tmp_path / "points").unlink()
    cache = open_cache(tmp_path / "points")
    (cache.folder / KEY[:2]).write_text("mine", encoding="utf-8")
    with pytest.raises(OutputError, match="a file has that name"):
        cache.put(KEY, "why")


def test_the_folder_is_the_one_given_or_named_or_the_users(tmp_path, monkeypatch):
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "named"))
    assert open_cache(tmp_path / "given").folder == tmp_path / "given"
    assert open_cache().folder == tmp_path / "named"
    monkeypatch.delenv(FOLDER_VARIABLE)
    monkeypatch.setattr("platformdirs.user_cache_dir", lambda name, appauthor: str(tmp_path / "user" / name))
    assert open_cache().folder == tmp_path / "user" / "coilarray" / "points"
    assert (tmp_path / "user" / "coilarray" / "points").is_dir()


@given(one=PLAIN, other=PLAIN)
def test_keys_are_equal_exactly_for_equal_parts(one, other):
    same = json.dumps(one, sort_keys=True) == json.dumps(other, sort_keys=True)
    assert (point_key(one) == point_key(other)) == same
    assert len(point_key(one)) == 64


def test_another_version_of_the_code_has_other_keys(monkeypatch):
    before = point_key("part")
    assert point_key("part") == before
    monkeypatch.setattr("coilarray.studies.cache.code_version", lambda: "9.9.9+0")
    assert point_key("part") != before


@pytest.fixture
def copied(tmp_path, monkeypatch):
    """A small package in a folder of its own, and its version, not remembered."""
    for name in ("coupling.py", "kernels/bars.py", "fabs/house.toml", "cli/sweep.py", "viz/plots.py"):
        path = tmp_path / "package" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(name, encoding="utf-8")
    monkeypatch.setattr(versions, "_ROOT", tmp_path / "package")
    return tmp_path / "package", versions.code_version.__wrapped__


@pytest.mark.parametrize(
    ("change", "changes"),
    [
        (lambda root: (root / "coupling.py").write_text("other"), True),
        (lambda root: (root / "kernels/bars.py").write_text("other"), True),
        (lambda root: (root / "fabs/house.toml").write_text("other"), True),
        (lambda root: (root / "new.py").touch(), True),
        (lambda root: (root / "coupling.py").rename(root / "circuit.py"), True),
        (lambda root: (root / "cli/sweep.py").write_text("other"), False),  # shows numbers, computes none
        (lambda root: (root / "viz/plots.py").write_text("other"), False),
        (lambda root: (root / "notes.txt").touch(), False),
        (lambda root: (root / "coupling.py").touch(), False),
    ],
)
def test_the_version_changes_with_the_source_of_what_computes(copied, change, changes):
    root, version = copied
    before = version()
    assert version() == before
    change(root)
    assert (version() != before) == changes


@pytest.mark.parametrize("package", ["numpy", "scipy", "numba"])
def test_the_version_changes_with_that_of_what_computes(copied, monkeypatch, package):
    _, version = copied
    before, installed = version(), versions.metadata.version
    monkeypatch.setattr(versions.metadata, "version", lambda name: "9.9" if name == package else installed(name))
    assert version() != before


def test_the_version_follows_links_to_folders(copied, tmp_path):
    """Geometry is such a link in a working copy; in an installation it is a folder."""
    root, version = copied
    linked = tmp_path / "geometry"
    linked.mkdir()
    (linked / "coil.py").write_text("turns", encoding="utf-8")
    before = version()
    (root / "geometry").symlink_to(linked)
    with_link = version()
    assert with_link != before
    (linked / "coil.py").write_text("more turns", encoding="utf-8")
    changed = version()
    assert changed != with_link
    (root / "geometry").unlink()
    linked.rename(root / "geometry")
    assert version() == changed


def test_the_version_of_this_package_counts_geometry():
    names = {path.relative_to(versions._ROOT).as_posix() for path in versions._sources()}
    assert {
        "geometry/coil.py",
        "electromagnetics/kernels/bars.py",
        "electromagnetics/inductance.py",
        "design/fabs/jlcpcb-4-layer.toml",
    } <= names
    assert not any(name.startswith(("cli/", "viz/", "report/")) for name in names)
    assert isinstance(versions.code_version, functools._lru_cache_wrapper)  # read once a process
