"""The transfer function of stored irradiance, E' in unit S and q byte / 255:  E' = q² / (1 + SOFT − q²)."""

from __future__ import annotations

import numpy as np

from lightwell.graph import Builder

# E' / S = q² / (1 + SOFT − q²): the display's curve x / (1 + x), then a square root, so that the steps of a byte are
# about equally visible everywhere; the largest value is 1 / SOFT.
SOFT = 1 / 64


def stored(value: np.ndarray) -> np.ndarray:
    """Encode relative irradiance as bytes.

    Args:
        value: [...] E' / S, ≥ 0.

    Returns:
        [...] float64 values of bytes, 0 to 255.
    """
    x = np.maximum(np.asarray(value, np.float64), 0)
    return np.floor(255 * np.sqrt(np.minimum(x * (1 + SOFT) / (1 + x), 1)) + 0.5).astype(np.uint8)


def restored(texels: np.ndarray) -> np.ndarray:
    """Decode bytes to relative irradiance, the inverse of ``stored``.

    Args:
        texels: [...] bytes.

    Returns:
        [...] float32 E' / S.
    """
    u = (np.asarray(texels, np.float32) / 255) ** 2
    return u / (1 + SOFT - u)


def restored_node(b: Builder, q: str) -> str:
    """Add relative irradiance to a graph, as ``restored``.

    Args:
        b: Graph to add nodes to.
        q: Name of the node of what is stored, width 3.

    Returns:
        Name of the node of E' / S, width 3.
    """
    u = b.multiply(q, q)
    return b.multiply(u, b.reciprocal(b.affine(u, [-1] * 3, [1] * 3), SOFT))
