"""A trainable texture in tensor mode, read bilinearly as the shading graph's ``texture`` op reads it.

Notation: B points, H x W texels, C channels. Quantisation in training (noise: Ballé et al. 2017; straight-through
estimator: Bengio et al. 2013): ``noise`` adds uniform noise of one rounding step, ``round`` rounds. At level m of the
mip chain the texture is read at a reduced resolution: means of 2^m x 2^m texels, bilinear between them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

from lightwell.backend import dr, mi
from lightwell.networks.hashgrid import FIXED_POINT, PACKET, Int64x4, UInt64x4

# Quantisation steps of a byte.
STEPS = 255.0


@dataclass(frozen=True)
class AtlasTexture:
    """A texture [H * W, C] with row 0 at v = 0: maps places [B, 2] in [0, 1]² to values [B, C] in [0, 1]."""

    height: int
    width: int
    channels: int
    """A multiple of four: texels are read and written in packets."""
    quantiser: Literal["none", "noise", "round", "frozen"] = "none"
    """How quantisation is simulated; 'frozen': the texture is already that of the file and gets no gradient."""
    level: int = 0
    """Level of the mip chain; H and W are multiples of 2^level."""

    def __post_init__(self) -> None:
        if self.channels % PACKET:
            raise ValueError(f"texture: {self.channels} channels, expected a multiple of {PACKET}")
        if self.height % (1 << self.level) or self.width % (1 << self.level):
            raise ValueError(f"texture: {self.width} x {self.height} texels have no mip level {self.level}")

    def __call__(self, table: Any, places: Any) -> Any:
        """Read the texture; differentiable in the table, not in the places."""
        return dr.custom(_Read, self, table, places)

    def evaluate(self, table: Any, places: Any) -> Any:
        """Read the texture without derivatives.

        Args:
            table: [H * W, C] texels.
            places: [B, 2] texture coordinates in [0, 1]².

        Returns:
            [B, C] interpolated values.
        """
        count, packets = places.shape[0], self.channels // PACKET
        stored = self._minified(self.stored(table.array))
        total = [mi.Vector4f(0)] * packets
        for texel, weight in self._corners(places):
            rows = [dr.gather(mi.Vector4f, stored, texel * packets + k) for k in range(packets)]
            total = [t + weight * row for t, row in zip(total, rows)]
        lane = dr.arange(mi.UInt32, count) * packets
        out = dr.empty(mi.Float, count * self.channels)
        for packet, value in enumerate(total):
            dr.scatter(out, value, lane + packet)
        return mi.TensorXf(out, (count, self.channels))

    def gradient(self, places: Any, features: Any) -> Any:
        """Compute the gradient of the texels; the sum does not depend on the order of its terms.

        Args:
            places: [B, 2] texture coordinates in [0, 1]².
            features: [B, C] gradient of the values.

        Returns:
            [H * W, C] gradient of the table.
        """
        packets = self.channels // PACKET
        lane = dr.arange(mi.UInt32, places.shape[0]) * packets
        total = dr.zeros(mi.UInt64, (self.height * self.width * self.channels) >> (2 * self.level))
        parts = [dr.gather(mi.Vector4f, features.array, lane + k) * FIXED_POINT for k in range(packets)]
        for texel, weight in self._corners(places):
            for packet, part in enumerate(parts):
                dr.scatter_add(total, UInt64x4(Int64x4(weight * part)), texel * packets + packet)
        return mi.TensorXf(
            self._spread(mi.Float(mi.Int64(total)) / FIXED_POINT), (self.height * self.width, self.channels)
        )

    def _minified(self, values: Any) -> Any:
        """Average blocks of 2^level x 2^level texels."""
        if self.level == 0:
            return values
        edge, width = 1 << self.level, self.width >> self.level
        lane = dr.arange(mi.UInt32, dr.width(values) >> (2 * self.level))
        channel, texel = lane % self.channels, lane // self.channels
        corner = (texel // width) * edge * self.width + (texel % width) * edge
        total = mi.Float(0)
        for y in range(edge):
            for x in range(edge):
                total += dr.gather(mi.Float, values, (corner + (y * self.width + x)) * self.channels + channel)
        total /= edge * edge
        dr.eval(total)
        return total

    def _spread(self, gradient: Any) -> Any:
        """Apply the adjoint of ``_minified``: every texel gets its share of the gradient of its block's mean."""
        if self.level == 0:
            return gradient
        dr.eval(gradient)
        lane = dr.arange(mi.UInt32, self.height * self.width * self.channels)
        channel, texel = lane % self.channels, lane // self.channels
        y, x = (texel // self.width) >> self.level, (texel % self.width) >> self.level
        mean = (y * (self.width >> self.level) + x) * self.channels + channel
        return dr.gather(mi.Float, gradient, mean) * (0.25**self.level)

    def stored(self, values: Any) -> Any:
        """Simulate the quantisation of the stored texture.

        Args:
            values: [K] texels, Dr.Jit floats.

        Returns:
            [K] what is read back.
        """
        if self.quantiser in ("none", "frozen"):
            return values
        if self.quantiser == "noise":
            # The bits of the values themselves seed the noise: they change with every step.
            bits, _ = mi.sample_tea_32(
                dr.arange(mi.UInt32, dr.width(values)), dr.reinterpret_array(mi.UInt32, values), 3
            )
            moved = dr.clip(values, 0, 1) + (mi.Float(bits >> 8) * 2.0**-24 - 0.5) / STEPS
        else:
            moved = dr.floor(dr.clip(values, 0, 1) * STEPS + 0.5) / STEPS
        dr.eval(moved)
        return moved

    def _corners(self, places: Any) -> Iterator[tuple[Any, Any]]:
        """Yield (texel, weight) of the four texels around each place."""
        lane = dr.arange(mi.UInt32, places.shape[0])
        low, high, fraction = [], [], []
        width, height = self.width >> self.level, self.height >> self.level
        for axis, size in enumerate((width, height)):
            at = dr.gather(mi.Float, places.array, lane * 2 + axis)
            at = dr.clip(dr.clip(at, 0, 1) * size - 0.5, 0, size - 1)
            low.append(dr.minimum(mi.UInt32(at), size - 1))
            high.append(dr.minimum(low[-1] + 1, size - 1))
            fraction.append(at - mi.Float(low[-1]))
        for corner in range(4):
            right, down = corner & 1, corner >> 1
            weight = (fraction[0] if right else 1 - fraction[0]) * (fraction[1] if down else 1 - fraction[1])
            yield (high[1] if down else low[1]) * width + (high[0] if right else low[0]), weight


class _Read(dr.CustomOp):
    """A bilinear read with a gradient whose sum does not depend on the order of its terms."""

    def eval(self, texture: AtlasTexture, table: Any, places: Any) -> Any:
        self._texture, self._places = texture, places
        return texture.evaluate(table, places)

    def backward(self) -> None:
        if self._texture.quantiser == "frozen":
            self.set_grad_in("table", dr.zeros(mi.TensorXf, self._shape()))
        else:
            self.set_grad_in("table", self._texture.gradient(self._places, self.grad_out()))

    def _shape(self) -> tuple[int, int]:
        t = self._texture
        return (t.height * t.width, t.channels)

    def forward(self) -> None:
        raise NotImplementedError("a texture is differentiated in reverse mode only")

    def name(self) -> str:
        return "atlas texture"
