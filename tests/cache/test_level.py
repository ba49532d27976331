"""The level of a still against NumPy, and what it must and must not follow."""

import numpy as np
import pytest

from lightwell.backend import dr, mi
from lightwell.cache import NrcIntegrator, RadianceCache, settings_of
from lightwell.cache.brightness_correction import (
    BITS,
    CAP,
    CELLS,
    CLEAR,
    MOST,
    PRIOR,
    SIDES,
    CellSums,
    CorrectedScaling,
    N,
)
from lightwell.cache.features import Vertex
from lightwell.cache.image_passes import limit_caustics

from .scenes import SMALL, room


def vertices(p, n):
    return Vertex(mi.Point3f(*np.asarray(p, np.float32).T), mi.Vector3f(*np.asarray(n, np.float32).T))


def levels_of(p, n, traced, said):
    sums = CellSums()
    sums.add(vertices(p, n), mi.Float(np.asarray(traced, np.float32)), mi.Float(np.asarray(said, np.float32)))
    return np.array(sums.levels()).reshape(SIDES, N, N, N)  # side, z, y, x


def oracle(p, n, traced, said):
    """The same with NumPy, in the order of rows throughout."""
    traced = np.minimum(traced, CAP * (said + 1))
    axis = np.abs(n).argmax(axis=1)
    side = 2 * axis + (n[np.arange(len(n)), axis] < 0)
    x, y, z = np.minimum((p * N).astype(int), N - 1).T
    at = ((side * N + z) * N + y) * N + x
    values = (np.ones(len(p)), traced, said, (traced - said) ** 2)
    pyramid = [np.stack([np.bincount(at, v, CELLS) for v in values]).reshape(4, SIDES, N, N, N)]
    for k in range(BITS):
        m = N >> (k + 1)
        pyramid.append(pyramid[-1].reshape(4, SIDES, m, 2, m, 2, m, 2).sum(axis=(3, 5, 7)))
    pyramid.append(pyramid[-1].sum(axis=1, keepdims=True))
    factor, around = np.ones((1, 1, 1, 1)), np.zeros((1, 1, 1, 1))
    for c, t, s, e in reversed(pyramid):
        for axis_, (have, want) in enumerate(zip(factor.shape, t.shape)):
            factor = factor.repeat(want // have, axis=axis_)
            around = around.repeat(want // have, axis=axis_)
        said_now = s * factor
        off = t / np.maximum(said_now, 1e-12) - 1
        own = c**2 * e / np.maximum(said_now**2, 1e-24)
        around = (own + PRIOR * around) / np.maximum(c + np.where(around > 0, PRIOR, 0), 1)
        noise = around / np.maximum(c, 1)
        k = np.where(s > 0, 1 + off * np.maximum(1 - CLEAR * noise / np.maximum(off**2, 1e-12), 0), 1)
        factor = np.clip(factor * np.clip(k, 1 / MOST, MOST), MOST**-2, MOST**2)
    return factor


def scattered(count, seed=0):
    rng = np.random.default_rng(seed)
    n = rng.normal(size=(count, 3))
    return rng.random((count, 3)), n / np.linalg.norm(n, axis=1, keepdims=True), rng


def test_levels_are_those_of_the_oracle():
    p, n, rng = scattered(40_000)
    said = rng.gamma(1.0, 1.0, len(p))
    traced = said * np.exp(np.sin(7 * p[:, 0]) * n[:, 2]) * rng.gamma(0.3, 1 / 0.3, len(p))
    assert np.allclose(levels_of(p, n, traced, said), oracle(p, n, traced, said), rtol=2e-3)


def test_a_clear_difference_is_followed_where_it_is_and_noise_nowhere():
    p, n, rng = scattered(400_000)
    n[:] = [0, 0, 1]
    true = np.where(p[:, 0] < 0.5, 2.0, 0.5)
    found = levels_of(p, n, true, np.ones(len(p)))[4]
    assert np.allclose(found[:, :, : N // 2], 2, atol=1e-3) and np.allclose(found[:, :, N // 2 :], 0.5, atol=1e-3)
    noisy = rng.gamma(0.1, 10.0, len(p))  # mean 1, relative variance 10, twelve records a cell
    found = levels_of(p, n, noisy, np.ones(len(p)))[4]
    assert 0.85 < found.mean() < 1.1 and found.std() < 0.65  # unshrunk: 0.91
    # Sides that no record met take what all others say together.
    assert np.allclose(levels_of(p, n, 1.5 * np.ones(len(p)), np.ones(len(p))), 1.5, atol=1e-3)


def test_records_that_are_no_numbers_or_without_a_prediction_change_nothing():
    p, n, _ = scattered(1000)
    bad = np.where(np.arange(1000) % 2, np.nan, np.inf)
    assert np.all(levels_of(p, n, bad, np.ones(1000)) > 0)
    assert np.allclose(levels_of(p, n, np.full(1000, np.nan), np.ones(1000)), 1)
    assert np.allclose(levels_of(p, n, np.ones(1000), np.zeros(1000)), 1)


def test_the_gain_is_interpolated_between_the_centres_of_cells():
    cell = np.arange(CELLS)
    ramp = (cell % N + 10 * (cell // N % N) + 100 * (cell // N**2 % N) + 1000 * (cell // N**3)).astype(np.float32)
    p = np.array([[0.3, 0.6, 0.9], [0.5 / N] * 3, [0, 0, 0], [1, 1, 1], [1 - 0.5 / N, 0.5, 0.5]])
    n = np.array([[0, 0, -1], [1, 0, 0], [-1, 0, 0], [0, 0.9, 0.1], [0, -1, 0]])
    out = np.array(CorrectedScaling(mi.Float(0.5), mi.Float(ramp)).at(vertices(p, n)))
    inside = np.clip(p * N - 0.5, 0, N - 1)
    assert np.allclose(out, 0.5 * (inside @ [1, 10, 100] + 1000 * np.array([5, 0, 1, 2, 3])), rtol=1e-5)


def still(**options):
    return NrcIntegrator(settings=settings_of({**SMALL, "mode": "still", "warmup": 4, **options}))


def test_a_still_has_a_level_that_frames_drop_and_files_keep(tmp_path):
    scene = room(24)
    nrc = still()
    first = np.array(mi.render(scene, integrator=nrc, spp=8, seed=1))
    cache = nrc.cache
    factors = np.array(cache.predictor.level)
    assert factors.shape == (CELLS,) and np.all(np.isfinite(factors)) and np.ptp(factors) > 0.01
    cache.save(tmp_path / "room.npz")
    again = RadianceCache.load(tmp_path / "room.npz", scene)
    assert np.array_equal(np.array(again.predictor.level), factors)
    again.prepare(scene)
    v = Vertex(mi.Point3f(0.3, 0.4, 0.5), mi.Vector3f(0, 0, 1), a=mi.Color3f(0.5))
    assert np.allclose(
        np.array(again.predictor.radiance(again.predictor.packed(), v)),
        np.array(cache.predictor.radiance(cache.predictor.packed(), v)),
    )
    assert np.all(np.isfinite(first))
    cache.train_frame(scene, scene.sensors()[0], 3)
    assert cache.predictor.level is None


@pytest.mark.parametrize("factors", [np.ones(7, np.float32), np.full(CELLS, np.nan, np.float32), np.zeros(CELLS, "f4"),
                                     np.full(CELLS, 1e9, np.float32), np.ones(CELLS)])  # fmt: skip
def test_a_level_that_is_none_is_refused(tmp_path, factors):
    scene = room(8)
    cache = RadianceCache(settings_of(SMALL))
    cache.prepare(scene)
    cache.save(tmp_path / "room.npz")
    arrays = dict(np.load(tmp_path / "room.npz"))
    np.savez(tmp_path / "bad.npz", **arrays, level=factors)
    with pytest.raises(ValueError, match="'level' is not"):
        RadianceCache.load(tmp_path / "bad.npz")


def test_the_level_brings_a_blurred_cache_nearer_to_the_truth():
    """A network whose weights are halved and doubled by place: the level undoes it."""
    scene = room(32)
    path = mi.load_dict({"type": "path", "max_depth": -1})
    truth = np.array(mi.render(scene, integrator=path, spp=256, seed=9))
    nrc = still(warmup=6, train_fraction_max=1.0)
    mi.render(scene, integrator=nrc, spp=8, seed=1)
    errors = []
    with_level = nrc.cache.predictor.level
    nrc.cache.freeze()
    for factors in (with_level * 0.25, with_level):
        nrc.cache.predictor.correct(factors)
        picture = np.array(mi.render(scene, integrator=nrc, spp=64, seed=2))
        errors.append(np.mean((picture - truth) ** 2 / (truth**2 + 0.01)))
    assert errors[1] < 0.5 * errors[0]


def test_a_still_too_short_for_two_frames_of_training_is_path_traced():
    scene = room(24)
    nrc = NrcIntegrator(settings=settings_of({**SMALL, "mode": "still", "seconds": 1e-3}))
    picture = np.array(mi.render(scene, integrator=nrc, spp=1, seed=1))
    assert (
        len(nrc.last.stats) == 1
        and not nrc.last.caching
        and nrc.cache.predictor.level is None
        and np.isfinite(picture).all()
    )
    plain = NrcIntegrator(settings=settings_of({"termination_c": "inf", "mode": "frames"}))
    assert np.allclose(
        picture, np.array(mi.render(scene, integrator=plain, spp=nrc.last.rendered.samples, seed=1)), atol=1e-5
    )


def test_caustics_are_cut_in_stills_only_and_less_the_more_samples_there_are():
    scene = room(8)
    nrc = still(spike_cap=0.5)
    mi.render(scene, integrator=nrc, spp=8, seed=1)
    mean = nrc.cache.predictor.scale.mean
    assert np.isclose(float(nrc.cache.region.context.spike[0]), 0.5 * 32 * mean, rtol=1e-5)
    limit_caustics(nrc.cache, 640)
    assert np.isclose(float(nrc.cache.region.context.spike[0]), 0.5 * 640 * mean, rtol=1e-5)
    limit_caustics(nrc.cache, 0)
    assert float(nrc.cache.region.context.spike[0]) > 1e38
    assert dr.width(nrc.cache.region.context.spike) == 1
