"""Losses have the minimum that their documentation says; schedules have the published values."""

import numpy as np
import pytest

from lightwell.backend import mi
from lightwell.networks import LOSSES, SCHEDULES


def _loss(name: str, f: float, targets: np.ndarray) -> float:
    y = mi.TensorXf(targets.reshape(-1, 1).astype(np.float32))
    prediction = mi.TensorXf(np.full((len(targets), 1), f, np.float32))
    return float(np.mean(np.array(LOSSES[name](prediction, y))))


# Nine dark paths and a bright one: mean 1, median 0.1. The shape of Monte Carlo targets.
SKEWED = np.array([0.1] * 9 + [9.1])


@pytest.mark.parametrize("name", ["l1", "relative"])
def test_absolute_losses_settle_at_the_median(name):
    assert _loss(name, 0.1, SKEWED) < _loss(name, 1.0, SKEWED)


def test_l2_settles_at_the_mean():
    values = np.linspace(0.2, 2.0, 181)
    assert values[np.argmin([_loss("l2", f, SKEWED) for f in values])] == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("name", ["relative1_5", "relative2"])
def test_squared_relative_losses_are_stationary_at_the_mean(name):
    """Its gradient, with the denominator held, is zero where f is the mean of the targets."""
    from lightwell.backend import dr

    f = mi.TensorXf(np.full((10, 1), 1.0, np.float32))
    dr.enable_grad(f)
    loss = dr.sum(LOSSES[name](f, mi.TensorXf(SKEWED.reshape(-1, 1).astype(np.float32))), axis=None)
    dr.backward(loss)
    # 10 terms of at most 16: float32 leaves 1e-5.
    assert abs(float(np.array(dr.grad(f)).sum())) < 1e-4


def test_relative1_5_goes_on_growing_where_relative2_stays_at_one():
    """A prediction ten times brighter costs more, so that light in black places is not free."""
    black = np.zeros(1)
    assert _loss("relative2", 10.0, black) == pytest.approx(_loss("relative2", 1.0, black), rel=0.01)
    assert _loss("relative1_5", 10.0, black) > 3 * _loss("relative1_5", 1.0, black)


def test_beyond_white_nothing_is_asked_but_to_be_as_bright():
    from lightwell.backend import dr
    from lightwell.networks.losses import LAMP_WHITE as white

    pairs = [
        (white + 1, 100 * white),
        (0.5 * white, 100 * white),
        (2 * white, 0.5 * white),
        (0.2, 0.3),
    ]
    f, y = (mi.TensorXf(np.float32([[pair[k]] for pair in pairs])) for k in (0, 1))
    dr.enable_grad(f)
    loss = LOSSES["relative1_5_to_white"](f, y)
    found = np.array(loss)[:, 0]
    dr.backward(dr.sum(loss, axis=None))
    slope = np.array(dr.grad(f))[:, 0]
    assert found[0] == 0 and slope[0] == 0
    assert found[1] == pytest.approx(_loss("relative1_5", 0.5 * white, np.array([white]))) and slope[1] < 0
    # A place that is too bright is pulled back, and below white the loss is the plain one.
    assert found[2] == pytest.approx(_loss("relative1_5", 2 * white, np.array([0.5 * white]))) and slope[2] > 0
    assert found[3] == pytest.approx(_loss("relative1_5", 0.2, np.array([0.3])))


def test_report_schedule_halves_after_fifty_epochs():
    assert SCHEDULES["report"](0.5, 0.0, 0.0) == 0.5
    assert SCHEDULES["report"](0.5, 0.0, 50.0) == 0.25


def test_expected_loss_and_its_gradient():
    """Against NumPy: Σ p l, ∂/∂z = p (l − Σ p l); large outputs do not overflow."""
    from lightwell.backend import dr

    values = np.array([[1.0, -2.0, 0.5], [90.0, 0.0, -90.0]])
    l = np.array([[0.2, 1.0, 3.0], [0.25, 0.25, 0.5]])
    z = mi.TensorXf(values.astype(np.float32))
    dr.enable_grad(z)
    loss = LOSSES["expected"](z, mi.TensorXf(l.astype(np.float32)))
    p = np.exp(values - np.logaddexp.reduce(values, axis=1, keepdims=True))
    np.testing.assert_allclose(np.array(dr.detach(loss)), p * l, rtol=1e-5, atol=1e-6)
    dr.backward(dr.sum(loss, axis=None))
    np.testing.assert_allclose(np.array(dr.grad(z)), p * (l - (p * l).sum(1, keepdims=True)), rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize(
    "rate, tau, epoch, expected",
    # The report's text and code: experts, single network, gate. (μ0, τ, e, μ0 τ / (τ + e)).
    [(0.5, 50, 20, 0.357143), (0.1, 100, 100, 0.05), (1.0, 30, 9, 0.769231)],
)
def test_report_schedule_has_the_published_values(rate, tau, epoch, expected):
    assert SCHEDULES["report"](rate, 0.0, epoch, tau) == pytest.approx(expected, rel=1e-5)


def test_cosine_schedule_ends_at_a_hundredth():
    assert SCHEDULES["cosine"](3e-3, 0.0, 0) == pytest.approx(3e-3)
    assert SCHEDULES["cosine"](3e-3, 1.0, 0) == pytest.approx(3e-5)
    assert SCHEDULES["cosine"](3e-3, 2.0, 0) == pytest.approx(3e-5)
