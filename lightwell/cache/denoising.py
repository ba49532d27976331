"""Open Image Denoise on a rendered image, with albedo and normal of the first surface that is not specular."""

from __future__ import annotations

from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.cache.image_state import ImageState
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


def denoised_image(image: ImageState, picture: Any) -> Any:
    """Denoise the colour channels of an image.

    Args:
        image: The image, whose film has a box filter.
        picture: [H, W, C] tensor, C ≥ 3, linear RGB first.

    Returns:
        [H, W, C] tensor.
    """
    check_film(image.sensor)
    albedo, normal = guides(image.scene, image.sensor, image.cache, image.seed)
    numbers = np.array(picture)
    numbers[..., :3] = denoise(numbers[..., :3], albedo, normal)
    out = mi.TensorXf(numbers)
    dr.eval(out)
    return out
