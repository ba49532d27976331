"""Rows that belong to groups: sorting into runs, and evaluation of one network per group in one launch.

Notation: E groups (experts, leaves), N rows, F features, K blocks of V rows each.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.backend import dr, mi, upload_integers
from lightwell.networks.device import tensor, tensors
from lightwell.networks.mlp import Mlp

# Rows that one launch evaluates; bounds memory.
ROWS_AT_ONCE = 1 << 19
# Rows of a block, which all share one network: between these, near the mean size of a group.
FEWEST_IN_BLOCK, MOST_IN_BLOCK = 16, 512


@dataclass(frozen=True)
class Runs:
    """Rows of a table that belong to E groups, each a contiguous run."""

    first: np.ndarray
    """[E] int64, the first row of each group."""
    count: np.ndarray
    """[E] int64, the number of rows of each group; may be 0."""

    def __len__(self) -> int:
        return len(self.first)

    @property
    def group(self) -> np.ndarray:
        """Group of each row in table order, [N] int64."""
        return np.repeat(np.arange(len(self)), self.count)

    def mean(self, values: np.ndarray, weight: np.ndarray | None = None) -> np.ndarray:
        """Average values by group.

        Args:
            values: [N] values in table order.
            weight: [N] weights; None: 1.

        Returns:
            [E] means; NaN for groups without rows or weight.
        """
        weight = np.ones(len(values)) if weight is None else weight
        total = np.bincount(self.group, values * weight, minlength=len(self))
        with np.errstate(invalid="ignore", divide="ignore"):
            return total / np.bincount(self.group, weight, minlength=len(self))


def sort_into_runs(group: np.ndarray, groups: int, seed: Any) -> tuple[np.ndarray, Runs]:
    """Order rows so that every group is a contiguous run, randomly permuted inside.

    Args:
        group: [N] int group of each row, −1 … groups − 1; rows of group −1 are left out.
        groups: Number of groups.
        seed: Seed of the permutation; the same seed and groups give the same order.

    Returns:
        [M] row numbers, and the runs.
    """
    shuffled = np.random.default_rng(seed).permutation(len(group))
    shuffled = shuffled[group[shuffled] >= 0]
    order = shuffled[np.argsort(group[shuffled], kind="stable")]
    count = np.bincount(group[order], minlength=groups).astype(np.int64)
    return order, Runs(np.concatenate([[0], np.cumsum(count)[:-1]]).astype(np.int64), count)


class GroupedRows:
    """Feature rows on the device, in blocks that belong to one group each, for repeated evaluation by E networks."""

    def __init__(self, features: np.ndarray, group: np.ndarray, groups: int) -> None:
        """Copy rows to the device.

        Args:
            features: [N, F] inputs.
            group: [N] int group of each row, 0 … groups − 1, in any order.
            groups: Number of groups.
        """
        self.count = len(features)
        order = np.argsort(group, kind="stable")
        counts = np.bincount(group, minlength=groups)
        size = self._block_size(counts)
        # Place of each sorted row: its group's first block, then row by row.
        blocks = -(-counts // size)
        start = np.concatenate([[0], np.cumsum(blocks)[:-1]]) * size
        first = np.concatenate([[0], np.cumsum(counts)[:-1]])
        sorted_group = group[order]
        place = start[sorted_group] + np.arange(self.count) - first[sorted_group]
        padded = np.zeros((int(blocks.sum()) * size, features.shape[1]), np.float32)
        padded[place] = features[order]
        # Place of the caller's row n among the padded rows.
        self._place = np.empty(self.count, np.int64)
        self._place[order] = place
        owner = np.repeat(np.arange(groups), blocks)
        self._chunks = []
        step = max(ROWS_AT_ONCE // size, 1)
        for begin in range(0, len(owner), step):
            rows = padded[begin * size : (begin + step) * size].reshape(-1, size, features.shape[1])
            self._chunks.append((tensor(rows), upload_integers(owner[begin : begin + step])))

    @staticmethod
    def _block_size(counts: np.ndarray) -> int:
        used = counts[counts > 0]
        mean = int(used.mean()) if len(used) else FEWEST_IN_BLOCK
        return int(min(max(1 << (mean.bit_length() - 1), FEWEST_IN_BLOCK), MOST_IN_BLOCK))

    def evaluate(self, mlp: Mlp, parameters: Mapping[str, Any]) -> np.ndarray:
        """Evaluate each row by the network of its group.

        Args:
            mlp: Shape of the networks.
            parameters: Weights, [E, ...] arrays or tensors.

        Returns:
            [N, out] outputs, in the order of the rows.
        """
        parameters = tensors({name: np.asarray(value) for name, value in parameters.items()})
        out = [np.zeros((0, mlp.sizes[-1]), np.float32)]
        with dr.suspend_grad():
            for rows, owner in self._chunks:
                own = {name: _pick(value, owner) for name, value in parameters.items()}
                out.append(np.array(mlp(own, rows)).reshape(-1, mlp.sizes[-1]))
        return np.concatenate(out)[self._place]


def _pick(table: Any, index: Any) -> Any:
    """Gather slices [K, a, b] of a tensor [E, a, b], one per index [K]."""
    _, a, b = table.shape
    at = dr.arange(mi.UInt32, dr.width(index) * a * b)
    owner = dr.gather(mi.UInt32, index, at // (a * b))
    return mi.TensorXf(dr.gather(mi.Float, table.array, owner * (a * b) + at % (a * b)), (dr.width(index), a, b))
