"""Weights of samples in training."""

from __future__ import annotations

import numpy as np


def by_object(shape: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Compute training weights by which an object counts as often as it was sampled, not by its area.

    Small objects have a minimum of samples (``lightwell.transport.surface``). Area weights would undo it, and a door
    handle would never be learned. Within an object the weights keep their ratios.

    Args:
        shape: [N] int index of the object of each sample.
        weight: [N] inverse density of the samples relative to area-uniform sampling.

    Returns:
        [N] float32 weights; their mean over each object with a positive weight is 1.
    """
    count = np.bincount(shape)
    mean = np.bincount(shape, weights=weight) / np.maximum(count, 1)
    return (weight / np.where(mean > 0, mean, 1)[shape]).astype(np.float32)
