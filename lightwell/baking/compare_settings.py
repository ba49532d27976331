"""What a person asks of a comparison of fields."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from lightwell.baking.settings import BakeSettings, Budget
from lightwell.fields import FIELDS, presets
from lightwell.limits import DEFAULT_LIMITS, Limits

DEFAULT_BUDGET = Budget()


@dataclass(frozen=True)
class FieldChoice:
    """A field and one of its presets."""

    field: str
    preset: str

    @property
    def name(self) -> str:
        """What it is called: ``mlp`` for the default preset, else ``mlp:report-20``."""
        return self.field if self.preset == presets(self.field)[0] else f"{self.field}:{self.preset}"

    @property
    def folder(self) -> str:
        """Name of its folder."""
        return self.name.replace(":", "-")


def parse_fields(text: str) -> tuple[FieldChoice, ...]:
    """``mlp,mlp:report-20,factored`` → choices, each once; ValueError with the choices for an unknown name."""
    words = [word.strip() for word in text.split(",") if word.strip()]
    if not words:
        raise ValueError(f"compare: --fields '{text}' names no field; choose some of {', '.join(FIELDS)}")
    return tuple(dict.fromkeys(_choice(word) for word in words))


def _choice(word: str) -> FieldChoice:
    field, _, preset = word.partition(":")
    if field not in FIELDS:
        raise ValueError(f"compare: unknown field '{field}' in --fields; choose some of {', '.join(FIELDS)}")
    known = presets(field)
    if preset and preset not in known:
        names = ", ".join(f"{field}:{name}" for name in known)
        raise ValueError(f"compare: field '{field}' has no preset '{preset}'; choose some of {names}")
    return FieldChoice(field, preset or known[0])


@dataclass(frozen=True)
class CompareSettings:
    """Everything that decides what a comparison computes."""

    scene: str
    """Path of a scene or the name of a built-in one."""
    out: Path
    fields: tuple[FieldChoice, ...]
    budget: Budget = DEFAULT_BUDGET
    """Seconds of tracing, once, and of training, for each field: what a bake of that budget would have."""
    vary: tuple[str, ...] = ()
    seed: int = 0
    resume: bool = False
    paths: int = 16
    """Light paths per training sample."""
    lights_per_shard: int = 512
    views: int = 3
    """Held-out views."""
    view_size: tuple[int, int] = (224, 140)
    """Width and height of the views, pixels."""
    steps: int | None = None
    """Fixed number of training steps of every field instead of a time."""
    shards: int | None = None
    """Fixed number of sample shards instead of a share of the budget."""
    truth: Budget | None = None
    """Seconds of tracing the held-out truth; None: a share of the budget. All fields share it."""
    keep: bool = False
    """Keep samples, truth and checkpoints, so that --resume can add fields later."""
    limits: Limits = DEFAULT_LIMITS
    """What the scene's file may ask for."""
    unit: float = 1.0
    """Metres per unit of length of a glTF file."""
    allow_paths: tuple[str, ...] = ()
    """Folders beside its own whose files a Mitsuba scene may name."""
    force: bool = False
    """Overwrite files in the output folder that lightwell did not write."""

    def __post_init__(self) -> None:
        """Refuse what means nothing, by the name of its option."""
        if self.budget.seconds is None:
            raise ValueError("compare: --budget must be a time such as 60s; an error cannot be the same for all fields")
        if self.truth and self.truth.seconds is None:
            raise ValueError("compare: --truth must be a time such as 5m")
        try:
            self.as_bake(self.fields[0])
        except ValueError as error:
            raise ValueError(str(error).replace("bake:", "compare:", 1)) from None

    def as_bake(self, choice: FieldChoice) -> BakeSettings:
        """The bake that would learn one of the fields from as many samples."""
        shared = ("scene", "out", "budget", "vary", "seed", "paths", "lights_per_shard", "views", "view_size")
        shared += ("limits", "unit", "allow_paths")
        counts = {"steps": self.steps, "shards": self.shards}
        return BakeSettings(field=choice.field, preset=choice.preset, **{k: getattr(self, k) for k in shared}, **counts)
