"""Open Image Denoise on a rendered picture, guided by albedo and normal of the first surface that is no mirror."""

from __future__ import annotations

from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.cache.views import guides


def check_film(sensor: Any) -> None:
    """The denoiser wants pixels that do not share samples."""
    if not sensor.film().rfilter().is_box_filter():
        raise ValueError("nrc: denoising needs independent pixels; give the film <rfilter type='box'/>")


def denoised(color: np.ndarray, albedo: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """[H, W, 3] linear colour, albedo in [0, 1], normals in [-1, 1] to the denoised colour."""
    try:
        import mitsuba_oidn as oidn
    except ImportError:
        raise ValueError("nrc: denoise needs Open Image Denoise; run: pip install 'lightwell[denoise]'") from None
    as_tensor = lambda a: mi.TensorXf(np.ascontiguousarray(a, np.float32))  # noqa: E731
    out = oidn.denoise(as_tensor(color), albedo=as_tensor(albedo), normal=as_tensor(normal), hdr=True)
    return np.array(out, np.float32)


def denoised_image(scene: Any, sensor: Any, cache: Any, image: Any, seed: int) -> Any:
    """The picture [H, W, C >= 3] with its colour denoised, as a tensor."""
    check_film(sensor)
    albedo, normal = guides(scene, sensor, cache, seed)
    numbers = np.array(image)
    numbers[..., :3] = denoised(numbers[..., :3], albedo, normal)
    out = mi.TensorXf(numbers)
    dr.eval(out)
    return out
