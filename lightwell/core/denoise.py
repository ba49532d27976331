"""Open Image Denoise: the only module that imports it.

It is a default dependency where wheels exist (pyproject.toml names the platforms). Elsewhere pictures and light maps
keep their noise, and every bake says so.
"""

from __future__ import annotations

import importlib.util
from functools import partial
from typing import Any, Literal

import numpy as np

# Filters of Open Image Denoise: for rendered pictures, and the one that was trained on light maps.
Filter = Literal["RT", "RTLightmap"]

MISSING = (
    "Open Image Denoise is not installed (there is no wheel of mitsuba-oidn for this platform, or it was removed): "
    "reference pictures and light maps keep their noise; run 'pip install mitsuba-oidn', or bake on Linux, "
    "macOS (arm64) or Windows (x86-64)"
)


def missing() -> str | None:
    """Return why the denoiser cannot be used.

    Returns:
        One line that says that it is not installed and how to install it; None when it is installed.
    """
    return None if importlib.util.find_spec("mitsuba_oidn") else MISSING


def denoise(
    color: np.ndarray,
    albedo: np.ndarray | None = None,
    normal: np.ndarray | None = None,
    *,
    filter: Filter = "RT",
    clean_guides: bool = False,
) -> np.ndarray:
    """Remove the noise of a path-traced picture or light map.

    Args:
        color: [H, W, 3] linear radiance, any non-negative range.
        albedo: [H, W, 3] reflectance of the first surfaces in [0, 1], or None.
        normal: [H, W, 3] unit normals of the first surfaces in [-1, 1], or None; needs ``albedo``.
        filter: "RT" for pictures, "RTLightmap" for light maps.
        clean_guides: Whether albedo and normal have no noise, such as those of ``clean_guide_images``.

    Returns:
        [H, W, 3] float32, non-negative. Pixels for which the denoiser has no finite value keep theirs.

    Raises:
        ValueError: Open Image Denoise is not installed; call ``missing`` first where it is optional.
    """
    try:
        import mitsuba_oidn as oidn
    except ImportError:
        raise ValueError(f"denoise: {MISSING}") from None
    as_image = partial(np.ascontiguousarray, dtype=np.float32)
    noisy = as_image(color)
    # Open Image Denoise takes what is below about 1e-8 for black: the light of 1 cd in a scene of kilometres is.
    mean = float(np.nan_to_num(noisy, posinf=0, neginf=0).mean(dtype=np.float64))
    scale = np.float32(1 / mean) if mean > 0 else np.float32(1)
    guides = {name: as_image(image) for name, image in (("albedo", albedo), ("normal", normal)) if image is not None}
    settings = {"clean_aux": True} if clean_guides else {}
    clean = np.asarray(oidn.denoise(noisy * scale, hdr=True, filter=filter, **settings, **guides), np.float32) / scale
    return np.where(np.isfinite(clean).all(axis=-1, keepdims=True), np.maximum(clean, 0), noisy)


def denoise_fast(color: Any, albedo: Any, normal: Any, scale: float) -> Any:
    """Remove the noise of a picture that is shown for a moment: less well than ``denoise``, in an eighth of its time.

    Args:
        color: [H, W, 3] Dr.Jit tensor, linear radiance ≥ 0, finite.
        albedo: [H, W, 3] tensor, reflectance in [0, 1] without noise.
        normal: [H, W, 3] tensor, normals in [-1, 1] without noise.
        scale: What makes the radiance about 1.

    Returns:
        [H, W, 3] tensor.

    Raises:
        ValueError: Open Image Denoise is not installed; call ``missing`` first.
    """
    from lightwell.backend import dr

    try:
        import mitsuba_oidn as oidn
    except ImportError:
        raise ValueError(f"denoise: {MISSING}") from None
    factor = dr.opaque(type(color.array), scale)
    images = (color * factor, albedo, normal)
    dr.eval(images)
    dr.sync_thread()
    guides = {"albedo": images[1], "normal": images[2]}
    clean = oidn.denoise(images[0], hdr=True, clean_aux=True, quality=oidn.Quality.Fast, **guides)
    return clean / factor


def clean_guide_images(albedo: np.ndarray, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Remove the noise of guide images, each by itself, so that the denoiser can keep their edges as they are.

    Args:
        albedo: [H, W, 3] reflectance in [0, 1].
        normal: [H, W, 3] normals in [-1, 1].

    Returns:
        Albedo in [0, 1] and normals in [-1, 1], both [H, W, 3] float32.
    """
    return np.clip(denoise(albedo), 0, 1), np.clip(2 * denoise((normal + 1) / 2) - 1, -1, 1)
