"""What a bake declares and its field does not learn is refused, in one line with the cure."""

from __future__ import annotations

from lightwell.core.environment_text import ROTATED, turn_range
from lightwell.core.vary import OF_SKY, parse_vary
from lightwell.fields.protocol import Field, Job, State
from lightwell.scenes.posing import declared_movers
from lightwell.scenes.variables import Turning, has_sky


def refuse_declared(name: str, field: Field, job: Job) -> None:
    """Refuse what is declared and the field does not learn, before the field prepares the scene, which takes time.

    Args:
        name: What ``--field`` calls the field.
        field: The field.
        job: Scene and settings.

    Raises:
        ValueError: A day, an environment that turns or a node is declared, and the field does not learn it, or the node
            is not there.
    """
    if any(turn_range(text) for text in job.request.vary):
        _need_turning(name, field)
    if any(parse_vary(text).parameter in OF_SKY for text in job.request.vary):
        _need_sky(name, field)
    movers = declared_movers(job.request.vary, job.scene)
    if movers and not getattr(field, "learns_movers", False):
        names = ", ".join(f"'{mover.name}'" for mover in movers)
        raise ValueError(f"bake: field '{name}' learns one pose; use --field factored, or drop {names} from --vary")


def refuse_sky(name: str, field: Field, state: State) -> None:
    """Refuse light from all around, which the scene itself may suggest, for fields that take all direct light for the
    rasteriser's.

    Args:
        name: What ``--field`` calls the field.
        field: The field.
        state: The prepared scene.

    Raises:
        ValueError: The variable has a sky, or is an environment map, which the field does not learn.
    """
    if isinstance(state.variable, Turning):
        _need_turning(name, field)
    if has_sky(state.variable):
        _need_sky(name, field)


def _need_turning(name: str, field: Field) -> None:
    if not getattr(field, "learns_turning", False):
        raise ValueError(
            f"bake: field '{name}' learns no environment that turns; use --field factored, or drop {ROTATED} from "
            "--vary"
        )


def _need_sky(name: str, field: Field) -> None:
    if not getattr(field, "learns_sky", False):
        raise ValueError(f"bake: field '{name}' learns no sky; use --field factored, or drop the day from --vary")
