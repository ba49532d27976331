"""What calls tell workers in place of rows: the same rows come out of it, in a scene that was loaded anew."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from lightwell.baking.quality import trace_patches
from lightwell.baking.reference import trace_points, trace_sweep, trace_view
from lightwell.baking.reference_budget import ReferenceBudget
from lightwell.core.lamps import LampRules
from lightwell.fields.lightmap.moving import moving_samples
from lightwell.fields.lightmap.sides import seen_sides
from lightwell.fields.lightmap.trace import chart
from lightwell.fields.lightmap.validation import LightmapValidation
from lightwell.fields.lightmap.views import eye_samples
from lightwell.fields.request import Request
from lightwell.fields.surface import lamp_samples
from lightwell.fields.surface.tracing import path_rate, validation_samples
from lightwell.probes.trace import air_light
from lightwell.scenes import load
from lightwell.scenes.atlas import build
from lightwell.scenes.default_light import with_lamp
from lightwell.scenes.lamps import group_lamps
from lightwell.scenes.placing import sample_lights
from lightwell.scenes.variables import declare
from lightwell.transport.camera import reference_image, static_image, total_image
from lightwell.transport.gathered_shards import GatheredShards
from lightwell.transport.row_recipes import inputs_of
from lightwell.transport.row_tasks import TASKS
from lightwell.transport.seen_shards import GatherSize
from lightwell.transport.shards import ShardSettings

BUDGET = ReferenceBudget(points=96, point_paths=2, lights=5, pixel_paths=2, sweep=4, sweep_points=16, sweep_paths=2)
# Sizes that tests make small; parts of points that do not divide a batch.
FEW = {
    "fields.lightmap.validation.POINTS": 64, "fields.lightmap.validation.PATHS": 2, "fields.lightmap.sides.LOOKS": 64,
    "fields.surface.lamp_samples.BATCH": 64, "fields.surface.lamp_samples.VALIDATION_POINTS": 64,
    "transport.lamp_light.POINTS_AT_ONCE": 48,
}  # fmt: skip


def lit_scene():
    """A scene with a lamp of its own, anew at each call."""
    scene = load("cornell")
    return with_lamp(scene, scene.center)


def assert_same(a, b):
    assert a.keys() == b.keys()
    for name, value in a.items():
        assert value.dtype == b[name].dtype and value.shape == b[name].shape, name
        assert value.tobytes() == b[name].tobytes(), name


class Checks:
    """An executor that makes the inputs of every call by its recipe, in a scene of its own."""

    def __init__(self, scene):
        self.scene, self.worker, self.recipes = scene, lit_scene(), []

    def rows(self, task, settings, columns, lanes, shared=None, recipe=None):
        if recipe is None and settings.get("limits", {}).get("past_mirrors"):
            # Pairs of point and light are chosen by the fit in part: 40 bytes of each are sent.
            return TASKS[task](self.scene, settings, columns, 0, shared or {})
        assert recipe is not None, f"{task}: rows are sent"
        told = replace(recipe, settings=json.loads(json.dumps(recipe.settings)))
        made = inputs_of(self.worker, told)
        assert_same(made.columns, columns)
        assert_same(made.shared, shared or {})
        self.recipes.append(recipe.name)
        return TASKS[task](self.scene, settings, columns, 0, shared or {})


@pytest.fixture
def room():
    scene = lit_scene()
    return scene, declare((), scene)


def points(scene, variable, role):
    trace_points(scene, variable, role, BUDGET, 3)


def views(scene, variable, role):
    light = sample_lights(scene, variable, 1, 1)[0]
    trace_view(scene, variable, scene.cameras[0], light, ("indirect", role), (12, 8), 2)
    reference_image(scene, scene.cameras[0], light, variable, 12, 8, 2)
    static_image(scene, scene.cameras[0], 12, 8, 2)
    total_image(scene, scene.cameras[0], light, variable, 12, 8, 2)


def sweep(scene, variable, role):
    trace_sweep(scene, variable, BUDGET, 3)


def patches(scene, variable, role):
    assert trace_patches(scene, variable if role == "indirect" else None, 3, 2, 3) is not None


def validation(scene, variable, role):
    validation_samples(scene, variable, 3, role == "static", points=64, lights=4)
    LightmapValidation.of(scene, variable, 3, role)
    path_rate(scene, variable, 3, role == "static")


def seen(scene, variable, role):
    settings = ShardSettings(paths=2, lights=8, points_per_light=8)
    GatheredShards(scene, variable, settings, GatherSize(256, 64, 8, 8))(scene, variable, None, settings, 0)


def lamps(scene, variable, role):
    """Batches and held-out points of the scene's own lamps."""
    moving = variable if role == "indirect" else None
    state = SimpleNamespace(scene=scene, variable=moving, lamps=group_lamps(scene, LampRules("all")))
    state.job = SimpleNamespace(request=Request(shards=2, seed=3, quality="draft"))
    tracer = lamp_samples.LampTracer(state)
    assert len(tracer.points) == 128
    tracer.batch(1), tracer.held_out()


def atlas(scene, variable, role):
    """Texels of a light map, the sides that it stores, and the narrow charts."""
    chart(scene, 128, 1, 2, 3)


def air(scene, variable, role):
    points = np.random.default_rng(1).random((8, 3), np.float32) - np.float32(0.5)
    light = sample_lights(scene, variable, 1, 1)[0]
    air_light(scene, points, 2, 3, variable=variable, light=light, numbers=np.arange(8) + 7)
    air_light(scene, points, 2, 3)


def views_of_a_light_map(scene, variable, role):
    moving_samples(scene, build(scene, 128, seen_sides(scene, 3).lit), variable, 64, 2, 3)
    # Without an atlas whose irradiance is known, paths are traced to their ends.
    eye_samples(scene, SimpleNamespace(atlas=build(scene, 128, seen_sides(scene, 3).lit)), 64, 2, 3, None)


@pytest.mark.parametrize(
    "trace, recipes",
    [(points, {"lit-points"}), (views, {"camera-points", "pixels"}), (sweep, {"lit-points"}),
     (validation, {"lit-points"}), (seen, {"seen-bins"}), (lamps, {"seen-bins"}), (patches, {"patches"}),
     (air, {"air-points"}), (atlas, {"sides", "texels"}), (views_of_a_light_map, {"moving-points", "eye-points"})],
)  # fmt: skip
@pytest.mark.parametrize("role", ["indirect", pytest.param("static", marks=pytest.mark.slow)])
def test_workers_make_the_rows_of_a_call(room, trace, recipes, role, monkeypatch):
    scene, variable = room
    for name, few in FEW.items():
        monkeypatch.setattr(f"lightwell.{name}", few)
    scene.executor = checks = Checks(scene)
    try:
        trace(scene, variable, role)
    finally:
        scene.executor = None
    assert set(checks.recipes) == recipes


def test_another_seed_makes_other_rows(room):
    """The comparison above can fail."""
    from lightwell.transport.lit_points import LitPoints

    scene, variable = room
    a, b = (inputs_of(scene, LitPoints(variable, 64, seed, lights=4).recipe()) for seed in (1, 2))
    assert a.columns["shape"].shape == b.columns["shape"].shape
    assert not np.array_equal(a.columns["barycentric"], b.columns["barycentric"])
