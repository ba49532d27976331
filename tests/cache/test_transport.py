"""Paths and targets against closed forms and against Mitsuba's own path tracer."""

import numpy as np
import pytest

from lightwell.backend import dr, mi
from lightwell.cache import NrcIntegrator, RadianceCache, settings_of
from lightwell.cache.training_paths import TrainingRecords, resolve

from .scenes import SMALL, furnace, room, sensor

pytestmark = pytest.mark.gpu


def integrator(**options):
    return NrcIntegrator(settings=settings_of({**SMALL, **options}))


def test_without_a_cache_it_is_mitsuba_s_path_tracer():
    scene = room()
    plain = integrator(termination_c="inf", sampling="sensor")
    ours = np.array(mi.render(scene, integrator=plain, spp=8, seed=3))
    path = np.array(mi.render(scene, integrator=mi.load_dict({"type": "path", "max_depth": -1}), spp=8, seed=3))
    assert np.allclose(ours, path, rtol=2e-4, atol=1e-5)
    assert (ours == path).mean() > 0.5


def test_hand_made_segments_resolve_backwards():
    records = TrainingRecords()
    records.gathered = mi.Float([1, 0, 2, 0, 0.5, 1, 0, 0, 9, 9, 9, 9, 3, 3, 3, 0, 0, 0, 0, 0, 0, 0, 0, 0])
    records.through = mi.Float([0.5, 0, 1, 0, 2, 0.25, 0, 0, 9, 9, 9, 9, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0])
    records.count, records.query = mi.UInt32(2, 1), mi.Int32(1, -1)
    records.ended = mi.Bool(True, True)
    targets, at_query = resolve(records, mi.Color3f([4, dr.inf], [4, dr.inf], [8, dr.inf]), 3, 2)
    t = np.array(targets).reshape(2, 3, 4)
    # L1 = C1 + T1 tail = (0.5 + 8, 1 + 1, 0); L0 = C0 + T0 L1 = (1 + 4.25, 0, 2 + 0)
    assert np.allclose(t[0, 1, :3], [8.5, 2, 0]) and np.allclose(t[0, 0, :3], [5.25, 0, 2])
    assert np.allclose(t[1, 0, :3], [3, 3, 3])  # a factor of zero shuts out an infinite tail
    assert t[0, 2, 3] == 0 and np.allclose(np.array(at_query).T, [[8.5, 2, 0], [0, 0, 0]])


@pytest.mark.parametrize("albedo", [(0.5, 0.001, 0.0)])
def test_furnace(albedo):
    scene = furnace(albedo)
    nrc = integrator(mode="still", warmup=40, unbiased_fraction=0.25)
    image = np.array(mi.render(scene, integrator=nrc, spp=8))
    expected = 1 / (1 - np.array(albedo))
    assert np.allclose(image.mean(axis=(0, 1)), expected, rtol=0.02)
    assert np.all(image[..., 2] == 1)
    assert all(t.dropped == 0 for t in nrc.last.stats)


@pytest.mark.parametrize("u", [1.0, pytest.param(1 / 16, marks=pytest.mark.slow)])
def test_training_meets_the_path_traced_mean_and_learns_the_room(u):
    """With targets of full paths, and with predictions at the ends of most."""
    scene = room(32)
    path = mi.load_dict({"type": "path", "max_depth": -1})
    reference = np.array(mi.render(scene, integrator=path, spp=512, seed=77))
    nrc = integrator(mode="still", warmup=60, still_unbiased=u)
    image = np.array(mi.render(scene, integrator=nrc, spp=32))
    assert abs(image.mean() / reference.mean() - 1) < 0.03
    bias = np.mean([t.bias[0] for t in nrc.last.stats[-20:]])
    assert abs(bias) < 0.05 * reference.mean()


def test_the_same_seed_gives_the_same_picture():
    scene = room()
    a, b = (np.array(mi.render(scene, integrator=integrator(mode="frames"), spp=3, seed=4)) for _ in range(2))
    assert np.array_equal(a, b)


