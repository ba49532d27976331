"""Recordings belong to one scene."""

import gc

import numpy as np

from lightwell.backend import dr, mi
from lightwell.cache import NrcIntegrator, frames, settings_of

from .scenes import room


def test_a_second_scene_is_not_rendered_with_the_materials_of_one_that_is_gone():
    path = mi.load_dict({"type": "path", "max_depth": -1})
    for bsdf in ({"type": "roughconductor", "alpha": 0.2}, {"type": "roughdielectric", "alpha": 0.3}):
        scene = room(16, bsdf)
        plain = NrcIntegrator(settings=settings_of({"termination_c": "inf"}))
        ours = np.array(mi.render(scene, integrator=plain, spp=256, seed=3)).mean()
        assert abs(ours / np.array(mi.render(scene, integrator=path, spp=256, seed=1)).mean() - 1) < 0.03
        del scene, plain
        gc.collect()


def test_passes_of_all_sizes_have_the_same_samples():
    # One recording serves them all: four passes of one sample are one of four.
    size = 16
    scene = room(size, {"type": "roughconductor", "alpha": 0.2})
    nrc = NrcIntegrator(settings=settings_of({"termination_c": "inf"}))
    cache, sensor = nrc.cache_of(scene), scene.sensors()[0]

    def radiance(first: int, spp: int) -> np.ndarray:
        numbers = [dr.opaque(mi.UInt32, n) for n in (first, spp, 5)]
        L, valid, place = frames.sobol_pass(
            scene, sensor, cache, numbers, size * size * spp, "guided", 1.0, False
        )  # fmt: skip
        assert dr.width(valid) == dr.width(place) == size * size * spp
        return np.array(L).T.reshape(size * size, spp, 3)

    whole = radiance(0, 4)
    np.testing.assert_allclose(np.concatenate([radiance(k, 1) for k in range(4)], axis=1), whole, rtol=1e-4, atol=1e-5)
    assert whole.std(axis=1).mean() > 0
