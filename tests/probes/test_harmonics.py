"""Harmonics of irradiance, ZH3 and deringing against closed forms."""

import numpy as np

from lightwell.probes import sh


def delta(direction) -> np.ndarray:
    """[9, 3] irradiance harmonics of a unit delta light."""
    y = sh.basis(np.asarray([direction], float))[0]
    return (y * sh.TO_IRRADIANCE)[:, None] * np.ones(3)


def evaluate_zh3(z, n):
    """Irradiance from ZH3 coefficients, without the five harmonics of band 2."""
    low = np.einsum("nk,nkc->nc", sh.basis(n)[:, :4], z[:, :4])
    cosine = (sh.axis(z) * n).sum(axis=1, keepdims=True)
    return low + z[:, 4] * np.sqrt(5 / (4 * np.pi)) * (3 * cosine**2 - 1) / 2


def test_constant_radiance_gives_pi():
    e = np.zeros((9, 3))
    e[0] = np.sqrt(4 * np.pi) * sh.COSINE[0]
    assert np.allclose(sh.evaluate(e, sh.directions(50)), np.pi)


def test_the_harmonics_are_orthonormal():
    y = sh.basis(sh.directions(20000))
    assert np.allclose(4 * np.pi * y.T @ y / len(y), np.eye(9), atol=2e-3)


def test_zh3_is_exact_for_one_light():
    d = np.array([0.48, 0.6, 0.64])
    e = delta(d)
    n = sh.directions(100)
    assert np.allclose(sh.axis(e), d)
    assert np.allclose(sh.from_zh3(sh.zh3(e)), e, atol=1e-12)
    assert np.allclose(evaluate_zh3(np.broadcast_to(sh.zh3(e), (100, 5, 3)), n), sh.evaluate(e, n), atol=1e-12)


def test_zh3_evaluates_as_its_nine_harmonics():
    e = np.random.default_rng(0).normal(size=(30, 9, 3))
    n = sh.directions(30)
    z = sh.zh3(e)
    assert np.allclose(evaluate_zh3(z, n), sh.evaluate(sh.from_zh3(z), n), atol=1e-12)


def test_deringing_is_as_small_as_it_can_be_and_shared_by_states():
    e = np.stack([delta([0, 1, 0]), delta([1, 0, 0]) + 5 * delta([0, 1, 0]), delta([0, 0, 1]) * 0])
    kappa = sh.deringing(e)
    n = sh.directions(sh.DIRECTIONS)
    for one, k in zip(e, kappa):
        assert sh.evaluate(sh.windowed(one, k), n).min() > -1e-5
    assert kappa[0] > 0 and kappa[2] == 0
    assert sh.evaluate(sh.windowed(e[0], 0.9 * kappa[0]), n).min() < 0
    both = sh.deringing(np.stack([e[:1], 0 * e[:1]]))
    assert np.allclose(both, kappa[:1])


def test_the_window_leaves_the_mean_alone():
    e = np.random.default_rng(1).normal(size=(4, 9, 3))
    assert np.allclose(sh.windowed(e, np.ones(4))[:, 0], e[:, 0])
