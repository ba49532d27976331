"""Files are whole or absent, and damaged ones end in one line."""

import errno
import os

import numpy as np
import pytest

from lightwell.files import (
    check_writable,
    files_beside,
    load_arrays,
    make_folder,
    save_arrays,
    whole_file,
    write_atomically,
)


def test_failure_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "room.glb"
    write_atomically(path, b"old")

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match=r"cannot write '.*room.glb': No space left.*free some space") as caught:
        write_atomically(path, b"new")
    assert caught.value.errno == errno.ENOSPC and "\n" not in str(caught.value)
    assert path.read_bytes() == b"old" and [p.name for p in tmp_path.iterdir()] == ["room.glb"]


def test_missing_folder_names_the_cure(tmp_path):
    with pytest.raises(FileNotFoundError, match="the folder does not exist; create it first"):
        write_atomically(tmp_path / "nowhere" / "room.glb", b"")


def test_a_file_in_place_of_a_folder_names_the_cure(tmp_path):
    (tmp_path / "out").write_bytes(b"")
    with pytest.raises(OSError, match=r"cannot create the folder '.*out': File exists; a file stands where a folder"):
        make_folder(tmp_path / "out")
    with pytest.raises(NotADirectoryError, match="a file stands where a folder is expected"):
        write_atomically(tmp_path / "out" / "room.glb", b"")


def test_a_file_that_cannot_be_written_is_told_before_the_work(tmp_path):
    (tmp_path / "folder.png").mkdir()
    (tmp_path / "file").write_bytes(b"old")
    for name, kind, cure in (
        ("nowhere/a.png", FileNotFoundError, "the folder does not exist; create it first"),
        ("folder.png", IsADirectoryError, "a folder of that name exists"),
        ("file/a.png", NotADirectoryError, "a file stands where a folder is expected"),
    ):
        with pytest.raises(kind, match=f"cannot write '.*{name}': .*{cure}"):
            check_writable(tmp_path / name)
    check_writable(tmp_path / "file")
    check_writable(tmp_path / "new")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "folder.png"]
    assert (tmp_path / "file").read_bytes() == b"old"


def test_files_beside_a_scene_are_listed_without_what_is_written_there(tmp_path):
    for name in ("room.gltf", "b.bin", "textures/a.png", "out/scene.glb", ".lightwell/store/x", "a.log"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(name.encode())
    (tmp_path / "gone").symlink_to(tmp_path / "nowhere")
    found = {p.relative_to(tmp_path).as_posix(): s.st_size for p, s in files_beside(tmp_path / "room.gltf")}
    assert list(found) == ["a.log", "b.bin", "room.gltf", "out/scene.glb", "textures/a.png"] and found["a.log"] == 5
    without = files_beside(tmp_path / "room.gltf", [tmp_path / "textures/../out", tmp_path / "a.log"])
    assert [path.name for path, _ in without] == ["b.bin", "room.gltf", "a.png"]


def test_flushed_before_the_rename(tmp_path, monkeypatch):
    """A rename that reaches the disk before the bytes leaves an empty file after a power cut."""
    order = []
    monkeypatch.setattr(os, "fsync", lambda _: order.append("flush"))
    replace = os.replace
    monkeypatch.setattr(os, "replace", lambda a, b: (order.append("rename"), replace(a, b)))
    write_atomically(tmp_path / "a", b"1")
    assert order == ["flush", "rename"]


def test_an_interrupted_writer_leaves_nothing(tmp_path):
    with pytest.raises(KeyboardInterrupt), whole_file(tmp_path / "a") as temporary:
        temporary.write_bytes(b"half")
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("compressed", [False, True])
def test_damaged_arrays_are_one_line(tmp_path, compressed):
    path, generator = tmp_path / "a.npz", np.random.default_rng(0)
    arrays = {"x": generator.random((40, 3)), "y": np.arange(5)}
    save_arrays(path, arrays, compressed)
    assert all((load_arrays(path)[name] == value).all() for name, value in arrays.items())
    whole = path.read_bytes()
    for k in range(300):
        data = bytearray(whole[: generator.integers(1, len(whole))] if k % 3 == 0 else whole)
        for place in generator.integers(len(data), size=k % 7):
            data[place] = generator.integers(256)
        path.write_bytes(data)
        try:
            load_arrays(path)
        except ValueError as error:
            assert "not a checkpoint; delete it" in str(error) and "\n" not in str(error)


def test_pickles_are_refused(tmp_path):
    path = tmp_path / "a.npz"
    np.savez(path, x=np.array([{}], object))
    with pytest.raises(ValueError, match="not a checkpoint"):
        load_arrays(path)
