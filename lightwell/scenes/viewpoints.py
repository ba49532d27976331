"""Sampling of cameras: positions in free air, and directions with depth and variety in which few rays escape."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lightwell.core.sobol import Sobol
from lightwell.scenes.vectors import vector

from .free_air import SEEN, free_air
from .scene import Camera, Scene
from .variables import PointLight, Variable

# Clearance of cameras as a share of the scene's longest edge, halved where too few positions have it.
EYE_CLEARANCE = 0.05
HALVINGS = 5

# Where no eye fits in and around the light's box, eyes are looked for in all of the scene, then above and around it, so
# far away, as shares of its longest edge: a car park has no air of its own.
AROUND = (0.0, 0.25, 0.5)
# Where none fits there either, cameras look at the middle of the scene from outside: their azimuths and elevations,
# degrees; those from below are for what only shows its underside.
OUTSIDE_AZIMUTHS, OUTSIDE_ELEVATIONS = 12, (15.0, 40.0, -25.0)

# Positions tested per requested camera (at least LEAST_EYES), views per position, rays per view.
EYES_PER_CAMERA, LEAST_EYES, LOOKS, GRID = 6, 64, 12, (8, 6)
# Positions that are tried, a power of two as Sobol sequences require.
CANDIDATES = 2048

FOV_Y = 60.0

# Range of pitches below and above the horizon, degrees.
PITCH = (-28.0, 14.0)

# Views rank lower when a larger share than this escapes, shows back faces, or surfaces nearer than NEAR of the extent.
ESCAPING, BACK, CLOSE, NEAR = 0.3, 0.05, 0.2, 0.08
# What is farther beside the looked-at part than this share of its longest edge counts as escaping.
BESIDE = 0.05

# Cameras nearer than this (distance relative to the extent, plus a third of the change of direction) are alike.
APART = 0.4


def camera_frame(camera: Camera) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compute the axes of a camera.

    Args:
        camera: Camera with position, target and up.

    Returns:
        Unit vectors [3]: right, up and forward.
    """
    forward = np.asarray(camera.target, dtype=np.float64) - np.asarray(camera.position)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, camera.up)
    right /= np.linalg.norm(right)
    return right, np.cross(right, forward), forward


def view_directions(camera: Camera, width: int, height: int) -> np.ndarray:
    """Compute the directions through the pixels of an image, row by row from the top.

    Args:
        camera: Pinhole camera.
        width: Pixels of a row.
        height: Rows.

    Returns:
        [width * height, 3] unit directions.
    """
    return _directions(np.array(camera_frame(camera))[:, None], camera.fov_y, width, height)[0]


def _directions(frames: np.ndarray, fov_y: float, width: int, height: int) -> np.ndarray:
    """Directions [K, width * height, 3] through the pixels of K cameras, whose axes are ``frames`` [3, K, 3]."""
    right, up, forward = frames[:, :, None]
    half = np.tan(np.radians(fov_y) / 2)
    y, x = np.meshgrid(1 - 2 * (np.arange(height) + 0.5) / height, np.arange(width) + 0.5, indexing="ij")
    x = (2 * x / width - 1) * width / height
    ways = forward + half * (x.reshape(-1, 1) * right + y.reshape(-1, 1) * up)
    return ways / np.linalg.norm(ways, axis=-1, keepdims=True)


def _frames(looks: Sequence[Camera]) -> np.ndarray:
    """Axes [3, K, 3] of K cameras at once: right, up and forward, as of ``camera_frame``."""
    position, target, above = (np.array([getattr(c, name) for c in looks]) for name in ("position", "target", "up"))
    forward = target - position
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    right = np.cross(forward, above)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    return np.stack([right, np.cross(right, forward), forward])


def sample_cameras(
    scene: Scene, variable: Variable, count: int, seed: int, authored: bool = False, outside: bool = True
) -> list[Camera]:
    """Choose different cameras with a field of view of 60 degrees.

    Views are ranked by their mean depth, the variety of their depths and the number of surfaces in them.

    Args:
        scene: Scene to look at.
        variable: The declared light; cameras are placed where it can be.
        count: Number of cameras, ≥ 0.
        seed: Seed of the cameras.
        authored: Put the scene's own cameras first.
        outside: Where no eye fits into the scene, such as a floor alone or a closed box, look at it from above, from
            around it, or from afar. False: refuse.

    Returns:
        ``count`` cameras.

    Raises:
        ValueError: No eye fits into the scene, and ``outside`` is False.
    """
    own = list(scene.cameras)[:count] if authored else []
    if len(own) == count:
        return own
    random = np.random.default_rng(np.random.SeedSequence([seed, 17]))
    wanted, extent = max(LEAST_EYES, EYES_PER_CAMERA * count), _extent(scene)
    eyes = _eyes(scene, variable, wanted, random)
    if not len(eyes) and not outside:
        raise ValueError(f"cameras: no eye fits into the free air of scene '{scene.name}'; add a camera to the scene")
    if not len(eyes):
        eyes = _eyes_around(scene, wanted, random)
    looks = [camera for eye in eyes for camera in _looks(eye, extent, random)] or _from_outside(scene, random)
    chosen = _spread(looks, _worth(scene, looks), count - len(own), extent)
    return own + [
        Camera(looks[k].position, looks[k].target, fov_y=FOV_Y, name=f"view {n + 1}") for n, k in enumerate(chosen)
    ]


def _extent(scene: Scene) -> float:
    """Longest edge of the part of the scene that is looked at, metres."""
    return float((scene.core[1] - scene.core[0]).max())


