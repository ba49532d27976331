"""Scores of a field, as it is written, against the path-traced reference at held-out lights and views."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from lightwell.baking.light_states import axis_value
from lightwell.baking.reference_budget import EVALUATION_SEED
from lightwell.core.sun_path import LOWEST, clock
from lightwell.fields.baked import Baked
from lightwell.fields.protocol import Fit, Lowered
from lightwell.report.records import PointComparison, ViewComparison, ViewPicture, ViewSurfaces
from lightwell.scenes.movers import Mover
from lightwell.scenes.placing import held_out_lights, initial_light, reached_part, sample_cameras
from lightwell.scenes.scene import Camera, Scene
from lightwell.scenes.variables import Turning, Variable, declare, has_sky
from lightwell.transport import Query, SurfacePoints, indirect, static
from lightwell.transport.camera import gbuffer

if TYPE_CHECKING:
    from lightwell.baking.display_pictures import DisplayView
    from lightwell.baking.reference import PointReference, SweepReference, ViewReference
    from lightwell.baking.view_setup import ViewSetup

# Index of the region of a pixel that shows no surface.
NO_REGION = -1
# The second expert's least share in a pixel that counts as blended.
BLENDED = 0.01
# Held-out lights that a view may have; of so many that reach most of it, the brightest is found by paths.
VIEW_LIGHTS, TRACED_LIGHTS = 32, 4
# In a view of light that stands still, this share of the pixels finds some by so many paths; where one does not, so
# many times as many cameras are asked. Four scenes: 0 to 0.006 in closed rooms, 0.08 and more in dim ones.
LIT_SHARE, VIEW_PATHS, SPARE_CAMERAS = 0.02, 32, 4
# Points of a picture that are evaluated at a time.
BLOCK = 1 << 19


@dataclass(frozen=True)
class Shipped:
    """A fit as it is written, evaluated at surface points."""

    role: str
    fit: Fit
    lowered: Lowered
    baked: Baked

    @staticmethod
    def of(role: str, fit: Fit, lowered: Lowered) -> Shipped:
        """Compile the graph of a fit.

        Args:
            role: Role of the fit.
            fit: The fit.
            lowered: Its graph.

        Returns:
            The compiled fit.
        """
        return Shipped(role, fit, lowered, Baked(lowered.graph, lowered.frame))

    def at(self, points: SurfacePoints, light: np.ndarray) -> np.ndarray:
        """Evaluate radiance for a unit light.

        Args:
            points: N surface points.
            light: [3] or [N, 3] position of the light in metres, or direction towards the sun.

        Returns:
            [N, 3] radiance, reflectance included.
        """
        return self.baked(self.fit.query(points, light))


def lit_views(scene: Scene, variable: Variable | None, count: int, seed: int) -> list[tuple[Camera, np.ndarray]]:
    """Choose held-out views: the scene's first camera with a suitable light, then sampled cameras with held-out lights.

    Args:
        scene: The scene.
        variable: Ranges of the light; None: no light varies, and all lights are zeros.
        count: Number of views, ≥ 1.
        seed: Seed of the bake.

    Returns:
        Camera and light [3] of each view.
    """
    if variable is None:
        return [(camera, np.zeros(3, np.float32)) for camera in _cameras_in_light(scene, count, seed)]
    return views_and_lights(scene, variable, count, seed)


def _cameras_in_light(scene: Scene, count: int, seed: int) -> list[Camera]:
    """The scene's own cameras, then sampled ones; others, where there are any, in place of those that look at nothing
    but black, such as in a room that is closed on all sides."""
    sample = partial(sample_cameras, scene, declare((), scene), seed=seed + EVALUATION_SEED, authored=True)
    cameras = sample(count)
    lit = [camera in scene.cameras or _finds_light(scene, camera) for camera in cameras]
    if all(lit):
        return cameras
    known = {(camera.position, camera.target) for camera in cameras}
    more = [c for c in sample(SPARE_CAMERAS * count) if (c.position, c.target) not in known]
    kept = [camera for camera, is_lit in zip(cameras, lit) if is_lit]
    kept += [camera for camera in more if _finds_light(scene, camera)]
    kept = (kept + [camera for camera, is_lit in zip(cameras, lit) if not is_lit])[:count]
    own = sum(camera in scene.cameras for camera in kept)
    return kept[:own] + [replace(camera, name=f"view {n + 1}") for n, camera in enumerate(kept[own:])]


def _finds_light(scene: Scene, camera: Camera) -> bool:
    """Whether paths from a coarse picture of a camera find the scene's own light."""
    points, mask, _ = gbuffer(scene, camera, 16, 10)
    points = points[np.flatnonzero(mask)]
    if not len(points):
        return False
    a, b = static(scene, points, VIEW_PATHS, EVALUATION_SEED)
    return bool(((a + b).max(axis=1) > 0).mean() >= LIT_SHARE)


