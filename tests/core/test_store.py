"""The store: same key, same result; whole entries only; bounded; shared by processes."""

import logging
import os
import subprocess
import sys
import time
from dataclasses import dataclass

import numpy as np
import pytest

from lightwell.core.formats import ARRAYS, COLUMNS, JSON, RecordFormat
from lightwell.core.keys import key
from lightwell.core.store import Store, default_folder


@dataclass(frozen=True)
class Place:
    position: np.ndarray


@dataclass(frozen=True)
class Light:
    place: Place
    half_a: np.ndarray
    direction: np.ndarray | None = None


def _arrays():
    return {"x": np.arange(6, dtype=np.float32).reshape(2, 3), "none": np.zeros((0, 3), np.uint32)}


@pytest.mark.parametrize("format", [ARRAYS, COLUMNS])
def test_arrays_come_back_and_are_made_once(tmp_path, format):
    store, made = Store(tmp_path), []
    for _ in range(2):
        found = store.get(key("a", 1, seed=3), lambda: made.append(1) or _arrays(), format)
        for name, array in _arrays().items():
            assert found[name].dtype == array.dtype and np.array_equal(found[name], array)
    assert len(made) == 1
    assert {p.name[0] for p in tmp_path.rglob("*") if p.is_file()} != {"."}
    assert not list(tmp_path.rglob("*.part")) and not list(tmp_path.rglob(".*.lock"))


def test_columns_are_memory_mapped(tmp_path):
    assert isinstance(Store(tmp_path).get(key("a", 1), _arrays, COLUMNS)["x"], np.memmap)


def test_json_and_records_come_back(tmp_path):
    store = Store(tmp_path)
    value = {"shards": 3, "seconds": [1.5, None, "ä"]}
    light = Light(Place(np.eye(3)), np.ones(2))
    for _ in range(2):
        assert store.get(key("plan", 1), lambda: value, JSON) == value
        found = store.get(key("light", 1), lambda: light, RecordFormat(Light))
        assert np.array_equal(found.place.position, np.eye(3)) and found.direction is None


def test_a_key_is_what_it_was_made_from():
    base = key("samples.shard", 1, scene="ab", settings=Place(np.zeros(3)), seed=1)
    assert base == key("samples.shard", 1, seed=1, settings=Place(np.zeros(3)), scene="ab")
    others = [
        key("samples.view", 1, scene="ab", settings=Place(np.zeros(3)), seed=1),
        key("samples.shard", 2, scene="ab", settings=Place(np.zeros(3)), seed=1),
        key("samples.shard", 1, scene="ac", settings=Place(np.zeros(3)), seed=1),
        key("samples.shard", 1, scene="ab", settings=Place(np.zeros(3, np.float32)), seed=1),
        key("samples.shard", 1, scene="ab", settings=Place(np.zeros((3, 1))), seed=1),
        key("samples.shard", 1, scene="ab", settings=Place(np.zeros(3)), seed=1.0),
        key("samples.shard", 1, scene="ab", settings=Place(np.zeros(3)), seed="1"),
        key("samples.shard", 1, scene="ab", settings=Place(np.zeros(3)), seed=True),
    ]
    assert len({base, *others}) == 1 + len(others)
    assert len(base.digest) == 40
    with pytest.raises(TypeError, match="cannot be made from object"):
        key("a", 1, scene=object())
    with pytest.raises(ValueError, match="is not a function name"):
        key("../a", 1)


