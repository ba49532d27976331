"""Sampling of positions for lights and cameras: seeded, low-discrepancy, in free air.

    train  = sample_lights(scene, variable, 512, seed=1)      # [512, 3]
    test   = held_out_lights(scene, variable, 32, seed=1)     # never the same positions
    views  = sample_cameras(scene, variable, 24, seed=1)

For a ``Sun`` the positions are unit directions on its arc, for a ``Turning`` those of the map's north, and the geometry
is not tested.
"""

from __future__ import annotations

import numpy as np

from lightwell.core.sobol import Sobol

from .free_air import FreeAir, free_air
from .scene import Camera, Scene
from .variables import PointLight, Sun, Turning, Variable, has_sky
from .viewpoints import camera_frame, view_directions
from .viewpoints import sample_cameras as sample_cameras

# Independent streams of random numbers of one seed.
_TRAINING, _HELD_OUT, _INITIAL = range(3)

# Candidates are tested in blocks of this size, a power of two as Sobol sequences require.
BLOCK = 2048

# A box of which less than this part is free air is refused.
LEAST_FREE = 0.02

# Held-out lights are picked from this many times their number.
POOL = 8

# An initial light that reaches this share of what the camera sees reaches enough; more is not better.
LIT_ENOUGH = 0.4

# Width of an image divided by its height, where only a camera is known.
ASPECT = 1.6

# Edge of the inner box, outside of which positions count as near the border, relative to the declared box.
INNER = 0.8


def sample_lights(scene: Scene, variable: Variable, count: int, seed: int) -> np.ndarray:
    """Sample training lights, uniformly (scrambled Sobol) in the part of the box that is free air.

    A box that lies nearly all inside geometry raises ``ValueError``.

    Args:
        scene: Scene to place the light in.
        variable: The declared light.
        count: Number of lights, ≥ 1.
        seed: Seed of the positions.

    Returns:
        [count, 3] float32 positions, metres (unit directions to a sun).
    """
    return _lights(scene, variable, count, seed, _TRAINING)


def held_out_lights(scene: Scene, variable: Variable, count: int, seed: int) -> np.ndarray:
    """Sample test lights; none is a training light of any seed's ``sample_lights``.

    A quarter lies near surfaces, a quarter outside the inner 80 % of the box, the others are uniform.

    Args:
        scene: Scene to place the light in.
        variable: The declared light.
        count: Number of lights, ≥ 1.
        seed: Seed of the positions.

    Returns:
        [count, 3] float32 positions, metres (unit directions to a sun).
    """
    if isinstance(variable, (Sun, Turning)):
        return _lights(scene, variable, count, seed, _HELD_OUT)
    pool = _lights(scene, variable, POOL * count, seed, _HELD_OUT)
    quarter = count // 4
    # Every fourth of the nearest eighth.
    near = np.argsort(free_air(scene).distance(pool), kind="stable")[:count:4][:quarter]
    rest = np.setdiff1d(np.arange(len(pool)), near)
    border = rest[_near_border(variable, pool[rest])][:quarter]
    rest = np.setdiff1d(rest, border)[: count - len(near) - len(border)]
    return pool[np.concatenate([near, border, rest])]


def _near_border(variable: PointLight, points: np.ndarray) -> np.ndarray:
    """Test [N] whether points lie outside the inner 80 % of the box."""
    low, high = np.asarray(variable.low), np.asarray(variable.high)
    return np.any(np.abs(2 * (points - low) / (high - low) - 1) > INNER, axis=1)


def _lights(scene: Scene, variable: Variable, count: int, seed: int, stream: int) -> np.ndarray:
    """Draw [count, 3] accepted positions (or sun directions) of one random stream, in the order of Sobol's sequence."""
    random = np.random.default_rng(np.random.SeedSequence([seed, stream]))
    if isinstance(variable, (Sun, Turning)):
        return variable.sample((np.arange(count) + random.random(count)) / count)[random.permutation(count)]
    sobol, air = Sobol(3, random), free_air(scene)
    kept: list[np.ndarray] = []
    found = tried = 0
    while found < count:
        candidates = variable.sample(sobol.random(BLOCK))
        kept.append(candidates[air.accepts(candidates, variable.clearance)])
        found, tried = found + len(kept[-1]), tried + BLOCK
        if found < LEAST_FREE * tried:
            raise ValueError(_no_room(variable, found, tried))
    return np.concatenate(kept)[:count]


def _no_room(variable: PointLight, found: int, tried: int) -> str:
    corners = ",".join(f"{v:g}" for v in (*variable.low, *variable.high))
    return (
        f"vary: the declared box lies inside geometry ({found} of {tried} positions of {variable.name}.position="
        f"box({corners}) are in free air, {variable.clearance:g} m from surfaces); move the box into a room or set a "
        f"smaller {variable.name}.clearance"
    )


