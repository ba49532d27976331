"""The option ``--max-bytes``: find the sizes, codecs and channels that fit and are best, by short trials."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from lightwell.core.color import display
from lightwell.fields.baked import Baked
from lightwell.fields.lightmap.curve import restored
from lightwell.fields.lightmap.fit import LightmapFit, LightmapPreset
from lightwell.fields.lightmap.trace import AtlasIrradiance
from lightwell.fields.lightmap.views import ViewSamples

# Steps of a trial, its training samples and its held-out samples.
TRIAL_STEPS, TRIAL_ROWS, JUDGED_ROWS = 300, 1 << 17, 1 << 14
# Codecs of the ordinary light map, from large to small; the first is lossless.
CODECS = ("webp", "webp98", "webp95", "webp90", "webp75")

Fitter = Callable[[LightmapPreset, ViewSamples, int], LightmapFit]


@dataclass(frozen=True)
class TrialFit:
    """A variant of the preset, its size and its error."""

    preset: LightmapPreset
    bytes: int
    error: float
    """Error of the stored light and of held-out samples, in display values; only the order of trials matters."""

    @property
    def label(self) -> str:
        """The variant in words."""
        p = self.preset
        features = f"{p.channels} features at 1/{round(1 / p.share)}" if p.channels else "no features"
        directions = f"directions at 1/{p.direction_reduction}" if p.stores_direction else "no directions"
        size = "" if p.base_reduction == 1 else f" at 1/{p.base_reduction}"
        return f"{p.base}{size}, {directions}, {features}"


def candidates(preset: LightmapPreset, mips: int) -> list[LightmapPreset]:
    """List variants of a preset, from large to small.

    Args:
        preset: The preset.
        mips: Levels of the mip chain.

    Returns:
        Presets.
    """
    if not preset.base:
        return [replace(preset, share=preset.share / 2**k) for k in range(6)]
    found = [replace(preset, base=codec) for codec in CODECS]
    if preset.stores_direction:
        found.append(replace(preset, base="webp75", direction_reduction=8))
    found.append(replace(preset, base="webp50", direction_reduction=8, share=preset.share / 2))
    small = replace(
        preset, base="webp50", direction_reduction=16, share=preset.share / 2, channels=min(preset.channels, 3)
    )
    found += [small, replace(small, channels=0)]
    # Half of the size reads level 1 of the atlas, which must not mix charts.
    found += [replace(small, base_reduction=2**m, channels=0, base="webp75") for m in range(1, mips + 1)]
    return list(dict.fromkeys(found))


def choose(
    limit: int,
    preset: LightmapPreset,
    made: AtlasIrradiance,
    samples: ViewSamples,
    fit: Fitter,
    say: Callable[[str], None],
) -> LightmapPreset:
    """Choose the best variant that fits into a number of bytes; each trial is printed.

    Args:
        limit: Most bytes.
        preset: The preset.
        made: Atlas and irradiance.
        samples: N samples.
        fit: Fits a variant.
        say: Prints a line.

    Returns:
        The chosen variant.

    Raises:
        ValueError: No variant fits.
    """
    trials = []
    for candidate in candidates(preset, made.atlas.mips):
        trials.append(trial(candidate, made, samples, fit))
        decibels = -10 * np.log10(max(trials[-1].error, 1e-6))
        say(f"  {trials[-1].bytes:>9,} bytes  {decibels:4.1f} dB  {trials[-1].label}")
    fitting = [t for t in trials if t.bytes <= limit]
    if not fitting:
        least = min(t.bytes for t in trials)
        raise ValueError(
            f"bake: --max-bytes {limit} is too few for this light map, whose smallest form takes {least} bytes; "
            "give more bytes or a smaller --size"
        )
    best = min(fitting, key=lambda t: t.error)
    say(f"--max-bytes {limit:,}: {best.label}, {best.bytes:,} bytes")
    return best.preset


def trial(preset: LightmapPreset, made: AtlasIrradiance, samples: ViewSamples, fit: Fitter) -> TrialFit:
    """Fit a variant with few steps; some samples are held out to measure the error.

    Args:
        preset: The variant.
        made: Atlas and irradiance.
        samples: N samples.
        fit: Fits the variant.

    Returns:
        Bytes and error of the variant.
    """
    order = np.random.default_rng(0x7121).permutation(len(samples.weight))
    held = order[: min(JUDGED_ROWS, len(order) // 2)]
    seen = order[len(held) :][:TRIAL_ROWS]
    found = fit(preset, samples[seen], TRIAL_STEPS if preset.hidden else 0)
    graph = found.lower()
    weights = sum(b.nbytes for name, b in graph.buffers.items() if name not in found.pictures)
    bytes_ = weights + sum(len(p.data) for p in found.pictures.values())
    error = _stored_error(found, made)
    if preset.hidden and len(held):
        # By the graph that would be written, without a network that does not lower the error; noise is subtracted.
        kept = samples[held]
        f, a, b = (display(v / found.unit) for v in (Baked(graph)(kept.query), kept.half_a, kept.half_b))
        error += float(np.average(((f - a) * (f - b)).mean(axis=1), weights=kept.weight + 1e-12))
    return TrialFit(preset, bytes_, error)


def _stored_error(fit: LightmapFit, made: AtlasIrradiance) -> float:
    """Mean squared error of the stored irradiance in display values."""
    if fit.base is None:
        return 0.0
    image = restored(fit.base.buffer().array)
    factor = made.atlas.size // image.shape[0]
    y, x = np.divmod(made.texels.index[made.stored], made.atlas.size)
    truth, found = made.image[y, x] / fit.unit, image[y // factor, x // factor]
    return float(np.mean((display(truth) - display(found)) ** 2))
