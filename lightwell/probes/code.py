"""Mixing factors of K bases, evaluated once per frame: of the position of a light, the dimmers of lamps, a pose, or
dimmers and a pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lightwell.graph import Builder, evaluate
from lightwell.graph.layers import add_layers


@dataclass(frozen=True)
class WeightCode:
    """Encoding of a light's position, and the layers of the network that follows."""

    center: tuple[float, float, float]
    """Centre of the light's box, metres."""
    half: float
    """Half of the longest edge, metres; the same for all axes."""
    layers: list[tuple[np.ndarray, np.ndarray]]
    """(weights [out, in], bias [out]) of each layer."""
    octaves: int = 2
    """Frequencies of the encoding."""

    @property
    def inputs(self) -> dict[str, int]:
        """Inputs of a graph that the factors depend on, and their widths."""
        return {"light": 3}

    @property
    def width(self) -> int:
        """Number of features of the encoding."""
        return 3 + 6 * self.octaves

    def mixed(self, b: Builder, bases: str) -> str:
        """Add the sum of the bases times their factors to a graph.

        Args:
            b: Graph under construction with the input ``light`` [3].
            bases: Name of the node with the bases [27 K], the factor's index fastest.

        Returns:
            Name of the node with the 27 numbers.
        """
        return b.matvec(bases, self.node(b), 27)

    def encoding(self, b: Builder) -> str:
        """Add the encoding of the input ``light`` to a graph.

        Args:
            b: Graph under construction with the input ``light`` [3].

        Returns:
            Name of the node with ``width`` features.
        """
        x = b.affine("light", [1 / self.half] * 3, [-c / self.half for c in self.center], per_frame=True)
        waves = b.frequency(b.affine(x, [0.5] * 3, [0.5] * 3, per_frame=True), self.octaves, per_frame=True)
        return b.concat(x, waves, per_frame=True)

    def node(self, b: Builder) -> str:
        """Add the encoding and the network to a graph.

        Args:
            b: Graph under construction with the input ``light`` [3].

        Returns:
            Name of the node with the K factors.
        """
        activations = ("silu",) * (len(self.layers) - 1) + (None,)
        return add_layers(b, self.encoding(b), self.layers, activations, per_frame=True)

    def features(self, light: np.ndarray) -> np.ndarray:
        """Compute the encoding of light positions.

        Args:
            light: [N, 3] positions in metres, or unit directions.

        Returns:
            [N, width] float32 features.
        """
        b = Builder(light=3)
        graph = b.build(features=self.encoding(b))
        return evaluate(graph, {"light": np.ascontiguousarray(light, np.float32)})["features"]


@dataclass(frozen=True)
class LampMix:
    """One basis per group of lamps; its factors are the dimmers and colours of the groups."""

    groups: int
    """K."""

    @property
    def inputs(self) -> dict[str, int]:
        """Inputs of a graph that the factors depend on, and their widths."""
        return {"lamps": 3 * self.groups}

    def mixed(self, b: Builder, bases: str) -> str:
        """Add the sum of the groups' light, colour by colour, to a graph.

        Args:
            b: Graph under construction with the input ``lamps`` [3 K]: red of all groups, then green, then blue.
            bases: Name of the node with the bases [27 K]: band 0 of three colours, then eight harmonics of each.

        Returns:
            Name of the node with the 27 numbers.
        """
        k = self.groups
        return _by_color(b, bases, [b.slice("lamps", color * k, k, per_frame=True) for color in range(3)], k)


@dataclass(frozen=True)
class PoseMix:
    """One basis per pose that was traced; between two poses their light is interpolated linearly."""

    poses: tuple[float, ...]
    """[K] increasing sliders from 0 to 1, K ≥ 2."""

    @property
    def inputs(self) -> dict[str, int]:
        """Inputs of a graph that the factors depend on, and their widths."""
        return {"pose": 1}

    def mixed(self, b: Builder, bases: str) -> str:
        """Add the light at a pose to a graph.

        Args:
            b: Graph under construction with the input ``pose`` [1].
            bases: Name of the node with the bases [27 K], the factor's index fastest.

        Returns:
            Name of the node with the 27 numbers.
        """
        return b.matvec(bases, _between(b, self.poses, np.eye(len(self.poses))), 27)


@dataclass(frozen=True)
class PosedLampMix:
    """Bases of all groups in all poses; a group's factors are interpolated linearly between two poses."""

    poses: tuple[float, ...]
    """[P] increasing sliders from 0 to 1, P ≥ 2."""
    mix: np.ndarray
    """[P, G, K] factors of the bases that give the light of each group in each pose."""

    @property
    def inputs(self) -> dict[str, int]:
        """Inputs of a graph that the factors depend on, and their widths."""
        return {"lamps": 3 * self.mix.shape[1], "pose": 1}

    def mixed(self, b: Builder, bases: str) -> str:
        """Add the sum of the groups' light in a pose, colour by colour, to a graph.

        Args:
            b: Graph under construction with the inputs ``lamps`` [3 G], as ``LampMix`` has them, and ``pose`` [1].
            bases: Name of the node with the bases [27 K]: band 0 of three colours, then eight harmonics of each.

        Returns:
            Name of the node with the 27 numbers.
        """
        poses, groups, k = self.mix.shape
        # [K, G]: basis by group.
        of_groups = _between(b, self.poses, self.mix.transpose(2, 1, 0).reshape(k * groups, poses))
        dimmers = [b.slice("lamps", color * groups, groups, per_frame=True) for color in range(3)]
        return _by_color(b, bases, [b.matvec(of_groups, d, k, per_frame=True) for d in dimmers], k)


def _between(b: Builder, poses: tuple[float, ...], values: np.ndarray) -> str:
    """[N] numbers at the input ``pose``, interpolated linearly between those [N, P] of the poses."""
    at, count = np.array(poses), len(poses)
    # max(pose - at, 0) bends at each pose; their sums with these factors are the hat functions of the poses.
    bends = b.activate(b.linear("pose", np.ones((count, 1)), -at, per_frame=True), "relu", per_frame=True)
    hats, slope = np.zeros((count, count)), 1 / np.diff(at)
    for k in range(count - 1):
        hats[k, k] -= slope[k]
        hats[k, k + 1] += slope[k]
        hats[k + 1, k] += slope[k]
        hats[k + 1, k + 1] -= slope[k]
    return b.linear(bends, values @ hats, values[:, 0], per_frame=True)


def _by_color(b: Builder, bases: str, factors: Sequence[str], count: int) -> str:
    """[27] sum of ``count`` bases [27 K] times the factors [K] of each colour."""
    even, rest = [], []
    for color, factor in enumerate(factors):
        even.append(b.matvec(b.slice(bases, color * count, count), factor, 1))
        rest.append(b.matvec(b.slice(bases, (3 + 8 * color) * count, 8 * count), factor, 8))
    return b.concat(*even, *rest)


Mixing = WeightCode | LampMix | PoseMix | PosedLampMix
"""What the factors of a volume's bases are computed from."""
