"""Incremental bakes of light maps: texels that nothing touches keep their bytes."""

from dataclasses import replace

import numpy as np
import pytest

from lightwell.api import bake
from lightwell.core.formats import ARRAYS
from lightwell.core.work import store_of
from lightwell.fields.lightmap.edits import KEY, LightmapEdit
from lightwell.scenes import load
from tests.plain_glb import write_plain

FEW = {"field": "lightmap", "size": 64, "mips": 0, "steps": 40, "shards": 1, "lights_per_shard": 16, "views": 1,
       "truth": "1s", "view_size": (48, 32), "paths": 8}  # fmt: skip
AGAIN = {"field": "lightmap"}


def kept(out):
    return LightmapEdit.of(store_of(out).find(KEY, ARRAYS))


@pytest.mark.slow
def test_texels_that_nothing_touches_keep_their_bytes(tmp_path):
    scene = load("cornell")
    room, old = tmp_path / "room.glb", tmp_path / "old"
    write_plain(room, scene)
    bake(room, old, keep=True, **FEW)
    same = bake(room, tmp_path / "same", rebake=old, **AGAIN)
    assert same["changed"] == [] and same["roles"]["static"]["traced_again"] == 0
    assert (tmp_path / "same/scene.glb").read_bytes() == (old / "scene.glb").read_bytes()
    # What OLD was given, as ``--watch`` repeats it, and what it was not.
    again = bake(room, tmp_path / "again", rebake=old, size=64, mips=0, **AGAIN)
    assert again["changed"] == []
    for options in ({"size": 128}, {"mips": 1}, {"max_bytes": 100_000}, {"compress": "ktx2"}):
        with pytest.raises(ValueError, match=r"--rebake (keeps|stores)"):
            bake(room, tmp_path / "other", rebake=old, **AGAIN, **options)
    last = replace(scene.meshes[-1], positions=scene.meshes[-1].positions + np.float32([0.02, 0, 0]))
    write_plain(room, replace(scene, meshes=[*scene.meshes[:-1], last]))
    told = bake(room, tmp_path / "new", rebake=old, **AGAIN)["roles"]["static"]
    assert 0 < told["traced_again"] < told["texels"]
    before, after = kept(old), kept(tmp_path / "new")
    assert (before.light.half_a == after.light.half_a).all(axis=1).sum() >= told["texels"] - told["traced_again"]
    assert len(before.parts) == len(after.parts) and before.preset == after.preset
    write_plain(room, replace(scene, meshes=scene.meshes[:-1]))
    with pytest.raises(ValueError, match="need another atlas"):
        bake(room, tmp_path / "less", rebake=old, **AGAIN)
