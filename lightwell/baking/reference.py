"""The path-traced reference that fields are scored against. It is traced once for all fields.

Every record holds N surface points and two independent halves of the radiance that leaves them. Fields make their own
queries of the points, because the inputs of fields differ.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from time import perf_counter
from typing import Any, TypeVar

import numpy as np

from lightwell.asset.page import PageView
from lightwell.baking.display_pictures import DisplayView, display_view, reference_picture
from lightwell.baking.evaluate import role_scale, view_name
from lightwell.baking.late_notes import LateNotes
from lightwell.baking.poses import scored_points, seen_points, standing, swept_points, view_pose
from lightwell.baking.reference_budget import EVALUATION_SEED, ReferenceBudget
from lightwell.baking.settings import Reported
from lightwell.baking.view_setup import ViewSetup, choose_stage
from lightwell.core.formats import JSON, RecordFormat
from lightwell.core.keys import key
from lightwell.core.progress import Progress
from lightwell.core.store import Store
from lightwell.fields.protocol import kind_of
from lightwell.scenes.executor import Recipe
from lightwell.scenes.movers import Pose
from lightwell.scenes.scene import Camera, Scene
from lightwell.scenes.variables import Variable
from lightwell.scenes.vectors import vector
from lightwell.transport import SurfacePoints, indirect, static
from lightwell.transport.camera import camera_points
from lightwell.transport.lit_points import LitPoints

# Version; to be increased when the same arguments give other samples than before.
VERSION = 7
# Mean of a picture, relative to the brightest of a page, that is black.
BLACK = 1e-3

T = TypeVar("T")


@dataclass(frozen=True)
class PointReference:
    """Area-uniform points, each with a view of its own, under held-out lights."""

    points: SurfacePoints
    light: np.ndarray
    """[N, 3] position of the light of each point, metres, or direction towards the sun."""
    half_a: np.ndarray
    """[N, 3] mean over the first half of the paths, for a light of 1 cd (1 lx)."""
    half_b: np.ndarray
    """[N, 3] ... over the second half."""
    weight: np.ndarray
    """[N] makes means area-uniform."""


@dataclass(frozen=True)
class ViewReference:
    """The surface points at the pixel centres of one view."""

    points: SurfacePoints
    light: np.ndarray
    """[3]."""
    half_a: np.ndarray
    """[N, 3] as in ``PointReference``; the scene's own light is included."""
    half_b: np.ndarray
    seen: np.ndarray
    """[N] pixels of the points, row-major; the other pixels show no surface."""


@dataclass(frozen=True)
class SweepReference:
    """The same few points under a chain of held-out lights, light-major."""

    points: SurfacePoints
    light: np.ndarray
    """[N, 3]."""
    half_a: np.ndarray
    half_b: np.ndarray
    place: np.ndarray
    """[N] number of the light along the chain."""


@dataclass(frozen=True)
class Reference:
    """Everything that fields are scored against and shown beside."""

    stage: ViewSetup
    points: dict[str, PointReference]
    """By role; those that could not be traced are absent."""
    views: list[ViewReference | None]
    """One for each view of the stage; None where it could not be traced."""
    sweep: SweepReference | None
    """None: no light varies, or it could not be traced."""
    pictures: list[PageView]
    """Complete path-traced pictures, for the page."""
    display: list[DisplayView | None]
    """The views for display, one for each view; None where it could not be made."""


def trace_reference(
    scene: Scene,
    variable: Variable | None,
    roles: Sequence[str],
    units: dict[str, float],
    settings: Reported,
    budget: ReferenceBudget,
    notes: LateNotes,
    progress: Progress,
    store: Store | None = None,
    stage: ViewSetup | None = None,
) -> Reference:
    """Trace held-out points, views, a sweep of the light, and the page's pictures.

    Args:
        scene: What is lit.
        variable: Ranges of the light; None: no light varies.
        roles: Which light: 'indirect', 'static' or both.
        units: Radiance unit S of each role, which decides how bright the light is first.
        settings: Views, seed and declarations.
        budget: Counts of points and paths.
        notes: Takes a note of each part that fails; the others are traced all the same.
        progress: Shows a bar.
        store: Keeps what is traced between runs; None: nothing is kept.
        stage: Views and lights; None: ``choose_stage``.

    Returns:
        The reference. What a store holds is not traced again.
    """
    made_from = {"scene": scene.digest, "variable": variable, "roles": list(roles)}
    keep = _Keeper(made_from | {"budget": budget, "seed": settings.seed}, store, notes)
    size, seed = settings.view_size, settings.seed
    with progress.stage("reference", settings.views + 3, "held-out lights and views") as bar:
        stage = stage or choose_stage(scene, variable, units, settings)
        points: dict[str, PointReference] = {}
        variables = {role: variable for role in roles} | {light.role: light.variable for light in stage.more}
        for role in roles:
            make_points = partial(trace_points, scene, variables[role], kind_of(role), budget, seed)
            what = f"the score at surface points ({role})"
            if found := keep(what, f"points-{role}", PointReference, make_points):
                points[role] = found
        bar.advance()
        sweep = None
        if scene.movers or (variable is not None and "indirect" in roles):
            make_sweep = partial(trace_sweep, scene, variable, budget, seed)
            if scene.movers:
                make_sweep = partial(trace_poses, scene, variable, kind_of(roles[0]), stage.views[0][1], budget, seed)
            sweep = keep("the error along the path of the light", "sweep", SweepReference, make_sweep)
        bar.advance()
        views: list[ViewReference | None] = []
        for k, (camera, light) in enumerate(stage.views):
            base = [role for role in roles if role == kind_of(role)]
            view = (scene, variable, camera, light, base, size, budget.pixel_paths, stage.intensity)
            make = partial(trace_view, *view, view_pose(scene, k), stage.further(k))
            more = {"view": k, "of": settings.views, "size": list(size)}
            views.append(keep(f"the score of {view_name(camera, k)}", "view", ViewReference, make, **more))
            bar.advance()
        pictures = _page_views(scene, variable, stage, size, budget, "static" in roles, keep)
        display = _display_views(scene, stage, views, size, notes)
        bar.advance()
    return Reference(stage, points, views, sweep, pictures, display)