@pytest.mark.parametrize(("format", "name"), [(ARRAYS, ""), (COLUMNS, "x.npy"), (COLUMNS, "columns.json"), (JSON, "")])
@pytest.mark.parametrize("harm", ["truncate", "flip", "empty"])
def test_damage_is_noticed_and_made_again(tmp_path, caplog, format, name, harm):
    store, value = Store(tmp_path), _arrays() if format is not JSON else {"shards": 3}
    store.get(key("a", 1), lambda: value, format)
    (entry,) = store.entries()
    path = entry.path / name if name else entry.path
    data = bytearray(path.read_bytes())
    if harm == "flip":
        place = data.find(_arrays()["x"].tobytes())
        data[place if place >= 0 else -5] ^= 0x10
    path.write_bytes({"truncate": data[: len(data) // 2], "flip": data, "empty": b""}[harm])
    made = []
    with caplog.at_level(logging.WARNING, "lightwell.store"):
        found = store.get(key("a", 1), lambda: made.append(1) or value, format)
    assert made, "a damaged entry was taken for a sound one"
    assert "is damaged and is made again" in caplog.text and "Traceback" not in caplog.text
    assert found == value if format is JSON else np.array_equal(found["x"], value["x"])


def test_objects_are_not_stored(tmp_path):
    with pytest.raises(TypeError, match="'x' holds Python objects"):
        Store(tmp_path).get(key("a", 1), lambda: {"x": np.array([{}], object)})
    assert not [p for p in tmp_path.rglob("*") if p.is_file()]


def test_put_replaces_and_find_only_looks(tmp_path):
    store = Store(tmp_path)
    assert store.find(key("fit", 1), JSON) is None
    for step in (1, 2):
        store.put(key("fit", 1), {"step": step}, JSON)
        assert store.find(key("fit", 1), JSON) == {"step": step}
    store.remove(key("fit", 1), JSON)
    assert store.find(key("fit", 1), JSON) is None


def test_update_sees_what_is_stored(tmp_path):
    store = Store(tmp_path)
    for _ in range(3):
        store.update(key("count", 1), lambda old: (old or 0) + 1, JSON)
    assert store.find(key("count", 1), JSON) == 3


def test_the_least_recently_used_goes(tmp_path):
    made = lambda: {"x": np.zeros(1000)}  # noqa: E731
    store = Store(tmp_path, limit=30_000)
    for k in range(3):
        store.get(key("a", 1, k=k), made)
    for age, entry in enumerate(store.entries()):
        os.utime(entry.path, (1000 - age, 1000 - age))
    store.get(key("a", 1, k=0), made)
    store.get(key("a", 1, k=3), made)
    assert sum(entry.bytes for entry in store.entries()) <= 30_000
    assert store.find(key("a", 1, k=0)) is not None, "what was just used was removed"
    assert store.find(key("a", 1, k=3)) is not None, "what was just made was removed"
    assert store.clear() > 20_000 and not store.entries()


def test_files_of_the_user_are_not_of_the_store(tmp_path):
    """A folder that holds other files may be named with ``--store`` or LIGHTWELL_STORE."""
    own = [tmp_path / "photos" / name for name in ("holiday.npz", "notes.txt", ".thesis.lock", ".thesis.part")]
    own[0].parent.mkdir()
    for path in own:
        path.write_bytes(bytes(100_000))
        os.utime(path, (1000, 1000))
    store = Store(tmp_path, limit=10_000)
    store.get(key("a", 1), _arrays)
    assert len(store.entries()) == 1 and store.clear() < 10_000
    assert all(path.exists() for path in own)


def test_a_killed_writer_leaves_no_entry(tmp_path):
    """Killed in the middle of writing: the next process makes the entry again; its leavings are swept."""
    code = f"""
import os, signal, numpy
from lightwell.core.store import Store
from lightwell.core.keys import key
class Dies:
    suffix = ".npz"
    def write(self, path, value):
        path.write_bytes(b"half")
        os.kill(os.getpid(), signal.SIGKILL)
    def read(self, path):
        return path.read_bytes()
Store({str(tmp_path)!r}).get(key("a", 1), dict, Dies())
"""
    assert subprocess.run([sys.executable, "-c", code]).returncode == -9
    store = Store(tmp_path)
    assert not store.entries() and len(list(tmp_path.glob("a/.*"))) == 2
    assert np.array_equal(store.get(key("a", 1), _arrays)["x"], _arrays()["x"])
    store.sweep(age=0)
    assert [p.suffix for p in tmp_path.glob("a/*")] == [".npz"]


def test_two_processes_make_an_entry_once(tmp_path):
    code = f"""
import time, numpy
from pathlib import Path
from lightwell.core.store import Store
from lightwell.core.keys import key
def make():
    with open({str(tmp_path / "made")!r}, "a") as file:
        file.write("x")
    time.sleep(0.3)
    return {{"x": numpy.ones(3)}}
assert Store({str(tmp_path / "store")!r}).get(key("a", 1), make)["x"].sum() == 3
"""
    running = [subprocess.Popen([sys.executable, "-c", code]) for _ in range(3)]
    assert [process.wait(30) for process in running] == [0, 0, 0]
    assert (tmp_path / "made").read_text() == "x"


def test_the_folder_follows_the_environment(monkeypatch, tmp_path):
    monkeypatch.setenv("LIGHTWELL_STORE", str(tmp_path / "kept"))
    assert default_folder() == tmp_path / "kept"
    monkeypatch.delenv("LIGHTWELL_STORE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    if sys.platform == "linux":
        assert default_folder() == tmp_path / "lightwell"


def test_sweeping_spares_what_is_still_written(tmp_path):
    (tmp_path / "a").mkdir()
    part = tmp_path / "a" / f".{key('a', 1).digest}.npz.1.part"
    part.write_bytes(b"half")
    Store(tmp_path).sweep()
    assert part.exists()
    os.utime(part, (time.time() - 2e5,) * 2)
    Store(tmp_path).sweep()
    assert not part.exists()


FULL = """
import resource, sys
import numpy as np
from lightwell.core.formats import ARRAYS, COLUMNS
from lightwell.core.keys import key
from lightwell.core.store import Store

store = Store(sys.argv[1])
store.put(key("small", 1), {"x": np.arange(10)}, ARRAYS)
resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, 50_000))
for format in (ARRAYS, COLUMNS):
    try:
        store.put(key("large", 1), {"x": np.zeros(100_000)}, format)
    except OSError as error:
        print(error)
store.put(key("next", 1), {"x": np.arange(10)}, ARRAYS)
print(len(store.find(key("small", 1), ARRAYS)["x"]))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="file sizes cannot be limited")
def test_a_full_disk_is_one_line_and_leaves_nothing_half_written(tmp_path):
    done = subprocess.run([sys.executable, "-c", FULL, str(tmp_path)], capture_output=True, text=True, check=True)
    first, second, found = done.stdout.splitlines()
    assert "write '" in first and "large" in first and "large" in second and found == "10"
    assert not list(tmp_path.rglob("*.part")) and not list(tmp_path.glob("large/*"))
    assert len(Store(tmp_path).entries()) == 2


def test_entries_of_other_processes_count_after_a_while(tmp_path, monkeypatch):
    one = {"x": np.zeros(1000, np.uint8)}
    store, other = Store(tmp_path, limit=10_000), Store(tmp_path, limit=None)
    store.put(key("a", 1), one)
    for k in range(20):
        other.put(key("b", 1, k=k), one)
    store.put(key("a", 2), one)
    assert len(store.entries()) == 22
    now = time.monotonic
    monkeypatch.setattr(time, "monotonic", lambda: now() + 100)
    store.put(key("a", 3), one)
    assert sum(entry.bytes for entry in store.entries()) <= 10_000
