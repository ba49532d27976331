"""The pilot: it finds the kind of pass with less variance times time, and is not led astray by single paths."""

import numpy as np
import pytest

from lightwell.backend import mi
from lightwell.cache import NrcIntegrator, settings_of
from lightwell.cache.guide_selector import COST, PASSES, GuideSelector, radiance_of, relative_variances

from .scenes import room

SMALL = {"levels": 3, "entries_log2": 10, "batch": 1024, "steps": 2, "max_vertices": 6, "mode": "still", "warmup": 4}


def passes(variance: float, seed: int, mean: float = 2.0, count: int = 12) -> np.ndarray:
    """Gamma-distributed passes [K, 32, 32, 3] of a relative variance."""
    rng = np.random.default_rng(seed)
    return mean * rng.gamma(1 / variance, variance, (count, 32, 32, 3))


def test_efforts_are_relative_variances():
    plain, guided = relative_variances(passes(0.5, 0), passes(0.1, 1))
    assert plain == pytest.approx(0.5, rel=0.1) and guided == pytest.approx(0.1, rel=0.1)
    brighter = relative_variances(100 * passes(0.5, 0), 100 * passes(0.1, 1))
    assert brighter == pytest.approx((plain, guided), rel=1e-5)


def test_single_bright_paths_do_not_decide():
    plain, guided = passes(0.5, 0), passes(0.1, 1)
    guided[3, 5, 7] = 1e4
    assert relative_variances(plain, guided)[1] < 0.15
    guided[:, 9, 9] = np.nan  # no sample fell there
    assert relative_variances(plain, guided)[1] < 0.15


def trial(plain: float, guided: float, seconds: tuple[float, float], count: int = PASSES) -> GuideSelector:
    made = GuideSelector()
    for kind, variance in ((False, plain), (True, guided)):
        made.pictures[kind] = list(passes(variance, 3 + kind, count=count))
        made.seconds[kind] = [9.0, seconds[kind], 2 * seconds[kind]][:count]
    return made


def test_time_counts_where_there_is_a_clock():
    assert trial(0.5, 0.3, (1.0, 1.2)).guide_pays(True)
    assert not trial(0.5, 0.3, (1.0, 2.0)).guide_pays(True)
    assert trial(0.5, 0.3, (1.0, 2.0)).guide_pays(False)  # no clock, no times: the picture is the same again
    assert not trial(0.5, 0.5 / COST * 1.1, (1.0, 0.1)).guide_pays(False)
    assert not trial(0.5, 0.1, (1.0, 1.0), 1).guide_pays(True)  # one pass each says nothing


def test_blocks_without_weight_hold_nothing():
    block = np.array([[[2.0, 4, 6, 1, 2], [1, 1, 1, 1, 0]]])
    assert np.allclose(radiance_of(block)[0, 0], [1, 2, 3]) and np.isnan(radiance_of(block)[0, 1]).all()
    assert np.isnan(relative_variances(*np.full((2, 3, 8, 8, 3), np.nan))).all()


def integrator(**options) -> NrcIntegrator:
    return NrcIntegrator(settings=settings_of({**SMALL, **options}))


def noisy(scene, **options) -> NrcIntegrator:
    """An integrator to which every scene is noisy."""
    nrc = integrator(**options)
    nrc.cache_of(scene).guiding.calm = 0.0
    return nrc


def test_a_noisy_still_has_a_pilot_whose_samples_stay_in_the_picture():
    scene = room(24)
    nrc = noisy(scene, warmup=8)
    picture = np.array(mi.render(scene, integrator=nrc, spp=64))
    pilot = nrc.last.pilot
    assert nrc.last.rendered.samples == 64 and nrc.cache.guiding.table.frames == 7
    assert all(len(x) == PASSES for x in pilot.pictures.values())
    assert nrc.last.guiding == pilot.guide_pays(False)
    plain = np.array(mi.render(scene, integrator=integrator(warmup=8, guide="never"), spp=64))
    assert picture.mean() == pytest.approx(plain.mean(), rel=0.05)
    again = np.array(mi.render(scene, integrator=noisy(scene, warmup=8), spp=64))
    assert np.allclose(picture, again, rtol=1e-3, atol=1e-4)


def test_an_unbiased_still_with_a_time_limit_may_leave_its_guide():
    scene = room(16)
    nrc = noisy(scene, estimator="guided", seconds=2.0)
    mi.render(scene, integrator=nrc, spp=1)
    assert nrc.last.pilot is not None and not nrc.last.caching
    assert nrc.last.guiding == nrc.last.pilot.guide_pays(True)
    # Without a limit the samples stay as they are: always guided.
    nrc = noisy(scene, estimator="guided", warmup=3)
    mi.render(scene, integrator=nrc, spp=32)
    assert nrc.last.pilot is None and nrc.last.guiding


def test_calm_stills_short_ones_and_frames_have_none():
    scene = room(16)
    for options, spp in (({}, 64), ({"mode": "frames"}, 4), ({"guide": "never"}, 64)):
        nrc = integrator(**options)
        mi.render(scene, integrator=nrc, spp=spp)
        assert not nrc.last.guiding and nrc.last.pilot is None and nrc.cache.guiding.guide is None
    guiding = integrator().cache_of(scene).guiding
    for allowed in (False, True):
        guiding.allowed = allowed
        assert (guiding.next_table(still=True, noise=guiding.calm) is not None) == allowed


def test_true_and_false_still_say_always_and_never():
    assert settings_of({"guide": True}).guiding.guide == "always"
    assert settings_of({"guide": False}).guiding.guide == "never"
    assert not settings_of({"first_hit": "restir-gi"}).guided and settings_of({}).guided
    with pytest.raises(ValueError, match="guide = 'often', expected one of auto, always, never"):
        settings_of({"guide": "often"})