@dataclass(frozen=True)
class _Keeper:
    """Makes the parts of a reference, or reads them from a store; a part that fails is noted."""

    made_from: dict[str, Any]
    """What all parts are made from, for their keys."""
    store: Store | None
    """None: nothing is kept."""
    notes: LateNotes

    def __call__(self, what: str, name: str, kind: type[T], make: Callable[[], T], **more: Any) -> T | None:
        """A part, None when it fails; ``more`` is what it alone is made from."""
        if self.store is None:
            return self.notes.attempt(what, make, None)
        of = key(f"reference.{name}", VERSION, **self.made_from, **more)
        return self.notes.attempt(what, partial(self.store.get, of, make, RecordFormat(kind)), None)

    def number(self, what: str, name: str, make: Callable[[], int], otherwise: int) -> int:
        """A number that depends on measured time: the same one when an interrupted bake goes on."""
        if self.store is None:
            return make()
        of = key(f"reference.{name}", VERSION, **self.made_from)
        return self.notes.attempt(what, partial(self.store.get, of, make, JSON), otherwise)


def _page_views(
    scene: Scene,
    variable: Variable | None,
    stage: ViewSetup,
    size: tuple[int, int],
    budget: ReferenceBudget,
    with_static: bool,
    keep: _Keeper,
) -> list[PageView]:
    """Complete pictures of the views, for the page; those that fail are left out."""
    pictures, spp, begin = [], budget.picture_spp, perf_counter()
    for k, (camera, light) in enumerate(stage.views):
        if k == 1:
            measured = lambda: budget.further_spp(perf_counter() - begin, len(stage.views))  # noqa: E731
            spp = keep.number("the plan of the pictures", "picture_spp", measured, spp)
        options = {"intensity": stage.intensity, "color": stage.color, "with_static": with_static}
        shown = standing(scene, view_pose(scene, k))
        more = [(other.places[k], other.variable, other.intensity, other.color) for other in stage.more]
        make = partial(reference_picture, shown, camera, light, variable, size, spp, k, **options, more=more)
        picture = keep.notes.attempt(f"the reference picture of {view_name(camera, k)}", make, None)
        if picture is not None and np.isfinite(picture).all():
            further = tuple(vector(other.places[k]) for other in stage.more)
            pose = view_pose(scene, k)
            pictures.append(PageView(view_name(camera, k), camera, vector(light), picture, pose, further))
    return with_light(pictures)


def with_light(views: list[PageView]) -> list[PageView]:
    """Leave out the saved views of a page that are black, such as those of a room that no light reaches.

    Args:
        views: The views; they are shown with one exposure.

    Returns:
        Those that are not black beside the brightest one; all where all are.
    """
    means = [float(view.reference.mean()) for view in views]
    return [view for view, mean in zip(views, means) if mean > BLACK * max(means)] or views


def _display_views(
    scene: Scene, stage: ViewSetup, views: Sequence[ViewReference | None], size: tuple[int, int], notes: LateNotes
) -> list[DisplayView | None]:
    """The scored views, enlarged and denoised; None for those that fail."""
    found: list[DisplayView | None] = []
    for k, ((camera, _), view) in enumerate(zip(stage.views, views)):
        make = partial(display_view, scene, camera, view, size)
        what = f"the enlarged picture of {view_name(camera, k)}"
        found.append(None if view is None else notes.attempt(what, make, None))
    return found


