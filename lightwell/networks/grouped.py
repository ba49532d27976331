"""Rows that belong to groups: sorting them into runs, and evaluating one network per group on all of them at once.

Notation: E groups (experts, leaves), N rows, F features, K blocks of V rows each.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.networks.device import integers, tensor, tensors
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
    """[E] int64, how many rows it has; may be 0."""

    def __len__(self) -> int:
        return len(self.first)

    @property
    def group(self) -> np.ndarray:
        """[N] int64, the group of each row in table order."""
        return np.repeat(np.arange(len(self)), self.count)

    def mean(self, values: np.ndarray, weight: np.ndarray | None = None) -> np.ndarray:
        """[E] (weighted) mean of [N] values in table order; NaN for groups without rows or weight."""
        weight = np.ones(len(values)) if weight is None else weight
        total = np.bincount(self.group, values * weight, minlength=len(self))
        with np.errstate(invalid="ignore", divide="ignore"):
            return total / np.bincount(self.group, weight, minlength=len(self))


def sort_into_runs(group: np.ndarray, groups: int, seed: Any) -> tuple[np.ndarray, Runs]:
    """Order that makes every group a contiguous run, randomly permuted inside; rows of group −1 are left out.

    group   [N] int, −1 … groups − 1.
    Returns ([M] row numbers, the runs). The same seed and groups give the same order.
    """
    shuffled = np.random.default_rng(seed).permutation(len(group))
    shuffled = shuffled[group[shuffled] >= 0]
    order = shuffled[np.argsort(group[shuffled], kind="stable")]
    count = np.bincount(group[order], minlength=groups).astype(np.int64)
    return order, Runs(np.concatenate([[0], np.cumsum(count)[:-1]]).astype(np.int64), count)


class GroupedRows:
    """Feature rows on the device, packed into blocks of one group each, to be evaluated by E networks many times."""

    def __init__(self, features: np.ndarray, group: np.ndarray, groups: int) -> None:
        """features [N, F]; group [N] int in 0 … groups − 1, in any order."""
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
        # Where row n of the caller lies among the padded rows.
        self._place = np.empty(self.count, np.int64)
        self._place[order] = place
        owner = np.repeat(np.arange(groups), blocks)
        self._chunks = []
        step = max(ROWS_AT_ONCE // size, 1)
        for begin in range(0, len(owner), step):
            rows = padded[begin * size : (begin + step) * size].reshape(-1, size, features.shape[1])
            self._chunks.append((tensor(rows), integers(owner[begin : begin + step])))

    @staticmethod
    def _block_size(counts: np.ndarray) -> int:
        used = counts[counts > 0]
        mean = int(used.mean()) if len(used) else FEWEST_IN_BLOCK
        return int(min(max(1 << (mean.bit_length() - 1), FEWEST_IN_BLOCK), MOST_IN_BLOCK))

    def evaluate(self, mlp: Mlp, parameters: Mapping[str, Any]) -> np.ndarray:
        """[N, out] outputs, each row by the network of its group; parameters [E, …] arrays or tensors."""
        parameters = tensors({name: np.asarray(value) for name, value in parameters.items()})
        out = [np.zeros((0, mlp.sizes[-1]), np.float32)]
        with dr.suspend_grad():
            for rows, owner in self._chunks:
                own = {name: _pick(value, owner) for name, value in parameters.items()}
                out.append(np.array(mlp(own, rows)).reshape(-1, mlp.sizes[-1]))
        return np.concatenate(out)[self._place]


def _pick(table: Any, index: Any) -> Any:
    """Slices [K, a, b] of a tensor [E, a, b], one per index [K]."""
    _, a, b = table.shape
    at = dr.arange(mi.UInt32, dr.width(index) * a * b)
    owner = dr.gather(mi.UInt32, index, at // (a * b))
    return mi.TensorXf(dr.gather(mi.Float, table.array, owner * (a * b) + at % (a * b)), (dr.width(index), a, b))
