"""Poses of a scene's mover in which a field is scored: held-out ones, and both end stops."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from lightwell.baking.evaluate import Shipped
from lightwell.baking.reference_budget import EVALUATION_SEED, ReferenceBudget
from lightwell.scenes.movers import Mover
from lightwell.scenes.posing import posed
from lightwell.scenes.scene import Camera, Scene
from lightwell.transport import SurfacePoints, draw_surface
from lightwell.transport.camera import gbuffer
from lightwell.transport.lit_points import LitPoints
from lightwell.transport.moved import at_pose

# Poses of the scored points; sliders between them are no nodes of any number of traced poses.
SCORED = (0.0, 0.03, 0.13, 0.29, 0.47, 0.62, 0.79, 0.94, 1.0)
# Poses of the views of a report, one after the other.
OF_VIEWS = (0.62, 0.0, 1.0, 0.29, 0.79, 0.13, 0.47, 0.94)
# A point is dark at an end stop where it has less than this share of the light that it has at the other one, and is
# lit at that one where it has more than this share of the mean.
DARK, LIT = 0.01, 0.1
# Relative errors are of the reference plus this, in the unit of the field.
EPSILON = 0.01
# Fewer such points say nothing.
FEWEST = 32


def view_pose(scene: Scene, number: int) -> float | None:
    """Choose the pose of a view of a report.

    Args:
        scene: The scene.
        number: Number of the view, from 0.

    Returns:
        Slider, 0 to 1; None in a scene without a mover.
    """
    return None if scene.mover is None else OF_VIEWS[number % len(OF_VIEWS)]


def standing(scene: Scene, slider: float | None) -> Scene:
    """Return a scene in a pose.

    Args:
        scene: The scene.
        slider: Pose, 0 to 1; None: as it is.

    Returns:
        The scene in which nothing moves.
    """
    return scene if slider is None else posed(scene, slider)


def seen_points(
    scene: Scene, camera: Camera, width: int, height: int, slider: float | None
) -> tuple[SurfacePoints, np.ndarray]:
    """Find the surface points at the pixel centres of a camera, in a pose.

    Args:
        scene: The scene.
        camera: The camera.
        width: Pixels.
        height: Pixels.
        slider: Pose, 0 to 1; None: nothing moves.

    Returns:
        A point per pixel, and which of them show a surface.
    """
    points, mask, _ = gbuffer(standing(scene, slider), camera, width, height)
    return (points if slider is None else at_pose(points, slider)), mask


def scored_points(scene: Scene, drawn: LitPoints) -> tuple[SurfacePoints, np.ndarray]:
    """Draw area-uniform points, divided among held-out poses and both end stops where something moves.

    Args:
        scene: The scene.
        drawn: How many, and how they are drawn.

    Returns:
        The points and their weights [N].
    """
    if scene.mover is None:
        draw = drawn.draw(scene)
        return draw.points, draw.weight
    share = max(drawn.count // len(SCORED), 1)
    draws = [draw_surface(posed(scene, slider), share, drawn.seed + k) for k, slider in enumerate(SCORED)]
    points = [at_pose(draw.points, slider) for draw, slider in zip(draws, SCORED)]
    return _joined(points), np.concatenate([draw.weight for draw in draws])


def swept_points(scene: Scene, count: int, poses: int, seed: int) -> tuple[SurfacePoints, int]:
    """Draw points on what stands still, each in every pose of a chain from one end stop to the other.

    Args:
        scene: Scene with a mover.
        count: Points.
        poses: Poses, ≥ 2.
        seed: Seed of the points.

    Returns:
        The points, pose by pose, and how many of them are of one pose.
    """
    points = draw_surface(posed(scene, 0.5), count, seed, floor=0).points
    still = points[np.flatnonzero(~np.isin(points.shape, _mover(scene).meshes))]
    sliders = held_out_chain(poses)
    return _joined([at_pose(still, float(slider)) for slider in sliders]), len(still)


def held_out_chain(poses: int) -> np.ndarray:
    """Choose poses from one end stop to the other that no bake traces between them.

    Args:
        poses: Poses, ≥ 2.

    Returns:
        [poses] increasing sliders from 0 to 1.
    """
    return np.linspace(0.0, 1.0, poses) if poses < 4 else np.unique(np.concatenate([[0.0, 1.0], _between(poses)]))


def _between(poses: int) -> np.ndarray:
    """[poses - 2] sliders in the middle of equal parts of the range, a little off nodes of cosines."""
    return (np.arange(poses - 2) + 0.53) / (poses - 2)


def pose_facts(scene: Scene, points: SurfacePoints, shipped: Shipped, halves: Sequence[np.ndarray]) -> dict[str, Any]:
    """Compute the error of each scored pose.

    Args:
        scene: Scene with a mover.
        points: N points with their poses.
        shipped: The field.
        halves: Its prediction and two independent halves of the reference, [N, 3] each.

    Returns:
        Facts for the report: the mover, and by pose its value, error and noise.
    """
    mover, pose = _mover(scene), np.zeros(0) if points.pose is None else points.pose
    f, a, b = (np.asarray(x, np.float64) / shipped.fit.unit for x in halves)
    y = 0.5 * (a + b)
    error = np.mean(np.abs(f - y) / (y + EPSILON), axis=1)
    floor = np.mean(np.abs(a - b) / 2 / (y + EPSILON), axis=1)
    rows = []
    for slider in np.unique(pose):
        at = (pose == slider) & np.isfinite(error)
        if at.any():
            value = round(mover.value(float(slider)), 4)
            rows.append({"value": value, "relative_error": float(error[at].mean()), "noise": float(floor[at].mean())})
    worst = max(rows, key=lambda row: row["relative_error"], default=None)
    return {**mover.json(), "poses": rows, "worst_pose": worst}


def leak_facts(scene: Scene, shipped: Shipped, light: np.ndarray, halves: Any, budget: ReferenceBudget) -> list[Any]:
    """Compute how much light of one end stop is learned at the other one, where it should be dark.

    Args:
        scene: Scene with a mover.
        shipped: The field.
        light: [3] place of the light that moves too; zeros without one.
        halves: Traces points: (points, light [N, 3], paths) → two halves [N, 3].
        budget: Numbers of points and paths.

    Returns:
        For each end stop its value, the number of points that are dark there and lit at the other one, and the learned
        light of these in relation to their light at the other one; None where there are too few.
    """
    mover, found = _mover(scene), []
    for stop, other in ((0.0, 1.0), (1.0, 0.0)):
        drawn = draw_surface(posed(scene, stop), budget.points, EVALUATION_SEED + 7).points
        still = drawn[np.flatnonzero(~np.isin(drawn.shape, mover.meshes))]
        here, there = at_pose(still, stop), at_pose(still, other)
        lights = np.broadcast_to(np.asarray(light, np.float32), (len(still), 3))
        y, lit = (0.5 * sum(np.nan_to_num(h) for h in halves(p, lights, budget.point_paths)) for p in (here, there))
        y, lit = y.mean(axis=1), lit.mean(axis=1)
        dark = np.flatnonzero((lit > LIT * lit.mean()) & (y < DARK * lit))
        learned = None
        if len(dark) >= FEWEST:
            f = np.maximum(shipped.at(here[dark], lights[dark]), 0).mean(axis=1)
            learned = float(f.mean() / lit[dark].mean())
        found.append({"value": mover.value(stop), "dark_points": len(dark), "leak": learned})
    return found


def _joined(parts: Sequence[SurfacePoints]) -> SurfacePoints:
    names = ("shape", "triangle", "barycentric", "view", "pose")
    return SurfacePoints(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def _mover(scene: Scene) -> Mover:
    if scene.mover is None:
        raise ValueError(f"report: scene '{scene.name}' has no mover; declare one with --vary")
    return scene.mover
