"""How the place of a light becomes K factors: an encoding and a small network, run once a frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.graph import Builder, evaluate


@dataclass(frozen=True)
class Code:
    """The encoding, and the layers behind it."""

    center: tuple[float, float, float]
    """Metres."""
    half: float
    """Half of the longest edge, metres; the same for all axes."""
    layers: list[tuple[np.ndarray, np.ndarray]]
    """(weights [out, in], bias [out])."""
    octaves: int = 2

    @property
    def width(self) -> int:
        """Features of a light."""
        return 3 + 6 * self.octaves

    def encoding(self, b: Builder) -> str:
        """Features of the input ``light``."""
        x = b.affine("light", [1 / self.half] * 3, [-c / self.half for c in self.center], per_frame=True)
        waves = b.frequency(b.affine(x, [0.5] * 3, [0.5] * 3, per_frame=True), self.octaves, per_frame=True)
        return b.concat(x, waves, per_frame=True)

    def node(self, b: Builder) -> str:
        """The K factors."""
        x = self.encoding(b)
        for k, (weights, bias) in enumerate(self.layers):
            x = b.linear(x, weights, bias, per_frame=True)
            if k + 1 < len(self.layers):
                x = b.activate(x, "silu", per_frame=True)
        return x

    def features(self, light: np.ndarray) -> np.ndarray:
        """[N, width] of places [N, 3]."""
        b = Builder(light=3)
        graph = b.build(features=self.encoding(b))
        return evaluate(graph, {"light": np.ascontiguousarray(light, np.float32)})["features"]
