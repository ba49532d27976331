"""The blend of a denoised image with the cache's view: better where the cache is, never worse by more than noise."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from lightwell.backend import mi
from lightwell.cache import NrcIntegrator, settings_of
from lightwell.cache.denoise_blend import NoisyHalves, blended, cache_weight
from lightwell.cache.views import guides
from lightwell.core.denoise import denoise

from .scenes import SMALL, room

EDGE = 96
RNG = np.random.default_rng(4)
ALBEDO = np.repeat((0.2 + 0.6 * (np.indices((EDGE, EDGE)).sum(axis=0) // 6 % 2))[..., None], 3, axis=2)


def truth() -> np.ndarray:
    """Stripes, which a filter blurs, on the left; smooth light on the right; a texture on both."""
    x = np.arange(EDGE) / EDGE
    light = np.where(x < 0.5, 1 + 0.5 * np.sign(np.sin(2 * np.pi * 12 * x)), 1 + 0.3 * x)
    return np.broadcast_to(light[None, :, None], (EDGE, EDGE, 3)) * ALBEDO


def images(cached: np.ndarray, seed: int = 1):
    """Noisy halves, the halves and the whole through a filter that blurs, and the cache's view."""
    rng = np.random.default_rng(seed)
    halves = NoisyHalves(*(truth() * rng.gamma(4, 1 / 4, (EDGE, EDGE, 3)) for _ in "ab"))
    blur = lambda image: gaussian_filter(image / ALBEDO, (3, 3, 0)) * ALBEDO  # noqa: E731
    return halves, NoisyHalves(blur(halves.a), blur(halves.b)), blur((halves.a + halves.b) / 2), cached


def error(image: np.ndarray, part: slice = slice(None)) -> float:
    return float(np.mean(((image - truth()) ** 2 / (truth() ** 2 + 0.01))[:, part]))


def result(cached: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    halves, denoised, whole, cached = images(cached)
    weight = cache_weight(halves, denoised, cached, ALBEDO)
    return blended(whole, cached, weight), whole, weight


def test_an_exact_cache_is_taken_where_the_filter_is_wrong():
    image, whole, weight = result(truth())
    assert weight[:, 8:40].mean() > 0.8 and error(image) < 0.2 * error(whole)


def test_a_cache_that_is_worse_changes_nothing():
    for cached in (0.5 * truth(), 2 * truth(), np.zeros_like(truth()), truth() + RNG.normal(0, 2, truth().shape)):
        image, whole, _ = result(cached)
        assert error(image) < 1.01 * error(whole)


def test_the_weight_follows_the_place():
    """The cache is right on the left, where the filter is wrong, and far off on the right."""
    cached = truth()
    cached[:, EDGE // 2 :] *= 1.6
    image, whole, weight = result(cached)
    left, right = slice(8, 40), slice(60, EDGE)
    assert weight[:, left].mean() > 0.5 and weight[:, right].mean() < 0.05
    assert error(image, left) < 0.5 * error(whole, left) and error(image, right) < 1.05 * error(whole, right)


def test_the_weight_is_that_of_least_error():
    """Of constant errors: 0.3 of the filter and −0.1 of the cache give 0.75."""
    base, rng = np.ones((EDGE, EDGE, 3)), np.random.default_rng(2)
    halves = NoisyHalves(*(base + rng.normal(0, 0.05, base.shape) for _ in "ab"))
    weight = cache_weight(halves, NoisyHalves(base + 0.3, base + 0.3), base - 0.1, base)
    assert abs(weight.mean() - 0.75) < 0.02


def test_a_planted_exchange_of_both_images_is_caught():
    halves, denoised, whole, cached = images(0.8 * truth())
    weight = cache_weight(halves, denoised, cached, ALBEDO)
    assert error(blended(whole, cached, weight)) < 1.01 * error(whole)
    assert error(blended(whole, cached, 1 - weight)) > error(blended(whole, cached, weight))


def test_noise_that_the_filter_leaves_counts_as_its_error():
    base, rng = np.ones((EDGE, EDGE, 3)), np.random.default_rng(3)
    halves = NoisyHalves(*(base + rng.normal(0, 0.3, base.shape) for _ in "ab"))
    denoised = NoisyHalves(*(gaussian_filter(x, (0.6, 0.6, 0)) for x in (halves.a, halves.b)))
    cached, mean = base - 0.05, (denoised.a + denoised.b) / 2
    best = np.mean((mean - base) * (mean - cached)) / np.mean((mean - cached) ** 2)
    # Two standard errors lower than the best.
    assert best - 0.3 < cache_weight(halves, denoised, cached, base).mean() < best + 0.05
    # Planted: each half judged by itself, which takes the noise that is left in it for light.
    judged_by_itself = NoisyHalves(halves.b, halves.a)
    assert cache_weight(judged_by_itself, denoised, cached, base).mean() < best - 0.5


def test_the_other_half_is_what_is_left():
    a, b = RNG.random((2, 4, 5, 3))
    found = NoisyHalves.of(0.25 * a + 0.75 * b, a, 0.25)
    assert np.allclose(found.b, b)


def test_values_that_are_not_finite_are_left_out():
    cached = truth()
    cached[3, 4] = np.nan
    whole = truth() + 1
    found = blended(whole, cached, np.full((EDGE, EDGE), 0.5, np.float32))
    assert np.isfinite(found).all() and np.array_equal(found[3, 4], whole[3, 4])


def test_a_still_is_not_worse_than_with_the_denoiser_alone():
    scene = room(48)
    reference = np.array(mi.render(scene, integrator=mi.load_dict({"type": "path", "max_depth": -1}), spp=512, seed=9))
    errors, share = {}, None
    for with_cache in (False, True):
        options = {**SMALL, "mode": "still", "warmup": 12, "denoise": with_cache, "denoise_cache": with_cache}
        nrc = NrcIntegrator(settings=settings_of(options))
        image = np.array(mi.render(scene, integrator=nrc, spp=8, seed=1))
        if not with_cache:  # the same samples, denoised
            image = denoise(image, *guides(scene, scene.sensors()[0], nrc.cache, 1))
        errors[with_cache] = float(np.mean((image - reference) ** 2 / (reference**2 + 0.01)))
        share = nrc.last.rendered.cache_share
    assert share is not None and 0 <= share <= 1
    # Half of the samples, and one of both halves.
    half, part = nrc.last.rendered.half
    assert part == 0.5 and half.shape == (48, 48, 3) and abs(half.mean() / reference.mean() - 1) < 0.3
    # Both are noise of one image: other samples change either by some per cent.
    assert errors[True] < 1.1 * errors[False]


@pytest.mark.parametrize("options", [{}, {"denoise": True, "estimator": "guided"}, {"denoise": True, "mode": "frames"}])
def test_what_cannot_be_blended_is_refused(options):
    with pytest.raises(ValueError, match="denoise_cache blends a denoised still") as caught:
        settings_of({**options, "denoise_cache": True})
    assert "\n" not in str(caught.value)
