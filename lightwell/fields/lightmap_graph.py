"""The shading graph of a light map: one meaning for training and for viewers.

Notation: R reflectance, a diffuse albedo, F = R − a what is reflected otherwise, E' irradiance / π, q byte / 255.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from lightwell.fields.base import FieldSetup
from lightwell.fields.features import INPUT_WIDTHS, local_features, normalised
from lightwell.graph import Builder, Graph, quantise
from lightwell.graph.pictures import Picture
from lightwell.networks.lightmap import FEATURE_HIGH, FEATURE_LOW, OMEGA, OMEGA_FIRST

if TYPE_CHECKING:
    from lightwell.fields.lightmap import LightmapPreset

INPUTS = {"uv1": 2} | INPUT_WIDTHS
# E' / S = q² / (1 + SOFT − q²): the display's curve x / (1 + x), then a square root, so that bytes are spent as the eye
# sees them; the largest value is 1 / SOFT.
SOFT = 1 / 64
# Octaves of the report's encoding of uv: sin and cos of 2^k uv for k = 0 … 5, without π.
REPORT_OCTAVES = 6
# Reflectance of dielectrics (glTF 2.0, appendix B).
DIELECTRIC = 0.04
# The lobe of a directional light map: a spherical Gaussian of this sharpness over roughness to the fourth.
SHARPNESS, LEAST_ROUGHNESS = 0.5, 0.05


def stored(value: np.ndarray) -> np.ndarray:
    """E' / S → bytes."""
    x = np.maximum(np.asarray(value, np.float64), 0)
    return np.floor(255 * np.sqrt(np.minimum(x * (1 + SOFT) / (1 + x), 1)) + 0.5).astype(np.uint8)


