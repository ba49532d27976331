"""Samples of indirect light that is known in closed form, for the tests of the fields."""

import numpy as np

from lightwell.fields.base import FieldSetup
from lightwell.transport.samples import Query, Samples

SETUP = FieldSetup((0.0, 0.0, 0.0), 1.0, 0.5, "point")


def unit(v):
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def smooth(query: Query) -> np.ndarray:
    """Albedo times a fall-off with the distance to the light."""
    distance2 = ((query.light - query.position) ** 2).sum(axis=1, keepdims=True)
    return query.reflectance * (0.1 + 0.3 / (1 + distance2))


def make_query(count: int, seed: int) -> Query:
    rng = np.random.default_rng(seed)
    position, light = rng.uniform(-1, 1, (2, count, 3))
    normal = unit(rng.standard_normal((count, 3)))
    view = unit(normal + 0.5 * unit(rng.standard_normal((count, 3))))
    reflectance = rng.uniform(0.1, 0.9, (count, 3))
    columns = [position, normal, view, light, reflectance, np.full((count, 1), 0.6), np.zeros((count, 1))]
    return Query(*(np.asarray(c, np.float32) for c in columns))


def make_samples(count: int, seed: int, radiance=smooth, noise: float = 0.0) -> Samples:
    """Two independent halves around the truth, each with the relative noise given (gamma distributed)."""
    query, rng = make_query(count, seed), np.random.default_rng(seed + 1000)
    truth = radiance(query)
    halves = []
    for _ in range(2):
        factor = rng.gamma(1 / noise**2, noise**2, (count, 1)) if noise else 1.0
        halves.append((truth * factor).astype(np.float32))
    return Samples(query, *halves, np.ones(count, np.float32), np.zeros(count, np.uint32))


def relative_error(fit, samples: Samples) -> float:
    f, y = fit.predict(samples.query) / SETUP.unit, samples.radiance / SETUP.unit
    return float(np.mean(np.abs(f - y) / (y + 0.01)))