def _eyes(scene: Scene, variable: Variable, count: int, random: np.random.Generator) -> np.ndarray:
    """Draw up to ``count`` points [K, 3] of free air in and around the light's box, with the largest clearance."""
    low, high = scene.core
    if isinstance(variable, PointLight):
        # Positions are drawn where the light can be: its box and a tenth of the scene around it.
        margin = 0.1 * (high - low)
        low = np.maximum(low, np.asarray(variable.low) - margin)
        high = np.minimum(high, np.asarray(variable.high) + margin)
    return _free(scene, low, high, count, random)


def _free(scene: Scene, low: np.ndarray, high: np.ndarray, count: int, random: np.random.Generator) -> np.ndarray:
    """Draw up to ``count`` points [K, 3] of free air in a box, with the largest clearance; none where it has none."""
    points = low + Sobol(3, random).random(CANDIDATES) * (high - low)
    air = free_air(scene)
    free = points[:0]
    for halving in range(HALVINGS):
        free = points[air.accepts(points, EYE_CLEARANCE * _extent(scene) / 2**halving)]
        if len(free) >= count:
            return free[:count]
    return free


def _eyes_around(scene: Scene, count: int, random: np.random.Generator) -> np.ndarray:
    """Draw up to ``count`` points [K, 3] of free air in the scene, above it and around it, from where it is seen."""
    low, high = scene.core
    found = np.zeros((0, 3))
    for share in AROUND:
        more = share * _extent(scene)
        # Not below it: two-sided ground would be seen from under it.
        found = _free(scene, low - more * np.array([1, 0, 1]), high + more, count, random)
        found = found[free_air(scene).views(found).hit >= SEEN] if len(found) else found
        if len(found):
            break
    return found


def _from_outside(scene: Scene, random: np.random.Generator) -> list[Camera]:
    """Make cameras around the scene that look at its middle and see all of it; nothing is said about the air there."""
    low, high = scene.core
    middle, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
    azimuth = 2 * np.pi * (np.arange(OUTSIDE_AZIMUTHS) + random.random()) / OUTSIDE_AZIMUTHS
    looks = []
    for elevation in np.radians(OUTSIDE_ELEVATIONS):
        y = np.full(OUTSIDE_AZIMUTHS, np.sin(elevation))
        away = np.stack([np.cos(elevation) * np.sin(azimuth), y, -np.cos(elevation) * np.cos(azimuth)], axis=1)
        eyes = middle + radius / np.sin(np.radians(FOV_Y / 2)) * away
        looks += [Camera(vector(eye), vector(middle), fov_y=FOV_Y) for eye in eyes]
    return looks


def _looks(eye: np.ndarray, extent: float, random: np.random.Generator) -> list[Camera]:
    """Make cameras at ``eye``: evenly spaced azimuths from a random start, random pitches."""
    azimuth = 2 * np.pi * (np.arange(LOOKS) + random.random()) / LOOKS
    pitch = np.radians(random.uniform(*PITCH, LOOKS))
    ways = np.stack([np.cos(pitch) * np.sin(azimuth), np.sin(pitch), -np.cos(pitch) * np.cos(azimuth)], axis=1)
    position = vector(eye)
    return [Camera(position, vector(eye + 0.25 * extent * w), fov_y=FOV_Y) for w in ways]


def _within(scene: Scene, places: np.ndarray) -> np.ndarray:
    """[...] whether places [..., 3] lie in the part of the scene that is looked at, or just beside it."""
    low, high = scene.core
    beside = BESIDE * _extent(scene)
    return np.logical_and(places >= low - beside, places <= high + beside).all(axis=-1)


def _worth(scene: Scene, looks: list[Camera]) -> np.ndarray:
    """Rank each view [K] by depth and variety."""
    extent, rays = _extent(scene), GRID[0] * GRID[1]
    directions = _directions(_frames(looks), FOV_Y, *GRID).reshape(-1, 3)
    origins = np.repeat([camera.position for camera in looks], rays, axis=0)
    hit, back, distance, shape = (x.reshape(-1, rays) for x in free_air(scene).trace(origins, directions))
    # Domes of sky and ground of kilometres are not what a view is chosen for.
    places = origins.reshape(*distance.shape, 3) + distance[..., None] * directions.reshape(*distance.shape, 3)
    hit &= _within(scene, places)
    depth = np.where(hit, np.clip(distance, 1e-3 * extent, extent) / extent, 0)
    # Rays that escape have no depth and do not count in the variety.
    log_depth = np.ma.masked_array(np.log(np.where(hit, depth, 1)), mask=~hit)
    kinds = np.sort(np.where(hit, shape, shape.max() + 1), axis=1)
    surfaces = 1 + (np.diff(kinds, axis=1) > 0).sum(axis=1)
    worth = depth.mean(axis=1) + 0.3 * log_depth.std(axis=1).filled(0) + 0.08 * np.log2(surfaces)
    for part, allowed in (((~hit), ESCAPING), (back, BACK), (hit & (depth < NEAR), CLOSE)):
        worth = worth - 4 * np.maximum(part.mean(axis=1) - allowed, 0)
    return worth


def _spread(looks: list[Camera], worth: np.ndarray, count: int, extent: float) -> list[int]:
    """Choose ``count`` views greedily: the best rank among those that differ from the ones already chosen."""
    eyes = np.array([c.position for c in looks]) / extent
    ways = np.array([c.target for c in looks]) / extent - eyes
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    value = worth - worth.min() + 1e-6
    chosen: list[int] = []
    for _ in range(min(count, len(looks))):
        best = int(np.argmax(value))
        chosen.append(best)
        apart = np.linalg.norm(eyes - eyes[best], axis=1) + np.linalg.norm(ways - ways[best], axis=1) / 3
        value = value * (1 - np.exp(-((apart / APART) ** 2)))
    return chosen