@pytest.mark.parametrize("estimator", ["residual", "two-level"])
def test_unbiased_estimators_agree_with_the_path_tracer_though_the_cache_is_wrong(estimator):
    scene = room(16)
    wrong = RadianceCache(settings_of({**SMALL, "estimator": estimator, "mode": "still"}))
    wrong.prepare(scene)
    rng = np.random.default_rng(0)
    wrong.predictor.learner.values = {
        k: mi.TensorXf((rng.normal(size=v.shape) * 0.4).astype(np.float32))
        for k, v in wrong.predictor.learner.values.items()
    }
    wrong.frozen = True
    means = []
    path = mi.load_dict({"type": "path", "max_depth": -1})
    for seed in range(24):
        nrc = integrator(estimator=estimator, mode="frames", residual_probability=0.5)
        nrc.cache = wrong
        means.append(
            [
                np.array(mi.render(scene, integrator=nrc, spp=16, seed=seed)).mean(),
                np.array(mi.render(scene, integrator=path, spp=16, seed=1000 + seed)).mean(),
            ]
        )
    ours, theirs = np.array(means).T
    z = (ours.mean() - theirs.mean()) / np.sqrt((ours.var(ddof=1) + theirs.var(ddof=1)) / len(means))
    assert abs(z) < 3.3  # 99.9 %
    biased = integrator(mode="frames")
    biased.cache = wrong
    off = np.array(mi.render(scene, integrator=biased, spp=64, seed=5)).mean()
    assert abs(off - theirs.mean()) > 10 * theirs.std(ddof=1) / np.sqrt(len(means))  # the test can see a wrong cache


def enclosed():
    """A closed box whose lamp is in a glass ball: all light comes through glass."""
    return mi.load_dict(
        {
            "type": "scene",
            "sensor": sensor(16, (0, 0, -0.9), (0, 0, 1), fov=75),
            "walls": {"type": "cube", "flip_normals": True},
            "glass": {"type": "sphere", "center": [0, 0.4, 0.3], "radius": 0.4, "bsdf": {"type": "dielectric"}},
            "lamp": {
                "type": "sphere",
                "center": [0, 0.4, 0.3],
                "radius": 0.3,
                "emitter": {"type": "area", "radiance": {"type": "rgb", "value": 8.0}},
            },
        }
    )


def test_no_caustic_is_dimmed_in_an_unbiased_still():
    scene, path = enclosed(), mi.load_dict({"type": "path", "max_depth": -1})
    cache = RadianceCache(settings_of({**SMALL, "estimator": "two-level"}))
    cache.prepare(scene)
    cache.predictor.scale.mean = 1e-3  # as of a scene that is dark where it was learned: a low limit of caustics
    cache.freeze()
    ours, theirs = [], []
    for seed in range(12):
        nrc = integrator(estimator="two-level", mode="still")
        nrc.cache = cache
        ours.append(np.array(mi.render(scene, integrator=nrc, spp=32, seed=seed)).mean())
        theirs.append(np.array(mi.render(scene, integrator=path, spp=64, seed=1000 + seed)).mean())
    z = (np.mean(ours) - np.mean(theirs)) / np.sqrt((np.var(ours, ddof=1) + np.var(theirs, ddof=1)) / 12)
    assert abs(z) < 3.3  # 99.9 %


def test_both_levels_read_one_cache_though_it_learns():
    scene, path = room(16), mi.load_dict({"type": "path", "max_depth": -1})
    ours, theirs = [], []
    for seed in range(64):
        # A high rate: predictions differ much from frame to frame.
        nrc = integrator(estimator="two-level", mode="frames", learning_rate=0.1, seed=seed)
        ours.append(np.array(mi.render(scene, integrator=nrc, spp=4, seed=seed)).mean())
        theirs.append(np.array(mi.render(scene, integrator=path, spp=64, seed=1000 + seed)).mean())
    z = (np.mean(ours) - np.mean(theirs)) / np.sqrt((np.var(ours, ddof=1) + np.var(theirs, ddof=1)) / 64)
    assert abs(z) < 3.3  # 99.9 %


def test_two_levels_keep_alpha():
    scene, about = furnace(size=8), sensor(8, (0.3, 0, 0), (0.3, 0, 1))
    about["film"]["pixel_format"] = "rgba"
    two_level = integrator(estimator="two-level", mode="frames")
    image = mi.render(scene, sensor=mi.load_dict(about), integrator=two_level, spp=2)
    assert np.allclose(np.array(image)[..., 3], 1)


def test_passes_of_successive_seeds_are_independent():
    scene = room()

    def image(seed: int) -> np.ndarray:
        return np.array(mi.render(scene, integrator=integrator(mode="frames", sampling="sensor"), spp=2, seed=seed))

    # Differences: without what all images have in common.
    noise = [np.clip(image(seed) - image(seed + 10), -0.3, 0.3).ravel() for seed in (4, 5)]
    assert abs(np.corrcoef(*noise)[0, 1]) < 0.25
