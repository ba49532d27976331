"""Rows that are traced in parts have the bytes of rows that are traced together; settings survive JSON."""

import json
from dataclasses import replace

import numpy as np
import pytest

from lightwell.probes.gathered import air_ends
from lightwell.probes.trace import air_light
from lightwell.scenes import load
from lightwell.scenes.atlas import build
from lightwell.scenes.default_light import with_lamp
from lightwell.scenes.placing import sample_lights
from lightwell.scenes.variables import declare
from lightwell.transport import draw_surface, indirect, static
from lightwell.transport.camera import total_image
from lightwell.transport.gather import gathered_irradiance, known_arrays
from lightwell.transport.irradiance import irradiance
from lightwell.transport.radiance import PathReport
from lightwell.transport.radiosity import Radiosity
from lightwell.transport.row_recipes import inputs_of
from lightwell.transport.row_tasks import TASKS
from lightwell.transport.tables import tables

POINTS = 150


def assert_same(a, b):
    assert a.keys() == b.keys()
    for name, value in a.items():
        assert value.dtype == b[name].dtype and value.shape == b[name].shape, name
        assert value.tobytes() == b[name].tobytes(), name


class Parts:
    """An executor that computes parts of odd sizes in this process, the last one first."""

    def __init__(self, scene, size=37):
        self.scene, self.size, self.tasks, self.recipes = scene, size, [], []

    def rows(self, task, settings, columns, lanes, shared=None, recipe=None):
        self.tasks.append(task)
        if recipe is not None:
            self.recipes.append(recipe.name)
            told = replace(recipe, settings=json.loads(json.dumps(recipe.settings)))
            made = inputs_of(self.scene, told)
            assert_same(made.columns, columns)
            assert_same(made.shared, shared or {})
        settings = json.loads(json.dumps(settings))
        starts = range(0, len(next(iter(columns.values()))), self.size)
        part = lambda start: {n: np.array(v[start : start + self.size]) for n, v in columns.items()}  # noqa: E731
        run = TASKS[task]
        found = [run(self.scene, settings, part(s), s, shared or {}) for s in reversed(starts)][::-1]
        return {name: np.concatenate([p[name] for p in found]) for name in found[0]}


@pytest.fixture(scope="module")
def room():
    scene = load("cornell")
    scene = with_lamp(scene, scene.center)
    variable = declare((), scene)
    return scene, variable, draw_surface(scene, POINTS, 1).points, sample_lights(scene, variable, POINTS, 1)


def radiance(scene, variable, points, lights):
    report = PathReport()
    both = [*indirect(scene, points, lights, variable, 4, 3, report=report), *static(scene, points, 4, 3)]
    return [*both, np.array([report.paths, report.paths - report.dropped])]


def texels(scene, variable, points, lights):
    found = irradiance(scene, points, 4, 3)
    return [found.half_a, found.half_b, found.direction, found.wrong + 1]


def gathered(scene, variable, points, lights):
    sides = np.ones((2, len(tables(scene).area)), bool)
    atlas, image = build(scene, 128, sides), np.full((128, 128, 3), 0.3, np.float32)
    light = known_arrays(scene, atlas, image, np.ones(len(scene.meshes), bool))
    both, direction = gathered_irradiance(scene, points, light, 4, 3)
    return [both, direction]


def picture(scene, variable, points, lights):
    return [total_image(scene, scene.cameras[0], lights[0], variable, 16, 12, 2, 5, intensity=2.0, with_static=True)]


def air(scene, variable, points, lights):
    found = air_light(scene, lights, 4, 3, variable=variable, light=lights)
    return [found.half_a, found.half_b]


def bins(scene, variable, points, lights):
    rows = Radiosity(scene, points, 5, 64).rows(points, 8, 7)
    return [rows.bin, rows.weight]


def ends(scene, variable, points, lights):
    found = air_ends(scene, variable, lights, 8, 3, np.arange(len(lights)))
    return [found.bin, found.weight, found.way]


@pytest.mark.parametrize(
    "trace, tasks",
    [(radiance, {"radiance"}), (texels, {"irradiance"}),
     (gathered, {"gathered-irradiance"}), (picture, {"picture"}), (air, {"air-light"}),
     (bins, {"radiosity"}), (ends, {"air-ends"})],
)  # fmt: skip
def test_parts_have_the_bytes_of_the_whole(room, trace, tasks):
    scene, *rest = room
    whole = trace(scene, *rest)
    scene.executor = parts = Parts(scene)
    try:
        divided = trace(scene, *rest)
    finally:
        scene.executor = None
    assert set(parts.tasks) == tasks and all(np.any(a) for a in whole)
    assert all(a.tobytes() == b.tobytes() and a.dtype == b.dtype for a, b in zip(whole, divided))
