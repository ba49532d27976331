"""Reservoirs against plain light sampling."""

import numpy as np
import pytest

from lightwell.backend import mi
from lightwell.cache import NrcIntegrator, settings_of

from .scenes import room


def _direct(scene, spp, seed, **options):
    nrc = NrcIntegrator(settings=settings_of({"termination_c": "inf", "max_depth": 2, **options}))
    return np.array(mi.render(scene, integrator=nrc, spp=spp, seed=seed))


@pytest.mark.parametrize("reuse", ["unbiased", "biased"])
def test_the_mean_is_that_of_light_sampling(reuse):
    scene = room(24)
    means = {"nee": [], "restir-di": []}
    for seed in range(12):
        for kind, values in means.items():
            values.append(_direct(scene, 4, seed, first_hit=kind, restir_reuse=reuse).mean())
    ours, theirs = (np.array(means[k]) for k in ("restir-di", "nee"))
    z = (ours.mean() - theirs.mean()) / np.sqrt((ours.var(ddof=1) + theirs.var(ddof=1)) / 12)
    if reuse == "unbiased":
        assert abs(z) < 3.3  # 99.9 %
    assert abs(ours.mean() / theirs.mean() - 1) < (0.02 if reuse == "unbiased" else 0.15)
