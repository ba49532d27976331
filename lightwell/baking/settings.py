"""What a person asks of a bake."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from lightwell.fields import field_of
from lightwell.limits import DEFAULT_LIMITS, Limits

# Seconds of tracing and training when nothing else is asked for: good on two cores.
DEFAULT_SECONDS = 120.0

# Longest edge of a light map: that of a texture in the format.
MOST_TEXELS = 4096

# Mean displayed radiance after exposure: a middle grey that leaves room for highlights.
MIDDLE_GREY = 0.18

# An error budget works in rounds of this many seconds until the goal is met ...
ROUND_SECONDS = 60.0
# ... or this many rounds have passed.
MOST_ROUNDS = 20


@dataclass(frozen=True)
class Budget:
    """Either seconds of tracing and training, or a relative error to reach on held-out lights."""

    seconds: float | None = DEFAULT_SECONDS
    error: float | None = None

    @staticmethod
    def parse(text: str) -> Budget:
        """``60s``, ``5m``, ``1h`` are times; ``5%`` is a relative error."""
        match = re.fullmatch(r"\s*([0-9]*\.?[0-9]+)\s*(s|m|min|h|%)?\s*", text)
        value = float(match.group(1)) if match else 0.0
        if not match or value <= 0:
            raise ValueError(f"bake: --budget '{text}' is not a time or an error; write 60s, 5m, 1h or 5%")
        unit = match.group(2) or "s"
        if unit == "%":
            return Budget(None, value / 100)
        return Budget(value * {"s": 1, "m": 60, "min": 60, "h": 3600}[unit])

    @property
    def round_seconds(self) -> float:
        """Seconds of the first (or only) round."""
        return self.seconds if self.seconds else ROUND_SECONDS


def metres(text: str) -> float:
    """``1m``, ``50cm`` or a plain number of metres."""
    match = re.fullmatch(r"\s*([0-9]*\.?[0-9]+)\s*(m|cm|mm)?\s*", text)
    value = float(match.group(1)) * {"m": 1, "cm": 0.01, "mm": 0.001}[match.group(2) or "m"] if match else 0.0
    if not value > 0:
        raise ValueError(f"bake: --spacing '{text}' is not a length; give metres, such as 1m or 50cm")
    return value


@dataclass(frozen=True)
class BakeSettings:
    """Everything that decides what a bake computes; with fixed ``steps`` and ``shards`` the same seed gives the same
    learned light, to the bit."""

    scene: str
    """Path of a scene or the name of a built-in one."""
    out: Path
    field: str = ""
    """Learned representation; empty: the first that has the preset."""
    preset: str = "default"
    budget: Budget = Budget()
    vary: tuple[str, ...] = ()
    """Declarations such as 'light.position=box(0,0,0,1,1,1)'."""
    seed: int = 0
    resume: bool = False
    paths: int = 16
    """Light paths per training sample."""
    lights_per_shard: int = 512
    """Light positions per shard; 128 surface points share each."""
    views: int = 4
    """Held-out views in the report."""
    view_size: tuple[int, int] = (224, 140)
    """Width and height of the report's views, pixels."""
    steps: int | None = None
    """Fixed number of training steps instead of a time budget (for reproducible runs)."""
    shards: int | None = None
    """Fixed number of sample shards instead of a time budget."""
    keep: bool = False
    """Keep samples and checkpoints after the bake."""
    force: bool = False
    """Overwrite files in the output folder that lightwell did not write."""
    static: bool = True
    """Also learn the light of the scene's own emitters."""
    size: int | None = None
    """Texels along each edge of a light map; None: the preset's."""
    mips: int = 1
    """Mip level up to which no texel of a light map mixes charts."""
    max_bytes: int | None = None
    """Most bytes that a light map may take; None: as many as its preset takes."""
    spacing: float | None = None
    """Distance of neighbouring light probes, metres; None: an eighth of the scene."""
    limits: Limits = DEFAULT_LIMITS
    """What the scene's file may ask for."""
    unit: float = 1.0
    """Metres per unit of length of a glTF file."""
    allow_paths: tuple[str, ...] = ()
    """Folders beside its own whose files a Mitsuba scene may name."""

    def __post_init__(self) -> None:
        """Name the field; refuse counts that mean nothing, by the name of their option."""
        if not self.field:
            object.__setattr__(self, "field", field_of(self.preset))
        for option, value, least in (
            ("--paths", self.paths, 2),
            ("--views", self.views, 1),
            ("--steps", self.steps, 1),
            ("--shards", self.shards, 1),
            ("--seed", self.seed, 0),
            ("--size", self.size, 16),
            ("--mips", self.mips, 0),
        ):
            if value is not None and value < least:
                raise ValueError(f"bake: {option} {value} is too small; give {least} or more")
        if self.size is not None and (self.size > MOST_TEXELS or self.size & (self.size - 1)):
            raise ValueError(f"bake: --size {self.size} is not a power of two up to {MOST_TEXELS}; give 512 or 1024")
        if self.spacing is not None and not 0 < self.spacing < float("inf"):
            raise ValueError(f"bake: --spacing {self.spacing} is not a length; give metres, such as 1m")
        if self.paths % 2:
            raise ValueError(f"bake: --paths {self.paths} is odd; give an even number (two independent halves)")