def views_and_lights(scene: Scene, variable: Variable, count: int, seed: int) -> list[tuple[Camera, np.ndarray]]:
    """Choose held-out views as ``lit_views`` does, for a scene with a variable light.

    Args:
        scene: The scene.
        variable: Ranges of the light.
        count: Number of views, ≥ 1.
        seed: Seed of the bake.

    Returns:
        Camera and light [3] of each view.
    """
    cameras = sample_cameras(scene, variable, count, seed + EVALUATION_SEED, authored=True)
    return list(zip(cameras, lights_of_views(scene, variable, cameras, seed, count)))


def lights_of_views(
    scene: Scene, variable: Variable, cameras: Sequence[Camera], seed: int, count: int = 1
) -> list[np.ndarray]:
    """Choose a held-out light for each view; a suitable one for the first.

    Args:
        scene: The scene.
        variable: Ranges of the light.
        cameras: Cameras of the views.
        seed: Seed of the bake.
        count: Lights to choose from, at least.

    Returns:
        [3] of each view: position in metres, or direction towards the sun.
    """
    held_out = held_out_lights(scene, variable, max(count, VIEW_LIGHTS), seed + EVALUATION_SEED)
    if has_sky(variable):
        # All views have one exposure, in which twilight is black.
        up = held_out[held_out[:, 1] > np.sin(np.radians(LOWEST))]
        held_out = up if len(up) else held_out
    chosen = []
    for k, camera in enumerate(cameras):
        light = initial_light(scene, variable, camera) if k == 0 else _best_lit(scene, variable, camera, held_out)
        chosen.append(np.asarray(light, np.float32))
    return chosen


def _best_lit(scene: Scene, variable: Variable, camera: Camera, lights: np.ndarray) -> np.ndarray:
    """The held-out light with most indirect light in a coarse picture of the camera, so that no view is black."""
    points, mask, _ = gbuffer(scene, camera, 16, 10)
    points = points[np.flatnonzero(mask)]
    if not len(points):
        return lights[0]
    # In a house most lights are in other rooms.
    reached = reached_part(scene, variable, lights, camera)
    lights = lights[np.argsort(-reached, kind="stable")[:TRACED_LIGHTS]]
    rows = np.tile(np.arange(len(points)), len(lights))
    a, b = indirect(scene, points[rows], lights.repeat(len(points), axis=0), variable, 16, EVALUATION_SEED)
    # The median, so that a light close to one wall is not chosen for one bright spot.
    found = np.median((a + b).mean(axis=1).reshape(len(lights), len(points)), axis=1)
    return lights[int(np.argmax(found))]


def compare_points(reference: PointReference, shipped: Shipped, objects: Sequence[str]) -> PointComparison:
    """Compare a field with the reference at held-out points.

    Args:
        reference: N points and their traced radiance.
        shipped: The field.
        objects: Names of the meshes of the scene.

    Returns:
        The comparison.
    """
    r, prediction = reference, shipped.at(reference.points, reference.light)
    return PointComparison(prediction, r.half_a, r.half_b, r.points.shape, objects, r.weight)


def compare_view(
    reference: ViewReference,
    fields: Sequence[Shipped],
    size: tuple[int, int],
    name: str,
    caption: str,
    stage: ViewSetup,
    number: int,
    objects: Sequence[str] = (),
    display: DisplayView | None = None,
    states: Mapping[str, float] = MappingProxyType({}),
) -> ViewComparison:
    """Compare the learned light of all roles with the reference in one view, for a light of 1 cd (1 lx).

    Args:
        reference: The view and its traced radiance.
        fields: The fields of all roles; the map of experts is that of the first.
        size: Width and height, pixels.
        name: Name of the view.
        caption: Caption of the view.
        stage: Where the lights of the view stand, and how bright they are.
        number: Number of the view.
        objects: Names of the meshes of the scene.
        display: The view for display; None: the scored one is shown.
        states: What it shows of what varies.

    Returns:
        The comparison.
    """
    width, height = size
    queries = [shipped.fit.query(reference.points, stage.place(shipped.role, number)) for shipped in fields]
    total = sum(stage.weight(s.role) * s.baked(query) for s, query in zip(fields, queries))
    images = np.zeros((3, height * width, 3), np.float32)
    images[:, reference.seen] = total, np.nan_to_num(reference.half_a), np.nan_to_num(reference.half_b)
    prediction, a, b = images.reshape(3, height, width, 3)
    regions, blend = _regions(queries[0], reference.seen, fields[0].baked, size)
    if display is None:
        return ViewComparison(name, prediction, a, b, regions, blend, caption, states=states)
    picture = ViewPicture(display.picture(_total(fields, display.points, stage, number)), display.reference)
    surfaces = ViewSurfaces(display.shape, display.position, objects)
    return ViewComparison(name, prediction, a, b, regions, blend, caption, picture, surfaces, states)


