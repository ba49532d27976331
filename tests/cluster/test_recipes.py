"""What calls tell workers in place of rows: the same rows come out of it, in a scene that was loaded anew."""

import json
from dataclasses import replace

import numpy as np
import pytest

from lightwell.baking.reference import trace_points, trace_sweep, trace_view
from lightwell.baking.reference_budget import ReferenceBudget
from lightwell.fields.lightmap.validation import LightmapValidation
from lightwell.fields.surface.tracing import path_rate, validation_samples
from lightwell.scenes import load
from lightwell.scenes.default_light import with_lamp
from lightwell.scenes.placing import sample_lights
from lightwell.scenes.variables import declare
from lightwell.transport.camera import reference_image, static_image, total_image
from lightwell.transport.gathered_shards import GatheredShards
from lightwell.transport.row_recipes import inputs_of
from lightwell.transport.row_tasks import TASKS
from lightwell.transport.seen_shards import GatherSize
from lightwell.transport.shards import ShardSettings

BUDGET = ReferenceBudget(points=96, point_paths=2, lights=5, pixel_paths=2, sweep=4, sweep_points=16, sweep_paths=2)


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


def validation(scene, variable, role):
    validation_samples(scene, variable, 3, role == "static", points=64, lights=4)
    LightmapValidation.of(scene, variable, 3, role)
    path_rate(scene, variable, 2, 3, role == "static")


def seen(scene, variable, role):
    settings = ShardSettings(paths=2, lights=8, points_per_light=8)
    GatheredShards(scene, variable, settings, GatherSize(256, 64, 8, 8))(scene, variable, None, settings, 0)


@pytest.mark.parametrize(
    "trace, recipes",
    [(points, {"lit-points"}), (views, {"camera-points", "pixels"}), (sweep, {"lit-points"}),
     (validation, {"lit-points"}), (seen, {"seen-bins"})],
)  # fmt: skip
@pytest.mark.parametrize("role", ["indirect", "static"])
def test_workers_make_the_rows_of_a_call(room, trace, recipes, role, monkeypatch):
    scene, variable = room
    monkeypatch.setattr("lightwell.fields.lightmap.validation.POINTS", 64)
    monkeypatch.setattr("lightwell.fields.lightmap.validation.PATHS", 2)
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
