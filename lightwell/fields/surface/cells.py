"""Cells of a scene's surfaces, described for a gate before anything is trained: position, normal, and radiance under
different lights. N samples, K occupied cells, B bins of the light.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.fields.surface.examples import Examples
from lightwell.fields.surface.lattice import VertexLattice
from lightwell.networks.assignment import assign_cells

# The light's range is cut in two this many times: 64 bins.
LIGHT_LEVELS = 6
# Most components of a cell's signature.
SIGNATURE = 8
# Radiance in unit S below which differences do not count; the ε of the loss.
DARK = 0.05
# Weights of normal and signature against position in the first split. On the Cornell box, weights of the signature
# from 0 to 1.5 end within 1 % of each other's error.
NORMAL_WEIGHT, SIGNATURE_WEIGHT = 0.7, 0.7
# Rounds of k-means, and how many of the last ones keep the limits.
MEANS_ROUNDS, BALANCED_ROUNDS = 12, 3


@dataclass(frozen=True)
class Cells:
    """The cells of a lattice that hold samples."""

    number: np.ndarray
    """[K] int64 cell numbers in the lattice, ascending."""
    of_sample: np.ndarray
    """[N] int64 index of each sample's cell in these arrays."""
    weight: np.ndarray
    """[K] float64 share of the samples; the sum is 1."""

    @staticmethod
    def of(lattice: VertexLattice, examples: Examples) -> Cells:
        """Find the cells that samples lie in.

        Args:
            lattice: The lattice.
            examples: N samples.

        Returns:
            The K occupied cells.
        """
        number, of_sample, count = np.unique(lattice.cell(examples.query), return_inverse=True, return_counts=True)
        return Cells(number, of_sample.ravel(), count / count.sum())

    def __len__(self) -> int:
        return len(self.number)

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Average values over the samples of each cell.

        Args:
            values: [N, C] a row per sample.

        Returns:
            [K, C] means.
        """
        count = np.bincount(self.of_sample, minlength=len(self))[:, None]
        return _sums(self.of_sample, values, len(self)) / count

    def pick(self, most: int, seed: int) -> np.ndarray:
        """Draw random samples of each cell.

        Args:
            most: Most samples per cell.
            seed: Seed of the draw.

        Returns:
            Int indices of the samples, ordered by cell.
        """
        order = np.random.default_rng((seed, len(self.of_sample))).permutation(len(self.of_sample))
        order = order[np.argsort(self.of_sample[order], kind="stable")]
        cell = self.of_sample[order]
        place = np.arange(len(order)) - np.searchsorted(cell, cell)
        return order[place < most]


def _sums(group: np.ndarray, values: np.ndarray, groups: int) -> np.ndarray:
    """[groups, C] sums of values [N, C]."""
    return np.stack([np.bincount(group, column, groups) for column in values.T], axis=1)


def light_bins(light: np.ndarray, levels: int = LIGHT_LEVELS) -> np.ndarray:
    """Sort lights into bins of equally many samples.

    The range is halved ``levels`` times at the median of its widest axis; this serves a box, an arc of the sun and a
    fixed light alike.

    Args:
        light: [N, 3] positions or directions of the light.
        levels: Number of halvings, ≥ 0.

    Returns:
        [N] int bin, in [0, 2^levels).
    """
    bins = np.zeros(len(light), np.int64)
    for _ in range(levels):
        bins *= 2
        for number in np.unique(bins):
            rows = np.flatnonzero(bins == number)
            axis = np.ptp(light[rows], axis=0).argmax()
            values = light[rows, axis]
            bins[rows[values > np.median(values)]] += 1
    return bins


def signature(cells: Cells, examples: Examples, size: int = SIGNATURE) -> np.ndarray:
    """Describe how the radiance of each cell depends on the light.

    The log of the mean target per colour and bin of the light, reduced to its principal components. With it a gate
    distinguishes colours and shadows, not only shapes. A bin in which a cell has no sample is filled with the sum of
    the mean deviations of the cell and of the bin.

    Args:
        cells: K cells.
        examples: Their samples.
        size: Most components.

    Returns:
        [K, ≤ size] components.
    """
    bins = light_bins(examples.query.light)
    bins = np.unique(bins, return_inverse=True)[1].ravel()
    columns, target = int(bins.max()) + 1, examples.target
    group = cells.of_sample * columns + bins
    count = np.bincount(group, minlength=len(cells) * columns)
    total = _sums(group, target, len(count))
    answer = np.log(np.maximum(total, 0) / np.maximum(count, 1)[:, None] + DARK).reshape(len(cells), columns, -1)
    known = (count > 0).reshape(len(cells), columns, 1)
    of_cell, of_bin = (_mean(answer, known, axis) for axis in (1, 0))
    answer = np.where(known, answer, of_cell + of_bin - _mean(answer, known, (0, 1)))
    return _main_components(answer.reshape(len(cells), -1), cells.weight, size)


def _mean(values: np.ndarray, known: np.ndarray, axis: int | tuple[int, int]) -> np.ndarray:
    """Mean of the known values along axes, which are kept."""
    return (values * known).sum(axis=axis, keepdims=True) / np.maximum(known.sum(axis=axis, keepdims=True), 1)


def _main_components(rows: np.ndarray, weight: np.ndarray, size: int) -> np.ndarray:
    """[K, ≤ size] coordinates along the directions of greatest weighted variance."""
    centred = rows - weight @ rows
    _, _, directions = np.linalg.svd(centred * np.sqrt(weight)[:, None], full_matrices=False)
    found = directions[:size]
    # The sign of a direction is arbitrary: fix it, so that all machines agree.
    largest = np.take_along_axis(found, np.abs(found).argmax(axis=1)[:, None], axis=1)
    return centred @ (found * np.sign(largest)).T


def describe(cells: Cells, examples: Examples) -> np.ndarray:
    """Describe each cell by position, normal and signature, each scaled to a weighted variance of its own.

    Args:
        cells: K cells.
        examples: Their samples.

    Returns:
        [K, 6 + ≤ 8] descriptions.
    """
    query = examples.query
    parts = [cells.mean(query.position), cells.mean(query.normal), signature(cells, examples)]
    scaled = []
    for part, importance in zip(parts, (1.0, NORMAL_WEIGHT, SIGNATURE_WEIGHT)):
        part = part - cells.weight @ part
        spread = np.sqrt((cells.weight @ part**2).sum())
        scaled.append(part * (importance / max(spread, 1e-9)))
    return np.concatenate(scaled, axis=1)


def balanced_means(
    points: np.ndarray, weight: np.ndarray, experts: int, limits: tuple[float, float], seed: int
) -> np.ndarray:
    """Cluster points by k-means whose last rounds keep the weight of every cluster within limits.

    It starts from k-means++ (Arthur & Vassilvitskii 2007). An empty cluster takes the point farthest from its centre.

    Args:
        points: [K, C] points.
        weight: [K] weights; their sum is 1.
        experts: Number of clusters.
        limits: Least and greatest weight of a cluster.
        seed: Seed of the start.

    Returns:
        [K] int cluster of each point.
    """
    centres = _spread_out(points, weight, experts, np.random.default_rng(seed))
    for k in range(MEANS_ROUNDS):
        cost = _squared_distances(points, centres)
        free = k < MEANS_ROUNDS - BALANCED_ROUNDS
        cluster = cost.argmin(axis=1) if free else assign_cells(cost, weight, *limits)
        total = np.bincount(cluster, weight, experts)
        moved = _sums(cluster, points * weight[:, None], experts) / np.maximum(total, 1e-30)[:, None]
        worst = np.argsort(-cost.min(axis=1), kind="stable")[: int((total == 0).sum())]
        moved[np.flatnonzero(total == 0)[: len(worst)]] = points[worst]
        centres = moved
    return cluster


def _spread_out(points: np.ndarray, weight: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """[count, C] points drawn by weight times squared distance to those drawn before."""
    chosen = [int(rng.choice(len(points), p=weight / weight.sum()))]
    while len(chosen) < count:
        away = weight * _squared_distances(points, points[chosen]).min(axis=1)
        chosen.append(int(rng.choice(len(points), p=away / away.sum())) if away.sum() > 0 else chosen[0])
    return points[chosen]


def _squared_distances(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """[len(a), len(b)]."""
    return ((a[:, None] - b) ** 2).sum(axis=2)
