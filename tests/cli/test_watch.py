"""``bake --watch``: which saves lead to a bake, and with which settings."""

import os
from functools import partial
from pathlib import Path

import pytest

from lightwell.baking.settings import BakeSettings
from lightwell.cli import main
from lightwell.cli.watched import edited, file_states, saves


def test_a_save_is_taken_up_when_the_file_is_at_rest(tmp_path):
    path = tmp_path / "room.glb"
    path.write_bytes(b"first")
    waits = []

    def wait(seconds):
        waits.append(seconds)
        if len(waits) == 2:  # An editor begins to write,
            path.write_bytes(b"se")
        if len(waits) == 3:  # goes on,
            path.write_bytes(b"second")
        if len(waits) == 6:  # and replaces the file by another.
            path.unlink()
        if len(waits) == 8:
            (tmp_path / "new").write_bytes(b"third!")
            os.replace(tmp_path / "new", path)

    found = saves(partial(file_states, path), file_states(path), wait)
    assert next(found)[0][1] == 6 and len(waits) == 4
    assert next(found)[0][1] == 6 and len(waits) >= 9


def test_files_beside_a_gltf_count(tmp_path):
    path = tmp_path / "room.gltf"
    path.write_bytes(b"{}")
    before = file_states(path)
    (tmp_path / "room.bin").write_bytes(b"1")
    assert file_states(path) != before and file_states(tmp_path / "none.glb") == ()


@pytest.mark.parametrize("out", ["out", "."])
def test_what_a_bake_writes_is_no_save(tmp_path, out):
    path, out, log = tmp_path / "room.gltf", tmp_path / out, tmp_path / "bake.log"
    path.write_bytes(b"{}")
    before = file_states(path, out, log)
    (out / ".lightwell/store").mkdir(parents=True)
    for name in ("scene.glb", "index.html", "report.json", "probes-a.lwp", ".lightwell.lock", ".lightwell/store/a"):
        (out / name).write_bytes(b"1")
    log.write_text("ended")
    (tmp_path / ".lightwell.holder.json").write_text("{}")
    assert file_states(path, out, log) == before
    (tmp_path / "textures").mkdir()
    (tmp_path / "textures/wall.png").write_bytes(b"1")
    assert file_states(path, out, log) != before


def test_fields_with_an_incremental_bake_use_it(tmp_path):
    asked = BakeSettings("room.glb", Path("out"), resume=True)
    again = edited(asked)
    assert again.options.rebake == Path("out") and again.keep and not again.resume
    probes = edited(BakeSettings("room.glb", Path("out"), field="probes"))
    assert probes.options.rebake is None and probes.keep


def test_a_built_in_scene_has_no_file(tmp_path, capsys):
    assert main(["bake", "cornell", "-o", str(tmp_path / "x"), "--watch"]) == 2
    assert "--watch looks at a file" in capsys.readouterr().err


@pytest.mark.parametrize("field", ["kdtree", "tree"])
def test_rebake_is_refused_where_there_is_none(field, capsys, tmp_path):
    assert main(["bake", "cornell", "-o", str(tmp_path / "x"), "--field", field, "--rebake", "old"]) == 2
    assert "--rebake" in capsys.readouterr().err
