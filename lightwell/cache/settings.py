"""What can be set of the radiance cache: presets, defaults, and the checks of values that a user gives.

The numbers come from Müller et al., *Real-time Neural Radiance Caching for Path Tracing* (2021), where
docs/radiance-cache.md does not say otherwise.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

# Squared, in the paper's units: the vendor SDK compares radii with a primary radius of d sqrt(4 pi / cos).
SDK_FACTOR = (4 * math.pi) ** 2
SDK_T = "termination_sdk_t"
PRESETS = ("compact", "paper")
CHOICES = {
    "preset": PRESETS,
    "encoding": ("hash", "frequency"),
    "bootstrap": ("raw", "ema"),
    "first_hit": ("nee", "restir-di", "restir-gi"),
    "restir_reuse": ("biased", "unbiased"),
    "estimator": ("biased", "residual", "two-level", "guided"),
    "guide": ("auto", "always", "never"),
    "on_change": ("detect", "hint-only", "off"),
    "budget": ("preset", "low", "auto"),
    "mode": ("auto", "frames", "still"),
    "sampling": ("sobol", "sensor"),
    "view": (
        "image", "cache", "cache-2", "depth", "spread", "training", "residual", "raw-minus-ema", "albedo", "dropped",
        "reservoir", "tiles", "bias",
    ),
}  # fmt: skip


@dataclass(frozen=True)
class CacheSettings:
    """Every option of ``lightwell_nrc``; also the names of the plugin's parameters."""

    preset: str = "compact"
    """'compact': hash grid and two layers of 32, for CPUs. 'paper': triangle wave and one-blob, five layers of 64."""
    encoding: str = "hash"
    """Of the position: 'hash' or 'frequency' (the paper's)."""
    levels: int = 6
    """Hash grid: levels of four channels."""
    base: float = 8.0
    """Hash grid: cells along each axis of the first level."""
    growth: float = 1.7
    """Hash grid: cells of a level relative to the one before."""
    entries_log2: int = 15
    """Hash grid: logarithm of the largest number of entries of a level."""
    hidden: int = 32
    """Neurons of a hidden layer."""
    layers: int = 2
    """Hidden layers."""
    termination_c: float = 0.01
    """A path ends in the cache once its footprint exceeds c times that of the primary hit; inf: plain path tracing."""
    unbiased_fraction: float = 1 / 16
    """Training paths that end by roulette alone."""
    lead_in: int = 2
    """Frames of a cold cache, or after a change, in which every training path ends by roulette: cache values that are
    still wrong would take as many frames to correct as light has bounces. Four times as many where ``eager`` is 1 or
    ``budget`` is not 'preset', none where ``unbiased_fraction`` is 0."""
    eager: int = 8
    """Gradient steps, and records for them, of the first frames of a cold cache (8, and 4 after a change), in those of
    a usual frame; 1: no larger."""
    still_unbiased: float = 1.0
    """The same while a still trains: its frames are large, so that noise costs less than a bounce per frame."""
    tail_after: int = 1
    """Records from the query vertex on before a cache value may end a training path; the paper: 1."""
    target_cap: float = 30.0
    """Records brighter than so many times what the cache says there plus the mean are cut to that; 0: never."""
    train_fraction_max: float = 0.05
    """Largest share of pixels that train in one frame."""
    max_vertices: int = 8
    """Records that one training path can leave."""
    batch: int = 2048
    """Records of one gradient step."""
    steps: int = 8
    """Gradient steps per frame, at most: fewer where records are short."""
    bootstrap: str = "raw"
    """Weights that end training paths: 'raw' or 'ema'."""
    factorise: bool = True
    """Learn radiance divided by reflectance."""
    ema_decay: float = 0.99
    """Decay of the averaged weights at four steps of 4,096 records a frame; 0 turns averaging off."""
    early_average: float = 8.0
    """Before that decay takes hold, the average reaches back over one part in so many of the steps taken; 0: over all
    of them, as in the paper."""
    learning_rate: float = 1e-2
    radiance_scale: float = 0.0
    """Factor that brings radiance to order one; 0: calibrated automatically."""
    tail_attenuation: float = 1.0
    """Factor on cache values that end training paths, <= 1; against BSDFs that make energy."""
    first_hit: str = "nee"
    """Light at the first hit: 'nee'; 'restir-di', reservoirs for direct light; 'restir-gi', for light of one bounce."""
    restir_reuse: str = "biased"
    """How neighbours' reservoirs are merged."""
    replay: float = 0.125
    """Share of training paths that start where earlier cameras looked, once the camera has moved: what is off screen is
    traced anew, not forgotten."""
    restir_candidates: int = 8
    """Light samples that a reservoir chooses from afresh (the paper: 32)."""
    estimator: str = "biased"
    """'biased': end in the cache. 'residual', 'two-level': unbiased, with the cache as control variate. 'guided':
    unbiased, no cache value in the picture; the guide steers whole paths."""
    guide: str = "auto"
    """Training also learns where light comes from, and paths sample it beside the BSDF (path guiding). 'auto': a noisy
    still tries it for some samples, and goes on with what needs less variance times time; true is 'always', false
    'never'. Always on with the estimator 'guided'."""
    guide_share: float = 0.5
    """Probability that a vertex samples the guide and not the BSDF."""
    residual_probability: float = 0.25
    """Share of paths that go on behind the query, to measure what the cache gets wrong."""
    level_samples: int = 4
    """two-level: cheap samples that read the cache, per path that measures its error."""
    on_change: str = "detect"
    """What follows a change of the scene: 'detect' it, obey 'hint-only', or 'off'."""
    budget: str = "preset"
    """'low': one step a frame. 'auto': training is held to a quarter of the frame time (not reproducible)."""
    denoise: bool = False
    """Open Image Denoise on the result (needs mitsuba-oidn and a box filter)."""
    max_depth: int = -1
    """Longest path, -1: unlimited."""
    rr_depth: int = 5
    """Depth from which roulette may end a path."""
    local_level: bool = True
    """still: correct what the network says, place by place, by what its training paths found."""
    spike_cap: float = 0.25
    """still: the light of a caustic is cut, per sample, to so many times the mean radiance times the samples per pixel
    so far, so that no single one shows; less is cut the more there are. 0: never."""
    mode: str = "auto"
    """'frames': train a little at every sample per pixel. 'still': train first, freeze, then render.
    'auto': 'still' from ``STILL_SPP`` samples per pixel on."""
    seconds: float = 0.0
    """Wall time of a still, training included (not reproducible); 0: as long as its samples take."""
    train_share: float = 0.3
    """seconds: the part of it that trains."""
    warmup: int = 0
    """still: frames of training before the picture; 0: by the number of samples."""
    sampling: str = "sobol"
    """'sobol': scrambled (0,2) sequences. 'sensor': the sensor's own sampler, as Mitsuba's ``path`` uses it."""
    view: str = "image"
    """'image' or a debug view."""
    seed: int = 0
    """Of the initial weights."""

    def __post_init__(self) -> None:
        for name, allowed in CHOICES.items():
            if getattr(self, name) not in allowed:
                raise ValueError(f"nrc: {name} = '{getattr(self, name)}', expected one of {', '.join(allowed)}")
        for name, low, high in _RANGES:
            value = getattr(self, name)
            if not low <= value <= high:
                raise ValueError(f"nrc: {name} = {value:g}, expected {low:g} ... {high:g}; correct the parameter")
        if self.max_depth < -1 or self.max_depth == 0:
            raise ValueError(f"nrc: max_depth = {self.max_depth}, expected -1 (no limit) or a number >= 1")

    @property
    def caching(self) -> bool:
        """Whether any path can end in the cache."""
        return math.isfinite(self.termination_c) and self.estimator != "guided"

    @property
    def guided(self) -> bool:
        """Whether a guide may be learned."""
        if self.guide == "auto" and not (self.estimator == "biased" and self.first_hit != "restir-gi"):
            return self.estimator == "guided"
        return self.estimator == "guided" or (self.guide != "never" and self.caching)

    @property
    def learns(self) -> bool:
        """Whether there is anything to train."""
        return self.caching or self.guided

    @property
    def step_decay(self) -> float:
        """Decay of the average per step: its time constant in frames does not depend on the number of steps."""
        return self.ema_decay ** (4 / self.steps)

    def changed(self, **values: Any) -> CacheSettings:
        """A copy with some values replaced."""
        return replace(self, **values)

    def network(self) -> dict[str, Any]:
        """The part that decides the shape and meaning of the weights."""
        names = ("encoding", "levels", "base", "growth", "entries_log2", "hidden", "layers", "factorise")
        return {name: getattr(self, name) for name in names}

    def to_json(self) -> dict[str, Any]:
        """All values; infinity as a string."""
        return {k: str(v) if isinstance(v, float) and math.isinf(v) else v for k, v in asdict(self).items()}


