"""The executor on Dask workers that are threads of this process: bytes, store, failures, refusals."""

import numpy as np
import pytest
from distributed import Client, LocalCluster

from lightwell.cluster import worker as remote
from lightwell.cluster.executor import DaskExecutor
from lightwell.cluster.ledger import UnitFailed
from lightwell.cluster.roster import Roster
from lightwell.cluster.worker import SceneSource
from lightwell.core.store import Store
from lightwell.scenes import load
from lightwell.scenes.placing import sample_lights
from lightwell.scenes.variables import declare
from lightwell.transport import draw_surface, indirect
from tests.plain_glb import write_plain

# 64 rows of 16 paths, 16 rows to a unit: four units.
POINTS, PATHS, LANES = 64, 16, 256


@pytest.fixture(scope="module")
def client():
    options = {"n_workers": 2, "threads_per_worker": 1, "processes": False, "dashboard_address": None}
    with LocalCluster(**options) as cluster, Client(cluster, set_as_default=False) as client:
        yield client


@pytest.fixture(scope="module")
def own():
    return remote.fingerprint()


@pytest.fixture
def scene(client, own, tmp_path):
    scene, said = load("cornell"), []
    roster = Roster(client, SceneSource("cornell", scene.digest), own, said.append)
    scene.executor = DaskExecutor(
        scene, roster, lambda: client, Store(tmp_path / "store"), said.append, unit_lanes=LANES, least_lanes=0
    )
    yield scene
    scene.executor = None


def trace(scene):
    variable = declare((), scene)
    lights = sample_lights(scene, variable, POINTS, 1)
    return indirect(scene, draw_surface(scene, POINTS, 1).points, lights, variable, PATHS, 3)


def test_bytes_and_store_and_a_full_disk(scene):
    found, moved = trace(scene), scene.executor.moved
    assert moved.units == 4 and moved.from_store == 0 and scene.executor.roster.seen in (1, 2)
    assert "4 units on" in scene.executor.summary()
    assert moved.bytes_sent == POINTS * 40
    again = trace(scene)
    assert moved.units == 4 and moved.from_store == 4

    def full(*arguments):
        raise OSError(28, "cannot write: the disk is full")

    scene.executor.store = Store(scene.executor.store.folder.with_name("other"))
    scene.executor.store.put = full
    third = trace(scene)
    assert np.isfinite(found).all() and np.any(found)
    assert moved.units == 8 and not scene.executor.stores
    scene.executor = None
    whole = trace(scene)
    for part in (found, again, third):
        assert all(a.tobytes() == b.tobytes() for a, b in zip(whole, part))


def test_work_that_fails_everywhere_ends_with_its_own_words(scene):
    columns = {"shape": np.zeros(4, np.uint32)}
    with pytest.raises(UnitFailed, match=r"3 times on \d workers: KeyError"):
        scene.executor.rows("irradiance", {"paths": 4, "seed": 1}, columns, 4)


def test_workers_of_other_bytes_are_refused_or_taken(client, own):
    said, source = [], SceneSource("cornell", load("cornell").digest)
    with pytest.raises(RuntimeError, match=r"computes other bytes \(mitsuba .* not 1.0\); leave it out"):
        Roster(client, source, own | {"bytes": "other", "mitsuba": "1.0"}, said.append).workers()
    roster = Roster(client, source, own | {"bytes": "other"}, said.append, allow_mixed=True)
    assert len(roster.workers()) and roster.mixed
    with pytest.raises(RuntimeError, match=r"has lightwell .*, this is 9\.9; install the same version"):
        Roster(client, source, own | {"lightwell": "9.9"}, said.append).workers()


def test_scene_files_are_sent_where_the_path_is_unknown(tmp_path):
    write_plain(tmp_path / "room.glb", load("cornell"))
    scene = load(tmp_path / "room.glb")
    files = remote.scene_files(SceneSource(str(tmp_path / "room.glb"), scene.digest))
    hidden = SceneSource("/nowhere/room.glb", scene.digest)
    assert not remote.take_scene(hidden) and remote.take_scene(hidden, files)
    with pytest.raises(ValueError, match="leads out"):
        remote.take_scene(SceneSource("room.glb", "other"), {"../room.glb": b""})
