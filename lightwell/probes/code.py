"""Maps the position of a light to K mixing factors: an encoding and a small network, evaluated once per frame."""

from __future__ import annotations

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
    def width(self) -> int:
        """Number of features of the encoding."""
        return 3 + 6 * self.octaves

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