def _total(fields: Sequence[Shipped], points: SurfacePoints, stage: ViewSetup, number: int) -> np.ndarray:
    """[N, 3] radiance of all roles; evaluated in blocks, because some queries need kilobytes for each point."""
    total = np.zeros((len(points), 3), np.float32)
    for start in range(0, len(points), BLOCK):
        rows = np.arange(start, min(start + BLOCK, len(points)))
        for s in fields:
            total[rows] += stage.weight(s.role) * s.at(points[rows], stage.place(s.role, number))
    return total


def role_scale(role: str, intensity: float) -> float:
    """Return the weight of a field in a picture for a declared light of 1 cd (1 lx).

    Args:
        role: Role of the field.
        intensity: Intensity of the light on the page, cd or lx, > 0.

    Returns:
        Factor of the radiance.
    """
    return 1.0 / intensity if role == "static" else 1.0


def _regions(
    query: Query, seen: np.ndarray, baked: Baked, size: tuple[int, int]
) -> tuple[np.ndarray | None, np.ndarray | None]:
    """[height, width] index of the expert of every pixel and whether it is blended; None for a single network."""
    if not baked.segmented:
        return None, None
    width, height = size
    index, share = baked.segments(query)
    regions = np.full(height * width, NO_REGION)
    blend = np.zeros(height * width, bool)
    regions[seen], blend[seen] = index, share > BLENDED
    return regions.reshape(height, width), blend.reshape(height, width)


def view_name(camera: Camera, number: int) -> str:
    """Return the name of a view: the camera's name, or its number from 1.

    Args:
        camera: The camera.
        number: Index of the view, from 0.

    Returns:
        The name.
    """
    return camera.name or f"view {number + 1}"


def view_caption(variable: Variable | None, light: np.ndarray, pose: str = "") -> str:
    """Describe the position of the light of a view.

    Args:
        variable: Ranges of the light; None: no light varies.
        light: [3] position in metres, or direction towards the sun.
        pose: The pose of the scene in words.

    Returns:
        The caption.
    """
    if pose:
        return f"{pose}, {view_caption(variable, light)}"
    if variable is None:
        return "the scene's own light"
    if has_sky(variable) and (hour := variable.hour(light)) is not None:
        return f"at {clock(hour)}"
    if isinstance(variable, Turning):
        return f"environment turned by {float(variable.angle(light)):.0f}°"
    where = ", ".join(f"{c:.2f}" for c in light)
    return f"{'light at' if variable.kind == 'point' else 'sun towards'} ({where})"


def object_names(scene: Scene) -> list[str]:
    """Return a name for every mesh.

    Args:
        scene: The scene.

    Returns:
        Names, in the order of the meshes.
    """
    return [mesh.name or f"mesh {k}" for k, mesh in enumerate(scene.meshes)]


def light_sweep(
    reference: SweepReference, shipped: Shipped, variable: Variable | None = None, mover: Mover | None = None
) -> list[tuple[float, float, float]]:
    """Compute the error of a field along the chain of held-out lights.

    Args:
        reference: Traced radiance along the chain.
        shipped: The field.
        variable: Ranges of the light; those of a day give the places in hours, those of an environment map in
            degrees.
        mover: The first mover, along whose range the points were traced; None: along the path of the light.

    Returns:
        (position on the chain in [0, 1], hour or degrees, relative error, noise floor) for each light, in this order;
        nothing where no point was traced, as where everything moves.
    """
    if not len(reference.place):
        return []
    r, unit = reference, shipped.fit.unit
    f, a, b = (x / unit for x in (shipped.at(r.points, r.light), r.half_a, r.half_b))
    y = 0.5 * (a + b)
    error = np.mean(np.abs(f - y) / (y + 0.01), axis=1)
    floor = np.mean(np.abs(a - b) / 2 / (y + 0.01), axis=1)
    last = max(int(r.place.max()), 1)
    lights = [r.place == k for k in np.unique(r.place)]
    hours = [axis_value(variable, r.light[at][0]) for at in lights]
    places = [k / last if hour is None else hour for k, hour in enumerate(hours)]
    if mover is not None and r.points.pose is not None:
        places = [mover.value(float(r.points.pose[at][0, 0])) for at in lights]
    return sorted((place, float(error[at].mean()), float(floor[at].mean())) for place, at in zip(places, lights))
