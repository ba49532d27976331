"""The network of the cache: tensors in training, packed matrices inside the rendering kernel for inference.

Notation: B records, K inputs beside the hash grid, layers W without biases, ReLU between them, three linear outputs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import drjit.nn as nn
import numpy as np

from lightwell.backend import dr, mi
from lightwell.cache.brightness_correction import RadianceScaling
from lightwell.cache.encodings import hash_lookup
from lightwell.cache.features import DARK, Vertex, paper_inputs, raw_inputs
from lightwell.cache.settings import NetworkSettings
from lightwell.graph.ops.layers import (
    cooperative,
    gathered_product,
    half_cooperative,
    half_vector,
    pack_half,
    row_table,
)
from lightwell.networks.hashgrid import HashGrid
from lightwell.networks.mlp import glorot

Tensors = dict[str, Any]


@dataclass(frozen=True)
class Model:
    """Shape of the cache's network; hashable, without weights."""

    shape: NetworkSettings
    """Encoding of the position, size of the layers, and meaning of the output."""

    @cached_property
    def grid(self) -> HashGrid | None:
        """Return the hash grid.

        Returns:
            The grid; None with the frequency encoding.
        """
        s = self.shape
        return HashGrid(s.levels, s.base, s.growth, s.entries_log2, 4) if s.encoding == "hash" else None

    @property
    def direct_inputs(self) -> int:
        """Return the number K of inputs beside the hash grid.

        Returns:
            16 or 64.
        """
        return 16 if self.grid else 64

    @property
    def sizes(self) -> tuple[int, ...]:
        """Return the widths of all layers.

        Returns:
            Inputs, hidden layers, outputs.
        """
        return (self.direct_inputs + (self.grid.width if self.grid else 0), *[self.shape.hidden] * self.shape.layers, 3)

    @property
    def last(self) -> str:
        """Return the name of the last layer's weights.

        Returns:
            Name.
        """
        return f"w{self.shape.layers}"

    @property
    def parameters(self) -> int:
        """Count the weights, table entries included.

        Returns:
            Number of weights.
        """
        table = self.grid.entries * self.grid.channels if self.grid else 0
        return table + sum(a * b for a, b in zip(self.sizes, self.sizes[1:]))

    def initial(self, seed: int) -> dict[str, np.ndarray]:
        """Draw initial weights: Xavier-uniform matrices [in, out] and a table of small numbers.

        Args:
            seed: Seed.

        Returns:
            Name to float32 array.
        """
        rng = np.random.default_rng(seed)
        values = {f"w{k}": glorot(rng, a, b) for k, (a, b) in enumerate(zip(self.sizes, self.sizes[1:]))}
        if self.grid:
            # The grid's rows come first in w0; both parts keep the bound of the whole layer.
            values["w0"], values["wd"] = values["w0"][: self.grid.width], values["w0"][self.grid.width :]
            values["table"] = self.grid.initial(rng)
        return values

    def inputs(self, v: Vertex) -> list[mi.Float]:
        """Compute the inputs beside the hash grid.

        Args:
            v: Vertices.

        Returns:
            K arrays [N].
        """
        return raw_inputs(v) if self.grid else paper_inputs(v)

    # ------------------------------------------------------------------ training

    def forward(self, values: Mapping[str, Any], direct: Any, points: Any) -> Any:
        """Evaluate the network on tensors, differentiable in the weights.

        Args:
            values: Weights by name.
            direct: [B, K] inputs.
            points: [B, 3] positions in [0, 1]^3.

        Returns:
            [B, 3] outputs.
        """
        if self.grid:
            x = dr.matmul(self.grid(values["table"], points), values["w0"]) + dr.matmul(direct, values["wd"])
        else:
            x = dr.matmul(direct, values["w0"])
        for k in range(1, self.shape.layers + 1):
            x = dr.matmul(dr.maximum(x, 0), values[f"w{k}"])
        return x

    # ------------------------------------------------------------------ inference

    def packed(self, values: Mapping[str, Any]) -> tuple[Any, ...]:
        """Pack weights in the layout of cooperative vectors, on CUDA as half floats; where it has none, as plain rows.

        Args:
            values: Weights by name.

        Returns:
            Views of the matrices or their rows, and the table of the hash grid.
        """
        first = values["w0"]
        if self.grid:
            first = dr.concat([values["w0"], values["wd"]], axis=0)
        matrices = [first, *[values[f"w{k}"] for k in range(1, self.shape.layers + 1)]]
        tensors = [mi.TensorXf(_transposed(m)) for m in matrices]
        if cooperative():
            views = nn.pack(*tensors, layout="inference")
        elif half_cooperative():
            views = pack_half(tensors)
        else:
            views = tuple(row_table(m) for m in tensors)
        table = values["table"].array if self.grid else mi.Float(0)
        return (*views, table)

    def evaluate(self, packed: tuple[Any, ...], v: Vertex) -> mi.Color3f:
        """Evaluate the network at one vertex per lane.

        Args:
            packed: Result of ``packed``.
            v: Vertices.

        Returns:
            [N] outputs, which may be negative.
        """
        *views, table = packed
        inputs = hash_lookup(self.grid.layout, table, self.grid.packets, v.p) if self.grid else []
        inputs = [*inputs, *self.inputs(v)]
        if not cooperative() and not half_cooperative():
            return mi.Color3f(*self._gathered(views, inputs))
        x: Any = nn.CoopVec(*inputs) if cooperative() else half_vector(inputs)
        for k, view in enumerate(views):
            if k:
                x = dr.maximum(x, 0)
            x = nn.matvec(view, x)
        return mi.Color3f(*[mi.Float(component) for component in x])

    def _gathered(self, tables: list[mi.Float], x: list[mi.Float]) -> list[mi.Float]:
        """Evaluate the layers by rows of weights."""
        for k, (table, outputs) in enumerate(zip(tables, self.sizes[1:])):
            if k:
                x = [dr.maximum(component, 0) for component in x]
            x = gathered_product(table, mi.UInt32(0), outputs, x)
        return x

    def radiance(self, packed: tuple[Any, ...], v: Vertex, gain: RadianceScaling) -> mi.Color3f:
        """Predict the scattered radiance towards ``v.w``.

        Args:
            packed: Result of ``packed``.
            v: Vertices.
            gain: Factor from network output to radiance.

        Returns:
            [N] radiance, ≥ 0.
        """
        return self.physical(self.evaluate(packed, v), v, gain.at(v))

    def physical(self, output: mi.Color3f, v: Vertex, unscale: mi.Float) -> mi.Color3f:
        """Convert network outputs to radiance; values that are not finite become 0.

        Args:
            output: [N] network outputs.
            v: Vertices.
            unscale: [N] or scalar factor, one over the radiance scale.

        Returns:
            [N] radiance, ≥ 0.
        """
        value = dr.maximum(output, 0) * unscale
        if self.shape.factorise:
            ρ = v.reflectance()
            value = dr.select(ρ > DARK, value * ρ, 0)
        return dr.select(dr.isfinite(value), value, 0)

    def target(self, radiance: mi.Color3f, v: Vertex, scale: mi.Float) -> tuple[mi.Color3f, mi.Color3f]:
        """Convert radiance to targets of the network.

        Args:
            radiance: [N] scattered radiance.
            v: Vertices.
            scale: Radiance scale.

        Returns:
            Targets [N], and per channel 1 where it is learned, else 0 [N].
        """
        y = radiance * scale
        if not self.shape.factorise:
            return y, mi.Color3f(1)
        ρ = v.reflectance()
        learned = ρ > DARK
        return dr.select(learned, y / dr.maximum(ρ, DARK), 0), dr.select(learned, mi.Color3f(1), 0)


def _transposed(matrix: Any) -> Any:
    """[a, b] to [b, a]."""
    rows, columns = matrix.shape
    i = dr.arange(mi.UInt32, rows * columns)
    return mi.TensorXf(dr.gather(mi.Float, matrix.array, (i % rows) * columns + i // rows), (columns, rows))
