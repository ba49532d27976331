"""New samples go where the fit is wrong, not where the paths are noisy."""

from __future__ import annotations

import numpy as np
import pytest

from lightwell.transport.adaptive import refine, relative_residual, residual_density
from lightwell.transport.queries import make_query
from lightwell.transport.samples import Samples
from lightwell.transport.surface import sample_surface

# A square of 15.6 cm on the floor: 0.1 % of the 24.4 m² of the room.
SPOT_LOW, SPOT_HIGH = (0.30, -0.75), (0.456, -0.594)


def lights(count: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform((-0.8, 0.2, -0.8), (0.8, 1.8, 0.8), (count, 3)).astype(np.float32)


def in_spot(position: np.ndarray, shape: np.ndarray) -> np.ndarray:
    x, z = position[:, 0], position[:, 2]
    inside = (x > SPOT_LOW[0]) & (x < SPOT_HIGH[0]) & (z > SPOT_LOW[1]) & (z < SPOT_HIGH[1])
    return inside & (shape == 0)


@pytest.fixture(scope="module")
def caustic(cornell):
    """Made-up samples: 1 everywhere, 20 in the spot, with noise as large as the signal. Not path-traced."""
    points = sample_surface(cornell, 1 << 16, 1)
    rng = np.random.default_rng(2)
    query = make_query(cornell, points, lights(len(points), 3))
    bright = np.where(in_spot(query.position, points.shape), 20.0, 1.0)
    noise = rng.exponential(size=(2, len(points)))
    a, b = (np.repeat((bright * n)[:, None], 3, axis=1).astype(np.float32) for n in noise)
    return Samples(query, a, b, np.ones(len(points), np.float32), points.shape)


def test_a_caustic_gets_ten_times_its_share(cornell, roaming, caustic):
    points, light, weight = refine(
        cornell, roaming, caustic, lambda q: np.ones((len(q), 3)), 1 << 14, 4, lights_fn=lights
    )
    spot = in_spot(make_query(cornell, points, light).position, points.shape)
    area = (0.156**2) / 24.4
    assert spot.mean() >= 10 * area
    # Weighted, the spot counts for its area again: some 200 samples or more, 8 % at one deviation, taken 4 times.
    assert weight[spot].sum() / weight.sum() == pytest.approx(area, rel=0.32)
    assert weight.mean() == pytest.approx(1, rel=0.05)


def test_noise_alone_draws_no_samples(cornell, caustic):
    # A perfect prediction of noisy samples: the residual averages to nothing.
    bright = np.where(in_spot(caustic.query.position, caustic.shape), 20.0, 1.0)[:, None] * np.ones(3)
    r = relative_residual(bright, caustic)
    assert abs(r.mean()) < 4 * r.std() / np.sqrt(len(r))
    # The planted bug: squared differences with the variance left in.
    naive = ((bright - caustic.radiance) ** 2 / bright**2).mean()
    assert naive > 100 * abs(r.mean())


def test_weights_estimate_the_uniform_mean(cornell, roaming, caustic):
    points, light, weight = refine(
        cornell, roaming, caustic, lambda q: np.ones((len(q), 3)), 1 << 14, 5, lights_fn=lights
    )
    query = make_query(cornell, points, light)
    # The mean height of surfaces and of lights, by area-uniform samples and by weighted adaptive ones: noise 1 %.
    assert np.average(query.position[:, 1], weights=weight) == pytest.approx(
        caustic.query.position[:, 1].mean(), rel=0.04
    )
    assert np.average(light[:, 1], weights=weight) == pytest.approx(1.0, rel=0.03)


def test_cells_without_samples_lean_on_their_object(cornell, caustic):
    density = residual_density(cornell, caustic[:200], np.ones((200, 3)))
    value = density(caustic.query.position, caustic.shape, caustic.query.light)
    assert np.isfinite(value).all() and value.shape == (len(caustic),)
