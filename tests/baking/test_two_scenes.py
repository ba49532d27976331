"""Several scenes in one process stay apart: what is kept of one is never used for another."""

import threading

import pytest

from lightwell.baking.pipeline import bake
from lightwell.scenes import load
from lightwell.scenes.scene import Scene
from lightwell.transport.tables import tables

from .conftest import small

SCENES = ("cornell", "two-rooms")


def _asset(folder, scene, field="mlp") -> bytes:
    out = folder / scene
    bake(small(out, scene=scene, field=field, preset="small", shards=1, steps=20, views=1))
    return (out / "scene.glb").read_bytes()


@pytest.fixture(scope="module")
def separate(tmp_path_factory):
    """The assets of bakes one after the other."""
    folder = tmp_path_factory.mktemp("separate")
    return {scene: _asset(folder, scene) for scene in SCENES}


@pytest.mark.slow
def test_two_scenes_in_turns(tmp_path, separate):
    """The first again after the second."""
    assert _asset(tmp_path, SCENES[0]) == separate[SCENES[0]]
    assert separate[SCENES[0]] != separate[SCENES[1]]


@pytest.mark.slow
def test_two_scenes_in_two_threads(tmp_path, separate):
    made, together = {}, threading.Barrier(len(SCENES))

    def run(scene):
        together.wait()
        made[scene] = _asset(tmp_path, scene)

    threads = [threading.Thread(target=run, args=(scene,)) for scene in SCENES]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert made == separate


def test_a_scene_holds_nothing_but_its_fields():
    """What is worked out from a scene is in its cache, which knows its bounds; a copy begins with an empty one."""
    scene = load("cornell")
    found = tables(scene)
    assert scene.extent > 0 and tables(scene) is found
    assert set(vars(scene)) <= set(Scene.__dataclass_fields__)
    other = load("two-rooms")
    assert tables(other) is not found and len(tables(other).air) == len(other.meshes)
