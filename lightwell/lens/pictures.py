"""Pictures that Pillow has opened, in modes whose conversion by Pillow would lose what the lens needs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from PIL.Image import Image

# Largest value of 16-bit grey over that of 8-bit grey.
SIXTEEN_OVER_EIGHT = 257


def eight_bits(image: Image) -> Image:
    """Scale 16-bit grey to 8 bits; Pillow's own conversion cuts it off at 255, which is almost black.

    Args:
        image: Picture in any mode.

    Returns:
        The same picture; grey of 8 bits instead of 16.
    """
    from PIL import Image as pillow

    if image.mode != "I" and not image.mode.startswith("I;16"):
        return image
    grey = np.clip(np.rint(np.asarray(image, np.float64) / SIXTEEN_OVER_EIGHT), 0, 255)
    return pillow.fromarray(grey.astype(np.uint8))


def levels(image: Image) -> Image:
    """Replace the indices of a palette, and single bits, by levels; other modes hold levels already.

    Args:
        image: Picture in any mode.

    Returns:
        Picture whose values are levels.
    """
    return image.convert("RGB") if image.mode in ("P", "PA", "1") else image
