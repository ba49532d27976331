"""Settings of the radiance cache: presets, defaults and range checks.

The default values come from Müller et al., *Real-time Neural Radiance Caching for Path Tracing* (2021), where
docs/radiance-cache.md does not say otherwise.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Sequence
from dataclasses import Field, dataclass, replace
from typing import Any

from lightwell.core.options import Option, option, options_of

# Squared, in the paper's units: the vendor SDK compares radii with a primary radius of d sqrt(4 pi / cos).
SDK_FACTOR = (4 * math.pi) ** 2
SDK_T = "termination_sdk_t"
PRESETS = ("compact", "paper")
VIEWS = (
    "image", "cache", "cache-2", "depth", "spread", "training", "residual", "raw-minus-ema", "albedo", "dropped",
    "reservoir", "tiles", "bias",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class NetworkSettings:
    """Shape of the network and meaning of its output."""

    encoding: str = option(
        "hash", "Encoding of the position: 'hash' or 'frequency' (the paper's).", choices=("hash", "frequency")
    )
    levels: int = option(6, "Hash grid: levels of four channels.", least=1, most=16)
    base: float = option(8.0, "Hash grid: cells along each axis of the first level.", least=1, most=4096)
    growth: float = option(1.7, "Hash grid: ratio of the cells per axis of successive levels.", least=1, most=8)
    entries_log2: int = option(
        15, "Hash grid: base-2 logarithm of the largest number of entries of a level.", least=8, most=22
    )
    hidden: int = option(32, "Neurons of a hidden layer.", least=4, most=256)
    layers: int = option(2, "Hidden layers.", least=1, most=8)
    factorise: bool = option(True, "Learn radiance divided by reflectance.")


@dataclass(frozen=True, kw_only=True)
class PathSettings:
    """Termination of rendering and training paths."""

    termination_c: float = option(
        0.01,
        "A path ends in the cache once its footprint exceeds c times that of the primary hit; inf: plain path tracing.",
        least=0,
        most=math.inf,
    )
    unbiased_fraction: float = option(
        1 / 16, "Share of the training paths that only Russian roulette ends.", least=0, most=1
    )
    still_unbiased: float = option(
        1.0,
        "unbiased_fraction while a still trains; its large frames make noise less costly than one bounce per frame.",
        least=0,
        most=1,
    )
    tail_after: int = option(
        1,
        "Records from the query vertex on before a prediction may end a training path; the paper: 1.",
        least=1,
        most=64,
    )
    tail_attenuation: float = option(
        1.0,
        "Factor of predictions that end training paths, <= 1; for BSDFs that do not conserve energy.",
        least=0,
        most=1,
    )
    max_vertices: int = option(8, "Largest number of records of a training path.", least=1, most=64)
    max_depth: int = option(
        -1,
        "Longest path, -1: unlimited.",
        check=lambda v: "" if v == -1 or v >= 1 else "expected -1 (no limit) or a number >= 1",
    )
    rr_depth: int = option(5, "Depth from which roulette may end a path.", least=1, most=1 << 30)


@dataclass(frozen=True, kw_only=True)
class TrainingSettings:
    """Training of the network and of the guide."""

    lead_in: int = option(
        2,
        "Frames of an untrained cache, or after a change, in which every training path ends by roulette: wrong "
        "predictions would take as many frames to correct as light has bounces. Four times as many where "
        "``eager`` is 1 or ``budget`` is not 'preset', none where ``unbiased_fraction`` is 0.",
        least=0,
        most=1 << 20,
    )
    eager: int = option(
        8,
        "Factor of gradient steps and records in the first frames of an untrained cache (8 frames, and 4 after a "
        "change); 1: no larger.",
        least=1,
        most=64,
    )
    target_cap: float = option(
        30.0,
        "Limit of a record, as a multiple of the prediction plus the mean; 0: no limit.",
        least=0,
        most=1e30,
    )
    train_fraction_max: float = option(
        0.05, "Largest share of pixels with a training path in one frame.", least=1e-6, most=1
    )
    batch: int = option(2048, "Records of one gradient step.", least=16, most=1 << 20)
    steps: int = option(
        8, "Largest number of gradient steps per frame; fewer when there are few records.", least=1, most=64
    )
    bootstrap: str = option("raw", "Weights that end training paths: 'raw' or 'ema'.", choices=("raw", "ema"))
    ema_decay: float = option(
        0.99,
        "Decay of the averaged weights at four steps of 4,096 records per frame; 0 disables averaging.",
        least=0,
        most=0.999999,
    )
    early_average: float = option(
        8.0,
        "Until ema_decay limits it, the average covers one part in so many of the steps taken; "
        "0: all of them, as in the paper.",
        least=0,
        most=1000,
    )
    learning_rate: float = option(1e-2, "Step size of the optimiser.", least=1e-7, most=1)
    radiance_scale: float = option(
        0.0, "Factor that brings radiance to order one; 0: calibrated automatically.", least=0, most=1e30
    )
    replay: float = option(
        0.125,
        "Share of training paths that start with rays of earlier cameras, once the camera has moved, so that "
        "regions off screen stay trained.",
        least=0,
        most=0.5,
    )
    on_change: str = option(
        "detect",
        "Reaction to changes of the scene: 'detect' them, only when announced ('hint-only'), or 'off'.",
        choices=("detect", "hint-only", "off"),
    )
    budget: str = option(
        "preset",
        "'low': one step per frame. 'auto': training takes at most a quarter of the frame time (not reproducible).",
        choices=("preset", "low", "auto"),
    )

    @property
    def step_decay(self) -> float:
        """Decay of the averaged weights per step, so that its time constant in frames does not depend on ``steps``.

        Returns:
            Decay in [0, 1).
        """
        return float(self.ema_decay ** (4 / self.steps))


@dataclass(frozen=True, kw_only=True)
class GuideSettings:
    """Path guiding beside the cache, or without it."""

    guide: str = option(
        "auto",
        "Path guiding: the distribution of incident light is learned, too, and sampled beside the BSDF. "
        "'auto': a noisy still tests it for some samples, and continues with the smaller product of variance "
        "and time; true is 'always', false 'never'. With the estimator 'guided' only a still with a time limit tests "
        "it.",
        choices=("auto", "always", "never"),
    )
    guide_share: float = option(
        0.5, "Probability that a vertex samples the guide and not the BSDF.", least=0, most=0.95
    )


@dataclass(frozen=True, kw_only=True)
class EstimationSettings:
    """Estimator of the radiance of a pixel."""

    first_hit: str = option(
        "nee",
        "Light at the first hit: 'nee'; 'restir-di', reservoirs for direct light; 'restir-gi', for indirect light.",
        choices=("nee", "restir-di", "restir-gi"),
    )
    restir_reuse: str = option("biased", "Merging of neighbours' reservoirs.", choices=("biased", "unbiased"))
    restir_candidates: int = option(8, "Initial light samples of a reservoir (the paper: 32).", least=1, most=1024)
    estimator: str = option(
        "biased",
        "'biased': end in the cache. 'residual', 'two-level': unbiased, with the cache as control variate. "
        "'guided': unbiased, no prediction in the image; the guide provides directions of full paths.",
        choices=("biased", "residual", "two-level", "guided"),
    )
    residual_probability: float = option(
        0.25, "Share of paths that continue after the query, to measure the cache's error.", least=1e-3, most=1
    )
    level_samples: int = option(
        4, "two-level: cheap samples that read the cache, per path that measures its error.", least=1, most=64
    )


@dataclass(frozen=True, kw_only=True)
class ImageSettings:
    """Rendering of images from samples."""

    denoise: bool = option(False, "Open Image Denoise on the result (needs mitsuba-oidn and a box filter).")
    denoise_cache: bool = option(
        False,
        "With 'denoise', a still: blend with the cache's view, pixel by pixel, where two halves of the samples show "
        "that it is nearer to the truth; guide images are denoised first.",
    )
    denoise_frames: int = option(
        1,
        "With 'denoise', frames: average up to so many denoised frames along the motion of the surfaces. 1: none.",
        least=1,
        most=64,
    )
    local_level: bool = option(
        True, "still: correct the mean of predictions by place, as measured by the training paths."
    )
    spike_cap: float = option(
        0.25,
        "still: limit of a caustic in one sample, as a multiple of the mean radiance times the samples per "
        "pixel so far, so that single ones are not visible. 0: no limit.",
        least=0,
        most=math.inf,
    )
    mode: str = option(
        "auto",
        "'frames': train a little at every sample per pixel. 'still': train first, freeze, then render. "
        "'auto': 'still' from ``STILL_SPP`` samples per pixel on.",
        choices=("auto", "frames", "still"),
    )
    seconds: float = option(
        0.0,
        "Time limit of a still in seconds, training included (not reproducible); 0: none.",
        least=0,
        most=1e6,
    )
    train_share: float = option(0.3, "With a time limit: the part of it for training.", least=0.01, most=0.99)
    warmup: int = option(
        0, "still: training frames before the image; 0: by the number of samples.", least=0, most=1 << 20
    )
    sampling: str = option(
        "sobol",
        "'sobol': scrambled (0,2) sequences. 'sensor': the sensor's own sampler, as Mitsuba's ``path`` uses it.",
        choices=("sobol", "sensor"),
    )
    view: str = option("image", "'image' or a debug view.", choices=VIEWS)


@dataclass(frozen=True, kw_only=True)
class CacheSettings:
    """All options of ``lightwell_nrc``, in groups.

    The names of the options are unique over the groups: they are the plugin's parameters and the words NAME=VALUE of
    the command line, see ``settings_of``.
    """

    network: NetworkSettings = NetworkSettings()
    paths: PathSettings = PathSettings()
    training: TrainingSettings = TrainingSettings()
    estimation: EstimationSettings = EstimationSettings()
    guiding: GuideSettings = GuideSettings()
    image: ImageSettings = ImageSettings()
    preset: str = option(
        "compact",
        "'compact': hash grid and two layers of 32, for CPUs. 'paper': triangle wave and one-blob, five layers of 64.",
        choices=PRESETS,
    )
    seed: int = option(0, "Seed of the initial weights.", least=0, most=(1 << 32) - 1)

    def __post_init__(self) -> None:
        """Refuse values outside the ranges that the options declare."""
        for name, (group, _, known) in OPTIONS.items():
            value = getattr(getattr(self, group) if group else self, name)
            if known.choices and value not in known.choices:
                raise ValueError(f"nrc: {name} = '{value}', expected one of {', '.join(known.choices)}")
            if known.least is not None and not known.least <= value <= known.most:
                raise ValueError(
                    f"nrc: {name} = {value:g}, expected {known.least:g} ... {known.most:g}; correct the parameter"
                )
            if known.check and (wrong := known.check(value)):
                raise ValueError(f"nrc: {name} = {value}, {wrong}")

        image, estimator = self.image, self.estimation.estimator
        if image.denoise_frames > 1 and not (image.denoise and image.mode != "still"):
            raise ValueError("nrc: denoise_frames averages denoised frames; set denoise=true, and mode=frames or auto")
        if image.seconds > 0 and estimator == "two-level":
            # The paths of the second level are traced after the samples, and their number follows from them.
            raise ValueError(
                "nrc: estimator=two-level keeps no time limit; leave out seconds, or set estimator=residual or guided"
            )
        alone = estimator == "biased" and self.guiding.guide != "always"
        if self.estimation.first_hit == "restir-gi" and not alone:
            # Reservoirs hold light of paths that end in the cache at the second surface, and that no guide directs.
            given = f"estimator={estimator}" if estimator != "biased" else "guide=always"
            raise ValueError(
                f"nrc: first_hit=restir-gi has no {given}; leave out one of them, or set first_hit=restir-di"
            )
        biased = self.caching and estimator == "biased"
        if image.denoise_cache and not (image.denoise and biased and image.mode != "frames"):
            raise ValueError(
                "nrc: denoise_cache blends a denoised still with the cache; set denoise=true, leave estimator and "
                "termination_c as they are, and render single pictures"
            )

    @property
    def caching(self) -> bool:
        """Whether paths can end in the cache.

        Returns:
            False with an infinite threshold or the estimator 'guided'.
        """
        return math.isfinite(self.paths.termination_c) and self.estimation.estimator != "guided"

    @property
    def guided(self) -> bool:
        """Whether a guide may be trained.

        Returns:
            True with the estimator 'guided', or where ``guide`` allows one beside the cache.
        """
        estimation, guide = self.estimation, self.guiding.guide
        if guide == "auto" and not (estimation.estimator == "biased" and estimation.first_hit != "restir-gi"):
            return estimation.estimator == "guided"
        return estimation.estimator == "guided" or (guide != "never" and self.caching)

    @property
    def learns(self) -> bool:
        """Whether there is anything to train.

        Returns:
            True with a cache or a guide.
        """
        return self.caching or self.guided

    def changed(self, **values: Any) -> CacheSettings:
        """Copy the settings with some values replaced.

        Args:
            **values: New values by the name of the option; the group need not be named.

        Returns:
            The copy, checked.
        """
        by_group: dict[str, dict[str, Any]] = {}
        for name, value in values.items():
            by_group.setdefault(OPTIONS[name][0], {})[name] = value
        own = by_group.pop("", {})
        return replace(self, **own, **{group: replace(getattr(self, group), **new) for group, new in by_group.items()})

    def to_json(self) -> dict[str, Any]:
        """Return all values as JSON types; infinity is a string.

        Returns:
            Name of the option to value.
        """
        values = {name: getattr(getattr(self, group) if group else self, name) for name, (group, *_) in OPTIONS.items()}
        return {k: str(v) if isinstance(v, float) and math.isinf(v) else v for k, v in values.items()}


GROUPS: dict[str, type] = {
    "network": NetworkSettings, "paths": PathSettings, "training": TrainingSettings, "guiding": GuideSettings,
    "estimation": EstimationSettings, "image": ImageSettings, "": CacheSettings,
}  # fmt: skip
# Name of every option to its group ('': none), field and declaration.
OPTIONS: dict[str, tuple[str, Field[Any], Option]] = {
    name: (group, *found) for group, kind in GROUPS.items() for name, found in options_of(kind).items()
}
# Values of the preset 'paper' that differ from the defaults.
PAPER = {
    "encoding": "frequency", "hidden": 64, "layers": 5, "train_fraction_max": 0.03, "batch": 16384, "steps": 4,
    "learning_rate": 5e-3,
}  # fmt: skip


def settings_of(given: dict[str, Any]) -> CacheSettings:
    """Make settings from named values; the values of the preset come first.

    Args:
        given: Name to value; ``termination_sdk_t`` is converted to ``termination_c``.

    Returns:
        The settings, checked.

    Raises:
        ValueError: A name is unknown (with the nearest ones), or a value has the wrong type or is out of range.
    """
    given = dict(given)
    if (t := given.pop(SDK_T, None)) is not None:
        given["termination_c"] = float(t) ** 2 * SDK_FACTOR
    for name in given:
        if name not in OPTIONS:
            near = difflib.get_close_matches(name, [*OPTIONS, SDK_T], n=2)
            hint = f"did you mean {' or '.join(near)}? " if near else ""
            raise ValueError(f"nrc: there is no parameter '{name}'; {hint}docs/radiance-cache.md lists them")
    values: dict[str, Any] = dict(PAPER) if given.get("preset") == "paper" else {}
    if given.get("budget") == "low":
        values["steps"] = 1
    for name, value in given.items():
        if name == "guide" and isinstance(value, bool):
            value = "always" if value else "never"
        values[name] = _typed(name, type(OPTIONS[name][1].default).__name__, value)
    return CacheSettings().changed(**values)


def parse_options(texts: Sequence[str]) -> CacheSettings:
    """Parse settings from command-line words.

    Args:
        texts: Words NAME=VALUE such as ``preset=paper`` and ``denoise=true``.

    Returns:
        The settings, checked.

    Raises:
        ValueError: A word is not NAME=VALUE, or ``settings_of`` refuses it.
    """
    given: dict[str, Any] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not value:
            raise ValueError(f"nrc: '{text}', expected NAME=VALUE such as preset=paper")
        given[name.strip()] = {"true": True, "false": False}.get(value.strip().lower(), value.strip())
    return settings_of(given)


def _typed(name: str, kind: str, value: Any) -> Any:
    """Convert a value to the type of its field; Mitsuba XML has floats, integers, booleans and strings."""
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