_RANGES = (
    ("levels", 1, 16),
    ("base", 1, 4096),
    ("growth", 1, 8),
    ("entries_log2", 8, 22),
    ("hidden", 4, 256),
    ("layers", 1, 8),
    ("termination_c", 0, math.inf),
    ("unbiased_fraction", 0, 1),
    ("still_unbiased", 0, 1),
    ("spike_cap", 0, math.inf),
    ("tail_after", 1, 64),
    ("target_cap", 0, 1e30),
    ("seconds", 0, 1e6),
    ("train_share", 0.01, 0.99),
    ("lead_in", 0, 1 << 20),
    ("eager", 1, 64),
    ("train_fraction_max", 1e-6, 1),
    ("max_vertices", 1, 64),
    ("batch", 16, 1 << 20),
    ("steps", 1, 64),
    ("ema_decay", 0, 0.999999),
    ("early_average", 0, 1000),
    ("learning_rate", 1e-7, 1),
    ("radiance_scale", 0, 1e30),
    ("tail_attenuation", 0, 1),
    ("replay", 0, 0.5),
    ("restir_candidates", 1, 1024),
    ("residual_probability", 1e-3, 1),
    ("level_samples", 1, 64),
    ("guide_share", 0, 0.95),
    ("rr_depth", 1, 1 << 30),
    ("warmup", 0, 1 << 20),
)

