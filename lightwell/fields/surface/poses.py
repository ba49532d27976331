"""Samples of a scene with movers: the poses that are traced, and those that are held out."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from lightwell.core.environment_text import ROTATED
from lightwell.core.vary import parse_vary
from lightwell.fields.protocol import Job, Role, State
from lightwell.fields.surface.plan import RAYS
from lightwell.fields.surface.roles import role_share
from lightwell.fields.surface.tracing import VALIDATION_LIGHTS, VALIDATION_POINTS, validation_samples
from lightwell.scenes.movers import Mover, pose_nodes, sobol_poses
from lightwell.scenes.posing import posed, with_movers
from lightwell.scenes.variables import Variable
from lightwell.transport.collect import join
from lightwell.transport.gathered_shards import GatheredShards
from lightwell.transport.moved import poses_of, with_rest
from lightwell.transport.own_light_shards import OwnLightShards
from lightwell.transport.posed_shards import PosedShards
from lightwell.transport.samples import Samples
from lightwell.transport.seen_shards import GatherSize
from lightwell.transport.shards import ShardSettings

# Most poses that are traced, by quality, and fewest.
POSES, FEWEST_POSES = {"draft": 8, "good": 16, "best": 32}, 4
# Seconds that a pose takes on two cores where none was timed, most of them before its first ray; and what is asked for
# beyond the least.
POSE_SECONDS, SPARE = 2.0, 1.1
# Share of the time of a role in which poses are prepared.
POSE_SHARE = 0.5
# Times as many for two and three movers.
POSES_OF = (1, 2, 3)
HELD_OUT_SEED = 0x905E
# Held-out poses of early stopping, both end stops among them, and where fewer than so many are traced: to prepare one
# takes as long as to prepare a traced one.
VALIDATION_POSES, FEWER_VALIDATION_POSES, MANY_POSES = 8, 4, 16
# Poses for each shard that the gather of a scene that stands still would be made for.
POSES_PER_SHARD = 2
# Points of all poses together, relative to those of a scene that stands still in the same time. Poses see much alike,
# but each finds its own bins of surface: half as many points as these cost doorway 3 points of error.
ALL_POINTS = {"draft": 2, "good": 4, "best": 4}
# Most times as many of the scene's own light, where there is time: doorway at good, 16 poses, 4,000 steps, seven
# pictures, 1, 2 and 4 times as many: 27.2, 27.8, 28.8 dB, error 14.4, 12.2, 11.7 %.
MOST_TIMES = 4


def moving_state(state: State, job: Job, movers: tuple[Mover, ...]) -> State:
    """Prepare a scene whose movers are variables of the bake.

    The scene's own light is one field that reads the pose. A light that moves too is learned where one is declared, or
    where the scene has no light of its own.

    Args:
        state: The prepared scene at rest.
        job: Scene and settings.
        movers: The movers, at least one.

    Returns:
        The prepared scene with the movers.

    Raises:
        ValueError: The bake has options that know one pose only.
    """
    request, names = job.request, ", ".join(f"'{mover.name}'" for mover in movers)
    if job.scene.surrounding is not None:
        raise ValueError(f"bake: a map turns where nothing else moves; drop {names} or {ROTATED} from --vary")
    if job.scene.executor is not None:
        raise ValueError(f"bake: --cluster traces one pose; leave it out, or drop {names} from --vary")
    if getattr(job.options, "rebake", None):
        raise ValueError(f"bake: --rebake knows one pose; bake whole, or drop {names} from --vary")
    if job.shared:
        raise ValueError(f"compare: fields are compared in one pose; drop {names} from --vary")
    declared = any(d.learned and not d.moves for d in map(parse_vary, request.vary))
    own = request.static and job.scene.has_static_light
    lights = tuple(role for role in state.roles if role != "static")
    roles: tuple[Role, ...] = ("static",) if own and not declared else (*lights, "static") if own else lights
    variable = state.variable if "indirect" in roles else None
    return replace(state, scene=with_movers(job.scene, movers), variable=variable, roles=roles)


def gather_in_time(
    state: State, seconds: float, gathered: int, timed: Callable[[int], float] | None = None
) -> tuple[int, float]:
    """Bound the gather by the poses that there is time for, and say what they take.

    Args:
        state: The prepared scene, with movers.
        seconds: Time of the role.
        gathered: As for ``traced_poses``.
        timed: Takes such a number, prepares a pose of that size, and returns the seconds that another one will take;
            None: they are not known.

    Returns:
        The same, or less; and the seconds of a pose, 0 where counts are fixed.

    Raises:
        ValueError: The time is too short for the fewest poses.
    """
    request, movers = state.job.request, state.scene.movers
    names, fewest = " and ".join(mover.name for mover in movers), FEWEST_POSES * POSES_OF[len(movers) - 1]
    if request.shards:
        return gathered, 0.0
    if seconds < POSE_SECONDS * fewest:
        fields, share = len(state.roles), POSE_SECONDS * fewest / max(seconds, 1e-3)
        asked = math.ceil((request.budget.seconds or seconds * fields) * share * SPARE / 10) * 10
        raise ValueError(
            f"bake: {names} {'takes' if len(movers) == 1 else 'take'} at least {fewest} poses, about "
            f"{POSE_SECONDS * fewest:.0f} s, of {seconds:.0f} s that this budget leaves; "
            f"give --budget {asked}s, or vary fewer things"
        )
    each, found = POSE_SECONDS, _bounded(gathered, seconds, POSE_SECONDS)
    if timed is not None:
        # Scenes and machines differ: where a pose took 8 s, those for 2 s each left no time for the training.
        each = timed(found)
        found = _bounded(gathered, seconds, each)
    count = len(traced_poses(request.quality, request.lights_per_shard, found, len(movers)))
    state.job.progress.say(f"{names}: {count} poses, about {seconds_of_poses(state, found, each):.0f} s of tracing")
    return found, each


def seconds_of_poses(state: State, gathered: int, each: float) -> float:
    """Compute how long it takes to prepare all traced poses.

    Args:
        state: The prepared scene, with movers.
        gathered: As for ``traced_poses``.
        each: Seconds of a pose; 0: counts are fixed.

    Returns:
        Seconds.
    """
    request = state.job.request
    return each * len(traced_poses(request.quality, request.lights_per_shard, gathered, len(state.scene.movers)))


def seconds_for_others(state: State, role: Role, gathered: int, each: float) -> float:
    """Compute the seconds of the first role that go into what the other roles use as well: poses are prepared once.

    Args:
        state: The prepared scene, with movers.
        role: The first role.
        gathered: As for ``traced_poses``.
        each: Seconds of a pose; 0: counts are fixed.

    Returns:
        Seconds, which the others give it.
    """
    return (1 - role_share(role, state.roles)) * seconds_of_poses(state, gathered, each)


def times_in_time(state: State, seconds: float, gathered: int, each: float) -> int:
    """Choose how many times the points of each pose are traced, by the time that the poses leave.

    Only the scene's own light has more of them, where it is learned alone: each of its points has one light and one
    view. What several lights share must be as large for each.

    Args:
        state: The prepared scene, with movers.
        seconds: Time of the role.
        gathered: As for ``traced_poses``.
        each: Seconds of a pose; 0: counts are fixed.

    Returns:
        A power of two, ≥ 1.
    """
    if tuple(state.roles) != ("static",) or each <= 0:
        return 1
    poses, times = seconds_of_poses(state, gathered, each), 1
    while times < MOST_TIMES and 2 * times * poses <= POSE_SHARE * seconds:
        times *= 2
    return times


def _bounded(gathered: int, seconds: float, each: float) -> int:
    """At most so many shards as there is time for the poses of, each of which takes ``each`` seconds."""
    return max(min(gathered, int(POSE_SHARE * seconds / each / POSES_PER_SHARD)), 1)


def traced_poses(quality: str, lights: int, gathered: int, movers: int = 1) -> np.ndarray:
    """Choose the poses that are traced: as many as the time has shards for, in the limits of the quality.

    Args:
        quality: 'draft', 'good' or 'best'.
        lights: Lights of a shard; the number of poses divides it.
        gathered: Shards that the gather of a scene that stands still would be made for, by its time.
        movers: M, ≥ 1.

    Returns:
        [K, M] sliders, both end stops among them: the first and the last for one mover.
    """
    most, fewest = POSES[quality] * POSES_OF[movers - 1], FEWEST_POSES * POSES_OF[movers - 1]
    count = int(np.clip(POSES_PER_SHARD * gathered, fewest, most))
    while lights % count:
        count -= 1
    return pose_nodes(max(count, 2), movers)


def held_out_poses(traced: np.ndarray, count: int) -> np.ndarray:
    """Choose poses that are not traced, with both end stops of every mover among them.

    Args:
        traced: [K, M] sliders.
        count: Poses, ≥ 2.

    Returns:
        [count, M] sliders from 0 to 1; for one mover they lie in the middle between two that are traced.
    """
    if traced.shape[1] > 1:
        inside = sobol_poses(count - 2, traced.shape[1], HELD_OUT_SEED) if count > 2 else np.zeros((0, traced.shape[1]))
        return np.concatenate([np.zeros((1, traced.shape[1])), inside, np.ones((1, traced.shape[1]))])
    between = 0.5 * (traced[1:] + traced[:-1])
    chosen = np.unique(np.linspace(0, len(between) - 1, count - 2).round().astype(int)) if count > 2 else []
    return np.concatenate([[[0.0]], between[chosen] if len(chosen) else np.zeros((0, 1)), [[1.0]]])


def posed_maker(
    state: State,
    role: Role,
    variable: Variable,
    shards: ShardSettings,
    gathered: int,
    pose_seconds: float = 0.0,
    times: int = 1,
) -> PosedShards:
    """Return the function that makes the shards of a role in all traced poses, one mover's end stops first.

    Args:
        state: The prepared scene, with movers.
        role: The part of the light to sample.
        variable: The declared light.
        shards: Sizes and seed of the shards.
        gathered: Shards that the gather before the first one is made for.
        pose_seconds: Known time of a pose.
        times: As many times the points of each pose, see ``times_in_time``.

    Returns:
        The maker.
    """
    quality = state.job.request.quality
    poses = traced_poses(quality, shards.lights, gathered, len(state.scene.movers))
    rays, wanted = RAYS[quality], times * max(ALL_POINTS[quality] * gathered // len(poses), 1)
    kind = OwnLightShards if role == "static" else GatheredShards
    if len(state.scene.movers) == 1:
        # What is prepared to time a pose serves whatever number of poses there will be.
        poses = poses[[0, -1, *range(1, len(poses) - 1)]]
    size = lambda own: GatherSize.of(wanted, own, rays)  # noqa: E731
    return PosedShards(state.scene, variable, shards, size, kind, poses.tolist(), state.looked, pose_seconds)


def posed_validation(state: State, role: Role, variable: Variable, shards: ShardSettings, gathered: int) -> Samples:
    """Trace the held-out samples of early stopping, at held-out poses.

    Args:
        state: The prepared scene, with movers.
        role: The part of the light.
        variable: The declared light.
        shards: Sizes of the shards.
        gathered: As for ``posed_maker``.

    Returns:
        The samples, pose by pose.
    """
    scene, request = state.scene, state.job.request
    traced = traced_poses(request.quality, shards.lights, gathered, len(scene.movers))
    count = VALIDATION_POSES if len(traced) >= MANY_POSES else FEWER_VALIDATION_POSES
    poses, points, lights = held_out_poses(traced, count), VALIDATION_POINTS // count, VALIDATION_LIGHTS // count
    parts = []
    for k, pose in enumerate(poses):
        own = role == "static"
        found = validation_samples(posed(scene, pose), variable, request.seed + k, own, points, lights, state.looked)
        parts.append(
            replace(found, query=with_rest(scene.movers, found.query, found.shape, poses_of(len(found), pose)))
        )
    return join(parts)


def timed_pose(state: State, role: Role, variable: Variable, shards: ShardSettings, gathered: int) -> float:
    """Prepare two poses, which are among the traced ones where one thing moves.

    Args:
        state: The prepared scene, with movers.
        role: The part of the light to sample.
        variable: The declared light.
        shards: Sizes and seed of the shards.
        gathered: As for ``posed_maker``.

    Returns:
        Seconds of the second one: the first one compiles kernels.
    """
    make = posed_maker(state, role, variable, shards, gathered)
    make.prepare(0)
    return make.prepare(1)