def free_cells(scene: Scene, variable: PointLight, n: int = 32) -> np.ndarray:
    """Test which cells of the declared box are allowed positions.

    Args:
        scene: Scene to place the light in.
        variable: The declared light.
        n: Cells along each edge, ≥ 1.

    Returns:
        [n, n, n] bool, indexed [z, y, x], tested at the middle of each cell.
    """
    middle = (np.arange(n) + 0.5) / n
    z, y, x = np.meshgrid(middle, middle, middle, indexing="ij")
    points = variable.sample(np.stack([x, y, z], axis=-1).reshape(-1, 3))
    blocks = np.array_split(points, max(1, len(points) // (4 * BLOCK)))
    air = free_air(scene)
    return np.concatenate([air.accepts(b, variable.clearance, rays=32) for b in blocks]).reshape(n, n, n)


def initial_light(scene: Scene, variable: Variable, camera: Camera, candidates: int = 256) -> np.ndarray:
    """Choose a position that lights much of what a camera sees, away from the middle of the image; deterministic.

    Args:
        scene: Scene to place the light in.
        variable: The declared light.
        camera: Camera of the first image.
        candidates: Number of positions to compare, ≥ 1.

    Returns:
        [3] float32 allowed position, metres (unit direction to a sun).
    """
    if isinstance(variable, Turning):
        return variable.direction(variable.initial).astype(np.float32)
    air = free_air(scene)
    points, to_eye = _seen_points(air, camera)
    lights = _lights(scene, variable, candidates, 0, _INITIAL)
    if len(points) == 0:
        return lights[0]
    worth = np.minimum(_lit_part(air, variable, lights, points, to_eye, scene.extent) / LIT_ENOUGH, 1)
    if isinstance(variable, PointLight):
        # Prefer positions far from the camera (a light beside it casts no visible shadows), in open air, and high.
        eye = np.asarray(camera.position)
        depth = np.median(np.linalg.norm(points - eye, axis=1))
        height = (lights[:, 1] - variable.low[1]) / (variable.high[1] - variable.low[1])
        worth += 0.5 * np.minimum(np.linalg.norm(lights - eye, axis=1) / (0.75 * depth), 1) + 0.3 * height
        worth += 0.5 * np.minimum(air.distance(lights) / (4 * variable.clearance), 1)
        worth -= 0.5 * _centrality(camera, lights)
    return lights[np.argmax(worth)]


def reached_part(scene: Scene, variable: Variable, lights: np.ndarray, camera: Camera) -> np.ndarray:
    """Compute how much of what a camera sees is reached by lights.

    Args:
        scene: The scene.
        variable: The declared light.
        lights: [L, 3] positions, metres (unit directions to a sun).
        camera: The camera.

    Returns:
        [L] shares of a coarse image, in [0, 1].
    """
    air = free_air(scene)
    points, to_eye = _seen_points(air, camera)
    if not len(points):
        return np.zeros(len(lights))
    if isinstance(variable, Turning):
        # It shines from all around.
        return np.ones(len(lights))
    return _lit_part(air, variable, lights, points, to_eye, scene.extent)


def _seen_points(air: FreeAir, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Find the points [P, 3] of a coarse image, and unit directions [P, 3] back to the camera."""
    directions = view_directions(camera, round(10 * ASPECT), 10)
    eye = np.broadcast_to(np.asarray(camera.position, dtype=np.float64), directions.shape)
    hit, _, distance, _ = air.trace(eye, directions)
    return (eye + np.where(hit, distance, 0)[:, None] * directions)[hit], -directions[hit]


def _lit_part(
    air: FreeAir, variable: Variable, lights: np.ndarray, points: np.ndarray, to_eye: np.ndarray, extent: float
) -> np.ndarray:
    """Compute [L] the share of the points that each light reaches, tested just in front of the visible side."""
    slack = 1e-3 * extent
    ends = np.tile(points + slack * to_eye, (len(lights), 1))
    starts = np.repeat(lights.astype(np.float64), len(points), axis=0)
    if isinstance(variable, Sun):
        starts = ends + 4 * extent * starts
    lit = 1 - air.occluded(starts, ends, slack).reshape(len(lights), len(points)).mean(axis=1)
    # A sun that has set lights nothing, also where no ground is in its way.
    return np.where(lights[:, 1] > 0, lit, 0) if has_sky(variable) else lit


def _centrality(camera: Camera, lights: np.ndarray) -> np.ndarray:
    """Compute [L] 1 in the middle of the image, 0 outside it and behind the camera; occlusion is ignored."""
    right, up, forward = camera_frame(camera)
    way = lights - np.asarray(camera.position)
    depth = way @ forward
    half = np.tan(np.radians(camera.fov_y) / 2)
    across = np.stack([way @ right / ASPECT, way @ up], axis=1) / (np.maximum(depth, 1e-6) * half)[:, None]
    return np.clip(1 - np.abs(across).max(axis=1), 0, 1) * (depth > 0)
