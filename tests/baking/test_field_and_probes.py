"""A bake of ``factored+probes``: field and probes in one file, both scored, and the probes follow lamp and switches."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from lightwell.asset.read import read_light
from lightwell.asset.validate import validate_file
from lightwell.baking.pipeline import bake
from lightwell.engines.bake import read_bake
from lightwell.fields.budget import Budget
from lightwell.fields.field_and_probes import light as probe_light
from lightwell.fields.probes import plan
from lightwell.fields.probes.field import planned, with_few_samples
from lightwell.fields.probes.plan import ProbePlan, probe_plan
from lightwell.fields.protocol import Job, State
from lightwell.fields.registry import find_field
from lightwell.fields.request import Request
from lightwell.graph import evaluate
from lightwell.probes.bake import bake_geometry
from lightwell.probes.samples import ProbeSampling
from lightwell.probes.trace import air_light
from lightwell.scenes import load
from lightwell.scenes.posing import declared_movers, posed, with_movers
from lightwell.scenes.turning import Turning
from lightwell.scenes.variables import declare, from_json
from tests.baking.conftest import small
from tests.baking.test_lamps_bake import room

FEW = ProbeSampling(4, 32, 64, most=1)
GATHER = {"sampling": FEW, "gathered_sampling": FEW, "bricks": 0.0}


@pytest.fixture(scope="module")
def baked(tmp_path_factory):
    """(scene, folder, report) of a room with two lamps that have switches, and a light that roams."""
    folder = tmp_path_factory.mktemp("both")
    tiny = replace(probe_light.PRESETS["draft"], places=6, rank=3, static_sampling=FEW, **GATHER)
    path = room(folder / "room.glb")
    settings = small(
        folder / "out",
        scene=str(path),
        field="factored+probes",
        options={"spacing": "1m"},
        shards=1,
        steps=40,
        lights_per_shard=8,
        views=1,
        quality="draft",
        lamps=("name",),
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(probe_light, "preset_of", lambda quality: ("draft", tiny))
        report = bake(settings)
    return load(str(path)), folder / "out", report


def asked(folder: Path, role: str, place, normal, **frame) -> np.ndarray:
    """[3] radiance of a white surface that the probes of a role light."""
    graph = next(entry.graph for entry in read_light(folder / "scene.glb")[1] if entry.role == role)
    rows = {"position": place, "normal": normal, **frame}
    inputs = {name: np.atleast_2d(np.float32(value)) for name, value in rows.items()}
    return evaluate(graph, inputs)["radiance"][0]


@pytest.mark.slow
def test_one_file_has_both(baked):
    _, folder, _ = baked
    fields, probes, variables = read_light(folder / "scene.glb")
    assert [f.role for f in fields] == [p.role for p in probes] == ["indirect", "static"]
    assert [p.variable for p in probes] == [0, None] and len(variables) == 1
    assert set(probes[0].graph.inputs) == {"position", "normal", "light"}
    assert probes[1].graph.inputs == {"position": 3, "normal": 3, "lamps": 6}
    assert validate_file(folder) == []


@pytest.mark.slow
def test_the_report_scores_both(baked):
    _, folder, report = baked
    assert report["field"] == "factored+probes" and report["relative_error"] > 0
    for role in ("indirect", "static"):
        told = report["facts"][f"{role}_probes"]
        assert 0 < told["error_in_the_air"] < 1 and told["count"] > 0 and told["bytes"] > 0
    assert report["facts"]["static_probes"]["follows"] == "the switches of the lamps"
    text = (folder / "report.html").read_text()
    assert "static probes, error in the air" in text and report["seconds"]["probes"] > 0
    json.dumps(report)


@pytest.mark.slow
def test_switches_add_up_and_agree_with_path_tracing(baked):
    scene, folder, _ = baked
    place, up = (0.0, 1.0, 0.0), (0.0, 1.0, 0.0)
    ask = lambda *dimmers: asked(folder, "static", place, up, lamps=np.tile(dimmers, 3))  # noqa: E731
    warm, cool, both = ask(1, 0), ask(0, 1), ask(1, 1)
    np.testing.assert_allclose(warm + cool, both, rtol=1e-3)
    np.testing.assert_allclose(ask(0.5, 0), 0.5 * warm, rtol=1e-3)
    assert warm[0] > 3 * warm[2] and cool[2] > 3 * cool[0]
    truth = air_light(scene, np.array([place]), 4096, 3, normals=np.array([up])).irradiance[0] / np.pi
    # 64 paths a probe, a metre apart: a wrong unit or normal is farther off.
    np.testing.assert_allclose(both, truth, rtol=0.5)


@pytest.mark.slow
def test_probes_follow_the_light_that_roams(baked):
    _, folder, _ = baked
    left, right = (asked(folder, "indirect", (-0.5, 1, 0), (-1, 0, 0), light=(x, 1.0, 0.0)) for x in (-0.7, 0.7))
    assert left.max() > 0 and np.abs(left - right).max() > 0.05 * left.max()


@pytest.mark.slow
def test_engines_find_the_probes(baked):
    assert read_bake(baked[1]).probes is not None


@pytest.mark.parametrize(
    "change, said",
    [
        ({"options": {"rebake": "x"}}, "--rebake is an option of the field"),
        ({"field": "factored+lightmap"}, "the one pair is --field factored+probes"),
    ],
)
def test_what_belongs_to_other_fields_is_refused(tmp_path, change, said):
    settings = {"scene": "doorway", "field": "factored+probes"} | change
    with pytest.raises(ValueError, match="factored") as error:
        bake(small(tmp_path / "out", **settings))
    assert said in str(error.value) and len(str(error.value).splitlines()) == 1


def test_comparisons_are_refused():
    with pytest.raises(ValueError, match="compare factored and probes"):
        find_field("factored+probes").prepare(SimpleNamespace(shared=True))


def test_a_plan_scales_paths_and_keeps_them_even():
    few = ProbePlan(1.0, {"static": 1}, paths=0.1).sampling(ProbeSampling(32, 256, 1024, most=8))
    assert (few.samples, few.paths, few.probe_paths, few.most) == (32, 26, 102, 2)
    assert ProbePlan(1.0, {}).sampling(FEW) is FEW


def test_a_plan_fits_into_the_paths_that_there_is_time_for(tmp_path):
    preset, scene = probe_light.PRESETS["default"], load(str(room(tmp_path / "room.glb")))
    geometry = bake_geometry(scene, 1.0, preset.function)
    turning = Turning(0.0, 360.0)
    variables = {"indirect": turning, "static": None}
    wanted = {"indirect": 48, "static": 2}
    counts = partial(plan.counts_within, geometry, preset, 1.0)
    few, some, many = (counts(variables, wanted, paths) for paths in (1e3, 1e6, 1e12))
    assert few.states == {"indirect": 12, "static": 2} and 0 < few.paths < some.paths < 1 and not few.bricks
    assert many == ProbePlan(1.0, wanted, 1.0, True)
    # Further lights have states of their own.
    two = counts({"indirect": turning, "indirect-day": turning}, {"indirect": 48, "indirect-day": 48}, 1e3)
    assert two.states == {"indirect": 12, "indirect-day": 12}


def test_places_of_a_light_cost_little_beside_the_rays_that_they_share(tmp_path):
    preset, scene = probe_light.PRESETS["default"], load(str(room(tmp_path / "room.glb")))
    geometry, variables = bake_geometry(scene, 1.0, preset.function), {"indirect": declare((), scene)}
    one, many = (plan.counts_within(geometry, preset, 1.0, variables, {"indirect": n}, 1e4) for n in (1, 160))
    # None of them is left out where the time is short: they are traced with fewer rays.
    assert many.states == {"indirect": 160} and one.paths / 3 < many.paths < one.paths
    found = many.applied(preset, "indirect")
    assert found.places == 160 and found.gathered_sampling.paths < preset.gathered_sampling.paths
    assert found.bricks == 0


def test_probes_alone_are_planned_by_the_budget():
    scene, part = load("cornell"), SimpleNamespace(get=lambda name, make, form: make())
    request = SimpleNamespace(preset="default", steps=None, shards=None, seed=0, budget=SimpleNamespace(seconds=None))
    work, options = SimpleNamespace(part=lambda **_: part), SimpleNamespace(spacing=1.0)
    job, of_role = SimpleNamespace(request=request, options=options, work=work), SimpleNamespace()
    of_role.variable = declare((), scene)
    state = SimpleNamespace(job=job, scene=scene, roles=("indirect",), for_role=lambda role: of_role)
    whole, spacing = planned(state, "indirect")  # type: ignore[arg-type]
    assert spacing == 1.0 and whole.gathered_sampling == probe_light.PRESETS["default"].gathered_sampling
    # Less than the rays of the preset take.
    request.budget.seconds = 0.02
    few, _ = planned(state, "indirect")  # type: ignore[arg-type]
    assert few.gathered_sampling.paths < whole.gathered_sampling.paths and few.bricks == 0


def test_probes_alone_trace_few_samples_where_a_time_is_given():
    def state_of(**changes) -> State:
        request = Request(budget=Budget(60.0), **changes)
        return State(Job(None, request, None, None, None), None, None, ("indirect",))  # type: ignore[arg-type]

    assert with_few_samples(state_of(vary=("day=2026-06-21,48.1,11.6",), north=180.0)).job.request.shards == 1
    for fixed in ({"shards": 3}, {"steps": 9}):
        state = state_of(**fixed)
        assert with_few_samples(state) is state


def test_probes_are_farther_apart_where_their_weights_take_too_long():
    asked = []

    def geometry(spacing: float) -> SimpleNamespace:
        asked.append(spacing)
        time.sleep(0.02)
        return SimpleNamespace(volume=SimpleNamespace(lattice=range(100)))

    assert plan.affordable_spacing(0.5, 1000.0, geometry) == 0.5  # type: ignore[arg-type]
    assert plan.affordable_spacing(0.5, 1e-3, geometry) == 1.0 and asked == [1.0, 1.0]  # type: ignore[arg-type]


def test_fixed_counts_and_goals_need_no_plan():
    request = SimpleNamespace(steps=1, shards=1, budget=SimpleNamespace(seconds=60.0))
    job = SimpleNamespace(request=request, options=SimpleNamespace(spacing=None))
    preset = probe_light.PRESETS["default"]
    found = probe_plan(job, None, preset, 0.5, {"static": None}, {"static": 1}, None)  # type: ignore[arg-type]
    assert found == ProbePlan(0.5, {"static": 1}, 1.0, True)


def tiny_bake(folder: Path, spacing: str = "1m", **changes) -> dict:
    """Bake with few probes and twelve states of a light."""
    tiny = replace(probe_light.PRESETS["draft"], states=12, places=12, rank=3, static_sampling=FEW, **GATHER)
    few = {"shards": 1, "steps": 40, "lights_per_shard": 8, "views": 1, "quality": "draft"} | changes
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(probe_light, "preset_of", lambda quality: ("draft", tiny))
        return bake(small(folder, field="factored+probes", options={"spacing": spacing}, **few))


@pytest.mark.slow
def test_probes_follow_the_sun_and_the_sky_of_a_day(tmp_path):
    report = tiny_bake(
        tmp_path / "out", scene="cornell", spacing="50cm", steps=400, vary=("day=2026-06-21,48.1,11.6", "day.north=180")
    )
    assert validate_file(tmp_path / "out") == [] and 0 < report["facts"]["indirect_probes"]["error_in_the_air"] < 1
    sun = from_json(read_light(tmp_path / "out/scene.glb")[2][0])
    place, scene = (0.0, 1.0, 0.0), load("cornell")
    for t in (0.1, 0.5, 0.9):
        more = {"normals": np.array([[0.0, 0.0, 1.0]]), "variable": sun, "light": sun.direction(t)}
        truth = air_light(scene, np.array([place]), 4096, 3, **more).irradiance[0] / np.pi
        found = asked(tmp_path / "out", "indirect", place, (0, 0, 1), light=sun.direction(t))
        # The box is open to the sky in front. 64 paths a probe: without the sky it is half as bright.
        np.testing.assert_allclose(found.mean(), truth.mean(), rtol=0.4)
    assert read_bake(tmp_path / "out").probes is not None


@pytest.mark.slow
def test_probes_follow_switches_where_something_moves(tmp_path):
    path = room(tmp_path / "room.glb")
    vary = ("node:cool.translation=(0,0,0)..(0,0.6,0)",)
    report = tiny_bake(tmp_path / "out", scene=str(path), lamps=("name",), vary=vary)
    assert report["facts"]["static_probes"]["follows"] == "the switches of the lamps and the node that moves"
    assert validate_file(tmp_path / "out") == []
    scene, up = with_movers(load(str(path)), declared_movers(vary, load(str(path)))), (0.0, 1.0, 0.0)
    # 27 probes of few paths: one place may be wrong by a factor of two, the mean of four is not.
    places = [(0.0, 1.0, 0.0), (0.3, 0.6, 0.2), (-0.4, 1.2, -0.3), (0.5, 1.5, 0.4)]

    def ask(pose, *dimmers):
        frame = {"lamps": np.tile(dimmers, 3), "pose": pose}
        return np.mean([asked(tmp_path / "out", "static", place, up, **frame) for place in places], axis=0)

    for pose in (0.0, 1.0):
        for emitter, dimmers in enumerate(((1, 0), (0, 1))):
            more = {"normals": np.array([up] * len(places)), "emitters": (emitter,)}
            truth = air_light(posed(scene, (pose,)), np.array(places), 4096, 3, **more).irradiance / np.pi
            np.testing.assert_allclose(ask(pose, *dimmers).mean(), truth.mean(), rtol=0.5)
        np.testing.assert_allclose(ask(pose, 1, 0) + ask(pose, 0, 1), ask(pose, 1, 1), rtol=1e-3)
    # The panel that slides up lights the places from above the more it is there; the other panel stays.
    np.testing.assert_allclose(ask(0.5, 0, 1), 0.5 * (ask(0.0, 0, 1) + ask(1.0, 0, 1)), rtol=0.5)
