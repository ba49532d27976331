"""Samples of radiance that leaves surfaces towards views.

n texels along the edge of the atlas, N samples.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from lightwell.fields.lightmap.media import media_meshes, volumetric
from lightwell.fields.lightmap.sides import free_places, matte
from lightwell.fields.lightmap.trace import AtlasIrradiance, diffuse_albedo
from lightwell.scenes.atlas import NOWHERE, Atlas
from lightwell.scenes.atlas_charts import cross
from lightwell.scenes.executor import Arrays, Inputs, Recipe
from lightwell.scenes.normal_maps import relief
from lightwell.scenes.scene import Scene
from lightwell.transport.gather import KnownIrradiance, gathered
from lightwell.transport.gather_rays import cosine_directions
from lightwell.transport.lightmap_query import LightmapQuery, query_of_lightmap
from lightwell.transport.queries import frames
from lightwell.transport.radiance import static
from lightwell.transport.samples import SurfacePoints, columns_of
from lightwell.transport.surface import SurfaceDraw, draw_surface
from lightwell.transport.tables import tables
from lightwell.transport.visible import seen_side

Rows = TypeVar("Rows", LightmapQuery, SurfacePoints)

# Points of a scene without glossy surfaces.
FEW_EYES = 1 << 12
# Paths through media are noisier: so many times more of them.
MEDIA_PATHS = 4
# Shares of view directions: towards likely camera positions, the rest as ``draw_surface`` distributes them.
TOWARDS_EYES = 0.5
# Share of the points that lie evenly on the texels: rooms into which no light finds its way have few or none others.
ON_TEXELS = 0.125


@dataclass(frozen=True)
class ViewSamples:
    """N surface points with views, and the radiance that leaves them."""

    query: LightmapQuery
    half_a: np.ndarray
    half_b: np.ndarray
    weight: np.ndarray
    shares: np.ndarray | None = None
    """[N, K, 3] radiance of each group of lamps, where they have switches."""

    @property
    def radiance(self) -> np.ndarray:
        """[N, 3] mean of both halves."""
        return 0.5 * (self.half_a + self.half_b)

    def __getitem__(self, rows: np.ndarray) -> ViewSamples:
        """Select rows."""
        shares = None if self.shares is None else self.shares[rows]
        return ViewSamples(self.query[rows], self.half_a[rows], self.half_b[rows], self.weight[rows], shares)

    def __add__(self, other: ViewSamples) -> ViewSamples:
        """Concatenate; the weights of the second are relative to the mean of the first."""
        a, b = (np.concatenate([getattr(s, n) for s in (self, other)]) for n in ("half_a", "half_b"))
        weight = np.concatenate([self.weight, other.weight * self.weight.mean()])
        return ViewSamples(joined([self.query, other.query]), a, b, weight)


def joined(parts: Sequence[Rows]) -> Rows:
    """Concatenate queries or surface points.

    Args:
        parts: One or more, all of one type.

    Returns:
        All rows, in order.
    """
    names = columns_of(parts[0])
    return type(parts[0])(**{n: np.concatenate([getattr(p, n) for p in parts]) for n in names})


def eye_samples(
    scene: Scene, made: AtlasIrradiance, count: int, paths: int, seed: int, known: np.ndarray | None
) -> ViewSamples:
    """Sample points on glossy surfaces, half of them visible from likely camera positions, and trace their radiance.

    A Lambertian surface needs none, because its radiance follows from the irradiance. Where all surfaces are
    Lambertian, a few points of all surfaces are sampled.

    Args:
        scene: The scene.
        made: Atlas and irradiance.
        count: Number of points.
        paths: Paths per point, even, ≥ 2.
        seed: Seed of the sampler.
        known: [n, n, 3] irradiance / π of the atlas, at which paths end; None: paths are traced to their ends.

    Returns:
        The samples.
    """
    # Workers of a cluster, which trace the paths of a map without irradiance, know the points by their seed alone.
    points, odds = eye_points(scene, count, seed, None if known is None else made)
    if media_meshes(scene).any():
        a, b = volumetric(scene, points, paths * MEDIA_PATHS, seed)
    elif known is None:
        a, b = static(scene, points, paths, seed, recipe=Recipe("eye-points", {"count": count, "seed": seed}))
    else:
        a, b = corrected(scene, made.atlas, points, known, paths, seed)
    good = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
    query = query_of_lightmap(scene, made.atlas, points)
    # A side that is not stored reads texels of another place: it would teach them light that is not theirs.
    good &= ~tables(scene).clear[points.shape] & on_texels(scene, made.atlas, points)
    # What has many texels is looked at: a sky dome must not outweigh a room.
    weight = np.where(good, odds * texels_per_area(scene, made.atlas)[points.shape], 0).astype(np.float32)
    return ViewSamples(query, np.nan_to_num(a), np.nan_to_num(b), weight)


def on_texels(scene: Scene, atlas: Atlas, points: SurfacePoints) -> np.ndarray:
    """Test whether the sides on which points are seen have texels of their own.

    Args:
        scene: The scene.
        atlas: Its atlas.
        points: N surface points.

    Returns:
        [N] bool.
    """
    triangle = tables(scene).first[points.shape] + points.triangle
    return atlas.chart[seen_side(scene, points), triangle] >= 0


def texels_per_area(scene: Scene, atlas: Atlas) -> np.ndarray:
    """Compute the texels of each mesh per square metre that is stored.

    Args:
        scene: Scene of M meshes.
        atlas: Its atlas.

    Returns:
        [M], relative to the mean over the area; 1 for meshes that are not stored.
    """
    t, stored = tables(scene), atlas.chart >= 0
    a, b, c = (atlas.uv[..., k, :].astype(np.float64) for k in range(3))
    texels = np.abs(cross(b - a, c - a)) * stored
    sums = [
        np.bincount(t.mesh_of, weights=v.sum(axis=0), minlength=len(scene.meshes)) for v in (texels, t.area * stored)
    ]
    found = sums[0] / np.maximum(sums[1], 1e-30) * sums[1].sum() / max(sums[0].sum(), 1e-30)
    return np.where(sums[1] > 0, found, 1.0).astype(np.float32)


def plain_samples(scene: Scene, made: AtlasIrradiance, count: int, seed: int) -> LightmapQuery:
    """Draw places evenly over the stored texels, each with a view.

    Args:
        scene: The scene.
        made: Atlas and irradiance.
        count: Number of places.
        seed: Seed of the sampler.

    Returns:
        ``count`` queries.
    """
    rng = np.random.default_rng([seed, 0x91A1])
    points = made.texels.points[rng.integers(len(made.texels.index), size=count)]
    return query_of_lightmap(scene, made.atlas, _seen_anywhere(points, rng))


def _seen_anywhere(points: SurfacePoints, rng: np.random.Generator) -> SurfacePoints:
    """Points with random views about the old ones, which are the normals."""
    view = cosine_directions(points.view, rng.random((2, len(points)))).astype(np.float32)
    return replace(points, view=view)


def eye_inputs(scene: Scene, settings: Mapping[str, Any], arrays: Arrays) -> Inputs:
    """Draw the points of ``eye_samples``; see ``row_recipes.RecipeFunction``.

    Args:
        scene: The scene.
        settings: ``count`` and ``seed``.
        arrays: Not used.

    Returns:
        Columns of ``SurfacePoints``.
    """
    return Inputs(columns_of(eye_points(scene, **settings)[0]))


def eye_points(
    scene: Scene, count: int, seed: int, made: AtlasIrradiance | None = None
) -> tuple[SurfacePoints, np.ndarray]:
    """Draw the points of ``eye_samples``: on glossy meshes, a few on all meshes where none of them is visible.

    Args:
        scene: The scene.
        count: Number of points.
        seed: Seed of the sampler; the same seed gives the same points.
        made: Atlas and irradiance, of which the texels get a share of the points; None: none.

    Returns:
        Points with views, and their [N] weights relative to area-uniform sampling.
    """
    wanted = ~matte(scene) & ~tables(scene).clear
    draw: SurfaceDraw | None = None
    if wanted.any():
        with suppress(ValueError):
            draw = draw_surface(scene, count, seed, floor=count, only=wanted, shown=True)
    draw = draw or draw_surface(scene, FEW_EYES, seed, floor=64, shown=True)
    points, odds = draw.points, draw.weight
    rows = np.flatnonzero(made.glossy & made.stored) if made is not None else np.zeros(0, np.int64)
    if len(rows):
        count = int(ON_TEXELS * len(points))
        drawn = np.random.default_rng([seed, 0x7E0]).integers(len(rows), size=count)
        places = _seen_anywhere(made.texels.points[rows[drawn]], np.random.default_rng([seed, 0x7E1]))
        density = texels_per_area(scene, made.atlas)
        level = np.average(density[points.shape], weights=odds)
        points = joined([points[np.arange(len(points) - count)], places])
        # Meshes that share one texel have none of their own, and no weight.
        odds = np.concatenate([odds[: len(odds) - count], level / np.maximum(density[places.shape], 1e-6 * level)])
    return towards_eyes(scene, points, seed), odds.astype(np.float32)


def corrected(
    scene: Scene, atlas: Atlas, points: SurfacePoints, known: np.ndarray, paths: int, seed: int
) -> np.ndarray:
    """Trace radiance by final gather, with its diffuse part replaced by the light map's.

    Args:
        scene: The scene.
        atlas: Its atlas.
        points: N surface points.
        known: [n, n, 3] irradiance / π of the atlas.
        paths: Paths per point, even, ≥ 2.
        seed: Seed of the sampler.

    Returns:
        [2, N, 3] radiance, two independent half means.
    """
    light, seen = gathered(scene, points, KnownIrradiance.of(scene, atlas, known, matte(scene)), paths, seed)
    query = query_of_lightmap(scene, atlas, points)
    color = diffuse_albedo(query)
    # E' is that of normals without relief, and directions below a bent horizon are never drawn.
    stored = (query.uv1 != NOWHERE).any(axis=1, keepdims=True) & ~relief(scene)[points.shape, None]
    return light + np.where(stored, color * (bilinear(known, query.uv1) - seen), 0)


def bilinear(image: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Read an image bilinearly, as the graph's op ``texture`` does.

    Args:
        image: [n, n, C] image.
        uv: [N, 2] texture coordinates in [0, 1].

    Returns:
        [N, C] values.
    """
    n = image.shape[0]
    at = np.clip(uv * np.float32(n) - np.float32(0.5), 0, n - 1)
    low = at.astype(np.int64)
    high, t = np.minimum(low + 1, n - 1), (at - low)[..., None].astype(np.float32)
    upper = image[low[:, 1], low[:, 0]] * (1 - t[:, 0]) + image[low[:, 1], high[:, 0]] * t[:, 0]
    lower = image[high[:, 1], low[:, 0]] * (1 - t[:, 0]) + image[high[:, 1], high[:, 0]] * t[:, 0]
    return upper * (1 - t[:, 1]) + lower * t[:, 1]


def towards_eyes(scene: Scene, points: SurfacePoints, seed: int) -> SurfacePoints:
    """Turn a share of the views towards free places that the surface faces.

    Occlusion is not tested: what lies behind another surface is seen through a door, or never.

    Args:
        scene: The scene.
        points: N surface points with views.
        seed: Seed of the sampler.

    Returns:
        The points with their views.
    """
    rng = np.random.default_rng([seed, 0xE7E])
    places = free_places(scene, rng)
    position, _, flat = frames(scene, points)
    flat = np.where((flat * points.view).sum(axis=1, keepdims=True) < 0, -flat, flat)
    eye = places[rng.integers(len(places), size=len(points))] - position
    eye /= np.maximum(np.linalg.norm(eye, axis=1, keepdims=True), 1e-9)
    turned = (rng.random(len(points)) < TOWARDS_EYES) & ((eye * flat).sum(axis=1) > 0.05)
    view = np.where(turned[:, None], eye, points.view).astype(np.float32)
    return SurfacePoints(points.shape, points.triangle, points.barycentric, view)