def trace_points(
    scene: Scene, variable: Variable | None, role: str, budget: ReferenceBudget, seed: int
) -> PointReference:
    """Trace the radiance of one role at held-out points; the points are the same for each role.

    Args:
        scene: The scene.
        variable: Ranges of the light; None: no light varies.
        role: The role.
        budget: Numbers of points, lights and paths.
        seed: Seed of the bake.

    Returns:
        The reference.
    """
    drawn = LitPoints(
        variable,
        budget.points,
        seed + EVALUATION_SEED,
        lights=0 if variable is None else budget.lights,
        light_seed=seed + 2 * EVALUATION_SEED,
        core=True,
    )
    points, weight = scored_points(scene, drawn)
    light = drawn.light_of(scene, len(points))
    recipe = drawn.recipe(lit=role != "static")
    a, b = halves_of(scene, variable, role, points, light, budget.point_paths, seed, recipe)
    return PointReference(points, light, a, b, weight)


def trace_view(
    scene: Scene,
    variable: Variable | None,
    camera: Camera,
    light: np.ndarray,
    roles: Sequence[str],
    size: tuple[int, int],
    paths: int,
    intensity: float = 1.0,
    pose: Pose | None = None,
    more: Sequence[tuple[Variable, np.ndarray, float]] = (),
) -> ViewReference:
    """Trace one view.

    Args:
        scene: The scene.
        variable: Ranges of the light; None: no light varies.
        camera: The camera.
        light: [3] position of the light in metres, or direction towards the sun.
        roles: Roles whose light is added up.
        size: Width and height, pixels.
        paths: Paths per pixel, even, ≥ 2.
        intensity: Intensity of the light on the page, cd or lx; the scene's own light is divided by it.
        pose: A slider, 0 to 1, for each mover; None: nothing moves.
        more: Further lights: each with its place [3] and its weight.

    Returns:
        The reference.
    """
    points, mask = seen_points(scene, camera, *size, pose)
    seen = np.flatnonzero(mask)
    a, b = np.zeros((2, len(seen), 3))
    for role in roles:
        recipe = camera_points(camera, size, None if variable is None or role == "static" else light)
        halves = halves_of(scene, variable, role, points[seen], light, paths, 1, recipe)
        a, b = (total + role_scale(role, intensity) * half for total, half in zip((a, b), halves))
    for other, place, weight in more:
        halves = halves_of(scene, other, "indirect", points[seen], place, paths, 1)
        a, b = (total + weight * half for total, half in zip((a, b), halves))
    return ViewReference(points[seen], np.asarray(light, np.float32), a, b, seen)


def trace_sweep(scene: Scene, variable: Variable, budget: ReferenceBudget, seed: int) -> SweepReference:
    """Trace a few points under a chain of held-out lights, each near the one before.

    Args:
        scene: The scene.
        variable: Ranges of the light.
        budget: Numbers of points, lights and paths.
        seed: Seed of the bake.

    Returns:
        The reference.
    """
    drawn = LitPoints(
        variable,
        budget.sweep_points,
        seed + 3 * EVALUATION_SEED,
        floor=0,
        repeats=budget.sweep,
        lights=budget.sweep,
        light_seed=seed + 3 * EVALUATION_SEED,
        chained=True,
        core=True,
        run=budget.sweep_points,
    )
    points = drawn.repeated(drawn.draw(scene).points)
    light = drawn.light_of(scene, len(points))
    a, b = indirect(scene, points, light, variable, budget.sweep_paths, seed, recipe=drawn.recipe())
    return SweepReference(points, light, a, b, np.arange(len(points)) // drawn.run)


def trace_poses(
    scene: Scene, variable: Variable | None, role: str, light: np.ndarray, budget: ReferenceBudget, seed: int
) -> SweepReference:
    """Trace a few points that stand still in a chain of poses, from one end stop of the first mover to the other.

    Args:
        scene: Scene with movers.
        variable: Ranges of the light; None: no light varies.
        role: The role.
        light: [3] place of the light.
        budget: Numbers of points, poses and paths.
        seed: Seed of the bake.

    Returns:
        The reference; ``place`` counts the poses.
    """
    points, each = swept_points(scene, budget.sweep_points, max(budget.sweep, 4), seed + 3 * EVALUATION_SEED)
    lights = np.broadcast_to(np.asarray(light, np.float32), (len(points), 3))
    a, b = halves_of(scene, variable, role, points, lights, budget.sweep_paths, seed)
    return SweepReference(points, lights, a, b, np.arange(len(points)) // max(each, 1))


def halves_of(
    scene: Scene,
    variable: Variable | None,
    role: str,
    points: SurfacePoints,
    light: np.ndarray,
    paths: int,
    seed: int,
    recipe: Recipe | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Trace the radiance of a role at points.

    Args:
        scene: The scene.
        variable: Ranges of the light; None: no light varies.
        role: The role.
        points: N points.
        light: [3] or [N, 3] places of the light.
        paths: Paths per point, even, ≥ 2.
        seed: Seed of the bake.
        recipe: How workers make points and lights again; None: they are sent.

    Returns:
        Two independent halves, [N, 3] each.
    """
    if role == "static" or variable is None:
        return static(scene, points, paths, seed + EVALUATION_SEED, recipe=recipe)
    return indirect(scene, points, light, variable, paths, seed + EVALUATION_SEED, recipe=recipe)
