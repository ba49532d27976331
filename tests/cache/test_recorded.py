"""Recordings belong to one scene."""

import gc

import numpy as np

from lightwell.backend import mi
from lightwell.cache import NrcIntegrator, settings_of

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
