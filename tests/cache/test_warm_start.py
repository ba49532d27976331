"""A cache that starts from a baked field: closed form, what it needs, and what it says when that is missing."""

from __future__ import annotations

import json

import numpy as np
import pytest

from lightwell.cache import RadianceCache, settings_of
from lightwell.cache.live_scene import Lamp, LiveScene
from lightwell.cache.views import view
from lightwell.cache.warm_start import BakedLight, check_light, scattered, warm_start
from lightwell.graph import Builder
from lightwell.rendering.integrators import render
from lightwell.rendering.settings import NrcOptions, RenderSettings
from lightwell.scenes import load
from lightwell.transport import sample_surface

from .scenes import SMALL


def constant(value: float, *more: str):
    """A graph of a constant radiance over reflectance."""
    b = Builder(position=3, uv1=2) if more else Builder(position=3)
    x = b.affine("position", [0.0] * 3, [value] * 3)
    return b.build(radiance=b.add(x, b.slice(b.concat("uv1", "uv1"), 0, 3)) if more else x)


@pytest.fixture(scope="module")
def room():
    loaded = load("cornell")
    low, high = loaded.bounds
    lamp = Lamp(0.5 * (low + high) + np.array([0, 0.25 * (high - low)[1], 0]), 1e-6)
    return loaded, LiveScene(loaded, 16, lamp=lamp)


def test_the_first_frame_shows_the_baked_light(room):
    # A lamp of 1e-6 cd: direct light is nothing beside a field of 0.5 per 1e-6, so that radiance is 0.5 reflectances.
    loaded, live = room
    cache = RadianceCache(settings_of({**SMALL, "batch": 1024}))
    done = warm_start(cache, live, loaded, BakedLight("scene.glb", {"indirect": constant(0.5e6)}), 1, 32)
    assert done.steps == 32 and done.records == 16 * 1024 and done.loss < 0.2
    assert cache.schedule.frame == 0 and not cache.schedule.eager and cache.schedule.unbiased_share < 1
    shown, albedo = (view(live.scene, live.sensor, cache, name, 1, 0) for name in ("cache", "albedo"))
    # Mitsuba's reflectance of a glossy surface is not exactly that of the format.
    assert np.median(shown / np.maximum(albedo, 1e-3)) == pytest.approx(0.5, rel=0.15)


def test_a_bake_without_the_light_of_the_scene_is_refused(room):
    loaded, live = room
    cache = RadianceCache(settings_of(SMALL))
    with pytest.raises(ValueError, match=r"'x.glb' has no field of a point light"):
        warm_start(cache, live, loaded, BakedLight("x.glb", {"static": constant(1.0)}), 1, 2)
    with pytest.raises(ValueError, match="reads uv1, which a cache does not know"):
        warm_start(cache, live, loaded, BakedLight("x.glb", {"indirect": constant(1.0, "uv1")}), 1, 2)
    # The page asks before it offers such a bake.
    with pytest.raises(ValueError, match="reads uv1"):
        check_light(live, BakedLight("x.glb", {"indirect": constant(1.0, "uv1")}))
    check_light(live, BakedLight("x.glb", {"indirect": constant(1.0)}))


def test_a_field_of_bent_normals_is_taken(room):
    """Default bakes of scenes with normal maps read them."""
    loaded, live = room
    b = Builder(position=3, shading_normal=3)
    x = b.add(b.affine("position", [0.0] * 3, [0.5e6] * 3), b.scale("shading_normal", 0.0))
    baked = BakedLight("x.glb", {"indirect": b.build(radiance=x)})
    points = sample_surface(loaded, 64, 1)
    cache = RadianceCache(settings_of(SMALL))
    assert warm_start(cache, live, loaded, baked, 1, 2).steps == 2
    assert np.median(scattered(live, loaded, points, baked)) > 0


def test_mistakes_in_the_option_are_told(tmp_path):
    with pytest.raises(ValueError, match=r"--cache-from 'nowhere.glb' does not exist; name the scene.glb of a bake"):
        NrcOptions(cache_from="nowhere.glb")
    (tmp_path / "scene.glb").write_bytes(b"")
    with pytest.raises(ValueError, match="--cache-from is for single pictures"):
        NrcOptions(cache_from=tmp_path / "scene.glb", frames=3)


def test_a_bake_is_refused_where_no_path_ends_in_the_cache(tmp_path):
    (tmp_path / "scene.glb").write_bytes(b"")
    options = {"nrc": ("termination_c=inf",), "cache_from": tmp_path / "scene.glb"}
    settings = RenderSettings("cornell", tmp_path / "a.exr", integrator="nrc", options=options)
    with pytest.raises(ValueError, match="leave out --cache-from"):
        render(settings)


def test_facts_of_a_picture_are_json(tmp_path):
    options = {"nrc": ("termination_c=inf",)}
    settings = RenderSettings("cornell", tmp_path / "a.exr", size=(16, 16), spp=1, integrator="nrc", options=options)
    assert json.loads(json.dumps(render(settings), allow_nan=False))["termination_c"] is None