# What the preset 'paper' sets otherwise.
PAPER = {
    "encoding": "frequency", "hidden": 64, "layers": 5, "train_fraction_max": 0.03, "batch": 16384, "steps": 4,
    "learning_rate": 5e-3,
}  # fmt: skip


def settings_of(given: dict[str, Any]) -> CacheSettings:
    """Settings from named values: the preset's first, then the given ones; ``termination_sdk_t`` is converted."""
    given = dict(given)
    if (t := given.pop(SDK_T, None)) is not None:
        given["termination_c"] = float(t) ** 2 * SDK_FACTOR
    known = {f.name: type(f.default).__name__ for f in fields(CacheSettings)}
    for name in given:
        if name not in known:
            near = difflib.get_close_matches(name, [*known, SDK_T], n=2)
            hint = f"did you mean {' or '.join(near)}? " if near else ""
            raise ValueError(f"nrc: there is no parameter '{name}'; {hint}docs/radiance-cache.md lists them")
    values: dict[str, Any] = dict(PAPER) if given.get("preset") == "paper" else {}
    if given.get("budget") == "low":
        values["steps"] = 1
    for name, value in given.items():
        if name == "guide" and isinstance(value, bool):
            value = "always" if value else "never"
        values[name] = _typed(name, known[name], value)
    return CacheSettings(**values)


def parse_options(texts: Sequence[str]) -> CacheSettings:
    """Settings from words such as ``preset=paper`` and ``denoise=true``."""
    given: dict[str, Any] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not value:
            raise ValueError(f"nrc: '{text}', expected NAME=VALUE such as preset=paper")
        given[name.strip()] = {"true": True, "false": False}.get(value.strip().lower(), value.strip())
    return settings_of(given)


def _typed(name: str, kind: str, value: Any) -> Any:
    """A value of the kind of its field; XML knows floats, integers, booleans and strings."""
    if kind == "bool" and not isinstance(value, bool | int):
        raise ValueError(f"nrc: {name} = {value!r}, expected true or false")
    makers = {"int": int, "float": float, "bool": bool, "str": str}
    try:
        made = makers[kind](value)
    except (TypeError, ValueError):
        raise ValueError(f"nrc: {name} = {value!r}, expected a value of type {kind}") from None
    if kind == "int" and made != value and not isinstance(value, str):
        raise ValueError(f"nrc: {name} = {value!r}, expected a whole number")
    return made
