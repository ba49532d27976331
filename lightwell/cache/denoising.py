"""Open Image Denoise on a rendered picture, guided by albedo and normal of the first surface that is no mirror."""

from __future__ import annotations

from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.cache.views import guides
from lightwell.core.denoise import denoise


def check_film(sensor: Any) -> None:
    """The denoiser wants pixels that do not share samples."""
    if not sensor.film().rfilter().is_box_filter():
        raise ValueError("nrc: denoising needs independent pixels; give the film <rfilter type='box'/>")


def denoised_image(scene: Any, sensor: Any, cache: Any, image: Any, seed: int) -> Any:
    """The picture [H, W, C >= 3] with its colour denoised, as a tensor."""
    check_film(sensor)
    albedo, normal = guides(scene, sensor, cache, seed)
    numbers = np.array(image)
    numbers[..., :3] = denoise(numbers[..., :3], albedo, normal)
    out = mi.TensorXf(numbers)
    dr.eval(out)
    return out
