"""How many pictures the light of K groups of lamps needs: a non-negative factorisation of low rank.

    E'_k ≈ Σ_r A_kr B_r,   A ≥ 0,   B ≥ 0,   for red, green and blue apart

Neither factor is negative, so that a share never is, and a lamp that is switched off leaves nothing. Lamps that light
the same places share a picture. The number of pictures is the smallest whose error is below ``ENOUGH`` for the lamp
that is worst off, at most ``MOST_PICTURES``. Factors are found on means of many texels, where noise is small.

Notation: T texels, C cells (squares of texels), K groups, R pictures. Light of each group is in a unit of its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.networks.losses import EPSILON

# Pictures of the light of lamps: a shader has 16 textures, of which features, mask and a material's own take ten.
MOST_PICTURES = 6
# Mean relative error of a lamp that another picture would not be worth.
ENOUGH = 0.02
# Cells along the edge of an atlas, at most.
CELLS = 96
# Sweeps of the updates: of both factors on cells, of the pictures alone on texels.
SWEEPS, TEXEL_SWEEPS = 200, 60
# What lamps outside of a cluster begin with, and texels that are fitted at a time.
BEGIN, TEXELS_AT_ONCE = 1e-2, 1 << 16
# Share of the mean light that is added to the light of a cell where cells are weighed: the dark is not all.
LEVEL = 0.1


@dataclass(frozen=True)
class LampFactors:
    """The light of K lamps as R pictures."""

    weights: np.ndarray
    """[K, R, 3] A, ≥ 0."""
    errors: tuple[float, ...]
    """Mean relative error of each lamp that the low rank leaves."""

    @property
    def rank(self) -> int:
        """R."""
        return self.weights.shape[1]


def cells_of(index: np.ndarray, size: int, shares: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Average texels over squares of an atlas.

    Args:
        index: [T] row-major numbers of the texels.
        size: Texels along the edge of the atlas.
        shares: [T, K, 3] light of each lamp.

    Returns:
        [C, K, 3] means, and [C] texels of each cell.
    """
    factor = -(-size // CELLS)
    y, x = np.divmod(index, size)
    edge = -(-size // factor)
    cell = y // factor * edge + x // factor
    count = np.bincount(cell, minlength=edge * edge)
    used = count > 0
    means = np.empty((int(used.sum()), *shares.shape[1:]))
    for k in range(shares.shape[1]):
        for c in range(3):
            means[:, k, c] = np.bincount(cell, shares[:, k, c].astype(np.float64), len(count))[used] / count[used]
    return means, count[used]


def factorised(cells: np.ndarray, count: np.ndarray, most: int = MOST_PICTURES, enough: float = ENOUGH) -> LampFactors:
    """Choose the number of pictures, and what each lamp takes of each.

    Args:
        cells: [C, K, 3] light of each lamp, in a unit of its own, ≥ 0.
        count: [C] texels of each cell.
        most: Largest number of pictures.
        enough: Error of the worst lamp that ends the search.

    Returns:
        The factors; with a picture for each lamp they are exact.
    """
    lamps = cells.shape[1]
    brightness = cells.mean(axis=(1, 2))
    weight = np.sqrt(count) / (brightness + LEVEL * np.average(brightness, weights=count) + 1e-30)
    for rank in range(1, min(lamps, most + 1)):
        found = _of_rank(cells, count, weight, rank)
        if max(found.errors) <= enough or rank == most:
            return found
    return LampFactors(np.repeat(np.eye(lamps)[:, :, None], 3, axis=2), (0.0,) * lamps)


def _of_rank(cells: np.ndarray, count: np.ndarray, weight: np.ndarray, rank: int) -> LampFactors:
    """Factors of a rank, which begin with clusters of lamps that light the same places."""
    data = np.ascontiguousarray((cells * weight[:, None, None]).transpose(2, 0, 1))
    cluster = _clusters(np.einsum("xtk,xtl->kl", data, data), rank)
    member = cluster[:, None] == np.arange(rank)
    A = np.repeat(np.where(member, 1.0, BEGIN)[None], 3, axis=0)
    B = np.stack([data[..., member[:, r]].mean(axis=2) for r in range(rank)], axis=2)
    for _ in range(SWEEPS):
        _sweep(A, np.einsum("xtk,xtr->xkr", data, B), np.einsum("xtr,xts->xrs", B, B))
        _sweep(B, np.einsum("xtk,xkr->xtr", data, A), np.einsum("xkr,xks->xrs", A, A))
    # The largest share of a picture is 1: what is stored then has the size of the light of a lamp.
    scale = np.maximum(A.max(axis=1, keepdims=True), 1e-30)
    A, B = A / scale, B * scale
    f = (B @ A.transpose(0, 2, 1)).transpose(1, 2, 0) / weight[:, None, None]
    return LampFactors(np.ascontiguousarray(A.transpose(1, 2, 0)), tuple(_errors(f, cells, count)))


def _errors(f: np.ndarray, y: np.ndarray, count: np.ndarray) -> list[float]:
    """Mean of |f − y| over the larger of both, of each lamp."""
    level = 4 * EPSILON * np.average(y.mean(axis=2), axis=0, weights=count)
    relative = np.abs(f - y) / (np.maximum(f, y) + level[:, None] + 1e-30)
    return [float(e) for e in np.average(relative.mean(axis=2), axis=0, weights=count)]


def _sweep(values: np.ndarray, products: np.ndarray, gram: np.ndarray) -> None:
    """One sweep of hierarchical alternating least squares (Cichocki et al. 2007), in place: values [.., n, R]."""
    for r in range(values.shape[-1]):
        own = np.maximum(gram[..., r, r], 1e-30)[..., None]
        rest = (values @ gram[..., :, r, None])[..., 0] - values[..., r] * gram[..., r, r][..., None]
        values[..., r] = np.maximum((products[..., r] - rest) / own, 0)


def _clusters(gram: np.ndarray, count: int) -> np.ndarray:
    """[K] numbers below ``count``: lamps are joined, those first that lose least by sharing a picture."""
    gram, members = gram.copy(), [[k] for k in range(len(gram))]
    while len(members) > count:
        energy = np.diagonal(gram)
        alike = np.square(gram) / np.maximum(np.outer(energy, energy), 1e-300)
        cost = np.minimum.outer(energy, energy) * (1 - alike)
        cost[np.tril_indices(len(cost))] = np.inf
        i, j = np.unravel_index(int(np.argmin(cost)), cost.shape)
        gram[i] += gram[j]
        gram[:, i] += gram[:, j]
        gram = np.delete(np.delete(gram, j, axis=0), j, axis=1)
        members[i] += members.pop(j)
    cluster = np.empty(sum(map(len, members)), np.int64)
    for number, lamps in enumerate(members):
        cluster[lamps] = number
    return cluster


def pictures_of(shares: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Find the pictures that give the light of lamps best, texel by texel.

    Args:
        shares: [T, K, 3] light of each lamp, ≥ 0.
        weights: [K, R, 3] A.

    Returns:
        [T, R, 3] float32 B, ≥ 0.
    """
    lamps, rank = weights.shape[:2]
    if lamps == rank and np.array_equal(weights, np.repeat(np.eye(lamps)[:, :, None], 3, axis=2)):
        return shares.astype(np.float32)
    A = weights.transpose(2, 0, 1)
    gram = np.einsum("xkr,xks->xrs", A, A)
    out = np.empty((len(shares), rank, 3), np.float32)
    for start in range(0, len(shares), TEXELS_AT_ONCE):
        part = np.ascontiguousarray(shares[start : start + TEXELS_AT_ONCE].transpose(2, 0, 1), np.float64)
        products, B = part @ A, np.zeros((3, part.shape[1], rank))
        for _ in range(TEXEL_SWEEPS):
            _sweep(B, products, gram)
        out[start : start + TEXELS_AT_ONCE] = B.transpose(1, 2, 0)
    return out
