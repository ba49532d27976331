"""What a bake declares and its field does not learn is refused, in one line with the cure."""

from __future__ import annotations

from lightwell.core.vary import OF_SKY, parse_vary
from lightwell.fields.protocol import Field, Job, State
from lightwell.scenes.posing import declared_movers
from lightwell.scenes.variables import has_sky


def refuse_declared(name: str, field: Field, job: Job) -> None:
    """Refuse what is declared and the field does not learn, before the field prepares the scene, which takes time.

    Args:
        name: What ``--field`` calls the field.
        field: The field.
        job: Scene and settings.

    Raises:
        ValueError: A day is declared, or a node is, which is not there or which the field does not learn.
    """
    if any(parse_vary(text).parameter in OF_SKY for text in job.request.vary):
        _need_sky(name, field)
    movers = declared_movers(job.request.vary, job.scene)
    if movers and not getattr(field, "learns_movers", False):
        names = ", ".join(f"'{mover.name}'" for mover in movers)
        raise ValueError(f"bake: field '{name}' learns one pose; use --field factored, or drop {names} from --vary")


def refuse_sky(name: str, field: Field, state: State) -> None:
    """Refuse a day, which the scene itself may suggest, for fields that take all direct light for the rasteriser's.

    Args:
        name: What ``--field`` calls the field.
        field: The field.
        state: The prepared scene.

    Raises:
        ValueError: The variable has a sky, which the field does not learn.
    """
    if has_sky(state.variable):
        _need_sky(name, field)


def _need_sky(name: str, field: Field) -> None:
    if not getattr(field, "learns_sky", False):
        raise ValueError(f"bake: field '{name}' learns no sky; use --field factored, or drop the day from --vary")
