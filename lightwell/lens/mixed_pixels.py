"""Antialiased edges: pixels that hold light of two surfaces although their depth is that of one.

Where a front surface ends, a pixel's colour is C = α F + (1 − α) B. F and B are taken from the pixels around that hold
one surface alone, α is the projection of C − B on F − B, and the light of the pixel is divided between the two layers
so that none is lost. A line too thin to have a pixel of its own gives as F the colour farthest from B.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_dilation, binary_erosion, convolve, distance_transform_edt

# Half the side of the windows in which colours of one surface are looked for, pixels.
WINDOW = 3
# Squared distance of F and B, relative to their squared mean, below which a pixel is not divided.
LEAST_CONTRAST = 0.01
NEIGHBOURS = np.ones((3, 3), bool)


@dataclass(frozen=True)
class Divided:
    """A picture divided by one cut of the circle of confusion."""

    mixed: np.ndarray
    """[height, width] bool: pixels that were divided."""
    share: np.ndarray
    """[height, width] coverage of the front at mixed pixels."""
    light: np.ndarray
    """[height, width, 4] premultiplied light of the front at mixed pixels; the rest of the pixel belongs behind."""
    front: np.ndarray
    """[height, width] s of the nearest surface in front."""
    back: np.ndarray
    """[height, width] s of the nearest surface behind."""


def divide(rgba: np.ndarray, s: np.ndarray, cut: float) -> Divided | None:
    """Divide the pixels at the edges of what lies in front of a cut.

    Args:
        rgba: Light [height, width, 4], premultiplied.
        s: Signed circle of confusion [height, width], pixels.
        cut: Value of s between front and back.

    Returns:
        The division; None where nothing lies on one of the sides.
    """
    front = s < cut
    if not front.any() or front.all():
        return None
    # Mixed are at most the pixels on both sides of the edge.
    edge = binary_dilation(front, NEIGHBOURS) & binary_dilation(~front, NEIGHBOURS)
    inside, behind = (side & ~edge for side in (front, ~front))
    background, known = _mean(rgba, behind)
    # Lines without a pixel of their own: what is least like the background around them.
    thin = front & ~binary_dilation(binary_erosion(front, NEIGHBOURS), NEIGHBOURS, iterations=2)
    foreground, own = _mean(rgba, inside)
    extreme = _farthest(rgba, front, background)
    use = thin | ~own
    foreground = np.where(use[..., None], extreme, foreground)
    apart = foreground - background
    contrast = np.square(apart[..., :3]).sum(-1)
    level = np.square(foreground[..., :3] + background[..., :3]).sum(-1) / 4
    mixed = edge & known & (contrast > LEAST_CONTRAST * np.maximum(level, 1e-12))
    share = ((rgba - background)[..., :3] * apart[..., :3]).sum(-1) / np.maximum(contrast, 1e-20)
    share = np.clip(share, 0, 1)
    light = np.clip(rgba - (1 - share)[..., None] * background, 0, rgba)
    light[..., 3] = share * rgba[..., 3]
    places = [distance_transform_edt(~side, return_distances=False, return_indices=True) for side in (front, ~front)]
    near, far = (s[place[0], place[1]] for place in places)
    return Divided(mixed, share.astype(np.float32), light.astype(np.float32), near, far)


def _mean(rgba: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean of the masked pixels in a window around each pixel [height, width, 4], and whether there are any."""
    kernel = np.ones((2 * WINDOW + 1,) * 2, np.float32)
    count = convolve(mask.astype(np.float32), kernel, mode="constant")
    planes = (np.where(mask, plane, 0).astype(np.float32) for plane in np.moveaxis(rgba, -1, 0))
    sums = [convolve(plane, kernel, mode="constant") for plane in planes]
    return np.stack(sums, -1) / np.maximum(count, 1)[..., None], count > 0.5


def _farthest(rgba: np.ndarray, mask: np.ndarray, background: np.ndarray) -> np.ndarray:
    """[height, width, 4] of the masked pixels within one pixel, the colour least like the background."""
    height, width = mask.shape
    padded, held = np.pad(rgba, ((1, 1), (1, 1), (0, 0))), np.pad(mask, 1)
    best, chosen = np.full((height, width), -1.0), background.copy()
    for dy in range(3):
        for dx in range(3):
            colour, there = padded[dy : dy + height, dx : dx + width], held[dy : dy + height, dx : dx + width]
            far = np.where(there, np.square((colour - background)[..., :3]).sum(-1), -1.0)
            better = far > best
            best = np.where(better, far, best)
            chosen = np.where(better[..., None], colour, chosen)
    return chosen
