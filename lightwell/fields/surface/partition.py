"""A partition of the scene's box by splits in the middle, as a growing binary tree. L leaves, n interior nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.files import Arrays


@dataclass
class Partition:
    """A partition of a box. When leaf i is split, its lower half keeps the number i; the upper half gets the next free
    number.
    """

    nodes: np.ndarray
    """[n, 4] float32 rows (axis, threshold, below, above); a child −1 − i is leaf i, another one a later row."""
    low: np.ndarray
    """[L, 3] float32, metres."""
    high: np.ndarray
    depth: np.ndarray
    """[L] splits above each leaf."""

    @staticmethod
    def of_box(low: np.ndarray, high: np.ndarray) -> Partition:
        """Make a partition with one leaf.

        Args:
            low: [3] smallest corner, metres.
            high: [3] greatest corner, metres.

        Returns:
            The partition.
        """
        low, high = (np.asarray(c, np.float32).reshape(1, 3) for c in (low, high))
        return Partition(np.zeros((0, 4), np.float32), low, high, np.zeros(1, np.int64))

    def __len__(self) -> int:
        return len(self.depth)

    def middle(self, leaf: np.ndarray | int) -> np.ndarray:
        """Return the centres of leaves, where they would be split.

        Args:
            leaf: [K] int leaves.

        Returns:
            [K, 3] float32 centres, metres.
        """
        return np.float32(0.5) * (self.low[leaf] + self.high[leaf])

    def split(self, leaf: int, axis: int) -> int:
        """Split a leaf in the middle.

        Args:
            leaf: Number of the leaf.
            axis: Axis of the cut, 0 to 2.

        Returns:
            Number of the upper half.
        """
        threshold = self.middle(leaf)[axis]
        upper, row = len(self), len(self.nodes)
        for column in (2, 3):
            self.nodes[self.nodes[:, column] == -1 - leaf, column] = row
        added = np.array([[axis, threshold, -1 - leaf, -1 - upper]], np.float32)
        self.nodes = np.concatenate([self.nodes, added])
        self.depth[leaf] += 1
        self.low, self.high = (np.concatenate([a, a[leaf : leaf + 1]]) for a in (self.low, self.high))
        self.depth = np.append(self.depth, self.depth[leaf])
        self.high[leaf, axis] = self.low[upper, axis] = threshold
        return upper

    def locate(self, position: np.ndarray) -> np.ndarray:
        """Find the leaf of each position; on a threshold the upper leaf, as the graph's op ``tree`` does.

        Args:
            position: [N, 3] float32 positions, metres.

        Returns:
            [N] int64 leaf.
        """
        return walk(self.rows, position)

    @property
    def levels(self) -> int:
        """Levels of interior nodes, at least 1: the parameter ``depth`` of the op ``tree``."""
        return max(int(self.depth.max()), 1)

    @property
    def rows(self) -> np.ndarray:
        """The nodes for the op ``tree``: a single leaf is a node with two equal sides."""
        return self.nodes if len(self.nodes) else np.array([[0, 0, -1, -1]], np.float32)

    @staticmethod
    def of(arrays: Arrays) -> Partition:
        """Restore a partition.

        Args:
            arrays: The result of ``arrays`` by name: nodes [n, 4], low and high [L, 3], depth [L]. A missing name is a
                ``KeyError``.

        Returns:
            The partition.

        Raises:
            ValueError: The arrays do not describe a partition.
        """
        found = Partition(*(arrays[name] for name in ("nodes", "low", "high", "depth")))
        leaves = len(found)
        for name, value in (("low", found.low), ("high", found.high)):
            if value.shape != (leaves, 3) or value.dtype != np.float32:
                raise ValueError(f"'{name}' is not a corner of each of {leaves} leaves")
        if leaves < 1 or len(found.nodes) != leaves - 1 or found.depth.dtype.kind != "i" or (found.depth < 0).any():
            raise ValueError(f"{len(found.nodes)} nodes do not make {leaves} leaves")
        check_nodes(found.nodes, leaves, 3)
        return found

    def arrays(self) -> Arrays:
        """Return the arrays of a checkpoint.

        Returns:
            Arrays by name.
        """
        return {"nodes": self.nodes, "low": self.low, "high": self.high, "depth": self.depth}


def check_nodes(nodes: np.ndarray, leaves: int, columns: int, depth: int | None = None) -> None:
    """Refuse rows of the op ``tree`` that no tree has: children come after their parents, leaves exist.

    Args:
        nodes: [n, 4] axis, threshold, child or -1 - leaf below, the same above.
        leaves: Number of leaves.
        columns: Number of values that an axis may choose from.
        depth: Levels of interior nodes that must suffice; None: not checked.

    Raises:
        ValueError: The rows are not such a tree.
    """
    if nodes.ndim != 2 or nodes.shape[1] != 4 or nodes.dtype != np.float32 or not np.isfinite(nodes).all():
        raise ValueError("'nodes' is not rows of four numbers")
    axis, sides = nodes[:, 0], nodes[:, 2:]
    row = np.arange(len(nodes))[:, None]
    good = (axis >= 0) & (axis < columns) & (axis == np.floor(axis))
    good = good[:, None] & (sides == np.floor(sides)) & (sides < len(nodes)) & (sides >= -leaves)
    if not (good & ((sides < 0) | (sides > row))).all():
        raise ValueError("'nodes' names an axis, a node or a leaf that does not exist")
    level = np.ones(len(nodes), np.int64)
    for parent, (below, above) in enumerate(sides.astype(np.int64)):
        for child in (below, above):
            if child > 0:
                level[child] = level[parent] + 1
    if depth is not None and level.max(initial=1) > depth:
        raise ValueError(f"'nodes' has {level.max()} levels, its depth is {depth}")


def walk(nodes: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Find the leaf of each row, as the graph's op ``tree`` does.

    Args:
        nodes: [n, 4] float32 axis, threshold and both children; the root first.
        values: [N, C] float32 rows.

    Returns:
        [N] int64 leaf.
    """
    at = np.zeros(len(values), np.int64)
    walking = np.arange(len(values))
    while len(walking):
        axis, threshold, below, above = nodes[at[walking]].T
        at[walking] = np.where(values[walking, axis.astype(np.int64)] < threshold, below, above)
        walking = walking[at[walking] >= 0]
    return -1 - at
