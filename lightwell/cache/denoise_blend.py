"""Blends a denoised image with the view of the radiance cache, pixel by pixel, where the cache is nearer to the truth.

Notation: T the image without noise; A, B independent noisy halves of the samples of an image; D the denoised image, DA
and DB the denoised halves, M their mean; C the view of the cache, independent of A and B; w its weight. The w that
minimises E[(M + w (C − M) − T)²] around a pixel is

    w = E[(M − T) (M − C)] / E[(M − C)²].

T is not known, but half B estimates it independently of DA and C, and half A of DB and C, so that

    E[(M − T) (M − C)] = ½ E[(M − B) (DA − C) + (M − A) (DB − C)]

holds without bias, whatever the errors of the denoiser and of the cache are: this sees the bias of the cache, which its
variance does not show. All images are divided by the albedo of the first surface, so that a texture does not set the
weight.

References: Rousselle et al. 2012, *Adaptive rendering with non-local means filtering* (two buffers); Zheng et al. 2021,
*Ensemble denoising for Monte Carlo renderings* (weights from two buffers).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter

# Standard deviation of the window in which a weight is estimated, pixels.
WINDOW = 5.0
# Standard errors by which the cache has to be better: where the halves do not show it, the denoised image stays.
STANDARD_ERRORS = 2.0
# Added to the albedo before the division; errors are relative to the light plus this share of its mean.
LEAST_ALBEDO, LEAST_LIGHT = 0.05, 0.1


@dataclass(frozen=True)
class NoisyHalves:
    """Two images of independent samples."""

    a: np.ndarray
    """[H, W, 3] linear radiance."""
    b: np.ndarray
    """[H, W, 3] linear radiance."""

    @staticmethod
    def of(whole: np.ndarray, half: np.ndarray, share: float) -> NoisyHalves:
        """Split an image into the half that was kept, and the rest.

        Args:
            whole: [H, W, 3] mean of all samples.
            half: [H, W, 3] mean of some of them.
            share: Share of the samples in ``half``, in (0, 1).

        Returns:
            Both halves.
        """
        return NoisyHalves(half, (whole - share * half) / (1 - share))


def cache_weight(halves: NoisyHalves, denoised: NoisyHalves, cached: np.ndarray, albedo: np.ndarray) -> np.ndarray:
    """Estimate the weight of the cache's view.

    Args:
        halves: A and B.
        denoised: DA and DB.
        cached: [H, W, 3] C.
        albedo: [H, W, 3] albedo of the first surface, in [0, 1].

    Returns:
        [H, W] weight in [0, 1].
    """
    white = np.maximum(albedo, 0) + LEAST_ALBEDO
    a, b, da, db, c = (image / white for image in (halves.a, halves.b, denoised.a, denoised.b, cached))
    m = (da + db) / 2
    light = _around(m.mean(axis=2))
    scale = 1 / (light**2 + (LEAST_LIGHT * light.mean()) ** 2 + np.finfo(np.float32).tiny)
    gain = scale * ((m - b) * (da - c) + (m - a) * (db - c)).sum(axis=2) / 2
    apart = scale * ((m - c) ** 2).sum(axis=2)
    mean = _around(gain)
    # Of independent pixels: a Gaussian window counts as 4 π σ² of them.
    variance = np.maximum(_around(gain**2) - mean**2, 0) / (4 * np.pi * WINDOW**2)
    sure = mean - STANDARD_ERRORS * np.sqrt(variance)
    weight = sure / np.maximum(_around(apart), np.finfo(np.float32).tiny)
    return np.clip(np.nan_to_num(weight), 0, 1).astype(np.float32)


def blended(whole: np.ndarray, cached: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Blend the denoised image with the cache's view.

    Args:
        whole: [H, W, 3] D.
        cached: [H, W, 3] C.
        weight: [H, W] weight of C.

    Returns:
        [H, W, 3] image.
    """
    return np.where(np.isfinite(cached), whole + weight[..., None] * (cached - whole), whole)


def _around(image: np.ndarray) -> np.ndarray:
    """Means in a Gaussian window around each pixel [H, W]."""
    return gaussian_filter(image.astype(np.float64), WINDOW, mode="reflect")
