"""Mixing factors of K bases, evaluated once per frame.

Bases express the light in some states of all variables together (``low_rank``), or are those states themselves where
they are few. Their factors are interpolated between the states: by a spline where a declared light is one of the
variables (``SplineMix``), else by the dimmers of lamps and hat functions of poses (``StateMix``). The field ``volume``
learns them from samples at surfaces, by a network (``WeightCode``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lightwell.graph import Builder, evaluate
from lightwell.graph.layers import add_layers
from lightwell.graph.pose_basis import PoseBasis
from lightwell.probes.spline import SplineMix


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
class StateMix:
    """Bases of states of the scene's own light: of every group of lamps in every pose at the nodes of a grid.

    The factors of the bases are linear in the dimmers of the groups, and between the nodes linear in each slider:
    c_k = Σ_p B_p(pose) Σ_g dimmer_g mix_pgk, with the functions B of ``PoseBasis``.
    """

    mix: np.ndarray
    """[P, G, K] factors of the bases that give the light of each group in each pose."""
    basis: PoseBasis | None = None
    """P functions of the sliders of what moves; None: nothing moves, P is 1."""
    lamps: bool = False
    """Whether the groups have dimmers; else there is one, G is 1."""

    @property
    def inputs(self) -> dict[str, int]:
        """Inputs of a graph that the factors depend on, and their widths."""
        lamps = {"lamps": 3 * self.mix.shape[1]} if self.lamps else {}
        return lamps | ({"pose": len(self.basis.nodes)} if self.basis else {})

    def mixed(self, b: Builder, bases: str) -> str:
        """Add the light of the groups in a pose, colour by colour, to a graph.

        Args:
            b: Graph under construction with the inputs ``lamps`` [3 G], red of all groups, then green, then blue, and
                ``pose`` [M], as far as there are lamps and movers.
            bases: Name of the node with the bases [27 K]: band 0 of three colours, then eight harmonics of each; the
                factor's index is fastest.

        Returns:
            Name of the node with the 27 numbers.
        """
        _, groups, k = self.mix.shape
        if not self.lamps:
            return b.matvec(bases, self._of_groups(b), 27)
        dimmers = [b.slice("lamps", color * groups, groups, per_frame=True) for color in range(3)]
        if self.basis is None:
            weights, none = self.mix[0].T, np.zeros(k)
            return _by_color(b, bases, [b.linear(d, weights, none, per_frame=True) for d in dimmers], k)
        of_groups = self._of_groups(b)
        return _by_color(b, bases, [b.matvec(of_groups, d, k, per_frame=True) for d in dimmers], k)

    def _of_groups(self, b: Builder) -> str:
        """[K G] factors of the bases for each group in the pose, the group's index fastest."""
        assert self.basis is not None
        poses, groups, k = self.mix.shape
        weights = self.mix.transpose(2, 1, 0).reshape(k * groups, poses)
        return b.linear(self.basis.add(b), weights, np.zeros(k * groups), per_frame=True)


def _by_color(b: Builder, bases: str, factors: Sequence[str], count: int) -> str:
    """[27] sum of ``count`` bases [27 K] times the factors [K] of each colour."""
    even, rest = [], []
    for color, factor in enumerate(factors):
        even.append(b.matvec(b.slice(bases, color * count, count), factor, 1))
        rest.append(b.matvec(b.slice(bases, (3 + 8 * color) * count, 8 * count), factor, 8))
    return b.concat(*even, *rest)


Mixing = WeightCode | SplineMix | StateMix
"""What the factors of a volume's bases are computed from."""
