"""Rotations as quaternions."""

from __future__ import annotations

import numpy as np

# Cosine of half the angle between two rotations above which a plain mean is as good as their slerp.
NEAR = 0.9995


def rotation_quaternion(matrix: np.ndarray) -> list[float]:
    """Convert a rotation to a quaternion, by the dominant eigenvector of a matrix of its entries.

    Args:
        matrix: [3, 3] rotation.

    Returns:
        Unit quaternion (x, y, z, w), w ≥ 0.

    Reference: I. Y. Bar-Itzhack, *New Method for Extracting the Quaternion from a Rotation Matrix*, 2000.
    """
    m = matrix
    k = np.zeros((4, 4))
    k[:3, :3] = m + m.T - np.trace(m) * np.eye(3)
    k[3, :3] = k[:3, 3] = [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]]
    k[3, 3] = np.trace(m)
    vector = np.linalg.eigh(k)[1][:, -1]
    return (vector if vector[3] >= 0 else -vector).tolist()


def slerp(a: np.ndarray, b: np.ndarray, f: np.ndarray) -> np.ndarray:
    """Interpolate rotations along the shorter way.

    Args:
        a: [N, 4] unit quaternions.
        b: [N, 4] unit quaternions.
        f: [N, 1] in [0, 1].

    Returns:
        [N, 4] unit quaternions.
    """
    cosine = (a * b).sum(axis=1, keepdims=True)
    b, cosine = np.where(cosine < 0, -b, b), np.abs(cosine)
    angle = np.arccos(np.clip(cosine, -1.0, 1.0))
    sine = np.where(cosine > NEAR, 1.0, np.sin(angle))
    u = np.where(cosine > NEAR, 1 - f, np.sin((1 - f) * angle) / sine)
    v = np.where(cosine > NEAR, f, np.sin(f * angle) / sine)
    mixed = u * a + v * b
    return mixed / np.linalg.norm(mixed, axis=1, keepdims=True)
