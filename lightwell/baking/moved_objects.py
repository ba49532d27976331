"""Scores what probes are for: small white balls in free air, lit by the written probes, beside path tracing.

A ball stands in the middle of each view of the report, where a person can see it, under the lights of that view. Direct
light of a point light or sun is in both pictures, because renderers add it to what probes give. A ball is so small that
it does not change the light around it: the irradiance at its surface is that of the empty air.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations_with_replacement

import numpy as np

from lightwell.baking.evaluate import Shipped, view_name
from lightwell.baking.poses import standing, view_pose
from lightwell.baking.quality import MOST_STOPS
from lightwell.baking.view_setup import ViewSetup
from lightwell.fields.protocol import Lowered, State
from lightwell.graph import Graph, evaluate
from lightwell.probes.trace import air_light, direct_irradiance
from lightwell.report.picture_metrics import exposure_unit
from lightwell.report.records import MovedObject
from lightwell.scenes.free_air import free_air
from lightwell.scenes.scene import Camera, Scene
from lightwell.scenes.viewpoints import camera_frame

# Pixels along an edge of the picture of a ball, and the radius of the ball in it, of 1.
SIZE, EXTENT = 64, 0.94
# Reflectance of a ball, and light paths of each of its pixels.
REFLECTANCE, PATHS = 0.8, 128
# Places along the middle of a view that are tried; the distance to the nearest surface in radii, and to the eye.
STEPS, SURFACE_RADII, EYE_RADII = 40, 2.5, 6.0
# Nearest place, of the extent of the scene.
NEAREST = 0.02
# Degree of the polynomial of the normal that takes the noise from the traced irradiance, which is smooth on a ball.
DEGREE = 4
# Inputs of graphs that light what is added to a scene: a place, a normal, and what is constant in a frame.
OF_AIR = {"position", "normal", "light", "lamps", "pose"}
SEED = 0xBA11


def lights_air(lowered: Lowered) -> Graph | None:
    """Find the graph of a field that lights what is added to the scene.

    Args:
        lowered: What the field writes.

    Returns:
        The graph of its probes, or its own where that asks for nothing that only surfaces have; None: neither.
    """
    if lowered.probes is not None:
        return lowered.probes
    graph = lowered.graph
    return graph if {"position", "normal"} <= graph.inputs.keys() <= OF_AIR and not lowered.pictures else None


def moved_objects(state: State, stage: ViewSetup, shipped: Sequence[Shipped]) -> list[MovedObject]:
    """Draw balls that probes light, and the same by path tracing.

    Args:
        state: The prepared scene.
        stage: Views and lights of the report.
        shipped: The fits as they are written.

    Returns:
        One ball for each view that has room for one and light there; none without probes.
    """
    graphs = [(s, graph) for s in shipped if (graph := lights_air(s.lowered)) is not None]
    found = []
    for k, (camera, _) in enumerate(stage.views if graphs else ()):
        pose = view_pose(state.scene, k)
        scene = standing(state.scene, pose)
        ball = ball_in_view(scene, camera)
        if ball is None:
            continue
        normals, mask = ball_normals(camera)
        points = ball[0] + ball[1] * normals
        learned, traced, direct = np.zeros((3, len(points), 3))
        for s, graph in graphs:
            light, weight = stage.place(s.role, k), stage.weight(s.role)
            frame = {"light": light, "pose": np.asarray(pose or ()), **s.lowered.frame}
            learned += weight * _learned(graph, points, normals, frame)
            seed, variable = state.job.request.seed + SEED + k, state.for_role(s.role).variable
            of_light = {} if s.role == "static" else {"variable": variable, "light": light}
            traced += weight / np.pi * air_light(scene, points, PATHS, seed, normals=normals, **of_light).irradiance
            if of_light:
                direct += weight / np.pi * direct_irradiance(scene, points, normals, **of_light, seed=seed)
        name = f"ball, view '{view_name(camera, k)}'"
        values = direct + np.maximum(learned, 0), direct + smoothed(traced, normals)
        found.append(MovedObject(name, *(_picture(x, mask) for x in values), mask))
    units = [unit for ball in found if (unit := exposure_unit(ball.reference[ball.mask]))]
    least = max(units, default=0.0) / 2**MOST_STOPS
    return [ball.exposed(max(exposure_unit(ball.reference[ball.mask]) or 0.0, least)) for ball in found if least]


def ball_in_view(scene: Scene, camera: Camera) -> tuple[np.ndarray, float] | None:
    """Choose a place in free air in the middle of a view.

    Args:
        scene: The scene.
        camera: The view.

    Returns:
        [3] middle of a ball and its radius, metres; None where there is no room.
    """
    extent = float((scene.core[1] - scene.core[0]).max())
    _, _, forward = camera_frame(camera)
    far = np.geomspace(NEAREST * extent, extent, STEPS)
    places = np.asarray(camera.position) + far[:, None] * forward
    air = free_air(scene)
    room = air.distance(places)
    free = air.accepts(places, NEAREST * extent / EYE_RADII)
    # What is behind the first surface is not seen.
    seen = np.logical_and.accumulate(free | (room > 0.5 * np.diff(far, append=far[-1])))
    radius = np.where(free & seen, np.minimum(room / SURFACE_RADII, far / EYE_RADII), 0.0)
    best = int(radius.argmax())
    return (places[best], float(radius[best])) if radius[best] > 0 else None


def ball_normals(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Compute the normals of a ball in the pixels of a picture of it.

    Args:
        camera: Looks at the ball, from far away.

    Returns:
        [N, 3] unit normals and [SIZE, SIZE] bool: the pixels that show the ball, N of them.
    """
    right, up, forward = camera_frame(camera)
    at = (2 * (np.arange(SIZE) + 0.5) / SIZE - 1) / EXTENT
    y, x = np.meshgrid(-at, at, indexing="ij")
    mask = x**2 + y**2 < 1
    x, y = x[mask][:, None], y[mask][:, None]
    return x * right + y * up - np.sqrt(1 - x**2 - y**2) * forward, mask


def smoothed(values: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Fit a polynomial of the normal, which takes noise away.

    Args:
        values: [N, 3] noisy irradiance.
        normals: [N, 3] unit normals.

    Returns:
        [N, 3] values of the polynomial, ≥ 0.
    """
    powers = [c for degree in range(DEGREE + 1) for c in combinations_with_replacement(range(3), degree)]
    rows = np.stack([np.prod(normals[:, list(c)], axis=1) for c in powers], axis=1)
    return np.maximum(rows @ np.linalg.lstsq(rows, values, rcond=1e-6)[0], 0)


def _learned(graph: Graph, points: np.ndarray, normals: np.ndarray, frame: Mapping[str, np.ndarray]) -> np.ndarray:
    """[N, 3] radiance of a white surface that the probes light."""
    rows = {name: np.float32(value).reshape(1, -1) for name, value in frame.items() if name in graph.inputs}
    given = {"position": np.float32(points), "normal": np.float32(normals), **rows}
    return np.asarray(evaluate(graph, given)["radiance"], np.float64)


def _picture(values: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """[SIZE, SIZE, 3] values of the ball's pixels, black around it."""
    picture = np.zeros((*mask.shape, 3))
    picture[mask] = REFLECTANCE * values
    return picture
