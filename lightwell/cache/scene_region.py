"""The part of a scene that a cache learns: its box and materials, and the parameters of paths in it."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.cache.materials import CacheMaterialTable, material_table
from lightwell.cache.path_context import PathContext
from lightwell.cache.settings import PathSettings
from lightwell.transport.emitter_table import EmitterTable
from lightwell.transport.sources import Emitters

# Relative margin of the box, so that no surface lies on its boundary.
INFLATE = 0.01


def bounds_of(scene: Any) -> np.ndarray:
    """Compute the bounding box of a scene.

    Args:
        scene: Mitsuba scene.

    Returns:
        [2, 3] smallest and largest corner, metres.

    Raises:
        ValueError: The scene has no surfaces.
    """
    box = scene.bbox()
    corners = np.array([np.array(box.min), np.array(box.max)], np.float64).reshape(2, 3)
    if not np.isfinite(corners).all() or (corners[1] < corners[0]).any():
        raise ValueError("nrc: the scene has no surfaces to learn on; add a shape")
    return corners


def fingerprint(scene: Any) -> str:
    """Describe a scene: number of shapes, triangles and emitters, and the bounding box.

    Args:
        scene: Mitsuba scene.

    Returns:
        JSON text; scenes with different texts are different.
    """
    box = scene.bbox()
    primitives = sum(int(shape.primitive_count()) for shape in scene.shapes())
    corners = [round(float(x), 4) for corner in (box.min, box.max) for x in np.array(corner).ravel()]
    return json.dumps([len(scene.shapes()), primitives, len(scene.emitters()), corners])


class SceneRegion:
    """Box, materials and fingerprint of the scene that is learned."""

    def __init__(self, settings: PathSettings, box: np.ndarray | None = None) -> None:
        """Wait for a scene.

        Args:
            settings: Limits of the paths.
            box: [2, 3] corners of the region, metres; None: the bounds of the first scene.
        """
        self.settings = settings
        self.box: np.ndarray | None = None if box is None else np.asarray(box, np.float64)
        self.materials: CacheMaterialTable | None = None
        """Tables of the scene's materials; None: no scene yet."""
        self.fingerprint = ""
        """See ``fingerprint``; '': no scene yet."""
        self._emitters = Emitters()
        self._context: PathContext | None = None

    def prepare(self, scene: Any) -> np.ndarray:
        """Read the bounds, unless they are set, and the materials of a scene.

        Args:
            scene: Mitsuba scene.

        Returns:
            [2, 3] corners of the region, metres.
        """
        if self.box is None:
            corners = bounds_of(scene)
            margin = np.maximum((corners[1] - corners[0]) * INFLATE, 1e-6 * max(1e-6, np.ptp(corners)))
            self.box = np.stack([corners[0] - margin, corners[1] + margin])
        self.materials = material_table(scene)
        self.read_emitters(scene)
        self.fingerprint = fingerprint(scene)
        return self.box

    def read_emitters(self, scene: Any) -> None:
        """Read where the emitters of a scene are and how they shine: by that one of several is chosen.

        Args:
            scene: Mitsuba scene.
        """
        self._emitters = Emitters(table=EmitterTable.of(scene) if len(scene.emitters()) > 1 else None)
        self._context = None

    @property
    def context(self) -> PathContext:
        """Return the parameters of rendering paths.

        Returns:
            Parameters with the threshold of the settings.
        """
        if self._context is None:
            self._context = self.context_with(self.settings.termination_c)
        return self._context

    def context_with(self, c: float) -> PathContext:
        """Make the parameters of paths with a given termination threshold.

        Args:
            c: Threshold on the footprint over that of the primary hit, ≥ 0.

        Returns:
            The parameters.

        Raises:
            RuntimeError: ``prepare`` has not been called.
        """
        if self.box is None or self.materials is None:
            raise RuntimeError("nrc: the cache has no scene yet; call prepare(scene) first")
        a = PathContext()
        low, edge = self.box[0], self.box[1] - self.box[0]
        a.low = mi.Point3f(*[dr.opaque(mi.Float, float(x)) for x in low])
        a.inverse = mi.Vector3f(*[dr.opaque(mi.Float, float(1 / x)) for x in edge])
        a.roughness, a.albedo = self.materials.roughness, self.materials.albedo
        a.c = dr.opaque(mi.Float, min(c, 3e38))
        depth = self.settings.max_depth
        a.max_depth = dr.opaque(mi.UInt32, 0xFFFFFFFF if depth < 0 else depth)
        a.rr_depth = dr.opaque(mi.UInt32, self.settings.rr_depth)
        a.spike, a.emitters = dr.opaque(mi.Float, 3e38), self._emitters
        return a
