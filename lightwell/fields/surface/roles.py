"""Parts of the light of a surface field: the time of each, and its light."""

from __future__ import annotations

from collections.abc import Sequence

from lightwell.core.vary import parse_vary
from lightwell.fields.budget import learning_seconds
from lightwell.fields.protocol import Job, Role, State
from lightwell.scenes.variables import Variable, default_variable

# Share of the budget that the static field gets when there is also a variable light.
STATIC_SHARE = 0.3


def role_seconds(state: State, role: Role) -> float:
    """Compute the time of the first round of a role.

    Args:
        state: The prepared scene.
        role: The role.

    Returns:
        Seconds.
    """
    return role_share(role, state.roles) * state.job.request.budget.round_seconds


def role_share(role: Role, roles: Sequence[Role], left: Sequence[Role] | None = None) -> float:
    """Compute the share of a role in the time of several.

    Args:
        role: The role.
        roles: All roles.
        left: Those among which the time is shared; None: all.

    Returns:
        The share, in (0, 1].
    """
    lights = max(sum(other != "static" for other in roles), 1)
    weights = {other: STATIC_SHARE if other == "static" else (1 - STATIC_SHARE) / lights for other in roles}
    return weights[role] / sum(weights[other] for other in (roles if left is None else left))


def learning_time(state: State, role: Role) -> tuple[float, float]:
    """Compute when a role is learned.

    Args:
        state: The prepared scene.
        role: The role, whose turn it is.

    Returns:
        Wall seconds of the bake so far, and the seconds of the role from now on.
    """
    request, begin = state.job.request, state.job.work.elapsed
    if not request.budget.seconds or state.job.shared:
        return begin, role_seconds(state, role)
    # What a role leaves is for those after it.
    left = role_share(role, state.roles, state.roles[state.roles.index(role) :])
    return begin, learning_seconds(request.budget, begin) * left


def looked_from(state: State) -> Variable:
    """Return the range of the declared light, or of one that may be anywhere: people look where it may be.

    Args:
        state: The prepared scene.

    Returns:
        The range.
    """
    return state.variable or default_variable(state.scene)


def light_declared(job: Job) -> bool:
    """Tell whether a light that varies was asked for, by the settings of a bake or by its scene.

    Args:
        job: Scene and settings.

    Returns:
        False where a point light may be anywhere because nothing else was said.
    """
    return any(d.learned and not d.moves for d in map(parse_vary, (*job.request.vary, *job.scene.vary)))
