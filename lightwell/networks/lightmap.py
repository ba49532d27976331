"""The small network of a neural light map: maps features of the texel and the view direction to radiance.

    f = base (1 + g (exp(o₀…₂) − 1)) + g specular exp(o₃…₅),   o = network(textures, inputs)        with a base
    f = gain exp(o),                                           o = network(textures, inputs)        without

Notation: B rows; ``base`` is albedo · E', ``specular`` the reflectance that is not diffuse, in unit S; g is the share
of view-dependent light, 0 for a Lambertian surface. Textures are read at uv, and at the place of an environment map
that the mirrored view ray meets. Layers may be those of a SIREN (Sitzmann et al. 2020), as Nobigi (Triglav 2022) uses
them: y = sin(ω (W x + b)) / k + x.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.networks.atlas_texture import STEPS, AtlasTexture
from lightwell.networks.mlp import (
    ACTIVATIONS,
    activations_of,
    apply_layers,
    evaluate_network,
    glorot,
    initial_layers,
)

# Columns of a row before its inputs: uv, base, gain of the second term, g, and the place of the environment map.
PLACE, BASE, GAIN, GLOSS, MIRROR = slice(0, 2), slice(2, 5), slice(5, 8), slice(8, 9), slice(9, 11)
HEAD = 11
# Features start in the middle of their range, with noise that makes texels differ.
START, START_NOISE = 0.5, 0.02
# Range of the decoded features.
FEATURE_LOW, FEATURE_HIGH = -2.0, 2.0
# Frequencies of sine layers: of the first one, and of the rest (Nobigi).
OMEGA_FIRST, OMEGA = 20.0, 30.0


@dataclass(frozen=True)
class LightmapNetwork:
    """The network of a neural light map.

    Parameters: ``t0`` the texture over the atlas, ``t1`` … those of the environment, ``e0`` the error of a codec, all
    [texels, C]; ``w0, b0`` … layers; ``s0, c0`` … layers of the first stage; ``u0, v0`` … layers that compute features
    from the position of a surface.
    """

    texture: AtlasTexture | None
    channels: int
    """Channels of the texture that are used; the others make up a packet of four."""
    inputs: int
    """Inputs of a row, after its fixed columns; at least one."""
    hidden: tuple[int, ...] = (24, 24)
    activation: str = "relu"
    base: bool = True
    """Whether there is an ordinary light map that the network corrects."""
    siren: bool = False
    """Sine layers with residuals, as Nobigi's."""
    stage: tuple[int, ...] = ()
    """Widths of sine layers that compute the features from uv, instead of the texture."""
    mirrors: tuple[AtlasTexture, ...] = ()
    """Textures of the environment, coarse to fine; all their channels but the packet's last are used."""
    mirror_channels: int = 0
    """Channels of each that are used."""
    surface: tuple[int, ...] = ()
    """Widths of layers that compute the features from known quantities of the place, instead of the texture."""
    rounded: bool = False
    """Whether these features are rounded as their texels will be (straight-through)."""
    about: int = 0
    """Known quantities of the place, after the inputs of a row."""
    error: AtlasTexture | None = None
    """Size of the texture ``e0``: what the codec of the file adds to the features, a constant (straight-through)."""

    @property
    def outputs(self) -> int:
        """Width of the last layer."""
        return 6 if self.base else 3

    @property
    def sizes(self) -> tuple[int, ...]:
        """Widths of the layers, input first."""
        return (self.learned + self.inputs, *self.hidden, self.outputs)

    @property
    def learned(self) -> int:
        """Number of features of a row that textures hold."""
        return self.channels + len(self.mirrors) * self.mirror_channels

    @property
    def stage_sizes(self) -> tuple[int, ...]:
        """Widths of the first stage."""
        return (2, *self.stage, self.channels) if self.stage else ()

    @property
    def surface_sizes(self) -> tuple[int, ...]:
        """Widths of the layers that compute features from the position of a surface."""
        return (self.about, *self.surface, self.channels) if self.surface else ()

    def initial(self, seed: int, bias: float = 0.0) -> dict[str, np.ndarray]:
        """Draw initial parameters; the output starts at the base alone, with a small second term.

        Args:
            seed: Seed of the parameters.
            bias: Initial value of the biases.

        Returns:
            Parameters by name, float32.
        """
        rng = np.random.default_rng(seed)
        made: dict[str, np.ndarray] = {}
        if self.texture is not None and not self.stage:
            shape = (self.texture.height * self.texture.width, self.texture.channels)
            made["t0"] = (START + START_NOISE * rng.standard_normal(shape)).astype(np.float32)
        for k, mirror in enumerate(self.mirrors, 1):
            shape = (mirror.height * mirror.width, mirror.channels)
            made[f"t{k}"] = (START + START_NOISE * rng.standard_normal(shape)).astype(np.float32)
        for k, (a, b) in enumerate(zip(self.stage_sizes, self.stage_sizes[1:])):
            made |= {f"s{k}": _sine_weights(rng, a, b, k), f"c{k}": np.zeros((1, b), np.float32)}
        made |= initial_layers(rng, self.surface_sizes, names="uv")
        last = len(self.sizes) - 2
        for k, (a, b) in enumerate(zip(self.sizes, self.sizes[1:])):
            weights = _sine_weights(rng, a, b, k) if self.siren else glorot(rng, a, b)
            made |= {f"w{k}": weights if k < last else 0.3 * weights, f"b{k}": np.zeros((1, b), np.float32)}
        made[f"b{last}"][0] = [0, 0, 0, *[-1.5] * (self.outputs - 3)] if self.base else -1.5
        return made

    def __call__(self, parameters: Mapping[str, Any], rows: Any) -> Any:
        """Map rows [B, 11 + I + A] to radiance [B, 3] in unit S."""
        o = self.corrections(parameters, rows)
        if not self.base:
            return rows[:, GAIN] * ACTIVATIONS["exp"](o)
        e = ACTIVATIONS["exp"](o)
        # A product, because the gradient of a broadcast is a sum whose order depends on the threads.
        gloss = dr.matmul(rows[:, GLOSS], dr.full(mi.TensorXf, 1, (1, 3)))
        return rows[:, BASE] * (1 + gloss * (e[:, 0:3] - 1)) + rows[:, GAIN] * gloss * e[:, 3:6]

    def corrections(self, parameters: Mapping[str, Any], rows: Any) -> Any:
        """Compute the outputs of the layers, before the exponential.

        Args:
            parameters: Parameters by name.
            rows: [B, 11 + I + A] rows.

        Returns:
            [B, outputs].
        """
        inputs = slice(HEAD, HEAD + self.inputs)
        if self.surface:
            begin = HEAD + self.inputs
            read = [self.made(parameters, rows[:, begin : begin + self.about])]
        else:
            read = [self.features(parameters, rows[:, PLACE])]
        if self.error is not None:
            added = self.error(parameters["e0"], rows[:, PLACE])[:, : self.channels]
            read[0] = read[0] + (FEATURE_HIGH - FEATURE_LOW) * added
        read += [self._decoded(m(parameters[f"t{k}"], rows[:, MIRROR])) for k, m in enumerate(self.mirrors, 1)]
        return self._layers(parameters, [r for r in read if r is not None], rows[:, inputs])

    def _decoded(self, t: Any) -> Any:
        """Decode the used channels of a texture of the environment."""
        return FEATURE_LOW + (FEATURE_HIGH - FEATURE_LOW) * t[:, : self.mirror_channels]

    def made(self, parameters: Mapping[str, Any], about: Any) -> Any:
        """Compute the features of places from their known quantities.

        Args:
            parameters: Parameters by name.
            about: [B, A] known quantities.

        Returns:
            [B, channels] decoded features.
        """
        layers = len(self.surface_sizes) - 1
        x = FEATURE_HIGH * apply_layers(parameters, about, activations_of(layers, "relu", "tanh"), "uv")
        if not self.rounded:
            return x
        step = (FEATURE_HIGH - FEATURE_LOW) / STEPS
        nearest = FEATURE_LOW + step * dr.floor((dr.detach(x) - FEATURE_LOW) / step + 0.5)
        return x + (nearest - dr.detach(x))

    def features(self, parameters: Mapping[str, Any], places: Any) -> Any:
        """Compute or read the features at places in the atlas.

        Args:
            parameters: Parameters by name.
            places: [B, 2] texture coordinates in [0, 1]².

        Returns:
            [B, channels] decoded features, or None for a network without any.
        """
        if self.stage:
            x, ones = places, dr.full(mi.TensorXf, 1, (places.shape[0], 1))
            for k in range(len(self.stage_sizes) - 1):
                x = dr.matmul(x, parameters[f"s{k}"]) + dr.matmul(ones, parameters[f"c{k}"])
                if k + 2 < len(self.stage_sizes):
                    x = dr.sin((OMEGA_FIRST if k == 0 else OMEGA) * x)
            return FEATURE_HIGH * dr.tanh(x)
        if self.texture is None:
            return None
        t = self.texture(parameters["t0"], places)[:, : self.channels]
        return FEATURE_LOW + (FEATURE_HIGH - FEATURE_LOW) * t

    def _layers(self, parameters: Mapping[str, Any], features: list[Any], x: Any) -> Any:
        ones = dr.full(mi.TensorXf, 1, (x.shape[0], 1))
        last = len(self.sizes) - 2
        for k in range(last + 1):
            weights = parameters[f"w{k}"]
            y = dr.matmul(ones, parameters[f"b{k}"])
            if k == 0 and features:
                begin = 0
                for part in features:
                    y = y + dr.matmul(part, weights[begin : begin + part.shape[1]])
                    begin += part.shape[1]
                y = y + dr.matmul(x, weights[begin:])
            else:
                y = y + dr.matmul(x, weights)
            if k == last:
                return y
            if self.siren:
                y = dr.sin((OMEGA_FIRST if k == 0 else OMEGA) * y)
                x = y if k == 0 else y * (1.0 / max(k - 1, 1)) + x
            else:
                x = ACTIVATIONS[self.activation](y)
        return x

    def evaluate(self, parameters: Mapping[str, np.ndarray], rows: np.ndarray) -> np.ndarray:
        """Evaluate the network on NumPy arrays, without gradients.

        Args:
            parameters: Parameters by name, shapes [...] as ``initial`` makes them.
            rows: [B, C] rows.

        Returns:
            [B, 3] radiance in unit S.
        """
        return evaluate_network(self, parameters, rows)


def _sine_weights(rng: np.random.Generator, inputs: int, outputs: int, layer: int) -> np.ndarray:
    """Draw U(±1/4) for the first layer, U(±√(6 / in) / ω) for the others (Nobigi; Sitzmann et al. 2020)."""
    bound = 0.25 if layer == 0 else np.sqrt(6 / inputs) / OMEGA
    return rng.uniform(-bound, bound, (inputs, outputs)).astype(np.float32)
