"""The sets of inputs that small networks and their gates are fed, each a part of a shading graph."""

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
# local    what a region with a network of its own needs: x, n, l and their geometry, no waves.
# lean     the same with waves of few octaves and the reflectance; what a glossy surface needs only where there is one.
# encoded  sines and cosines of positions besides (``features.encoded_features``).
# place    x and n: what a gate may know so that no light or eye moves its borders.
Kind = Literal["raw", "ren", "local", "lean", "encoded", "place"]


class Inputs:
    """A set of inputs of one scene: a node of a graph, and the rows that a network is trained on."""

    def __init__(self, setup: FieldSetup, kind: Kind, octaves: FeatureOctaves | None = None) -> None:
        self.setup, self.kind, self.octaves = setup, kind, octaves or FeatureOctaves()
        b = open_builder()
        self._table = Tabulated(b.build(features=self.node(b)))
        self.width = self._table.width("features")

    def node(self, b: Builder) -> str:
        """Add the inputs to a graph; returns the value that holds them all."""
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
        """[N, F] float32, as the graph computes them."""
        return self._table(query)["features"]
