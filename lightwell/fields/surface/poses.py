"""Samples of a scene with a mover: the poses that are traced, and those that are held out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lightwell.core.vary import parse_vary
from lightwell.fields.protocol import Job, Role, State
from lightwell.fields.surface.plan import RAYS
from lightwell.fields.surface.tracing import VALIDATION_LIGHTS, VALIDATION_POINTS, validation_samples
from lightwell.scenes.movers import Mover, pose_nodes
from lightwell.scenes.posing import posed, with_mover
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable
from lightwell.transport.collect import join
from lightwell.transport.gathered_shards import GatheredShards
from lightwell.transport.moved import with_rest
from lightwell.transport.own_light_shards import OwnLightShards
from lightwell.transport.posed_shards import PosedShards
from lightwell.transport.samples import Samples
from lightwell.transport.seen_shards import GatherSize
from lightwell.transport.shards import ShardSettings

# Most poses that are traced, by quality, and fewest.
POSES, FEWEST_POSES = {"draft": 8, "good": 16, "best": 32}, 4
# Held-out poses of early stopping, both end stops among them.
VALIDATION_POSES = 8
# Points of all poses together, relative to those of a scene that stands still in the same time.
ALL_POINTS = 2


def moving_state(state: State, job: Job, mover: Mover) -> State:
    """Prepare a scene whose mover is a variable of the bake.

    The scene's own light is one field that reads the pose. A light that moves too is learned where one is declared, or
    where the scene has no light of its own.

    Args:
        state: The prepared scene at rest.
        job: Scene and settings.
        mover: The mover.

    Returns:
        The prepared scene with the mover.

    Raises:
        ValueError: The bake has options that know one pose only.
    """
    request = job.request
    if job.scene.executor is not None:
        raise ValueError(f"bake: --cluster traces one pose; leave it out, or drop node '{mover.name}' from --vary")
    if request.lamps:
        raise ValueError(
            f"bake: switches of lamps are learned for one pose; leave out --lamps, or drop node '{mover.name}'"
        )
    if getattr(job.options, "rebake", None):
        raise ValueError(f"bake: --rebake knows one pose; bake whole, or drop node '{mover.name}' from --vary")
    if job.shared:
        raise ValueError(f"compare: fields are compared in one pose; drop node '{mover.name}' from --vary")
    declared = any(d.learned and not d.moves for d in map(parse_vary, request.vary))
    own = request.static and job.scene.has_static_light
    roles: tuple[Role, ...] = ("static",) if own and not declared else ("indirect", "static") if own else ("indirect",)
    variable = state.variable if "indirect" in roles else None
    return replace(state, scene=with_mover(job.scene, mover), variable=variable, roles=roles)


def traced_poses(quality: str, lights: int, gathered: int) -> np.ndarray:
    """Choose the poses that are traced: as many as the time has shards for, in the limits of the quality.

    Args:
        quality: 'draft', 'good' or 'best'.
        lights: Lights of a shard; the number of poses divides it.
        gathered: Shards that the gather of a scene that stands still would be made for, by its time.

    Returns:
        [K] sliders, both end stops among them.
    """
    count = int(np.clip(ALL_POINTS * gathered, FEWEST_POSES, POSES[quality]))
    while lights % count:
        count -= 1
    return pose_nodes(max(count, 2))


def held_out_poses(traced: np.ndarray, count: int) -> np.ndarray:
    """Choose poses that are not traced, in the middle between two that are, and both end stops.

    Args:
        traced: [K] sliders.
        count: Poses, ≥ 2.

    Returns:
        [count] increasing sliders from 0 to 1.
    """
    between = 0.5 * (traced[1:] + traced[:-1])
    chosen = np.unique(np.linspace(0, len(between) - 1, count - 2).round().astype(int)) if count > 2 else []
    return np.concatenate([[0.0], between[chosen] if len(chosen) else [], [1.0]])


def posed_maker(state: State, role: Role, variable: Variable, shards: ShardSettings, gathered: int) -> PosedShards:
    """Return the function that makes the shards of a role in all traced poses.

    Args:
        state: The prepared scene, with a mover.
        role: The part of the light to sample.
        variable: The declared light; people look where it may be.
        shards: Sizes and seed of the shards.
        gathered: Shards that the gather before the first one is made for.

    Returns:
        The maker.
    """
    quality = state.job.request.quality
    sliders = traced_poses(quality, shards.lights, gathered)
    rays, wanted = RAYS[quality], max(ALL_POINTS * gathered // len(sliders), 1)
    kind = OwnLightShards if role == "static" else GatheredShards
    return PosedShards(
        state.scene, variable, shards, lambda own: GatherSize.of(wanted, own, rays), kind, [*map(float, sliders)]
    )


def posed_validation(state: State, role: Role, variable: Variable, shards: ShardSettings, gathered: int) -> Samples:
    """Trace the held-out samples of early stopping, at held-out poses.

    Args:
        state: The prepared scene, with a mover.
        role: The part of the light.
        variable: The declared light; people look where it may be.
        shards: Sizes of the shards.
        gathered: As for ``posed_maker``.

    Returns:
        The samples, pose by pose.
    """
    scene, request = state.scene, state.job.request
    mover = _mover(scene)
    sliders = held_out_poses(traced_poses(request.quality, shards.lights, gathered), VALIDATION_POSES)
    points, lights = VALIDATION_POINTS // VALIDATION_POSES, VALIDATION_LIGHTS // VALIDATION_POSES
    parts = []
    for k, slider in enumerate(map(float, sliders)):
        own = role == "static"
        found = validation_samples(posed(scene, slider), variable, request.seed + k, own, points, lights)
        at = np.full(len(found), slider, np.float32)
        parts.append(replace(found, query=with_rest(mover, found.query, found.shape, at)))
    return join(parts)


def _mover(scene: Scene) -> Mover:
    if scene.mover is None:
        raise ValueError(f"samples: scene '{scene.name}' has no mover; declare one with --vary")
    return scene.mover
