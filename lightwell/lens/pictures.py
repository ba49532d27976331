"""Pictures that Pillow has opened, in modes whose values are no levels."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from PIL.Image import Image


def levels(image: Image) -> Image:
    """Replace the indices of a palette, and single bits, by levels; other modes hold levels already.

    Args:
        image: Picture in any mode.

    Returns:
        Picture whose values are levels.
    """
    return image.convert("RGB") if image.mode in ("P", "PA", "1") else image
