"""Settings of bakes and comparisons."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lightwell.core.cluster_options import ClusterOptions
from lightwell.core.options import check, made, option, options_of
from lightwell.core.scene_edits import SceneEdits, read_edits
from lightwell.core.scene_options import SceneOptions
from lightwell.fields.budget import Budget
from lightwell.fields.registry import DEFAULT, option_homes, options_type
from lightwell.fields.request import Request


def _time(text: str) -> Budget:
    budget = Budget.parse(text)
    if budget.seconds is None:
        raise ValueError(f"'{text}' must be a time such as 5m")
    return budget


@dataclass(frozen=True, kw_only=True)
class Reported(Request, SceneOptions, ClusterOptions):
    """Settings that a bake and a comparison share: the request, and the contents of the report."""

    views: int = option(4, "held-out views in the report (default: 4)", least=1, group="report")
    truth: Budget | None = option(
        None,
        "time for tracing the reference that the result is scored against (default: what the budget leaves)",
        parse=_time,
        metavar="TIME",
        group="report",
    )
    edits: SceneEdits | None = option(
        None,
        "apply the edits that 'lightwell live' wrote: surfaces moved, lamps dimmed, materials painted",
        parse=read_edits,
        metavar="FILE",
    )
    view_size: tuple[int, int] = (224, 140)
    """Width and height of the report's views, pixels."""
    resume: bool = option(False, "go on with a bake that was interrupted", group="interrupting")
    keep: bool = option(False, "keep samples and checkpoints after the bake", group="interrupting")
    force: bool = option(False, "overwrite files in OUT that lightwell did not write", group="interrupting")


@dataclass(frozen=True, kw_only=True)
class Compared(Reported):
    """Settings that all fields of a comparison share."""

    views: int = option(3, "held-out views (default: 3)", least=1, group="report")


@dataclass(frozen=True)
class BakeSettings(Reported):
    """Settings of a bake."""

    scene: str
    """Path of a scene or the name of a built-in one."""
    out: Path
    """Folder to write."""
    field: str = ""
    """Learned representation; empty: the first that has the preset."""
    options: Any = None
    """Options of the field: an instance of its ``Options``, or a dictionary; None: the defaults."""

    def __post_init__(self) -> None:
        """Refuse values out of range, by the name of their option."""
        super().__post_init__()
        check(self, "bake")
        if self.options is None or isinstance(self.options, Mapping):
            object.__setattr__(self, "options", field_options(self.field, self.options or {}))


def field_options(field: str, given: Mapping[str, Any], verb: str = "bake") -> Any:
    """Make the options of a field; an unknown option is an error that names the fields that have it.

    Args:
        field: Name of the field; empty: the default one.
        given: Options by name.
        verb: Verb of the command line for error messages.

    Returns:
        Instance of the field's ``Options``.
    """
    kind = options_type(field or DEFAULT)
    return made(kind, given, verb, "field", field or DEFAULT, option_homes())


def request_of(settings: Reported) -> dict[str, Any]:
    """Return the settings that a field is given.

    Args:
        settings: Settings of a bake or comparison.

    Returns:
        Fields of ``Request`` by name.
    """
    names = (*options_of(Request), "lights_per_shard")
    return {name: getattr(settings, name) for name in names}
