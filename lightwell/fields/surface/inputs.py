"""Sets of inputs of small networks and their gates; each is a part of a shading graph."""

from __future__ import annotations

from typing import Literal

import numpy as np

from lightwell.fields.base import FieldSetup
from lightwell.fields.features import (
    DISTANCE_SOFTENING,
    FeatureOctaves,
    encoded_features,
    normalised,
    open_builder,
    raw_features,
    waves,
)
from lightwell.fields.tabulate import Tabulated
from lightwell.graph import Builder
from lightwell.transport.samples import Query

# raw      x, n, −v, l: the report's 12 numbers.
# ren      the same and three parameters of the surface, here its reflectance: 15 numbers.
# local    for a network of a small region: x, n, l and their geometry, without frequency encoding.
# lean     the same with few octaves and the reflectance; inputs of glossy surfaces only where the scene has one.
# encoded  the same with the frequency encoding of positions (``features.encoded_features``).
# place    x and n: for gates whose borders are independent of light and camera.
Kind = Literal["raw", "ren", "local", "lean", "encoded", "place"]


class Inputs:
    """A set of inputs for one scene, as a node of a graph and as rows to train on."""

    def __init__(self, setup: FieldSetup, kind: Kind, octaves: FeatureOctaves | None = None) -> None:
        """Choose a set of inputs.

        Args:
            setup: Bounds and light of the scene.
            kind: Name of the set.
            octaves: Octaves of the encoding; None: the default.
        """
        self.setup, self.kind, self.octaves = setup, kind, octaves or FeatureOctaves()
        b = open_builder()
        self._table = Tabulated(b.build(features=self.node(b)))
        self.width = self._table.width("features")

    def node(self, b: Builder) -> str:
        """Add the inputs to a graph.

        Args:
            b: Graph with the inputs of a query.

        Returns:
            Name of the node that holds all F inputs.
        """
        if self.kind == "place":
            return b.concat(normalised(b, "position", self.setup), "normal")
        if self.kind == "local":
            return b.concat(*self._local(b))
        if self.kind == "lean":
            return b.concat(*self._lean(b))
        if self.kind == "encoded":
            pixel, frame = encoded_features(b, self.setup, self.octaves)
            return b.concat(*pixel, *frame)
        pixel, frame = raw_features(b, self.setup)
        surface = ["reflectance"] if self.kind == "ren" else []
        return b.concat(*pixel, *frame, *surface)

    def _local(self, b: Builder) -> list[str]:
        p = normalised(b, "position", self.setup)
        r = b.normalize(b.reflect("normal", "view"))
        nodes = [p, "normal", b.dot("normal", "view"), "roughness", "metallic"]
        if self.setup.light == "static":
            return [*nodes, r]
        if self.setup.light == "sun":
            return [*nodes, "light", b.dot("normal", "light"), b.dot(r, "light")]
        light = normalised(b, "light", self.setup)
        return [*nodes, light, *self._towards(b, p, light, r)]

    def _lean(self, b: Builder) -> list[str]:
        """Even rough surfaces change towards grazing views and against the light (Burley's diffuse term), so that n·v
        and r·ω always matter; r itself and the parameters of the surface only where something is glossy."""
        p, octaves = normalised(b, "position", self.setup), self.octaves
        r = b.normalize(b.reflect("normal", "view"))
        nodes = [p, "normal", b.dot("normal", "view"), "reflectance"]
        nodes += [] if self.setup.matte else [r, "roughness", "metallic"]
        if octaves.position:
            nodes.append(waves(b, p, octaves.position, octaves.falloff))
        if self.setup.light == "static":
            return nodes
        if self.setup.light == "sun":
            light = "light"
            nodes += [b.dot("normal", light), b.dot(r, light)]
        else:
            light = normalised(b, "light", self.setup, per_frame=True)
            nodes += self._towards(b, p, light, r)
        if octaves.light:
            nodes.append(waves(b, light, octaves.light, octaves.falloff, per_frame=True))
        return [*nodes, light]

    @staticmethod
    def _towards(b: Builder, p: str, light: str, r: str) -> list[str]:
        """Direction to a point light, its cosines with normal and mirrored view, and two functions of the distance."""
        to_light = b.subtract(light, p)
        distance, direction = b.length(to_light), b.normalize(to_light)
        near = b.scale(b.reciprocal(distance, DISTANCE_SOFTENING * 10), 0.25)
        geometry = [direction, b.dot("normal", direction), b.dot(r, direction)]
        return [*geometry, b.log(distance, DISTANCE_SOFTENING), near]

    def rows(self, query: Query) -> np.ndarray:
        """Compute the inputs of queries with the same graph.

        Args:
            query: N queries.

        Returns:
            [N, F] float32 inputs.
        """
        return self._table(query)["features"]