@dataclass(frozen=True)
class MapNodes:
    """Puts together the nodes of one light map."""

    preset: LightmapPreset
    unit: float
    base: Picture | None
    direction: Picture | None
    setup: FieldSetup | None = None
    """What a light map that follows a moving light knows of the scene."""

    # ------------------------------------------------------------------ parts

    def albedo(self, b: Builder) -> tuple[str, str]:
        """a and F, from the reflectance and the metallicness."""
        dielectric = b.affine("metallic", [-1], [1])
        color = b.subtract("reflectance", b.scale(dielectric, DIELECTRIC))
        albedo = b.clamp(b.multiply(color, dielectric), 0.0, 1.0)
        return albedo, b.subtract("reflectance", albedo)

    def curve(self, b: Builder) -> str:
        """q, what the base stores."""
        return b.texture("uv1", b.buffer(self.base.buffer(), "e"), name="q")

    def direction_node(self, b: Builder) -> str:
        """Mean direction of the light, shorter the less it is directed."""
        return b.affine(b.texture("uv1", b.buffer(self.direction.buffer(), "d")), [2] * 3, [-1] * 3, name="direction")

    def irradiance(self, b: Builder) -> str:
        """E' / S."""
        q = self.curve(b)
        u = b.multiply(q, q)
        return b.multiply(u, b.reciprocal(b.affine(u, [-1] * 3, [1] * 3), SOFT))

    def inputs(self, b: Builder) -> list[str]:
        """What the network knows beside features."""
        kind = self.preset.inputs
        if kind == "uv":
            return [b.affine("uv1", [2, 2], [-1, -1])]
        if kind == "report":
            turns = b.scale("uv1", float(1 / np.pi))
            return [b.frequency(turns, REPORT_OCTAVES), b.sh("view", 4), b.sh("normal", 4)]
        if kind == "light":
            light = "light" if self.setup.light == "sun" else normalised(b, "light", self.setup, per_frame=True)
            return [light, normalised(b, "position", self.setup), *local_features(b, self.setup)]
        cosine = b.dot("normal", "view")
        if kind == "view":
            return [b.sh("view", 4), cosine, "roughness"]
        r = b.reflect("normal", "view")
        known = [r, cosine, "roughness", "metallic"]
        if self.base is not None:
            known.append("q")
        if self.direction is not None:
            d = self.direction_node(b)
            known += [d, b.dot(r, d), b.dot("normal", d)]
        return known

    # ------------------------------------------------------------------ whole graphs

    def rows(self, b: Builder) -> tuple[str, str, str, str]:
        """place, base, gain, inputs: the columns of a training row."""
        albedo, rest = self.albedo(b)
        if self.base is not None:
            return "uv1", b.multiply(albedo, self.irradiance(b)), rest, b.concat(*self.inputs(b))
        zero = b.scale("reflectance", 0.0)
        gain = "reflectance" if self.preset.demodulated else b.affine("reflectance", [0] * 3, [1] * 3)
        return "uv1", zero, gain, b.concat(*self.inputs(b))

    def lowered(self, features: Mapping[str, Picture], weights: Mapping[str, np.ndarray]) -> Graph:
        """The graph that ships: pictures as they are, weights as half floats."""
        b = Builder(**INPUTS)
        light = self._with_network(b, features, weights) if self.preset.hidden else self._without(b)
        graph = _pruned(b.build(radiance=b.scale(light, self.unit)))
        half = quantise(graph)
        buffers = {k: v if v.type == "uint8" else half.buffers[k] for k, v in graph.buffers.items()}
        return replace(graph, buffers=buffers)

    def _without(self, b: Builder) -> str:
        """Ordinary and directional light maps: R E', and a lobe round the dominant direction."""
        light = self.irradiance(b)
        if self.direction is None:
            return light
        d = self.direction_node(b)
        albedo, rest = self.albedo(b)
        # λ exp(λ (r · d̂ − 1)): a lobe as bright as even light, weighed by how directed the light is.
        r2 = b.multiply("roughness", "roughness")
        sharp = b.scale(b.reciprocal(b.multiply(r2, r2), LEAST_ROUGHNESS), SHARPNESS)
        cosine = b.dot(b.reflect("normal", "view"), b.normalize(d))
        lobe = b.activate(b.multiply(sharp, b.affine(cosine, [1], [-1])), "exp")
        directed = b.multiply(b.length(d), b.multiply(sharp, lobe))
        even = b.affine(b.length(d), [-1], [1])
        gloss = b.multiply(rest, b.multiply(light, b.add(even, directed)))
        return self._over_reflectance(b, b.add(b.multiply(albedo, light), gloss))

    def _with_network(self, b: Builder, features: Mapping[str, Picture], weights: Mapping[str, np.ndarray]) -> str:
        _, base, gain, inputs = self.rows(b)
        low, width = FEATURE_LOW, FEATURE_HIGH - FEATURE_LOW
        read = [b.texture("uv1", b.buffer(picture.buffer(), name)) for name, picture in features.items()]
        read = [b.affine(t, [width] * 3, [low] * 3) for t in read]
        x = self._layers(b, b.concat(*read, inputs), weights)
        if self.base is None:
            if self.preset.demodulated:
                return b.activate(x, "exp")
            return self._over_reflectance(b, b.activate(x, "exp"))
        e = b.activate(x, "exp")
        diffuse = b.multiply(base, b.slice(e, 0, 1))
        return self._over_reflectance(b, b.add(diffuse, b.multiply(gain, b.slice(e, 1, 3))))

    def _layers(self, b: Builder, x: str, weights: Mapping[str, np.ndarray]) -> str:
        count = sum(name.startswith("w") for name in weights)
        for k in range(count):
            factor = (OMEGA_FIRST if k == 0 else OMEGA) if self.preset.siren and k + 1 < count else 1.0
            matrix, bias = factor * weights[f"w{k}"].T, factor * weights[f"b{k}"][0]
            y = b.linear(x, matrix, bias)
            if k + 1 == count:
                return y
            y = b.activate(y, "sine" if self.preset.siren else self.preset.activation)
            x = b.add(b.scale(y, 1.0 / max(k - 1, 1)), x) if self.preset.siren and k else y
        return x

    @staticmethod
    def _over_reflectance(b: Builder, light: str) -> str:
        """A runtime multiplies by the reflectance."""
        return b.multiply(light, b.reciprocal("reflectance", 1e-9))


def row_graph(nodes: MapNodes) -> Graph:
    """The columns of a training row as outputs ``place, base, gain, inputs``."""
    b = Builder(**INPUTS)
    place, base, gain, inputs = nodes.rows(b)
    names = {"place": place, "base": base, "gain": gain, "inputs": inputs}
    return b.build(**{name: b.scale(node, 1.0) for name, node in names.items()})


def _pruned(graph: Graph) -> Graph:
    """Without nodes and inputs that nothing needs."""
    return graph.only(*graph.outputs)
