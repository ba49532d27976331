"""How much a sample counts in training."""

from __future__ import annotations

import numpy as np


def by_object(shape: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Weights [N] by which an object counts as often as it was sampled, not by its area.

    shape   [N] object of every sample.
    weight  [N] 1 / density of the samples relative to area-uniform sampling.

    Small objects have a floor of samples (``lightwell.transport.surface``); area weights would undo it, and a door
    handle would never be learned. Within an object the weights keep their ratios. The mean of the result is that of
    objects with weight: 1.
    """
    count = np.bincount(shape)
    mean = np.bincount(shape, weights=weight) / np.maximum(count, 1)
    return (weight / np.where(mean > 0, mean, 1)[shape]).astype(np.float32)
