"""The executor on Dask workers that are threads of this process: bytes, store, failures, refusals."""

import numpy as np
import pytest
from distributed import Client, LocalCluster

from lightwell.cluster import worker as remote
from lightwell.cluster.executor import DaskExecutor
from lightwell.cluster.ledger import UnitFailed
from lightwell.cluster.roster import Roster
from lightwell.cluster.work import MadeInputs, Order, Work, array_names, inputs_digest, recipe_name
from lightwell.cluster.worker import SceneSource
from lightwell.core.store import Store
from lightwell.scenes import load
from lightwell.scenes.executor import Inputs, Recipe
from lightwell.scenes.placing import sample_lights
from lightwell.scenes.variables import declare
from lightwell.transport import draw_surface, indirect
from lightwell.transport.lit_points import LitPoints
from lightwell.transport.row_recipes import inputs_of
from lightwell.transport.seen_shards import GatherSize, SeenShards
from lightwell.transport.shards import ShardSettings
from tests.plain_glb import write_plain

# 64 rows of 16 paths, 16 rows to a unit: four units.
POINTS, PATHS, LANES = 64, 16, 256
# Bytes that a unit without rows may have (specification of clusters).
MOST_BYTES = 1000


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
    # 40 bytes a row, and what is the same for all units.
    assert 40 * POINTS < moved.bytes_sent < 40 * POINTS + 4 * MOST_BYTES
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


def references(scene):
    """Held-out points under held-out lights, as references are traced."""
    variable = declare((), scene)
    drawn = LitPoints(variable, POINTS, 1, lights=8, light_seed=2)
    light = drawn.light_of(scene, POINTS)
    return indirect(scene, drawn.draw(scene).points, light, variable, PATHS, 3, recipe=drawn.recipe())


def training(scene):
    """What training samples of a moving light share: points, bins and rays."""
    settings = ShardSettings(paths=2, lights=8, points_per_light=8)
    size = GatherSize(points=POINTS, bins=64, lights=8, rays=PATHS)
    rows = SeenShards(scene, declare((), scene), settings, size).seen.rows
    return np.array(rows.bin), np.array(rows.weight)


@pytest.mark.parametrize("traced", [references, training])
def test_units_carry_no_rows_and_give_the_bytes_of_one_process(scene, traced):
    whole = traced(load("cornell"))
    found, moved = traced(scene), scene.executor.moved
    assert all(a.tobytes() == b.tobytes() for a, b in zip(whole, found)) and np.any(whole[0])
    assert moved.units == 4 and moved.again == 0
    assert moved.bytes_sent < MOST_BYTES * moved.units


def test_workers_of_this_machine_get_the_rows(scene):
    whole = references(load("cornell"))
    scene.executor.near = True
    found, moved = references(scene), scene.executor.moved
    assert all(a.tobytes() == b.tobytes() for a, b in zip(whole, found)) and moved.units == 4
    assert moved.bytes_sent > 40 * POINTS


@pytest.mark.parametrize("fault", ["others", "none"])
def test_rows_are_sent_where_a_worker_makes_others(scene, monkeypatch, fault):
    whole, said = references(load("cornell")), []

    def spoiled(scene, recipe):
        if fault == "none":
            raise ValueError("cannot be made")
        made = inputs_of(scene, recipe)
        columns = made.columns | {"light": made.columns["light"] + np.float32(1e-6)}
        return Inputs(columns, made.shared)

    remote.forget_inputs()
    monkeypatch.setattr("lightwell.cluster.work.inputs_of", spoiled)
    monkeypatch.setattr(scene.executor, "say", said.append)
    found, moved = references(scene), scene.executor.moved
    assert all(a.tobytes() == b.tobytes() for a, b in zip(whole, found))
    assert moved.units == 4 and moved.again >= 1 and moved.bytes_sent > 40 * POINTS
    assert len(said) == 1 and "makes other rows of 'radiance'; they are sent" in said[0]
    remote.forget_inputs()


def test_results_are_found_whether_rows_were_sent_or_made(scene):
    references(scene)
    variable = declare((), scene)
    drawn = LitPoints(variable, POINTS, 1, lights=8, light_seed=2)
    indirect(scene, drawn.draw(scene).points, drawn.light_of(scene, POINTS), variable, PATHS, 3)
    assert scene.executor.moved.units == 4 and scene.executor.moved.from_store == 4


