"""Poses of a scene's movers in which a field is scored: held-out ones, and the end stops."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from lightwell.baking.evaluate import Shipped
from lightwell.baking.reference_budget import EVALUATION_SEED, ReferenceBudget
from lightwell.scenes.movers import Pose, moving_meshes, sobol_poses
from lightwell.scenes.posing import posed
from lightwell.scenes.scene import Camera, Scene
from lightwell.scenes.scene_cache import Derived
from lightwell.transport import SurfacePoints, draw_surface
from lightwell.transport.camera import gbuffer
from lightwell.transport.lit_points import LitPoints
from lightwell.transport.moved import at_pose

# Sliders of the scored points of one mover; those between the ends are no nodes of any number of traced poses.
SCORED = (0.0, 0.03, 0.13, 0.29, 0.47, 0.62, 0.79, 0.94, 1.0)
# Of each of several movers, while the others stand anywhere.
SCORED_OF_SEVERAL, SCORED_SEED = (0.0, 0.13, 0.47, 0.79, 1.0), 0x5C0E
# Sliders of the views of a report, one after the other; those of a further mover begin this much later in the row, and
# take every n-th.
OF_VIEWS = (0.62, 0.0, 1.0, 0.29, 0.79, 0.13, 0.47, 0.94)
LATER, EVERY = (0, 3, 5), (1, 3, 5)
# A point is dark at an end stop where it has less than this share of the light that it has at the other one, and is
# lit at that one where it has more than this share of the mean.
DARK, LIT = 0.01, 0.1
# Relative errors are of the reference plus this, in the unit of the field.
EPSILON = 0.01
# Fewer such points say nothing.
FEWEST = 32
# A draw in each pose takes as long as its paths.
SCORED_POINTS = Derived[tuple[SurfacePoints, np.ndarray]]("baking.scored_points")


def view_pose(scene: Scene, number: int) -> Pose | None:
    """Choose the pose of a view of a report.

    Args:
        scene: The scene.
        number: Number of the view, from 0.

    Returns:
        A slider, 0 to 1, for each mover; None in a scene without one.
    """
    if not scene.movers:
        return None
    return tuple(OF_VIEWS[(LATER[k] + EVERY[k] * number) % len(OF_VIEWS)] for k in range(len(scene.movers)))


def standing(scene: Scene, pose: Pose | None) -> Scene:
    """Return a scene in a pose.

    Args:
        scene: The scene.
        pose: The pose; None: as it is.

    Returns:
        The scene in which nothing moves.
    """
    return scene if pose is None else posed(scene, pose)


def pose_caption(scene: Scene, pose: Pose | None) -> str:
    """Describe a pose in words.

    Args:
        scene: The scene.
        pose: The pose; None: nothing moves.

    Returns:
        For example 'Door at 45°, Lid at 10°'; empty where nothing moves.
    """
    return ", ".join(mover.caption(slider) for mover, slider in zip(scene.movers, pose or ()))


def seen_points(
    scene: Scene, camera: Camera, width: int, height: int, pose: Pose | None
) -> tuple[SurfacePoints, np.ndarray]:
    """Find the surface points at the pixel centres of a camera, in a pose.

    Args:
        scene: The scene.
        camera: The camera.
        width: Pixels.
        height: Pixels.
        pose: The pose; None: nothing moves.

    Returns:
        A point per pixel, and which of them show a surface.
    """
    points, mask, _ = gbuffer(standing(scene, pose), camera, width, height)
    return (points if pose is None else at_pose(points, pose)), mask


def scored_poses(movers: int) -> np.ndarray:
    """Choose the poses of the scored points.

    Args:
        movers: M, ≥ 1.

    Returns:
        [K, M] sliders: those of each mover from end to end, while the others stand anywhere.
    """
    if movers == 1:
        return np.array(SCORED)[:, None]
    own = len(SCORED_OF_SEVERAL)
    poses = sobol_poses(own * movers, movers, SCORED_SEED)
    for k in range(movers):
        poses[k * own : (k + 1) * own, k] = SCORED_OF_SEVERAL
    return poses


def scored_points(scene: Scene, drawn: LitPoints) -> tuple[SurfacePoints, np.ndarray]:
    """Draw area-uniform points, divided among the scored poses where something moves; the scene keeps them.

    Args:
        scene: The scene.
        drawn: How many, and how they are drawn. Lights of one bake are scored at the same points.

    Returns:
        The points and their weights [N].
    """
    looked = drawn.variable if drawn.seen else None
    arguments = replace(drawn, variable=looked, lights=0, light_seed=0)
    return scene.cache.get(SCORED_POINTS, partial(_draw_scored, scene, drawn), arguments)


def _draw_scored(scene: Scene, drawn: LitPoints) -> tuple[SurfacePoints, np.ndarray]:
    if not scene.movers:
        draw = drawn.draw(scene)
        return draw.points, draw.weight
    poses = scored_poses(len(scene.movers))
    share = max(drawn.count // len(poses), 1)
    draws = [
        draw_surface(posed(scene, pose), share, drawn.seed + k, core=drawn.core, shown=True)
        for k, pose in enumerate(poses)
    ]
    points = [at_pose(draw.points, pose) for draw, pose in zip(draws, poses)]
    return _joined(points), np.concatenate([draw.weight for draw in draws])


def swept_points(scene: Scene, count: int, poses: int, seed: int) -> tuple[SurfacePoints, int]:
    """Draw points on what stands still, each in every pose of a chain from one end stop to the other.

    Args:
        scene: Scene with movers; all but the first stand in the middle.
        count: Points.
        poses: Poses, ≥ 2.
        seed: Seed of the points.

    Returns:
        The points, pose by pose, and how many of them are of one pose.
    """
    middle = np.full(len(scene.movers), 0.5)
    points = draw_surface(posed(scene, middle), count, seed, floor=0, shown=True).points
    still = points[np.flatnonzero(~np.isin(points.shape, moving_meshes(scene.movers)))]
    chain = np.tile(middle, (len(held_out_chain(poses)), 1))
    chain[:, 0] = held_out_chain(poses)
    return _joined([at_pose(still, pose) for pose in chain]), len(still)


def held_out_chain(poses: int) -> np.ndarray:
    """Choose sliders from one end stop to the other that no bake traces between them.

    Args:
        poses: Poses, ≥ 2.

    Returns:
        [poses] increasing sliders from 0 to 1.
    """
    return np.linspace(0.0, 1.0, poses) if poses < 4 else np.unique(np.concatenate([[0.0, 1.0], _between(poses)]))


def _between(poses: int) -> np.ndarray:
    """[poses - 2] sliders in the middle of equal parts of the range, a little off nodes of cosines."""
    return (np.arange(poses - 2) + 0.53) / (poses - 2)


def pose_facts(
    scene: Scene, points: SurfacePoints, shipped: Shipped, halves: Sequence[np.ndarray]
) -> list[dict[str, Any]]:
    """Compute the error of each mover at its scored sliders.

    Args:
        scene: Scene with movers.
        points: N points with their poses.
        shipped: The field.
        halves: Its prediction and two independent halves of the reference, [N, 3] each.

    Returns:
        Facts for the report, a mover each: what it is, and by slider its value, error and noise.
    """
    f, a, b = (np.asarray(x, np.float64) / shipped.fit.unit for x in halves)
    y = 0.5 * (a + b)
    error = np.mean(np.abs(f - y) / (y + EPSILON), axis=1)
    floor = np.mean(np.abs(a - b) / 2 / (y + EPSILON), axis=1)
    poses = scored_poses(len(scene.movers))
    pose = np.zeros((len(points), len(scene.movers))) if points.pose is None else points.pose
    found = []
    for k, mover in enumerate(scene.movers):
        rows = []
        for slider in SCORED if len(scene.movers) == 1 else SCORED_OF_SEVERAL:
            chosen = poses[np.isclose(poses[:, k], slider, atol=1e-6)].astype(np.float32)
            at = (pose[:, None] == chosen).all(axis=2).any(axis=1) & np.isfinite(error)
            if at.any():
                value = round(mover.value(float(slider)), 4)
                means = {"relative_error": float(error[at].mean()), "noise": float(floor[at].mean())}
                rows.append({"value": value, **means})
        worst = max(rows, key=lambda row: row["relative_error"], default=None)
        found.append({**mover.json(), "poses": rows, "worst_pose": worst})
    return found


def leak_facts(
    scene: Scene, mover: int, shipped: Shipped, light: np.ndarray, halves: Any, budget: ReferenceBudget
) -> list[Any]:
    """Compute how much light of one end stop of a mover is learned at the other one, where it should be dark.

    Args:
        scene: Scene with movers; the others stand as a page shows them first.
        mover: Index of the mover.
        shipped: The field.
        light: [3] place of the light that moves too; zeros without one.
        halves: Traces points: (points, light [N, 3], paths) → two halves [N, 3].
        budget: Numbers of points and paths.

    Returns:
        For each end stop its value, the number of points that are dark there and lit at the other one, and the learned
        light of these in relation to their light at the other one; None where there are too few.
    """
    found, first = [], np.array([other.initial for other in scene.movers])
    for stop, other in ((0.0, 1.0), (1.0, 0.0)):
        end, back = first.copy(), first.copy()
        end[mover], back[mover] = stop, other
        drawn = draw_surface(posed(scene, end), budget.points, EVALUATION_SEED + 7, shown=True).points
        still = drawn[np.flatnonzero(~np.isin(drawn.shape, moving_meshes(scene.movers)))]
        here, there = at_pose(still, end), at_pose(still, back)
        if not len(still):
            found.append({"value": scene.movers[mover].value(stop), "dark_points": 0, "leak": None})
            continue
        lights = np.broadcast_to(np.asarray(light, np.float32), (len(still), 3))
        y, lit = (0.5 * sum(np.nan_to_num(h) for h in halves(p, lights, budget.point_paths)) for p in (here, there))
        y, lit = y.mean(axis=1), lit.mean(axis=1)
        dark = np.flatnonzero((lit > LIT * lit.mean()) & (y < DARK * lit))
        learned = None
        if len(dark) >= FEWEST:
            f = np.maximum(shipped.at(here[dark], lights[dark]), 0).mean(axis=1)
            learned = float(f.mean() / lit[dark].mean())
        found.append({"value": scene.movers[mover].value(stop), "dark_points": len(dark), "leak": learned})
    return found


def _joined(parts: Sequence[SurfacePoints]) -> SurfacePoints:
    names = ("shape", "triangle", "barycentric", "view", "pose")
    return SurfacePoints(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})
