"""Irradiance in spherical harmonics: bands 0 … 2, zonal band 2 (ZH3), and the removal of ringing.

e_lm = A_l L_lm with A = (π, 2π/3, π/4) (Ramamoorthi and Hanrahan 2001). The harmonics are those of the shading
graph's op ``sh`` with degree 3, signs included. Arrays are [..., 9, 3]: harmonic, then colour.
"""

from __future__ import annotations

import numpy as np

from lightwell.graph.ops.encoding import sh_components

# Convolution of band l with the clamped cosine.
COSINE = np.array([np.pi, 2 * np.pi / 3, np.pi / 4])
# Band of each of the nine harmonics.
BAND = np.array([0, 1, 1, 1, 2, 2, 2, 2, 2])
TO_IRRADIANCE = COSINE[BAND]
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
# Band 1 of the harmonics is (-Y_1 y, Y_1 z, -Y_1 x): indices and signs of x, y and z.
ORDER, SIGN = np.array([3, 1, 2]), np.array([-1.0, -1.0, 1.0])
# Number of directions in which irradiance must not be negative, and bisection steps of the search for the window.
DIRECTIONS, BISECTIONS = 256, 24
MAX_WINDOW = 16.0


def basis(d: np.ndarray) -> np.ndarray:
    """Evaluate the nine harmonics.

    Args:
        d: [N, 3] unit directions.

    Returns:
        [N, 9] float64.
    """
    return np.stack(sh_components(*np.asarray(d, np.float64).T, 3), axis=1)


def directions(count: int) -> np.ndarray:
    """Distribute directions evenly on the sphere, on a Fibonacci spiral.

    Args:
        count: Number of directions, ≥ 1.

    Returns:
        [count, 3] unit directions.
    """
    k = np.arange(count) + 0.5
    z, turn = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=1)


def evaluate(e: np.ndarray, n: np.ndarray) -> np.ndarray:
    """Evaluate irradiance.

    Args:
        e: [N, 9, 3] irradiance harmonics, or [9, 3] for all normals.
        n: [N, 3] unit normals.

    Returns:
        [N, 3] irradiance; may be negative where harmonics ring.
    """
    return np.einsum("nk,...nkc->nc", basis(n), np.broadcast_to(e, (len(n), 9, 3)))


def windowed(e: np.ndarray, kappa: np.ndarray) -> np.ndarray:
    """Attenuate high bands: band l is multiplied by 1 / (1 + κ l² (l + 1)²).

    Args:
        e: [..., 9, 3] irradiance harmonics.
        kappa: [...] strength κ ≥ 0.

    Returns:
        [..., 9, 3] attenuated harmonics.
    """
    squared = (BAND * (BAND + 1.0)) ** 2
    return e / (1 + np.asarray(kappa)[..., None, None] * squared[:, None])


def deringing(e: np.ndarray) -> np.ndarray:
    """Find the least window strength for which irradiance is nowhere negative.

    The states of a light share the largest κ, so that mixing them stays linear.

    Args:
        e: [P, 9, 3] irradiance harmonics, or [S, P, 9, 3] of S states.

    Returns:
        [P] κ for ``windowed``, from 0 to ``MAX_WINDOW``.
    """
    y = basis(directions(DIRECTIONS))
    e = np.asarray(e, np.float64)
    states = e.reshape(-1, *e.shape[-3:])
    e0 = states[..., 0, :].max(axis=-1)

    def good(kappa: np.ndarray) -> np.ndarray:
        window = windowed(states, np.broadcast_to(kappa, states.shape[:2]))
        least = np.einsum("dk,spkc->spdc", y, window).min(axis=(2, 3))
        return (least >= -1e-6 * np.maximum(e0, 1e-30)).all(axis=0)

    low, high = np.zeros(states.shape[1]), np.full(states.shape[1], MAX_WINDOW)
    done = good(low)
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        fine = good(middle)
        low, high = np.where(fine, low, middle), np.where(fine, middle, high)
    return np.where(done, 0.0, high)


def zh3(e: np.ndarray) -> np.ndarray:
    """Encode harmonics as ZH3: bands 0 and 1, and one zonal value per colour about the shared luminance direction ω.

    Reference: Roughton, Sloan, Silvennoinen, Iwanicki and Shirley, ZH3: Quadratic Zonal Harmonics, 2024.

    Args:
        e: [..., 9, 3] irradiance harmonics.

    Returns:
        [..., 5, 3] ZH3 coefficients.
    """
    e = np.asarray(e, np.float64)
    y = basis(axis(e).reshape(-1, 3))[:, 4:].reshape(*e.shape[:-2], 5)
    z = np.sqrt(4 * np.pi / 5) * np.einsum("...k,...kc->...c", y, e[..., 4:, :])
    return np.concatenate([e[..., :4, :], z[..., None, :]], axis=-2)


def axis(e: np.ndarray) -> np.ndarray:
    """Return the luminance direction ω of band 1.

    Args:
        e: [..., 4 or more, 3] irradiance harmonics, or ZH3 coefficients.

    Returns:
        [..., 3] unit directions; +y where band 1 is 0.
    """
    v = np.einsum("...kc,c->...k", e[..., ORDER, :], LUMINANCE) * SIGN
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.where(length > 1e-12, v / np.maximum(length, 1e-12), [0.0, 1.0, 0.0])


def from_zh3(z: np.ndarray) -> np.ndarray:
    """Decode ZH3 coefficients: the zonal harmonic is rotated to ω.

    Args:
        z: [..., 5, 3] ZH3 coefficients.

    Returns:
        [..., 9, 3] irradiance harmonics.
    """
    y = basis(axis(z).reshape(-1, 3))[:, 4:].reshape(*z.shape[:-2], 5)
    band = np.sqrt(4 * np.pi / 5) * y[..., :, None] * z[..., 4:5, :]
    return np.concatenate([z[..., :4, :], band], axis=-2)
