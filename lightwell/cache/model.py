"""The network of the cache: training in tensor mode, inference packed inside the rendering kernel.

Notation: B records, K inputs beside the hash grid, layers W without biases, ReLU inside, linear output of three.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import drjit.nn as nn
import numpy as np

from lightwell.backend import dr, mi
from lightwell.cache.encodings import hash_lookup
from lightwell.cache.features import DARK, Vertex, paper_inputs, raw_inputs
from lightwell.cache.level import Gain
from lightwell.cache.settings import CacheSettings
from lightwell.networks.hashgrid import HashGrid
from lightwell.networks.mlp import glorot

Tensors = dict[str, Any]


@dataclass(frozen=True)
class Model:
    """Shape of the cache's network; hashable, holds no weights."""

    encoding: str
    levels: int
    base: float
    growth: float
    entries_log2: int
    hidden: int
    layers: int
    factorise: bool

    @staticmethod
    def of(settings: CacheSettings) -> Model:
        """The model that the settings describe."""
        return Model(**settings.network())

    @cached_property
    def grid(self) -> HashGrid | None:
        """The hash grid, or None with the frequency encoding."""
        if self.encoding != "hash":
            return None
        return HashGrid(self.levels, self.base, self.growth, self.entries_log2, 4)

    @property
    def direct_inputs(self) -> int:
        """Inputs that are computed, not looked up."""
        return 16 if self.grid else 64

    @property
    def sizes(self) -> tuple[int, ...]:
        """Widths of the layers."""
        return (self.direct_inputs + (self.grid.width if self.grid else 0), *[self.hidden] * self.layers, 3)

    @property
    def last(self) -> str:
        """Name of the last layer."""
        return f"w{self.layers}"

    @property
    def parameters(self) -> int:
        """Number of weights."""
        table = self.grid.entries * self.grid.channels if self.grid else 0
        return table + sum(a * b for a, b in zip(self.sizes, self.sizes[1:]))

    def initial(self, seed: int) -> dict[str, np.ndarray]:
        """Xavier-uniform weights [in, out] and a table of small numbers, float32."""
        rng = np.random.default_rng(seed)
        values = {f"w{k}": glorot(rng, a, b) for k, (a, b) in enumerate(zip(self.sizes, self.sizes[1:]))}
        if self.grid:
            # The grid's rows come first in w0; both parts keep the bound of the whole layer.
            values["w0"], values["wd"] = values["w0"][: self.grid.width], values["w0"][self.grid.width :]
            values["table"] = self.grid.initial(rng)
        return values

    def inputs(self, v: Vertex) -> list[mi.Float]:
        """Inputs beside the hash grid."""
        return raw_inputs(v) if self.grid else paper_inputs(v)

    # ------------------------------------------------------------------ training

    def forward(self, values: Mapping[str, Any], direct: Any, points: Any) -> Any:
        """[B, K] inputs and [B, 3] points to [B, 3] outputs, differentiable in the weights."""
        if self.grid:
            x = dr.matmul(self.grid(values["table"], points), values["w0"]) + dr.matmul(direct, values["wd"])
        else:
            x = dr.matmul(direct, values["w0"])
        for k in range(1, self.layers + 1):
            x = dr.matmul(dr.maximum(x, 0), values[f"w{k}"])
        return x

    # ------------------------------------------------------------------ inference

    def packed(self, values: Mapping[str, Any]) -> tuple[Any, ...]:
        """Weights in the layout that cooperative vectors read, and the table."""
        first = values["w0"]
        if self.grid:
            first = dr.concat([values["w0"], values["wd"]], axis=0)
        matrices = [first, *[values[f"w{k}"] for k in range(1, self.layers + 1)]]
        views = nn.pack(*[mi.TensorXf(_transposed(m)) for m in matrices], layout="inference")
        table = values["table"].array if self.grid else mi.Float(0)
        return (*views, table)

    def evaluate(self, packed: tuple[Any, ...], v: Vertex) -> mi.Color3f:
        """Network output of one vertex per lane, unclipped."""
        *views, table = packed
        inputs = hash_lookup(self.grid.layout, table, self.grid.packets, v.p) if self.grid else []
        x = nn.CoopVec(*inputs, *self.inputs(v))
        for k, view in enumerate(views):
            if k:
                x = dr.maximum(x, 0)
            x = nn.matvec(view, x)
        return mi.Color3f(*x)

    def radiance(self, packed: tuple[Any, ...], v: Vertex, gain: Gain) -> mi.Color3f:
        """Scattered radiance of a vertex, never negative."""
        return self.physical(self.evaluate(packed, v), v, gain.at(v))

    def physical(self, output: mi.Color3f, v: Vertex, unscale: mi.Float) -> mi.Color3f:
        """Network output to radiance. A value that is not finite counts as 0."""
        value = dr.maximum(output, 0) * unscale
        if self.factorise:
            ρ = v.reflectance()
            value = dr.select(ρ > DARK, value * ρ, 0)
        return dr.select(dr.isfinite(value), value, 0)

    def target(self, radiance: mi.Color3f, v: Vertex, scale: mi.Float) -> tuple[mi.Color3f, mi.Color3f]:
        """What the network should say for a radiance, and 1 or 0 per channel: whether it is learned."""
        y = radiance * scale
        if not self.factorise:
            return y, mi.Color3f(1)
        ρ = v.reflectance()
        learned = ρ > DARK
        return dr.select(learned, y / dr.maximum(ρ, DARK), 0), dr.select(learned, mi.Color3f(1), 0)


def _transposed(matrix: Any) -> Any:
    """[a, b] to [b, a]."""
    rows, columns = matrix.shape
    i = dr.arange(mi.UInt32, rows * columns)
    return mi.TensorXf(dr.gather(mi.Float, matrix.array, (i % rows) * columns + i // rows), (columns, rows))
