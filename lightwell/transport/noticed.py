"""Which points could notice a change of the scene: those whose paths cross the boxes around what has changed.

From every point a few directions are followed to the first surface. A point notices a change when one of these segments
crosses a changed box, when a way from the surface that was hit to the light does, or when a changed lamp lights that
surface. Where the light of a point is learned whole, its own ways to the light count as well. Later bounces are left
out: what they carry is weaker by the reflectance of two surfaces.
"""

from __future__ import annotations

import numpy as np

from lightwell.backend import dr, mi
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Turning, Variable, surrounds
from lightwell.transport.interactions import upload
from lightwell.transport.sources import Emitters, Source, declared

# Directions that are followed from a point.
RAYS = 12
# Boxes are enlarged by this share of the scene's extent, and segments begin so far from their surface.
MARGIN, LIFT = 1e-3, 1e-4
# Distance of what no surface stops, in extents of the scene; share of it within which something was met: single
# precision rounds it.
FAR, MET = 4.0, 1 - 1e-6


def noticed(
    scene: Scene,
    position: np.ndarray,
    normal: np.ndarray,
    boxes: np.ndarray,
    lamps: np.ndarray,
    seed: int,
    rays: int = RAYS,
    *,
    variable: Variable | None = None,
    light: np.ndarray | None = None,
) -> np.ndarray:
    """Find the points that could notice a change.

    Args:
        scene: The scene after the change.
        position: [N, 3] points, metres.
        normal: [N, 3] unit normals.
        boxes: [B, 2, 3] boxes around what has changed, metres.
        lamps: [L, 2, 3] those that emit light; they are looked at for the scene's own light only.
        seed: Seed of the directions.
        rays: Directions that are followed from a point, and ways to the light from it.
        variable: What the declared light is; None: the scene's own light, of which a lamp is chosen for each way, most
            often one that would bring much.
        light: [N, 3] position of the declared light, or direction to it; None without one.

    Returns:
        [N] bool.
    """
    found = np.zeros(len(position), bool)
    margin, lift, far = MARGIN * scene.extent, LIFT * scene.extent, FAR * scene.extent
    wide = np.stack([boxes[:, 0] - margin, boxes[:, 1] + margin], axis=1)
    # The ways to the light have random numbers of their own.
    random, chance = (np.random.default_rng([seed, stream]) for stream in (0xED17, 0xED18))
    start, source = position + lift * normal, _source(scene, variable, light)
    whole = variable is None or surrounds(variable)
    for lamp in lamps:
        found |= _sees(scene, start, lamp.mean(axis=0))
    for _ in range(rays):
        direction = _cosine(normal, random)
        distance = _distance(scene, start, direction)
        # Not quite to the surface: the next segments begin in front of it.
        end = start + (distance - lift)[:, None] * direction
        found |= crosses(start, start + distance[:, None] * direction, wide)
        if source is not None:
            met = distance < MET * far
            found |= met & crosses(end, _to_light(scene, source, end, -direction, chance), wide)
        if source is not None and whole:
            found |= crosses(start, _to_light(scene, source, start, normal, chance), wide)
        for lamp in lamps:
            found |= _sees(scene, end, lamp.mean(axis=0))
    return found


def crosses(start: np.ndarray, end: np.ndarray, boxes: np.ndarray) -> np.ndarray:
    """Find the segments that cross one of several boxes.

    Args:
        start: [N, 3] points.
        end: [N, 3] points.
        boxes: [B, 2, 3] smallest and largest corners.

    Returns:
        [N] bool.
    """
    found = np.zeros(len(start), bool)
    step = end - start
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1 / np.where(step == 0, 1e-30, step)
        for low, high in boxes:
            a, b = (low - start) * inverse, (high - start) * inverse
            first, last = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
            found |= (first <= last) & (last >= 0) & (first <= 1)
    return found


def _source(scene: Scene, variable: Variable | None, light: np.ndarray | None) -> Source | None:
    """The light of points; None where there is none."""
    if variable is None:
        return Emitters.of(scene) if scene.has_static_light else None
    if light is None or (isinstance(variable, Turning) and scene.surrounding is None):
        return None
    return declared(variable, upload(mi.Vector3f, light), scene)


def _to_light(
    scene: Scene, source: Source, place: np.ndarray, normal: np.ndarray, random: np.random.Generator
) -> np.ndarray:
    """[N, 3] ends of ways from places to the light; the places themselves where none of it comes from there.

    What stands in the way is not looked for: light passes glass, and what blocked it may be what has changed.
    """
    it = dr.zeros(mi.SurfaceInteraction3f, len(place))
    it.p, it.n = upload(mi.Point3f, place), mi.Normal3f(upload(mi.Vector3f, normal))
    it.sh_frame = mi.Frame3f(it.n)
    it.wi = mi.Vector3f(0, 0, 1)
    u = upload(mi.Point2f, random.random((len(place), 2)))
    d, weight, _, _, ray = source.sample(scene.mi, it, u, mi.Bool(True))
    length = dr.minimum(ray.maxt, FAR * scene.extent)
    way = np.array(dr.select(dr.max(weight) > 0, d * length, 0), np.float64)
    return place + way.T


def _cosine(normal: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Directions around normals, by the cosine."""
    sphere = random.normal(size=normal.shape)
    direction = normal + sphere / np.linalg.norm(sphere, axis=1, keepdims=True)
    length = np.linalg.norm(direction, axis=1, keepdims=True)
    return np.where(length > 1e-6, direction / np.maximum(length, 1e-6), normal)


def _distance(scene: Scene, start: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """[N] distance to the first surface."""
    ray = mi.Ray3f(upload(mi.Point3f, start), upload(mi.Vector3f, direction))
    hit = scene.mi.ray_intersect_preliminary(ray)
    far = FAR * scene.extent
    return np.array(dr.select(hit.is_valid(), dr.minimum(hit.t, far), far), np.float64)


def _sees(scene: Scene, start: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Whether nothing stands before the last hundredth of the way to a place."""
    way = 0.99 * (place - start)
    length = np.maximum(np.linalg.norm(way, axis=1), 1e-9)
    return _distance(scene, start, way / length[:, None]) >= length
