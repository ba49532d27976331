"""Non-negative functions of a pose that sum to 1: between its nodes, what is weighted by them changes linearly.

A slider has linear hat functions over its nodes; several sliders have the products of theirs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from lightwell.graph.buffers import Buffer, pack
from lightwell.graph.builder import Builder


@dataclass(frozen=True)
class PoseBasis:
    """Products of hat functions, those of the last mover the fastest."""

    nodes: tuple[tuple[float, ...], ...]
    """For each mover, increasing sliders from 0 to 1."""

    @property
    def count(self) -> int:
        """Number of functions."""
        return int(np.prod([len(own) for own in self.nodes]))

    @property
    def poses(self) -> np.ndarray:
        """[P, M] the pose at which each function is 1."""
        return np.array(list(product(*self.nodes)))

    def add(self, b: Builder) -> str:
        """Add the functions of the input ``pose`` to a graph.

        Args:
            b: Graph to add nodes to.

        Returns:
            Name of the node with their values, evaluated per frame.
        """
        found = ""
        for mover in range(len(self.nodes)):
            hats = self._hats(b, mover)
            found = b.multiply(found, hats, per_frame=True) if found else hats
        return found

    def _hats(self, b: Builder, mover: int) -> str:
        """The hat functions of a mover, each as often as products have it."""
        ramps = b.linear("pose", *_ramps(self.nodes[mover], mover, len(self.nodes)), per_frame=True)
        ramps = b.clamp(ramps, low=0.0, high=1.0, per_frame=True)
        sizes = [len(own) for own in self.nodes]
        before, after = int(np.prod(sizes[:mover])), int(np.prod(sizes[mover + 1 :]))
        # Ramp j rises from node j to node j + 1; a hat is the difference of two neighbouring ramps.
        size = sizes[mover]
        steps = np.eye(size, size - 1, -1) - np.eye(size, size - 1)
        weights, bias = (np.repeat(np.tile(a, (before, 1)), after, axis=0) for a in (steps, np.eye(size, 1)))
        # Half floats hold -1, 0 and 1.
        return b.linear(ramps, pack(weights, "float16"), pack(bias[:, 0], "float16"), per_frame=True)


def _ramps(nodes: Sequence[float], mover: int, movers: int) -> tuple[Buffer, Buffer]:
    """Weights [n - 1, M] and bias of what rises from 0 to 1 between neighbouring nodes."""
    at = np.asarray(nodes)
    weights, rise = np.zeros((len(at) - 1, movers)), 1 / np.diff(at)
    weights[:, mover] = rise
    return Buffer(weights.astype(np.float32)), Buffer((-at[:-1] * rise).astype(np.float32))
