"""Open Image Denoise on a rendered image, with albedo and normal of the first surface that is not specular, and blended
with the view of the cache."""

from __future__ import annotations

from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.cache.denoise_blend import NoisyHalves, blended, cache_weight
from lightwell.cache.image_state import ImageState
from lightwell.cache.temporal import TemporalHistory, film_of, first_surfaces
from lightwell.cache.views import GUIDE_SPP, guides, view
from lightwell.core.denoise import clean_guide_images, denoise


def check_film(sensor: Any) -> None:
    """Check that the pixels of a film are independent, which the denoiser needs.

    Args:
        sensor: Mitsuba sensor.

    Raises:
        ValueError: The reconstruction filter of the film is not a box filter.
    """
    if not sensor.film().rfilter().is_box_filter():
        raise ValueError("nrc: denoising needs independent pixels; give the film <rfilter type='box'/>")


def denoised_image(image: ImageState, picture: Any, history: TemporalHistory) -> Any:
    """Denoise the colour channels of an image.

    Args:
        image: The image, whose film has a box filter.
        picture: [H, W, C] tensor, C ≥ 3, linear RGB first.
        history: Denoised frames before it, which frames are averaged with.

    Returns:
        [H, W, C] tensor.
    """
    check_film(image.sensor)
    albedo, normal = guides(image.scene, image.sensor, image.cache, image.seed)
    numbers = np.array(picture)
    if image.rendered.half is None:
        numbers[..., :3] = denoise(numbers[..., :3], albedo, normal)
    else:
        numbers[..., :3] = _with_cache(image, numbers[..., :3], albedo, normal)
    if history.most > 1 and not image.still and (film := film_of(image.sensor)) is not None:
        if any(stats.changed for stats in image.stats):
            history.forget()
        surfaces = first_surfaces(image.scene, image.sensor, albedo)
        numbers[..., :3] = history.accumulate(numbers[..., :3], surfaces, film)
    out = mi.TensorXf(numbers)
    dr.eval(out)
    return out


def _with_cache(image: ImageState, picture: np.ndarray, albedo: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Denoise the colours [H, W, 3], and blend them with the view of the cache where that is nearer to the truth."""
    assert image.rendered.half is not None
    albedo, normal = clean_guide_images(albedo, normal)
    halves = NoisyHalves.of(picture, *image.rendered.half)
    whole, a, b = (denoise(x, albedo, normal, clean_guides=True) for x in (picture, halves.a, halves.b))
    cached = view(image.scene, image.sensor, image.cache, "cache", GUIDE_SPP, image.seed)
    weight = cache_weight(halves, NoisyHalves(a, b), cached, albedo)
    image.rendered.cache_share = float(weight.mean())
    return blended(whole, cached, weight)
