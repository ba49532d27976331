"""Host side of the guide: sums over training records, and the table that is computed from them.

Notation: R cells with records (rows of the sums), K rows of the finished table.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from lightwell.backend import dr, mi, upload_floats, upload_integers
from lightwell.cache.guide import BINS, FACES, LOG2, NODES, OFFSETS, SIDE, Guide

# Cells along the longest edge of the scene's box.
LONGEST = 24
# Effective records at which a cell's own distribution (level) has the same weight as that of the enclosing cell.
PRIOR, PRIOR_LEVEL = 16.0, 8.0
# Records are clamped to this multiple of the mean of their cell; share of the uniform distribution in every row.
CAP, FLOOR = 50.0, 0.02
# Factor of the sums from one frame to the next; factor when the scene changes.
KEPT, KEPT_AFTER_CHANGE = 0.97, 0.05
# Columns of the sums.
SUMS = 5
# Frames between two builds of the table, in addition to those whose number is a power of two.
EVERY = 8


class GuideTable:
    """Sums of scattered radiance by cell and direction, from which ``Guide`` is built."""

    def __init__(self, box: np.ndarray, share: float, longest: int = LONGEST) -> None:
        """Make an empty table.

        Args:
            box: [2, 3] corners of the scene's box, metres.
            share: Probability that a vertex samples the guide and not its BSDF, in [0, 1).
            longest: Cells along the longest edge of the box, ≥ 1.
        """
        edge = np.asarray(box[1] - box[0], np.float64)
        self.cells = np.maximum(1, np.ceil(edge / edge.max() * longest - 1e-6)).astype(np.int64)
        """Cells along x, y, z."""
        self.share = share
        self.row_of = np.full(int(np.prod(self.cells)) * FACES, -1, np.int64)
        """[cells * FACES] row of the sums, -1: no records."""
        self.keys = np.zeros(0, np.int64)
        """[R] cell of each row."""
        self.bins = np.zeros((0, BINS))
        """[R, BINS] sums of scattered radiance by the incident direction, without light sampling."""
        self.sums = np.zeros((0, SUMS))
        """[R, 5] number of records; sums of that radiance and of its square; those of all scattered radiance."""
        self.frames = 0
        """Frames added since the scene changed."""
        self.made: Guide | None = None
        """Table for kernels as it was last built; None: it must be rebuilt."""
        self._levels = np.zeros(0)

    @property
    def opaque_cells(self) -> mi.Vector3f:
        """Return ``cells`` as opaque numbers for kernels.

        Returns:
            Cells along x, y, z.
        """
        return mi.Vector3f(*[dr.opaque(mi.Float, float(n)) for n in self.cells])

    @property
    def opaque_share(self) -> mi.Float:
        """Return ``share`` as an opaque number for kernels.

        Returns:
            Probability in [0, 1).
        """
        return dr.opaque(mi.Float, self.share)

    def forget(self) -> None:
        """Reduce the weight of all sums after a change of the scene."""
        self.bins *= KEPT_AFTER_CHANGE
        self.sums *= KEPT_AFTER_CHANGE
        self.frames = 0

    def add(
        self, keys: np.ndarray, bins: np.ndarray, met: np.ndarray, reach: np.ndarray, whole: np.ndarray
    ) -> None:  # fmt: skip
        """Add the records of one frame.

        The radiance that the next vertex of a path scatters is read from the table: the mean of its cell has far less
        variance than one path (expected SARSA; Dahm and Keller 2017, *Learning Light Transport the Reinforced Way*).

        Args:
            keys: [N] numbers of cells.
            bins: [N] bins of the directions; -1: no record.
            met: [N] luminance that arrived from the direction, up to the next record.
            reach: [N] factor of the luminance that the record in the next place scatters.
            whole: [N] luminance scattered by the vertex, light sampling included.
        """
        self.frames += 1
        finite = np.isfinite(met) & np.isfinite(reach) & np.isfinite(whole)
        ok = (bins >= 0) & (bins < BINS) & finite & (keys < len(self.row_of))
        if not ok.any():
            return
        place = np.flatnonzero(ok)
        keys = keys.astype(np.int64)
        self._meet(np.unique(keys[place]))
        row, R = self.row_of[keys[place]], len(self.keys)
        count = np.bincount(row, minlength=R)
        total: Callable[[np.ndarray], np.ndarray] = lambda value: np.bincount(row, value, R)  # noqa: E731
        capped: Callable[..., np.ndarray] = lambda y, mean: np.minimum(y, CAP * mean[row])  # noqa: E731
        whole = np.maximum(whole[place], 0).astype(np.float64)
        whole = capped(whole, (total(whole) + self.sums[:, 3] + 4 * whole.mean()) / (count + self.sums[:, 0] + 4))
        self.sums *= KEPT
        self.sums[:, 0] += count
        self.sums[:, 3] += total(whole)
        self.sums[:, 4] += total(whole * whole)
        self._levels = self._level_of_rows()
        after = self.row_of[keys[np.minimum(place + 1, len(keys) - 1)]]
        y = np.maximum(met[place] + reach[place] * np.where(after >= 0, self._levels[after], 0), 0).astype(np.float64)
        y = capped(y, (total(y) + self.sums[:, 1] + 4 * y.mean()) / (self.sums[:, 0] + 4))
        bins = row * BINS + bins[place].astype(np.int64)
        self.bins = KEPT * self.bins + np.bincount(bins, y, R * BINS).reshape(R, BINS)
        self.sums[:, 1] += total(y)
        self.sums[:, 2] += total(y * y)
        if self._due():
            self.made = None

    def _due(self) -> bool:
        """Whether the table is rebuilt after this frame."""
        return self.frames & (self.frames - 1) == 0 or self.frames % EVERY == 0

    def _meet(self, keys: np.ndarray) -> None:
        """Add rows for cells without one."""
        new = keys[self.row_of[keys] < 0]
        self.row_of[new] = len(self.keys) + np.arange(len(new))
        self.keys = np.concatenate([self.keys, new])
        self.bins = np.concatenate([self.bins, np.zeros((len(new), BINS))])
        self.sums = np.concatenate([self.sums, np.zeros((len(new), SUMS))])

    def restore(self, keys: np.ndarray, bins: np.ndarray, sums: np.ndarray, frames: int) -> None:
        """Restore sums that were saved.

        Args:
            keys: [R] numbers of cells.
            bins: [R, ``BINS``] sums by direction.
            sums: [R, ``SUMS``] sums by cell.
            frames: Frames added since the last change of the scene.
        """
        self.keys, self.bins, self.sums, self.frames = keys, bins.astype(np.float64), sums, frames
        self.row_of[keys] = np.arange(len(keys))
        self.made = None

    def guide(self) -> Guide:
        """Return the table for kernels; it is rebuilt when ``made`` is None.

        Returns:
            The table on the device.
        """
        if self.made is None:
            self.made = on_device(*self.table(), self.opaque_cells, self.opaque_share)
        return self.made

    def _boxes(self) -> Iterator[tuple[int, np.ndarray, np.ndarray, np.ndarray]]:
        """Iterate over the boxes with records, from the whole box down to single cells.

        Yields (logarithm of the edge in cells, keys of the boxes, a row of the sums in each, box of each row).
        """
        x, y, _ = self.cells
        cell, face = self.keys // FACES, self.keys % FACES
        at = np.stack([cell % x, cell // x % y, cell // (x * y)])
        for k in range(int(np.ceil(np.log2(self.cells.max()))) if len(self.keys) else -1, -1, -1):
            nx, ny, _ = ((self.cells - 1) >> k) + 1
            key = (((at[2] >> k) * ny + (at[1] >> k)) * nx + (at[0] >> k)) * FACES + face
            yield k, *np.unique(key, return_index=True, return_inverse=True)

    def _box_sums(self) -> Iterator[tuple[Any, tuple[np.ndarray, np.ndarray]]]:
        """Iterate over the boxes as ``_boxes``, with their sums, which are added up from those of the boxes within."""
        boxes, within = list(self._boxes()), np.arange(len(self.keys))
        bins, sums = self.bins, self.sums
        levels = []
        for one in reversed(boxes):
            _, _, first, box = one
            bins, sums = _grouped(bins, box[within]), _grouped(sums, box[within])
            levels.append((one, (bins, sums)))
            within = first
        yield from reversed(levels)

    def _level_of_rows(self) -> np.ndarray:
        """[R] mean scattered luminance of the cells, shrunk towards those of the enclosing boxes."""
        level: Any = None
        for _, _, first, box in self._boxes():
            sums = np.stack([np.bincount(box, column) for column in self.sums.T], 1)
            level = _level(sums, None if level is None else level[first])[box]
        return level

    def table(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Compute the finished table.

        From the whole box down to single cells, the distribution of a box is its own mean, shrunk towards that of the
        enclosing box where there are few records or a few dominant ones. Cells without records have the row of the
        smallest enclosing box with records.

        Returns:
            Row of each cell [cells * ``FACES``], probabilities [K, ``BINS``] and levels [K]; row 0 means no data.
        """
        x, y, z = self.cells
        dense = np.zeros((z, y, x, FACES), np.int64)
        index = np.meshgrid(np.arange(z), np.arange(y), np.arange(x), indexing="ij")
        shares, levels, rows = [np.full((1, BINS), 1 / BINS)], [np.zeros(1)], 1
        around: np.ndarray | None = None
        for (k, found, first, box), (bins, sums) in self._box_sums():
            nx, ny, nz = ((self.cells - 1) >> k) + 1
            shares.append(_shrunk(bins, sums, shares[0] if around is None else shares[-1][around[first]]))
            levels.append(_level(sums, None if around is None else levels[-1][around[first]]))
            coarse = np.zeros(nx * ny * nz * FACES, np.int64)
            coarse[found] = rows + np.arange(len(found))
            spread = coarse.reshape(nz, ny, nx, FACES)[index[0] >> k, index[1] >> k, index[2] >> k]
            dense = np.where(spread > 0, spread, dense)
            rows += len(found)
            around = box
        p = np.concatenate(shares)
        return dense.ravel(), (1 - FLOOR) * p + FLOOR / BINS, np.concatenate(levels)


