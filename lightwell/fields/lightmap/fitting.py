"""Fits of a light map: the picture of the irradiance, and a network that is kept only where it lowers the error."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lightwell.core.color import display
from lightwell.core.work import WorkPart
from lightwell.fields.baked import Baked
from lightwell.fields.base import FieldSetup, radiance_unit
from lightwell.fields.lightmap.curve import stored
from lightwell.fields.lightmap.fit import PRESETS, LightmapFit, LightmapPreset
from lightwell.fields.lightmap.lamp_map import LampMap
from lightwell.fields.lightmap.trace import AtlasIrradiance, direction_image, mask_image, reduced
from lightwell.fields.lightmap.views import ViewSamples, plain_samples
from lightwell.graph.pictures import Fallback, Picture, encode
from lightwell.scenes.atlas import Atlas
from lightwell.scenes.normal_maps import relief
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable
from lightwell.transport.lightmap_query import LightmapQuery
from lightwell.transport.samples import Samples

# Edge of the features of a larger atlas, relative to those of one of the usual size.
FINER = 1.5
# Trainings from different starts, and the distance of their seeds.
STARTS, START_SEED = 3, 0x10001
# Samples per place where the network is held to what arrives evenly, and the weight of such a place.
PRIOR_SHARE, PRIOR_WEIGHT = 8, 0.05
# Edge of the fallback.
FALLBACK_SIZE = 512
FALLBACK_CODEC = "jpeg90"
# The brightest irradiance of the fallback, as a quantile of all texels: bytes are not spent on a few highlights.
FALLBACK_QUANTILE = 0.999


@dataclass(frozen=True)
class Starts:
    """Trainings from different starts, of which the best on held-out samples is taken."""

    most: int = STARTS
    """Number of trainings, at most."""
    enough_steps: int = 800
    """Least steps of each."""
    held: int = 1 << 13
    """Held-out samples, at most."""
    error: Callable[[LightmapFit, ViewSamples], float] | None = None
    """Error on held-out samples, also by which the network is left out; None: ``shown_error``."""


def fitted(
    scene: Scene,
    made: AtlasIrradiance,
    samples: ViewSamples,
    preset: LightmapPreset,
    seed: int,
    steps: int,
    progress: Callable[[int], None] | None = None,
    part: WorkPart | None = None,
    size: int | None = None,
    starts: Starts | None = None,
    lamps: Callable[[float, LightmapPreset], LampMap] | None = None,
) -> LightmapFit:
    """Encode the irradiance as a picture and train the network.

    Args:
        scene: The scene.
        made: Atlas and irradiance.
        samples: N samples of radiance towards views.
        preset: Settings.
        seed: Seed of the weights.
        steps: Number of training steps.
        progress: Called with the number of the step, every 50 steps.
        part: Part of the bake that stores checkpoints; None: the training cannot be resumed.
        size: Texels along the edge of the features' atlas; None: as ``made``.
        starts: How many trainings are compared, and by what; None: the defaults.
        lamps: Makes the light of groups of lamps, given unit and settings; None: it cannot be changed.

    Returns:
        The fit.
    """
    size = size or made.atlas.size
    if preset.base and size > preset.size:
        # A larger atlas is for small charts, which share fewer texels of features then; directions stay as they are.
        factor = size // preset.size
        coarser = preset.direction_reduction * factor
        preset = replace(preset, share=FINER * preset.share / factor, direction_reduction=coarser)
    bumpy = bool(relief(scene).any())
    if bumpy and preset.inputs == "mirror" and preset.direction:
        # With normal maps, the network needs the direction of the light: bumps lean towards it or away from it.
        preset = replace(preset, inputs="reflected")
    unit = sample_unit(samples)
    base = base_picture(made, unit, preset) if preset.base else None
    direction = direction_picture(made, preset.direction_reduction, preset.codec) if preset.direction else None
    mask = encode(mask_image(made), preset.codec, made.atlas.mips) if preset.base else None
    setup = FieldSetup.of(scene, unit, "static")
    extra: dict[str, Any] = {"mips": made.atlas.mips, "setup": setup, "mask": mask, "relief": bumpy}
    extra["lamps"] = lamps and lamps(unit, preset)
    start = lambda k: LightmapFit(preset, size, unit, base, direction, seed + k * START_SEED, **extra)  # noqa: E731
    if not (preset.base and preset.hidden):
        fit = start(0)
        fit.train(samples.query, samples.radiance, samples.weight, steps, progress, part)
        return fit
    places = plain_samples(scene, made, len(samples.weight) // PRIOR_SHARE + 1, seed)
    return _best_start(start, samples, places, seed, steps, progress, part, starts or Starts())


def _best_start(
    start: Callable[[int], LightmapFit],
    samples: ViewSamples,
    places: LightmapQuery,
    seed: int,
    steps: int,
    progress: Callable[[int], None] | None,
    part: WorkPart | None,
    choice: Starts,
) -> LightmapFit:
    """The best of several trainings, and of no network, on held-out samples."""
    held = np.random.default_rng([seed, 0x6A7E]).random(len(samples.weight)) < min(
        choice.held / len(samples.weight), 0.1
    )
    seen, judged = samples[np.flatnonzero(~held)], samples[np.flatnonzero(held & (samples.weight > 0))]
    starts = int(np.clip(steps // choice.enough_steps, 1, choice.most)) if len(judged.weight) else 1
    if seen.shares is None:
        # Texels that no sample reaches would otherwise show what the network happens to make of them.
        even = start(0).without_network(places)
        seen = seen + ViewSamples(places, even, even, np.full(len(even), PRIOR_WEIGHT, np.float32))
    fits = []
    for k in range(starts):
        fits.append(start(k))
        own = part and part.part(start=k)
        fits[k].train(seen.query, seen.radiance, seen.weight, steps // starts, progress, own, seen.shares)
    if not len(judged.weight):
        return fits[0]
    codecs = {"base": fits[0].preset.base, "codec": fits[0].preset.codec}
    plain = replace(fits[0], preset=replace(PRESETS["plain"], **codecs), direction=None)
    error = choice.error or shown_error
    return min([*fits, plain], key=lambda fit: error(fit, judged))


def shown_error(fit: LightmapFit, samples: ViewSamples) -> float:
    """Compute the mean squared error after the transfer function of a display, without the noise of the samples.

    Args:
        fit: The fit.
        samples: N samples.

    Returns:
        The error; display values are in [0, 1].
    """
    shown = Baked(fit.lower(), fit.frame)(samples.query)
    f, a, b = (display(v / fit.unit) for v in (shown, samples.half_a, samples.half_b))
    return float(np.average(((f - a) * (f - b)).mean(axis=1), weights=samples.weight))


def base_picture(made: AtlasIrradiance, unit: float, preset: LightmapPreset) -> Picture:
    """Encode irradiance / π with an sRGB-like transfer function.

    Args:
        made: Atlas and irradiance.
        unit: Radiance unit S.
        preset: Codec and reduction.

    Returns:
        The picture.
    """
    image = reduced(made.image, preset.base_reduction) if preset.base_reduction > 1 else made.image
    mips = max(made.atlas.mips - int(np.log2(preset.base_reduction)), 0)
    return encode(stored(image / unit), preset.base, mips)


def sample_unit(samples: ViewSamples, variable: Variable | None = None) -> float:
    """Compute the radiance unit S, 4 × the mean radiance.

    Args:
        samples: N samples.
        variable: The declared light that they are of, for the message; None: the scene's own.

    Returns:
        S.
    """
    shape = np.zeros(len(samples.weight), np.uint32)
    return radiance_unit(Samples(samples.query, samples.half_a, samples.half_b, samples.weight, shape), variable)


def direction_picture(made: AtlasIrradiance, reduction: int, codec: str = "webp") -> Picture:
    """Encode the dominant direction of the light as bytes, at a lower resolution.

    Args:
        made: Atlas and irradiance.
        reduction: Texels of the atlas per texel of the picture along an edge, ≥ 1.
        codec: Codec of the picture.

    Returns:
        The picture.
    """
    small = reduced(direction_image(made), min(reduction, made.atlas.size))
    mips = max(made.atlas.mips - int(np.log2(reduction)), 0)
    return encode(np.floor(127.5 * (np.clip(small, -1, 1) + 1) + 0.5).astype(np.uint8), codec, mips)


def fallback(made: AtlasIrradiance) -> Fallback:
    """Encode linear irradiance for viewers that only support MOZ_lightmap.

    Args:
        made: Atlas and irradiance.

    Returns:
        Picture and its greatest value.
    """
    image = made.image
    factor = max(made.atlas.size // FALLBACK_SIZE, 1)
    irradiance = np.pi * reduced(image, factor)
    top = max(float(np.quantile(irradiance, FALLBACK_QUANTILE)), 1e-6)
    texels = np.floor(255 * np.clip(irradiance / top, 0, 1) + 0.5).astype(np.uint8)
    return Fallback(encode(texels, FALLBACK_CODEC), top)


def atlas_facts(atlas: Atlas) -> dict[str, Any]:
    """Summarise the atlas for the report.

    Args:
        atlas: The atlas.

    Returns:
        JSON values.
    """
    return {
        "origin": atlas.origin,
        "size": atlas.size,
        "charts": atlas.charts,
        "coverage": round(atlas.coverage, 4),
        "mips": atlas.mips,
    }


def texel_facts(made: AtlasIrradiance) -> dict[str, Any]:
    """Summarise the irradiance at the texels for the report.

    Args:
        made: Atlas and irradiance.

    Returns:
        JSON values.
    """
    return {
        "texels": len(made.texels.index),
        "texels_without_light": int((~made.stored).sum()),
        "paths_per_texel_noise": float(np.abs(made.light.half_a - made.light.half_b).mean() / 2),
    }
