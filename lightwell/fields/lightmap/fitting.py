"""Fits of a light map: pictures of the light that arrives, and a network that is better than none or left out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from lightwell.core.color import display
from lightwell.fields.baked import Baked
from lightwell.fields.base import FieldSetup, radiance_unit
from lightwell.fields.lightmap.fit import PRESETS, LightmapFit, LightmapPreset
from lightwell.fields.lightmap.nodes import stored
from lightwell.fields.lightmap.trace import Chart, EyeSamples, direction_image, mask_image, reduced
from lightwell.graph.pictures import Fallback, Picture, encode
from lightwell.scenes.atlas import Atlas
from lightwell.scenes.normal_maps import relief
from lightwell.scenes.scene import Scene
from lightwell.transport.samples import Samples

# Edge of the features of a larger atlas, relative to those of one of the usual size.
FINER = 1.5
# Eye samples that judge whether the network is better than none.
HELD = 1 << 13
# Trainings from different starts, of which the best on held-out samples is taken; each has at least so many steps.
STARTS, ENOUGH_STEPS, START_SEED = 3, 800, 0x10001
# Edge of the fallback.
FALLBACK_SIZE = 512
FALLBACK_CODEC = "jpeg90"
# The brightest irradiance of the fallback, as a quantile of all texels: bytes are not spent on a few highlights.
FALLBACK_QUANTILE = 0.999


def fitted(
    scene: Scene,
    made: Chart,
    samples: EyeSamples,
    preset: LightmapPreset,
    seed: int,
    steps: int,
    progress=None,
    folder: Path | None = None,
    size: int | None = None,
) -> LightmapFit:
    """Pictures of the light that arrives, and the trained network; ``size`` of the features' atlas where it differs."""
    size = size or made.atlas.size
    if preset.base and size > preset.size:
        # A larger atlas is for small charts, which share fewer texels of features then; directions stay as they are.
        factor = size // preset.size
        coarser = preset.direction_reduction * factor
        preset = replace(preset, share=FINER * preset.share / factor, direction_reduction=coarser)
    bumpy = bool(relief(scene).any())
    if bumpy and preset.inputs == "mirror" and preset.direction:
        # Where normals are bent, the network reads where the light comes from: leaning towards it is what bumps do.
        preset = replace(preset, inputs="reflected")
    unit = sample_unit(samples)
    base = base_picture(made, unit, preset) if preset.base else None
    direction = direction_picture(made, preset.direction_reduction) if preset.direction else None
    mask = encode(mask_image(made), "webp", made.atlas.mips) if preset.base else None
    setup = FieldSetup.of(scene, unit, "static")
    extra: dict[str, Any] = {"mips": made.atlas.mips, "setup": setup, "mask": mask, "relief": bumpy}
    start = lambda k: LightmapFit(preset, size, unit, base, direction, seed + k * START_SEED, **extra)  # noqa: E731
    if not (preset.base and preset.hidden):
        fit = start(0)
        fit.train(samples.query, samples.radiance, samples.weight, steps, progress, folder)
        return fit
    held = np.random.default_rng([seed, 0x6A7E]).random(len(samples.weight)) < min(HELD / len(samples.weight), 0.1)
    seen, judged = samples[np.flatnonzero(~held)], samples[np.flatnonzero(held & (samples.weight > 0))]
    starts = int(np.clip(steps // ENOUGH_STEPS, 1, STARTS)) if len(judged.weight) else 1
    fits = []
    for k in range(starts):
        fits.append(start(k))
        own = None if folder is None else folder / f"start{k}"
        fits[k].train(seen.query, seen.radiance, seen.weight, steps // starts, progress, own)
    if not len(judged.weight):
        return fits[0]
    plain = replace(fits[0], preset=replace(PRESETS["plain"], base=preset.base), direction=None)
    return min([*fits, plain], key=lambda fit: shown_error(fit, judged))


def shown_error(fit: LightmapFit, samples: EyeSamples) -> float:
    """Mean squared error of what a screen shows, without the noise of the samples."""
    f, a, b = (display(v / fit.unit) for v in (Baked(fit.lower())(samples.query), samples.half_a, samples.half_b))
    return float(np.average(((f - a) * (f - b)).mean(axis=1), weights=samples.weight))


def base_picture(made: Chart, unit: float, preset: LightmapPreset) -> Picture:
    """E' in the curve of a screen."""
    image = reduced(made.image, preset.base_reduction) if preset.base_reduction > 1 else made.image
    mips = max(made.atlas.mips - int(np.log2(preset.base_reduction)), 0)
    return encode(stored(image / unit), preset.base, mips)


def sample_unit(samples: EyeSamples) -> float:
    """S = 4 x the mean radiance."""
    shape = np.zeros(len(samples.weight), np.uint32)
    return radiance_unit(Samples(samples.query, samples.half_a, samples.half_b, samples.weight, shape))


def direction_picture(made: Chart, reduction: int) -> Picture:
    """The dominant direction as bytes, at a lower resolution."""
    small = reduced(direction_image(made), min(reduction, made.atlas.size))
    mips = max(made.atlas.mips - int(np.log2(reduction)), 0)
    return encode(np.floor(127.5 * (np.clip(small, -1, 1) + 1) + 0.5).astype(np.uint8), "webp", mips)


def fallback(made: Chart) -> Fallback:
    """Linear irradiance for viewers that know MOZ_lightmap only."""
    image = made.image
    factor = max(made.atlas.size // FALLBACK_SIZE, 1)
    irradiance = np.pi * reduced(image, factor)
    top = max(float(np.quantile(irradiance, FALLBACK_QUANTILE)), 1e-6)
    texels = np.floor(255 * np.clip(irradiance / top, 0, 1) + 0.5).astype(np.uint8)
    return Fallback(encode(texels, FALLBACK_CODEC), top)


def atlas_facts(atlas: Atlas) -> dict[str, Any]:
    """What the report says of the atlas."""
    return {
        "origin": atlas.origin,
        "size": atlas.size,
        "charts": atlas.charts,
        "coverage": round(atlas.coverage, 4),
        "mips": atlas.mips,
    }


def texel_facts(made: Chart) -> dict[str, Any]:
    """What the report says of the light at the texels."""
    return {
        "texels": len(made.texels.index),
        "texels_without_light": int((~made.stored).sum()),
        "paths_per_texel_noise": float(np.abs(made.light.half_a - made.light.half_b).mean() / 2),
    }