def _grouped(values: np.ndarray, group: np.ndarray) -> np.ndarray:
    """Sums of rows [R, n] by group [R]; every group has a row."""
    order = np.argsort(group, kind="stable")
    return np.add.reduceat(values[order], np.searchsorted(group[order], np.arange(group.max() + 1)), axis=0)


def _effective(total: np.ndarray, square: np.ndarray) -> np.ndarray:
    """Effective number of records: that of equal records with the same relative variance of the mean."""
    return np.where(square > 0, total * total / np.maximum(square, 1e-300), 0)


def _shrunk(bins: np.ndarray, sums: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """Distribution [R, BINS] of boxes, shrunk towards those of the enclosing boxes."""
    effective = _effective(sums[:, 1], sums[:, 2])[:, None]
    mean = bins / np.maximum(bins.sum(1, keepdims=True), 1e-300)
    p = effective * mean + PRIOR * prior
    return p / p.sum(1, keepdims=True)


def _level(sums: np.ndarray, prior: np.ndarray | None) -> np.ndarray:
    """Mean scattered luminance [R] of boxes, shrunk towards those of the enclosing boxes."""
    mean = sums[:, 3] / np.maximum(sums[:, 0], 1e-9)
    if prior is None:
        return mean
    effective = _effective(sums[:, 3], sums[:, 4])
    return (effective * mean + PRIOR_LEVEL * prior) / (effective + PRIOR_LEVEL)


def tree_of(p: np.ndarray) -> np.ndarray:
    """Compute the conditional probabilities of a quadtree over bins.

    Args:
        p: [K, ``BINS``] probabilities of bins, > 0.

    Returns:
        [K, ``NODES``, 4] probabilities of the children of each node, given the node.
    """
    K = len(p)
    tree = np.zeros((K, NODES, 4), np.float32)
    q = p.reshape(K, SIDE, SIDE)
    for k in range(LOG2 - 1, -1, -1):
        half = 1 << k
        children = q.reshape(K, half, 2, half, 2)
        q = children.sum(axis=(2, 4))
        nodes = children.transpose(0, 1, 3, 2, 4).reshape(K, half * half, 4)
        tree[:, OFFSETS[k] : OFFSETS[k + 1]] = nodes / q.reshape(K, half * half, 1)
    return tree


def on_device(rows: np.ndarray, p: np.ndarray, level: np.ndarray, cells: mi.Vector3f, share: mi.Float) -> Guide:
    """Copy a table to the device.

    Args:
        rows: [cells * ``FACES``] row of each cell.
        p: [K, ``BINS``] probabilities of bins, > 0.
        level: [K] mean scattered luminance.
        cells: Cells along the axes.
        share: Probability that a vertex samples the guide.

    Returns:
        ``Guide`` with these arrays.
    """
    guide = Guide()
    guide.cells = cells
    guide.rows = upload_integers(rows)
    guide.tree = upload_floats(tree_of(p).ravel())
    guide.density = upload_floats((p * (BINS / (4 * np.pi))).ravel())
    guide.level = upload_floats(level)
    guide.share = share
    dr.eval(guide)
    return guide
