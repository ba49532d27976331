"""Trials of unbiased stills: the right kind is continued, passes of the worse kind add no noise, the mean stays."""

import numpy as np
import pytest

from lightwell.backend import mi
from lightwell.cache import NrcIntegrator, RadianceCache, settings_of
from lightwell.cache.guide import BINS
from lightwell.cache.guide_trial import PASSES, GuideTrial, has_trial, weighted
from lightwell.cache.image_state import ImageState

from .scenes import SMALL, room

SIZE = 32


def film(rfilter: str = "box"):
    made = mi.load_dict({"type": "hdrfilm", "width": SIZE, "height": SIZE, "rfilter": {"type": rfilter}})
    made.prepare([])
    return made


def block(film, picture: np.ndarray):
    """One sample of a picture [SIZE, SIZE] in the middle of every pixel."""
    made = film.create_block()
    y, x = np.mgrid[:SIZE, :SIZE].reshape(2, -1)
    value = mi.Float(picture.ravel().astype(np.float32))
    made.put(mi.Point2f(x + 0.5, y + 0.5), [value, value, value, mi.Float(1)])
    return made


@pytest.mark.parametrize("rfilter", ["box", "gaussian"])
def test_weighted_blocks_add_up_to_the_weighted_mean(rfilter):
    made = film(rfilter)
    made.put_block(weighted(block(made, np.full((SIZE, SIZE), 3.0)), 0.25))
    made.put_block(block(made, np.full((SIZE, SIZE), 8.0)))
    assert np.allclose(np.array(made.develop())[..., :3], (0.25 * 3 + 8) / 1.25, rtol=1e-4)
    for unknown in (np.nan, np.inf, 0.0):
        assert weighted(whole := block(made, np.ones((SIZE, SIZE))), unknown) is whole


def still(scene, cache: RadianceCache | None = None, **options) -> ImageState:
    """An unbiased still whose guide is frozen and holds nonsense."""
    settings = settings_of({**SMALL, "estimator": "guided", "mode": "still", "seconds": 1e4, **options})
    nrc = NrcIntegrator(settings=settings)
    nrc.cache = cache or frozen(scene)
    made = ImageState(settings, scene, scene.sensors()[0], nrc.cache_of(scene), nrc.reservoirs, 0, 1)
    assert has_trial(made)
    return made


def frozen(scene, seed: int = 0) -> RadianceCache:
    """A frozen cache whose guide samples a few directions that no light comes from."""
    cache = RadianceCache(settings_of({**SMALL, "estimator": "guided"}))
    cache.prepare(scene)
    table, rng = cache.guiding.table, np.random.default_rng(seed)
    keys = np.arange(len(table.row_of))
    bins = rng.gamma(0.2, size=(len(keys), BINS)) + 1e-3
    table.restore(keys, 1000 * bins / bins.sum(1, keepdims=True), np.full((len(keys), 5), 1000.0), 8)
    cache.freeze()
    return cache


@pytest.mark.parametrize("better", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_the_kind_with_less_noise_is_continued_and_the_other_hardly_counts(better):
    made, rng, mean = film(), np.random.default_rng(5), 2.0
    variance = {better: 0.01, not better: 1.0}

    def trace(guided: bool, number: int):
        return block(made, mean * rng.gamma(1 / variance[guided], variance[guided], (SIZE, SIZE)))

    trial = GuideTrial(image := still(room(SIZE)), trace)
    trial.run()
    assert image.guiding == better and [len(x) for x in trial.held.values()] == [PASSES, PASSES]
    for each in trial.blocks():
        made.put_block(each)
    found = np.array(made.develop())[..., 0]
    # Optimal weights: 1 / (2 / 0.01 + 2 / 1); equal ones would have 0.25.
    assert np.mean((found / mean - 1) ** 2) == pytest.approx(1 / 202, rel=0.2)


def test_passes_that_leave_no_time_for_samples_are_not_compared():
    made = film()
    image = still(room(SIZE), seconds=1e-3)
    trial = GuideTrial(image, lambda guided, number: block(made, np.ones((SIZE, SIZE))))
    trial.run()
    assert not image.guiding and not trial.held[True]


@pytest.mark.slow  # Twelve stills, each with kernels of its own.
def test_the_mean_of_a_still_with_a_bad_guide_is_the_path_tracer_s():
    scene = room(16)
    path, cache = mi.load_dict({"type": "path", "max_depth": -1}), frozen(scene)
    ours, theirs = [], []
    for seed in range(12):
        nrc = NrcIntegrator(settings=settings_of({**SMALL, "estimator": "guided", "mode": "still", "seconds": 0.3}))
        nrc.cache = cache
        ours.append(np.array(mi.render(scene, integrator=nrc, spp=1, seed=seed)).mean())
        assert nrc.last.pilot is not None and nrc.last.rendered.samples > 0
        theirs.append(np.array(mi.render(scene, integrator=path, spp=1024, seed=2000 + seed)).mean())
    spread = np.sqrt((np.var(ours, ddof=1) + np.var(theirs, ddof=1)) / len(ours))
    assert abs(np.mean(ours) - np.mean(theirs)) < 2.6 * spread


def test_passes_that_found_no_light_are_kept():
    made = film()
    trial = GuideTrial(image := still(room(SIZE)), lambda guided, number: block(made, np.zeros((SIZE, SIZE))))
    trial.run()
    assert not image.guiding and len(trial.blocks()) == 2 * PASSES