def test_a_worker_keeps_the_last_inputs_alone(monkeypatch):
    made = []

    def numbered(scene, recipe):
        made.append(recipe.settings["k"])
        return Inputs({"x": np.full(100, recipe.settings["k"])}, {"y": np.ones(100)})

    monkeypatch.setattr("lightwell.cluster.work.inputs_of", numbered)
    kept, shared = MadeInputs(most=3, most_bytes=4000), array_names({"y": np.ones(100)})

    def ask(k):
        recipe = Recipe("numbered", {"k": k})
        digest = inputs_digest({"x": np.full(10, k)}, shared)
        order = Order("", "scene", {}, recipe, recipe_name(recipe))
        return kept.rows(None, order, Work(order.packed(), 20, 10, {}, digest), {})

    for k in (0, 0, 1, 2, 0):
        assert ask(k).columns["x"].tolist() == 10 * [k]
        assert len(kept) <= 2 and kept.nbytes <= 4000
    assert made == [0, 1, 2, 0]
    kept = MadeInputs(most=3, most_bytes=1)
    assert ask(1) is not None and ask(1) is not None and len(kept) == 1 and made[-2:] == [0, 1]


def test_arrays_of_a_recipe_are_sent_once_where_they_are_fewer_bytes(scene, monkeypatch):
    def repeated(scene, recipe):
        return Inputs({"row": np.repeat(recipe.arrays["few"], recipe.settings["times"])})

    monkeypatch.setattr("lightwell.cluster.work.inputs_of", repeated)
    monkeypatch.setattr("lightwell.transport.row_tasks.RowTask.__call__", lambda *a: {"row": a[3]["row"]})
    few, moved = np.arange(100.0), scene.executor.moved
    for times, sent in ((8, True), (1, False)):
        before, columns = moved.bytes_sent, {"row": np.repeat(few, times)}
        recipe = Recipe("repeated", {"times": times}, {"few": few})
        found = scene.executor.rows("picture", {"times": times}, columns, 64, recipe=recipe)
        assert found["row"].tobytes() == columns["row"].tobytes()
        arrays = few.nbytes * len(scene.executor.roster.workers())
        units = -(-len(few) * times // 4)
        fewest = arrays if sent else columns["row"].nbytes
        assert fewest < moved.bytes_sent - before < fewest + MOST_BYTES * units


def test_work_that_fails_everywhere_ends_with_its_own_words(scene):
    columns = {"shape": np.zeros(4, np.uint32)}
    with pytest.raises(UnitFailed, match=r"3 times on \d workers: KeyError"):
        scene.executor.rows("irradiance", {"paths": 4, "seed": 1}, columns, 4)


@pytest.mark.slow
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
    # What cannot be loaded is not asked for again.
    assert not remote.take_scene(SceneSource("room.glb", "other"), {"room.glb": b"no scene"})


def test_a_worker_whose_test_fails_twice_is_refused_with_its_error(client, own, monkeypatch):
    def broken(*_):
        raise MemoryError("no room for the scene")

    monkeypatch.setattr(remote, "take_scene", broken)
    roster = Roster(client, SceneSource("cornell", "x"), own, lambda line: None)
    with pytest.raises(RuntimeError, match=r"cannot be tested \(MemoryError: no room for the scene\); look at its log"):
        roster.workers()


def test_a_file_beside_the_scene_that_cannot_be_read_is_no_lost_connection(tmp_path, monkeypatch):
    for name in ("room.gltf", "room.bin", ".lightwell.lock"):
        (tmp_path / name).write_bytes(name.encode())
    source = SceneSource(str(tmp_path / "room.gltf"), "x")
    assert set(remote.scene_files(source)) == {"room.gltf", "room.bin"}
    read = type(tmp_path).read_bytes

    def read_bytes(path):
        if path.name == "room.bin":
            raise PermissionError(13, "Permission denied", str(path))
        return read(path)

    monkeypatch.setattr(type(tmp_path), "read_bytes", read_bytes)
    with pytest.raises(ValueError, match=r"cannot read '.*room.bin' for the workers \(Permission denied\); change"):
        remote.scene_files(source)
