"""Open Image Denoise on a rendered image, with albedo and normal of the first surface that is not specular."""

from __future__ import annotations

from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.cache.radiance_cache import RadianceCache
from lightwell.cache.views import guides
from lightwell.core.denoise import denoise


def check_film(sensor: Any) -> None:
    """Check that the pixels of a film are independent, which the denoiser needs.

    Args:
        sensor: Mitsuba sensor.

    Raises:
        ValueError: The reconstruction filter of the film is not a box filter.
    """
    if not sensor.film().rfilter().is_box_filter():
        raise ValueError("nrc: denoising needs independent pixels; give the film <rfilter type='box'/>")


def denoised_image(scene: Any, sensor: Any, cache: RadianceCache, image: Any, seed: int) -> Any:
    """Denoise the colour channels of an image.

    Args:
        scene: Mitsuba scene.
        sensor: Mitsuba sensor of the image, with a box filter.
        cache: ``RadianceCache`` of the scene, for the material tables.
        image: [H, W, C] tensor, C ≥ 3, linear RGB first.
        seed: Seed of the guide images.

    Returns:
        [H, W, C] tensor.
    """
    check_film(sensor)
    albedo, normal = guides(scene, sensor, cache, seed)
    numbers = np.array(image)
    numbers[..., :3] = denoise(numbers[..., :3], albedo, normal)
    out = mi.TensorXf(numbers)
    dr.eval(out)
    return out
