"""Makes the pictures of a light map whose lamps have switches from the traced light of each.

The pictures of all lamps together are scaled, texel by texel, to the path traced map of all lights: with every dimmer
at 1 a light map with switches is the one without. Notation: T texels, K lamps, R pictures, n texels along an edge.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lightwell.fields.lightmap.curve import stored
from lightwell.fields.lightmap.fit import LightmapPreset
from lightwell.fields.lightmap.lamp_map import LampMap
from lightwell.fields.lightmap.lamp_rank import cells_of, factorised, pictures_of
from lightwell.fields.lightmap.lamp_shares import LampTexels
from lightwell.fields.lightmap.trace import AtlasIrradiance, light_image
from lightwell.graph.pictures import encode

# Share of a picture's mean that every texel has, so that light of which no share was found belongs to somebody.
LEAST = 1e-4


def lamp_map(
    made: AtlasIrradiance,
    lamps: LampTexels,
    names: tuple[str, ...],
    unit: float,
    preset: LightmapPreset,
    say: Callable[[str], None] = lambda text: None,
) -> LampMap:
    """Choose the number of pictures and encode them.

    Args:
        made: Atlas and irradiance of all lamps together.
        lamps: Light of each at the texels.
        names: Their names.
        unit: Radiance unit S.
        preset: Codec.
        say: Prints a line.

    Returns:
        The light of the lamps.
    """
    valid, size = made.stored, made.atlas.size
    found = factorised(*cells_of(made.texels.index[valid], size, lamps.texels[valid]))
    # What is stored of a lamp is relative to the mean of all.
    weights = found.weights * lamps.units[:, None, None]
    texels = pictures_of(lamps.texels, found.weights)
    images = [light_image(made, values=texels[:, r]) for r in range(found.rank)]
    images = [image + LEAST * image.mean(axis=(0, 1)) for image in images]
    total = sum(np.einsum("kc,yxc->yxc", weights[:, r], image) for r, image in enumerate(images))
    scale = made.image / np.maximum(total, 1e-30)
    covered = made.texels.chart >= 0
    mean = max(float(made.image[covered].mean()), 1e-30)
    pictures, units = [], []
    for image in images:
        image = image * scale
        # A picture has the range of the light map of all lamps.
        units.append(unit * max(float(image[covered].mean()), 1e-30) / mean)
        pictures.append(encode(stored(image / units[-1]), preset.base, made.atlas.mips))
    say(_told(names, found.errors, found.rank))
    weights = (weights * np.array(units)[:, None] / unit).astype(np.float32)
    share = lamps.units / lamps.units.sum()
    return LampMap(names, tuple(pictures), weights, share, found.errors)


def _told(names: tuple[str, ...], errors: tuple[float, ...], rank: int) -> str:
    """One line about the pictures."""
    if not max(errors):
        return f"{len(names)} lamps in {rank} pictures, one for each"
    worst = int(np.argmax(errors))
    return f"{len(names)} lamps in {rank} pictures: '{names[worst]}' loses most by it, {errors[worst]:.1%} of its light"
