"""The shading graph of a light map, the same for training and viewers.

Notation: R reflectance, a diffuse albedo, F = R − a the rest of the reflectance, E' irradiance / π, q byte / 255.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from lightwell.fields.base import FieldSetup
from lightwell.fields.features import INPUT_WIDTHS, local_features, normalised
from lightwell.fields.lightmap.curve import restored_node
from lightwell.fields.lightmap.lamp_map import LAMP_WEIGHTS, LampMap
from lightwell.graph import Builder, Graph, quantise
from lightwell.graph.pictures import Picture
from lightwell.networks.lightmap import FEATURE_HIGH, FEATURE_LOW, OMEGA, OMEGA_FIRST

if TYPE_CHECKING:
    from lightwell.fields.lightmap.fit import LightmapPreset

INPUTS = {"uv1": 2, "shading_normal": 3} | INPUT_WIDTHS
# Octaves of the report's encoding of uv: sin and cos of 2^k uv for k = 0 … 5, without π.
REPORT_OCTAVES = 6
# Reflections are learned relative to the light that arrives and so much of the unit: they can be bright in shade.
LEAST_ARRIVING = 0.05
# The box of the environment is a little larger than the scene; what counts as parallel to one of its faces.
BOX_MARGIN, PARALLEL = 1.02, 1e-3
# Reflectance of dielectrics (glTF 2.0, appendix B).
DIELECTRIC = 0.04
# The lobe of a directional light map: a spherical Gaussian of this sharpness over roughness to the fourth.
SHARPNESS, LEAST_ROUGHNESS = 0.5, 0.05
# Limits the effect of a bump where the light is at a grazing angle to the geometric surface.
LEAST_UPRIGHT = 0.1


@dataclass(frozen=True)
class MapNodes:
    """Builds the nodes of one light map."""

    preset: LightmapPreset
    unit: float
    base: Picture | None
    direction: Picture | None
    setup: FieldSetup | None = None
    """Bounds and light of the scene; needed for a variable light and for an environment."""
    mask: Picture | None = None
    """Mask of the surfaces: red where glossy, green where the light map covers them."""
    far: int = 0
    """Level of the mip chain of the atlas that is read; 0 for the stored graph."""
    size: int = 1
    """Edge of the atlas."""
    relief: bool = False
    """Whether normal maps bend the normals of a surface that is lit."""
    lamps: LampMap | None = None
    """Light of groups of lamps that have a switch each; ``base`` is that of all of them, and is not stored then."""

    @property
    def learns_places(self) -> bool:
        """Whether sine layers compute the features in training."""
        return bool(self.preset.surface and self.preset.channels) and self.setup is not None

    # ------------------------------------------------------------------ parts

    def albedo(self, b: Builder) -> tuple[str, str]:
        """Add diffuse albedo a and the rest of the reflectance F, from reflectance and metallic.

        Args:
            b: Graph to add nodes to.

        Returns:
            Names of the nodes of a and F, width 3 each.
        """
        dielectric = b.affine("metallic", [-1], [1])
        color = b.subtract("reflectance", b.scale(dielectric, DIELECTRIC))
        albedo = b.clamp(b.multiply(color, dielectric), 0.0, 1.0)
        return albedo, b.subtract("reflectance", albedo)

    def stored(self, b: Builder, picture: Picture, name: str) -> str:
        """Add a picture as a buffer, at the level of the mip chain that this graph reads.

        Args:
            b: Graph to add to.
            picture: The picture.
            name: Name of the buffer.

        Returns:
            Name of the buffer.
        """
        return b.buffer(picture.buffer(picture.level(self.far, self.size) if self.far else 0), name)

    def curve(self, b: Builder) -> str:
        """Add q, the stored value of the irradiance.

        Args:
            b: Graph to add nodes to.

        Returns:
            Name of the node, width 3.
        """
        return b.texture("uv1", self.stored(b, self.base, "e"), name="q")

    def direction_node(self, b: Builder) -> str:
        """Add the mean direction of the light; it is shorter the less directed the light is.

        Args:
            b: Graph to add nodes to.

        Returns:
            Name of the node, width 3.
        """
        return b.affine(b.texture("uv1", self.stored(b, self.direction, "d")), [2] * 3, [-1] * 3, name="direction")

    def known(self, b: Builder) -> tuple[str, str]:
        """Add the mask: the gloss g, and whether the light map covers the surface.

        Args:
            b: Graph to add nodes to.

        Returns:
            Names of two nodes, width 1 each.
        """
        if self.mask is None:
            one = b.affine("roughness", [0], [1])
            return one, one
        m = b.texture("uv1", self.stored(b, self.mask, "m"))
        # Bilinear reads on a chart's border are its own: the picture is continued there.
        return b.slice(m, 0, 1), b.slice(m, 1, 1)

    def mirrored(self, b: Builder) -> tuple[str, str]:
        """Add the point where the mirrored view ray leaves the scene's box.

        Slab method on the box scaled to [−1, 1]³. The direction from the middle of the box to that point is octahedral
        (Cigolle et al. 2014).

        Args:
            b: Graph to add nodes to.

        Returns:
            Names of the nodes of the place in the environment, width 2, and of the distance, width 1.
        """
        half = [0.5 * BOX_MARGIN * max(s, 1e-6) for s in self.setup.size]
        p = b.affine("position", [1 / h for h in half], [-c / h for c, h in zip(self.setup.center, half)])
        p = b.clamp(p, -1.0, 1.0)
        r = b.affine(b.reflect("normal", "view"), [1 / h for h in half], [0] * 3)
        inverse = b.reciprocal(_absolute(b, r), PARALLEL)
        t = b.multiply(b.affine(b.multiply(p, b.multiply(r, inverse)), [-1] * 3, [1] * 3), inverse)
        x, y, z = (b.slice(t, k, 1) for k in range(3))
        distance = _smaller(b, _smaller(b, x, y), z)
        return _octahedral(b, b.add(p, b.multiply(r, distance))), distance

    def irradiance(self, b: Builder) -> str:
        """Add E' / S, decoded from q.

        Args:
            b: Graph to add nodes to.

        Returns:
            Name of the node, width 3.
        """
        return restored_node(b, self.curve(b))

    def leaned(self, b: Builder, light: str, direction: str) -> str:
        """Correct irradiance for a shading normal n': E'(n') / E'(n) = n' · v / n · v, unless light crosses the
        horizon.

        v = ∫ L ω is nearly parallel to the mean direction of the light.

        Args:
            b: Graph to add nodes to.
            light: Name of the node of E' / S, width 3.
            direction: Name of the node of the mean direction, width 3.

        Returns:
            Name of the node, width 3.
        """
        lean = b.dot(b.subtract("shading_normal", "normal"), direction)
        upright = b.reciprocal(b.clamp(b.dot("normal", direction), 0.0, 1.0), LEAST_UPRIGHT)
        return b.multiply(light, b.activate(b.affine(b.multiply(lean, upright), [1], [1]), "relu"))

    def inputs(self, b: Builder) -> list[str]:
        """Add the inputs of the network other than features.

        Args:
            b: Graph to add nodes to.

        Returns:
            Names of the nodes.
        """
        kind = self.preset.inputs
        if kind == "uv":
            return [b.affine("uv1", [2, 2], [-1, -1])]
        if kind == "report":
            turns = b.scale("uv1", float(1 / np.pi))
            return [b.frequency(turns, REPORT_OCTAVES), b.sh("view", 4), b.sh("normal", 4)]
        if kind == "light":
            light = "light" if self.setup.light == "sun" else normalised(b, "light", self.setup, per_frame=True)
            return [light, normalised(b, "position", self.setup), *local_features(b, self.setup)]
        normal = "shading_normal" if self.relief else "normal"
        cosine = b.dot(normal, "view")
        if kind == "view":
            return [b.sh("view", 4), cosine, "roughness"]
        r = b.reflect(normal, "view")
        known = [r, cosine, "roughness", "metallic"]
        bump = b.subtract("shading_normal", "normal") if self.relief else ""
        known += [bump] if bump else []
        if kind == "mirror":
            return known
        if self.base is not None and self.lamps is None:
            known.append("q")
        if self.direction is not None:
            d = self.direction_node(b)
            known += [d, b.dot(r, d), b.dot("normal", d)] + ([b.dot(bump, d)] if bump else [])
        if self.preset.mirrors:
            half = 0.5 * max(self.setup.size)
            known.append(b.affine("position", [1 / half] * 3, [-c / half for c in self.setup.center]))
        return known

    def about(self, b: Builder) -> str:
        """Add the view-independent inputs of a place: position, normal and the light that arrives.

        Args:
            b: Graph to add nodes to.

        Returns:
            Name of the node.
        """
        position = normalised(b, "position", self.setup)
        known = [position, b.frequency(b.scale(position, 0.5), self.preset.octaves), "normal"]
        known += ["q"] if self.base is not None else []
        if self.direction is not None:
            known.append("direction" if self.preset.inputs == "reflected" else self.direction_node(b))
        return b.concat(*known)

    # ------------------------------------------------------------------ whole graphs

    def rows(self, b: Builder, shown: bool = False) -> dict[str, str]:
        """Add the columns of a training row: place, base, gain, gloss, mirror, inputs, and parts where there are lamps.

        Args:
            b: Graph to add nodes to.
            shown: Whether lamps are as a viewer sets them, not all as in the bake.

        Returns:
            Name of the column to name of the node.
        """
        albedo, rest = self.albedo(b)
        gloss, lit = self.known(b)
        # The inputs name the curve, q, which the irradiance reads.
        light = self.irradiance(b) if self.base is not None else ""
        mirror, inputs = b.scale("uv1", 0.0), self.inputs(b)
        if self.preset.mirrors:
            mirror, distance = self.mirrored(b)
            inputs = [*inputs, b.reciprocal(distance, 0.5)]
        made = {"place": "uv1", "gloss": gloss, "mirror": mirror, "inputs": b.concat(*inputs)}
        if self.learns_places:
            made["about"] = self.about(b)
        if self.base is not None:
            scale = b.multiply(albedo, lit)
            if self.relief and self.direction is not None and self.preset.inputs == "reflected":
                scale = self.leaned(b, scale, "direction")
            if self.lamps is not None and shown:
                light = self.lamps.light(b, partial(self.stored, b))
            elif self.lamps is not None:
                parts = self.lamps.parts(b, partial(self.stored, b))
                made["parts"] = b.concat(*(b.multiply(scale, part) for part in parts))
            gain = b.multiply(rest, lit)
            if self.lamps is None:
                # Relative to the light that arrives, reflections need few texels of features: rough metals need none.
                gain = b.multiply(gain, b.affine(light, [1] * 3, [LEAST_ARRIVING] * 3))
            return made | {"base": b.multiply(scale, light), "gain": gain}
        gain = "reflectance" if self.preset.demodulated else b.affine("reflectance", [0] * 3, [1] * 3)
        return made | {"base": b.scale("reflectance", 0.0), "gain": b.multiply(gain, lit)}

    def lowered(self, features: Mapping[str, Picture], weights: Mapping[str, np.ndarray]) -> Graph:
        """Return the graph that is written: pictures as they are, weights in the preset's storage type.

        Args:
            features: Pictures of the features by name.
            weights: Weights [in, out] and biases [1, out] of the network by name.

        Returns:
            The graph.
        """
        b = Builder(**INPUTS, **({} if self.lamps is None else {"lamps": 3 * self.lamps.count}))
        light = self._with_network(b, features, weights) if self.preset.hidden else self._without(b)
        graph = _pruned(b.build(radiance=b.scale(light, self.unit)))
        small = quantise(graph, self.preset.storage)
        whole = (LAMP_WEIGHTS, *(name for name, buffer in graph.buffers.items() if buffer.type == "uint8"))
        buffers = {k: v if k in whole else small.buffers[k] for k, v in graph.buffers.items()}
        return replace(graph, buffers=buffers)

    def _without(self, b: Builder) -> str:
        """Ordinary and directional light maps: (a + g F) E', and a lobe round the dominant direction."""
        gloss, lit = self.known(b)
        light = self.irradiance(b) if self.lamps is None else self.lamps.light(b, partial(self.stored, b))
        light = b.multiply(light, lit)
        albedo, rest = self.albedo(b)
        rest = b.multiply(rest, gloss)
        if self.direction is None:
            return self._over_reflectance(b, b.multiply(b.add(albedo, rest), light))
        d = self.direction_node(b)
        light = self.leaned(b, light, d) if self.relief else light
        # λ exp(λ (r · d̂ − 1)): a lobe as bright as even light, weighed by how directed the light is.
        r2 = b.multiply("roughness", "roughness")
        sharp = b.scale(b.reciprocal(b.multiply(r2, r2), LEAST_ROUGHNESS), SHARPNESS)
        cosine = b.dot(b.reflect("shading_normal" if self.relief else "normal", "view"), b.normalize(d))
        lobe = b.activate(b.multiply(sharp, b.affine(cosine, [1], [-1])), "exp")
        directed = b.multiply(b.length(d), b.multiply(sharp, lobe))
        even = b.affine(b.length(d), [-1], [1])
        gloss = b.multiply(rest, b.multiply(light, b.add(even, directed)))
        return self._over_reflectance(b, b.add(b.multiply(albedo, light), gloss))

    def _with_network(self, b: Builder, features: Mapping[str, Picture], weights: Mapping[str, np.ndarray]) -> str:
        row = self.rows(b, shown=True)
        gain = row["gain"]
        low, width = FEATURE_LOW, FEATURE_HIGH - FEATURE_LOW
        at = {name: row["mirror"] if name.startswith("r") else "uv1" for name in features}
        read = [b.texture(at[name], b.buffer(picture.buffer(), name)) for name, picture in features.items()]
        read = [b.affine(t, [width] * 3, [low] * 3) for t in read]
        # The last picture may hold fewer channels than three.
        if over := len(read) * 3 - self.preset.channels if read and not self.preset.mirrors else 0:
            read[-1] = b.slice(read[-1], 0, 3 - over)
        x = self._layers(b, b.concat(*read, row["inputs"]), weights)
        if self.base is None:
            return self._over_reflectance(b, b.multiply(gain, b.activate(x, "exp")))
        e = b.activate(x, "exp")
        factor = b.affine(b.multiply(b.affine(b.slice(e, 0, 3), [1] * 3, [-1] * 3), row["gloss"]), [1] * 3, [1] * 3)
        diffuse = b.multiply(row["base"], factor)
        bright = b.slice(e, 3, 3) if self.lamps is None else self.lamps.gloss(b, e, weights["lamps"])
        gloss = b.multiply(b.multiply(gain, row["gloss"]), bright)
        return self._over_reflectance(b, b.add(diffuse, gloss))

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
        """Divide by the reflectance, because a runtime multiplies by it."""
        return b.multiply(light, b.reciprocal("reflectance", 1e-9))


def row_graph(nodes: MapNodes) -> Graph:
    """Return a graph whose outputs are the columns of a training row.

    Args:
        nodes: Nodes of the light map.

    Returns:
        The graph.
    """
    b = Builder(**INPUTS)
    return b.build(**{name: b.scale(node, 1.0) for name, node in nodes.rows(b).items()})


def _absolute(b: Builder, a: str) -> str:
    return b.add(b.activate(a, "relu"), b.activate(b.scale(a, -1.0), "relu"))


def _smaller(b: Builder, a: str, c: str) -> str:
    return b.subtract(a, b.activate(b.subtract(a, c), "relu"))


def _octahedral(b: Builder, direction: str) -> str:
    """[2] in [0, 1]: a direction on the square; y is its axis, so that the folded half looks down."""
    size = _absolute(b, direction)
    x, y, z = (b.slice(size, k, 1) for k in range(3))
    d = b.multiply(direction, b.reciprocal(b.add(b.add(x, y), z), PARALLEL * PARALLEL))
    flat = b.concat(b.slice(d, 0, 1), b.slice(d, 2, 1))
    turned = b.concat(b.slice(d, 2, 1), b.slice(d, 0, 1))
    sign = b.multiply(flat, b.reciprocal(_absolute(b, flat), PARALLEL * PARALLEL))
    folded = b.multiply(b.affine(_absolute(b, turned), [-1, -1], [1, 1]), sign)
    return b.affine(b.select(b.slice(d, 1, 1), flat, folded), [0.5, 0.5], [0.5, 0.5])


def _pruned(graph: Graph) -> Graph:
    """Remove nodes and inputs that no output depends on."""
    return graph.only(*graph.outputs)
