"""Queries with texture coordinates of a light map."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from lightwell.scenes.atlas import Atlas
from lightwell.scenes.scene import Scene
from lightwell.transport.queries import make_query
from lightwell.transport.samples import Query, SurfacePoints, columns_of
from lightwell.transport.visible import seen_side


@dataclass(frozen=True)
class LightmapQuery(Query):
    """A query with the second texture coordinates of an atlas."""

    uv1: np.ndarray = field(kw_only=True)
    """[N, 2] texture coordinates in the atlas, in [0, 1]."""


def query_of_lightmap(
    scene: Scene, atlas: Atlas, points: SurfacePoints, light: np.ndarray | None = None
) -> LightmapQuery:
    """Make the named inputs of a light map's graph.

    Args:
        scene: Scene of the points.
        atlas: Atlas of the light map.
        points: N points.
        light: [N, 3] or [3] positions of the declared light; None: zeros.

    Returns:
        N rows of inputs.
    """
    query = make_query(scene, points, np.zeros(3, np.float32) if light is None else light)
    uv = atlas.lookup(points.shape, points.triangle, points.barycentric, seen_side(scene, points))
    columns = columns_of(query)
    return LightmapQuery(**columns, uv1=uv.astype(np.float32))
