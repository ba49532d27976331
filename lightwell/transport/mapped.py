"""Queries that know where on a light map they lie."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.scenes.atlas import Atlas
from lightwell.scenes.normal_maps import shading_normals
from lightwell.scenes.scene import Scene
from lightwell.transport.queries import make_query
from lightwell.transport.samples import Query, SurfacePoints
from lightwell.transport.visible import seen_side


@dataclass(frozen=True)
class MappedQuery(Query):
    """A query with the second texture coordinates of an atlas."""

    uv1: np.ndarray
    """[N, 2]."""
    shading_normal: np.ndarray
    """[N, 3] unit, bent by the normal maps of the materials."""


def mapped_query(scene: Scene, atlas: Atlas, points: SurfacePoints, light: np.ndarray | None = None) -> MappedQuery:
    """The named inputs of a light map's graph at N points."""
    query = make_query(scene, points, np.zeros(3, np.float32) if light is None else light)
    uv = atlas.lookup(points.shape, points.triangle, points.barycentric, seen_side(scene, points))
    columns = {name: getattr(query, name) for name in Query.__dataclass_fields__}
    bent = shading_normals(scene, points.shape, points.triangle, points.barycentric, query.normal)
    return MappedQuery(**columns, uv1=uv.astype(np.float32), shading_normal=bent)
