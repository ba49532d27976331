"""Incremental bakes of surface fields: what has changed, who could notice it, and that the rest keeps its bytes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lightwell.api import bake
from lightwell.backend import mi
from lightwell.baking.settings import BakeSettings
from lightwell.core.formats import ARRAYS
from lightwell.core.progress import Progress
from lightwell.core.work import Work, store_of
from lightwell.fields.base import WHITE
from lightwell.fields.no_options import NoOptions
from lightwell.fields.protocol import Job
from lightwell.fields.request import Request
from lightwell.fields.surface.edit_state import EditState, edit_key, kept_rows
from lightwell.fields.surface.edits import EditedScene, edited_samples
from lightwell.scenes import load
from lightwell.scenes.assemble import assemble
from lightwell.scenes.parts import ScenePart, scene_changes, scene_parts
from lightwell.scenes.variables import default_variable, sun_arc
from lightwell.transport.noticed import crosses, noticed
from lightwell.transport.queries import make_query
from lightwell.transport.samples import Query, Samples, SurfacePoints
from lightwell.transport.surface import draw_surface
from tests.plain_glb import write_plain
from tests.transport import rooms


@pytest.fixture(scope="module")
def cornell():
    return load("cornell")


def with_mesh(scene, number, **changes):
    meshes = list(scene.meshes)
    meshes[number] = replace(meshes[number], **changes)
    return replace(scene, meshes=meshes)


def test_names_and_cameras_are_no_parts_and_everything_else_is(cornell):
    before = scene_parts(cornell)
    renamed = with_mesh(cornell, 0, name="other")
    assert not scene_changes(before, scene_parts(replace(renamed, cameras=[], name="x")))
    moved = with_mesh(cornell, 3, positions=cornell.meshes[3].positions + np.float32(0.1))
    changes = scene_changes(before, scene_parts(moved))
    assert len(changes.boxes) == 2 and changes.names == (cornell.meshes[3].name,)
    assert changes.mesh[3] == -1 and (np.delete(changes.mesh, 3) == np.delete(np.arange(len(before)), 3)).all()
    red = [replace(m, base_color=(1.0, 0.0, 0.0, 1.0)) if k == 0 else m for k, m in enumerate(cornell.materials)]
    users = sum(mesh.material == 0 for mesh in cornell.meshes)
    assert len(scene_changes(before, scene_parts(replace(cornell, materials=red))).boxes) == 2 * users


def test_added_and_removed_objects(cornell):
    before, after = scene_parts(cornell), scene_parts(replace(cornell, meshes=cornell.meshes[:-1]))
    gone = scene_changes(before, after)
    assert len(gone.boxes) == 1 and gone.mesh[-1] == -1
    added = scene_changes(after, before)
    assert len(added.boxes) == 1 and (added.mesh >= 0).all()
    assert ScenePart.of_json({**before[0].__dict__, "low": list(before[0].low)}) == before[0]


def test_segments_and_boxes():
    box = np.array([[[0, 0, 0], [1, 1, 1]]], float)
    start = np.array([[-1, 0.5, 0.5], [-1, 0.5, 0.5], [-1, 2, 0.5], [0.5, 0.5, 0.5], [2, 0.5, 0.5]])
    end = np.array([[2, 0.5, 0.5], [-0.5, 0.5, 0.5], [2, 2, 0.5], [0.6, 0.5, 0.5], [3, 0.5, 0.5]])
    assert crosses(start, end, box).tolist() == [True, False, False, True, False]


def test_points_near_a_change_notice_it_and_points_behind_a_wall_do_not(cornell):
    low, high = cornell.bounds
    middle = 0.5 * (low + high)
    box = np.array([[middle - 0.2, middle + 0.2]])
    inside = np.tile(middle - [0, 0.6, 0], (64, 1))
    outside = np.tile(low - 1.0, (64, 1))
    up = np.tile([0.0, 1.0, 0.0], (64, 1))
    found = [noticed(cornell, place, up, box, box[:0], 1).mean() for place in (inside, outside)]
    assert found[0] > 0.5 and found[1] < 0.2


def around(place, half):
    """[1, 2, 3] a cube around a place."""
    return np.array([[np.subtract(place, half), np.add(place, half)]])


@pytest.mark.parametrize("kind", ["point", "area", "two of many"])
def test_a_change_between_a_point_and_a_lamp_of_the_scene_is_noticed(kind):
    floor = rooms.quad("floor", (-9, 0, -9), (0, 0, 18), (18, 0, 0))
    meshes, area, emitters = [floor], [None], []
    if kind == "area":
        meshes.append(rooms.quad("lamp", (-0.05, 2, -0.05), (0.1, 0, 0), (0, 0, 0.1)))
        area.append({"type": "area", "radiance": {"type": "rgb", "value": [9.0] * 3}})
    else:
        # Those that are far away bring little.
        places = [[0, 2, 0], *([[8, 8, k] for k in range(20)] if kind != "point" else [])]
        power = {"type": "rgb", "value": [1.0] * 3}
        emitters = [mi.load_dict({"type": "point", "position": at, "intensity": power}) for at in places]
    scene = rooms.build(kind, meshes, [rooms.diffuse(rooms.WHITE)] * len(meshes), area, emitters=emitters)
    # Half way from the lamp to the first place; rays of chance rarely meet it.
    box, up = around((0.5, 1, 0), 0.06), np.tile([0.0, 1.0, 0.0], (64, 1))
    shaded, lit = (noticed(scene, np.tile([x, 0.0, 0.0], (64, 1)), up, box, box[:0], 1).mean() for x in (1, -1))
    assert shaded > 0.9 and lit < 0.2


def test_a_change_between_the_sun_and_what_a_point_sees_is_noticed():
    # Under a roof, before a wall that the sun lights.
    parts = [
        rooms.quad("floor", (-1, 0, -1), (0, 0, 2), (2, 0, 0)),
        rooms.quad("back", (-1, 0, -1), (2, 0, 0), (0, 2, 0)),
        rooms.quad("roof", (-1, 1, -0.6), (2, 0, 0), (0, 0, 1.6)),
    ]
    scene = rooms.build("porch", parts, [rooms.diffuse(rooms.WHITE)] * 3)
    box = np.array([[[-1, 3, -1.1], [1, 3.2, -0.9]]])
    place, up = np.tile([0.0, 0.0, 0.5], (64, 1)), np.tile([0.0, 1.0, 0.0], (64, 1))

    def share(sun):
        light = {"variable": sun_arc(90, 20, 270, 20), "light": np.tile(np.float32(sun), (64, 1))}
        return noticed(scene, place, up, box, box[:0], 1, **light).mean()

    assert share((0, 1, 0)) > 0.5 and share((0, 0, 1)) == 0


def test_what_is_traced_again_of_own_light_has_the_limits_of_a_bake(tmp_path, cornell):
    shining = [replace(m, emissive=(8.0, 8.0, 8.0)) for m in cornell.materials]
    lit = assemble("lit", cornell.meshes, shining, digest="lit")
    points = draw_surface(lit, 64, 1, floor=1).points
    dark = np.zeros((2, 64, 3), np.float32)
    kept = Samples(make_query(lit, points, np.zeros(3)), *dark, np.ones(64, np.float32), points.shape)
    # As if all had been much darker.
    facts = {"seed": 1, "paths": 640, "setup": {"unit": 1e-4}}
    before, parts = EditState(kept, points, {}, [], facts), scene_parts(lit)
    moved = replace(parts[-1], low=tuple(lit.bounds[0]), high=tuple(lit.bounds[1]), digest="other")
    settings = BakeSettings(scene="cornell", out=tmp_path / "out")
    job = Job(lit, Request(), NoOptions(), Work(settings, lit.digest), Progress(quiet=True))
    changes = scene_changes(parts, [*parts[:-1], moved])
    state = EditedScene(job, lit, default_variable(lit), ("static",), before={"static": before}, changes=changes)
    made = edited_samples(state, "static").samples
    assert state.touched["static"].any() and 0 < made.half_a.max() <= WHITE * 1e-4


def test_a_kept_state_is_read_as_it_was(tmp_path):
    query = Query(*(np.full((2, 3), k, np.float32) for k in range(5)), *np.zeros((2, 2, 1), np.float32))
    samples = Samples(query, *np.ones((2, 2, 3), np.float32), np.ones(2, np.float32), np.zeros(2, np.uint32))
    points = SurfacePoints(samples.shape, np.zeros(2, np.uint32), np.zeros((2, 2), np.float32), query.view)
    store, at = store_of(tmp_path), edit_key("indirect")
    store.put(at, EditState(samples, points, {"value.w": np.ones(3)}, [], {"seed": 1}).arrays(), ARRAYS)
    found = EditState.of(store.find(at, ARRAYS))
    assert found.samples.query.pose is None and np.array_equal(found.samples.query.view, query.view)
    assert np.array_equal(found.learner["value.w"], np.ones(3)) and found.facts == {"seed": 1}


def test_whole_runs_are_kept():
    rows = kept_rows(64 * 128, 128, most=16 * 128)
    assert len(rows) == 16 * 128 and (rows.reshape(16, 128) % 128 == np.arange(128)).all()


def state(out, role="indirect"):
    return EditState.of(store_of(Path(out)).find(edit_key(role), ARRAYS))


@pytest.mark.slow
def test_an_edit_keeps_what_it_does_not_touch(tmp_path, cornell):
    write_plain(tmp_path / "room.glb", cornell)
    few = {"shards": 1, "steps": 60, "lights_per_shard": 32, "static": False, "views": 1, "truth": "1s"}
    bake(tmp_path / "room.glb", tmp_path / "old", keep=True, view_size=(48, 32), **few)
    same = bake(tmp_path / "room.glb", tmp_path / "same", rebake=tmp_path / "old")
    assert same["changed"] == [] and same["roles"]["indirect"]["traced_again"] == 0
    moved = with_mesh(cornell, -1, positions=cornell.meshes[-1].positions + np.float32([0.05, 0, 0]))
    write_plain(tmp_path / "room.glb", moved)
    told = bake(tmp_path / "room.glb", tmp_path / "new", rebake=tmp_path / "old")["roles"]["indirect"]
    assert 0 < told["traced_again"] <= told["samples"] and told["error"] <= told["error_before"]
    old, new = state(tmp_path / "old"), state(tmp_path / "new")
    kept = (old.samples.half_a == new.samples.half_a).all(axis=1)
    assert kept.sum() >= told["samples"] - told["traced_again"]
    assert (tmp_path / "new/index.html").exists() and (tmp_path / "new/rebake.json").exists()
    # In place, as --watch does it.
    bake(tmp_path / "room.glb", tmp_path / "new", rebake=tmp_path / "new")


@pytest.mark.slow  # Three bakes of two fields.
def test_fields_that_share_an_asset_keep_their_sizes(tmp_path, cornell):
    lit = with_mesh(cornell, -1, emission=(8.0, 8.0, 8.0))
    write_plain(tmp_path / "room.glb", lit)
    few = {"shards": 1, "steps": 20, "lights_per_shard": 8, "views": 1, "truth": "1s", "view_size": (24, 16)}
    bake(tmp_path / "room.glb", tmp_path / "old", keep=True, **few)
    # The lamp is gone: what is left keeps the size that it had beside another field.
    write_plain(tmp_path / "room.glb", with_mesh(lit, -1, emission=(0.0, 0.0, 0.0)))
    told = bake(tmp_path / "room.glb", tmp_path / "dark", rebake=tmp_path / "old")["roles"]
    assert set(told) == {"indirect"} and told["indirect"]["traced_again"] > 0
    # The lamp is there, and is left out.
    write_plain(tmp_path / "room.glb", lit)
    told = bake(tmp_path / "room.glb", tmp_path / "without", rebake=tmp_path / "old", static=False)["roles"]
    assert set(told) == {"indirect"} and told["indirect"]["traced_again"] == 0
