"""Precomputed radiance transfer against closed forms: a transfer that is multilinear, principal components by SVD."""

from dataclasses import replace

import numpy as np
import pytest
from made_up import SETUP, make_samples, relative_error

from lightwell.fields.surface.transfer import PRESETS, TransferFit, cluster_blocks, regress

# Small enough for the tests: 2 x 2 x 2 blocks of 2 x 2 x 2 cells.
TINY = replace(PRESETS["small"], cells=4, block=2, clusters=4, components=4, lights=2)


def fitted(preset, samples, setup=SETUP, seed=0) -> TransferFit:
    fit = TransferFit(setup, preset, seed)
    fit.learn_from(samples)
    fit.validate_on(samples[:200])
    assert fit.train(5, 5)
    return fit


def multilinear(query) -> np.ndarray:
    """Radiance that hat functions and a lattice represent exactly, of rank 3."""
    x, l = query.position, query.light
    parts = [1 + 0.4 * x[:, 0] * l[:, 0], 1 + 0.3 * l[:, 1] * l[:, 2], 1.2 + 0.2 * x[:, 1] - 0.3 * l[:, 0]]
    return query.reflectance * np.stack(parts, axis=1)


def flat(samples):
    """Samples of a scene whose normals point upwards: the lattice is read a constant way above the surface."""
    normal = np.tile(np.float32([0, 1, 0]), (len(samples), 1))
    return replace(samples, query=replace(samples.query, normal=normal))


def test_a_multilinear_transfer_of_low_rank_is_found():
    samples = flat(make_samples(12_000, 1, multilinear))
    fit = fitted(replace(TINY, storage="float16"), samples)
    # The prior of PRIOR samples per node draws a little to the coarser lattice.
    assert relative_error(fit, flat(make_samples(500, 2, multilinear))) < 0.02
    assert fit.facts["light_functions"] == 8 and fit.state.best_error < 0.02


def test_nodes_without_samples_keep_the_coarser_lattice():
    rng = np.random.default_rng(0)
    places = rng.uniform(0, 0.4, (4000, 3))
    target = np.ones((4000, 3)) + places[:, :1]
    nodes = regress(places, np.ones((4000, 1)), target, np.ones(4000), 8)
    # [z, y, x, K, colours]: linear where samples are, continued by the cell of the coarsest lattice beyond.
    # (A node at the edge of the samples sees one side alone: at most a cell of the slope.)
    np.testing.assert_allclose(nodes[1, 1, :4, 0, 0], 1 + np.arange(4) / 8, atol=0.05)
    np.testing.assert_allclose(nodes[8, 8, 8], nodes[8, 8, 8, 0, 0], atol=1e-9)
    assert 1 < nodes[8, 8, 8, 0, 0] < 2.1


def test_components_of_one_cluster_are_those_of_the_singular_value_decomposition():
    vectors = np.random.default_rng(1).standard_normal((6, 5, 7))
    cluster, mean, rows = cluster_blocks(vectors, 1, 3, 0)
    x = vectors.reshape(-1, 7)
    _, values, right = np.linalg.svd(x - x.mean(axis=0), full_matrices=False)
    assert (cluster == 0).all()
    np.testing.assert_allclose(mean[0], x.mean(axis=0), atol=1e-12)
    np.testing.assert_allclose(np.abs(rows[0] @ right[:3].T), np.eye(3), atol=1e-9)
    left = x - mean[0] - (x - mean[0]) @ rows[0].T @ rows[0]
    assert np.square(left).sum() == pytest.approx(np.square(values[3:]).sum())


def test_blocks_of_two_planes_are_told_apart_though_their_middles_are_equal():
    rng = np.random.default_rng(2)
    planes = [np.linalg.qr(rng.standard_normal((6, 2)))[0].T for _ in range(2)]
    kind = np.arange(16) % 2
    vectors = np.stack([rng.standard_normal((20, 2)) @ planes[k] for k in kind])
    cluster, mean, rows = cluster_blocks(vectors, 2, 2, 3)
    assert len(set(zip(kind.tolist(), cluster.tolist()))) == 2
    left = vectors - mean[cluster][:, None]
    left = left - np.einsum("bvd,bpd,bpe->bve", left, rows[cluster], rows[cluster])
    assert np.square(left).mean() < 1e-12


def test_more_components_and_more_clusters_leave_less_error():
    samples = flat(make_samples(8000, 3))
    errors = [relative_error(fitted(replace(TINY, **change), samples), samples)
              for change in ({"components": 1, "clusters": 1}, {"components": 4, "clusters": 1}, {})]  # fmt: skip
    assert errors[0] > errors[1] >= errors[2] - 1e-3


@pytest.mark.parametrize("light", ["sun", "static"])
def test_suns_and_scenes_without_a_variable_light(light):
    def towards(query):
        sky = 1 + 0.5 * query.light[:, 1:2] if light == "sun" else 1.0
        return query.reflectance * sky * (1 + 0.2 * query.position[:, :1])

    samples = flat(make_samples(6000, 4))
    unit = samples.query.light / np.linalg.norm(samples.query.light, axis=1, keepdims=True)
    samples = replace(samples, query=replace(samples.query, light=unit))
    truth = towards(samples.query).astype(np.float32)
    samples = replace(samples, half_a=truth, half_b=truth)
    fit = fitted(TINY, samples, replace(SETUP, light=light))
    assert relative_error(fit, samples) < 0.03
    assert fit.facts["light_functions"] == (16 if light == "sun" else 1)


def test_a_resumed_fit_is_the_same_and_new_samples_replace_the_old():
    samples = flat(make_samples(3000, 5))
    fit = fitted(TINY, samples)
    again = TransferFit(SETUP, TINY, 0)
    again.learn_from(samples)
    again.validate_on(samples[:200])
    again.restore(fit.arrays())
    np.testing.assert_array_equal(again.predict(samples.query), fit.predict(samples.query))
    assert again.state.step == 5
    before = fit.predict(samples.query)
    fit.learn_from(replace(samples, half_a=2 * samples.half_a, half_b=2 * samples.half_b))
    assert fit.predict(samples.query).mean() == pytest.approx(2 * before.mean(), rel=0.05)
