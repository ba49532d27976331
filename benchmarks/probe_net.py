"""The baseline without a lattice (B7): one small network (x, n) → E of as many bytes as ours, on the same samples."""

from __future__ import annotations

import numpy as np

from lightwell.networks import Mlp, Trainer, TrainingSet, TrainingSettings
from lightwell.probes import sh
from lightwell.probes.light import SolvedVolume

OCTAVES, LAYERS, NORMALS, MEAN = 6, 3, 16, 0.25
SETTINGS = TrainingSettings(rate=3e-3, batch=1 << 13, patience=0)


def answers(
    lit: SolvedVolume, bytes_: float, place: np.ndarray, normal: np.ndarray, steps: int, seed: int = 0
) -> np.ndarray:
    """[N, 3] irradiance at places for normals, of a network of half floats trained for ``steps``."""
    rng, samples = np.random.default_rng(seed), lit.samples
    rows = np.repeat(np.arange(len(samples.place)), NORMALS)
    n = rng.standard_normal((len(rows), 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    target = np.maximum(sh.evaluate(samples.light[rows].astype(np.float64), n), 0)
    unit = max(float(target.mean()), 1e-30) / MEAN
    low, high = samples.place.min(axis=0), samples.place.max(axis=0)
    half = 0.5 * float((high - low).max())
    x = _features((samples.place[rows] - low) / half - 1, n)
    order = rng.permutation(len(x))
    width = _width(x.shape[1], bytes_ / 2)
    trainer = Trainer(Mlp((x.shape[1], *[width] * LAYERS, 3), "silu", "identity"), SETTINGS, seed)
    data = TrainingSet.from_numpy(x[order], target[order] / unit, np.ones(len(x)))
    check = order[: 1 << 12]

    def error(parameters) -> float:
        found = np.maximum(trainer.network.evaluate(parameters, x[check]), 0)
        return float(np.mean(np.abs(found - target[check] / unit) / (target[check] / unit + 0.01)))

    trainer.fit(data, error, steps, steps)
    asked = _features((np.asarray(place, float) - low) / half - 1, np.asarray(normal, float))
    return np.maximum(trainer.network.evaluate(trainer.best, asked), 0) * unit


def _features(x: np.ndarray, n: np.ndarray) -> np.ndarray:
    """Place, its waves, and the harmonics of the normal."""
    waves = [f(np.pi * 2.0**k * 0.5 * x) for k in range(OCTAVES) for f in (np.sin, np.cos)]
    return np.concatenate([x, *waves, sh.basis(n)], axis=1).astype(np.float32)


def _width(inputs: int, numbers: float) -> int:
    """Units of a hidden layer, so that the network has about so many numbers."""
    a, b = LAYERS - 1, inputs + 3 + LAYERS
    return max(4, int((-b + np.sqrt(b * b + 4 * a * numbers)) / (2 * a)))
