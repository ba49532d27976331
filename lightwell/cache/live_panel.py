"""The picture of the live page as a JPEG file, and its exposure."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.core.color import SRGB_A, SRGB_GAMMA, SRGB_SLOPE, SRGB_TOE
from lightwell.core.image_io import encoded

JPEG_QUALITY = 88
# Displayed value of the brightest tenth of an image, and share of the way to it that the exposure goes per frame.
BRIGHT, EXPOSED = 0.7, 0.1
# Pictures, the first ones, that it follows at once.
FIRST = 8
# The exposure looks at one pixel of so many.
SAMPLED = 7


def _codes(linear: mi.Float) -> Any:
    """sRGB codes 0 to 255 as bytes on the device; what is not finite is black."""
    x = dr.clip(dr.select(dr.isfinite(linear), linear, 0), 0, 1)
    curve = (1 + SRGB_A) * dr.power(dr.maximum(x, SRGB_TOE), 1 / SRGB_GAMMA) - SRGB_A
    return dr.uint8_array_t(mi.Float)(dr.select(x <= SRGB_TOE, SRGB_SLOPE * x, curve) * 255 + 0.5)


class LivePanel:
    """The picture of the page as a JPEG file, and its exposure."""

    def __init__(self, size: int) -> None:
        """Start without a picture.

        Args:
            size: Edge of the square picture, pixels.
        """
        self._size = size
        self._jpeg = b""
        self.exposure = 1.0
        """Factor on radiance."""
        self.number = 0
        """Pictures so far."""
        self._lock = threading.Lock()

    def publish(self, image: mi.Float, metered: bool = True) -> None:
        """Encode a picture for the page; the exposure follows it slowly.

        Args:
            image: [3 N] radiance on the device.
            metered: Whether the exposure follows it.
        """
        if metered:
            lane = dr.arange(mi.UInt32, self._size**2 // SAMPLED) * SAMPLED
            sample = np.array(dr.gather(mi.Color3f, image, lane)).mean(axis=0)
            lit = sample[np.isfinite(sample) & (sample > 0)]
            wanted = BRIGHT / float(np.percentile(lit, 90)) if len(lit) else self.exposure
            follows = EXPOSED if self.number >= FIRST else 1.0
            self.exposure += follows * (wanted - self.exposure)
        codes = _codes(image * dr.opaque(mi.Float, self.exposure))
        picture = np.array(codes).reshape(self._size, self._size, 3)
        made = encoded(picture, "JPEG", quality=JPEG_QUALITY)
        with self._lock:
            self._jpeg, self.number = made, self.number + 1

    def jpeg(self) -> bytes:
        """Return the encoded picture; may be called from any thread.

        Returns:
            JPEG file; empty before the first picture.
        """
        with self._lock:
            return self._jpeg
