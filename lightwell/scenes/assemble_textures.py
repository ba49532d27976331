"""Textures of the records as Mitsuba textures.

Mitsuba's bitmaps put v = 0 at the top row, as glTF does, so texture coordinates travel unchanged (the OBJ reader of
Mitsuba flips v because OBJ files count it upwards).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lightwell.backend import mi
from lightwell.core.color import linear
from lightwell.scenes.scene import Image, Texture

# Largest finite half-precision number; brighter textures are stored in single precision.
HALF_MAX = 65504.0


# Linear value of each 8-bit sRGB code, [256] float32.
LINEAR_OF_SRGB8 = linear(np.arange(256) / 255.0).astype(np.float32)


def linear_pixels(image: Image, factor: Sequence[float] = (1.0, 1.0, 1.0)) -> np.ndarray:
    """[height, width, 3] linear colour of an sRGB-encoded picture times ``factor``; half precision if that holds it."""
    table = LINEAR_OF_SRGB8[:, None] * np.float32(factor)
    return _looked_up(table.astype(np.float16 if table.max() <= HALF_MAX else np.float32), image.pixels)


def raw_pixels(image: Image, channels: slice = slice(0, 3), factor: float = 1.0) -> np.ndarray:
    """[height, width, C] half-precision channels of a picture in [0, 1] times ``factor``, no decoding."""
    pixels = image.pixels[..., channels]
    table = np.arange(256, dtype=np.float32) / 255 * factor
    return _looked_up(np.repeat(table[:, None], pixels.shape[2], axis=1).astype(np.float16), pixels)


def _looked_up(table: np.ndarray, codes: np.ndarray) -> np.ndarray:
    """[..., C] entries of ``table`` [256, C] for ``codes`` [..., C or more], channel by channel."""
    return np.stack([table[:, c][codes[..., c]] for c in range(table.shape[1])], axis=-1)


def bitmap(pixels: np.ndarray, texture: Texture, *, nearest: bool | None = None):
    """Mitsuba bitmap texture of linear ``pixels`` [height, width, C], laid out as ``texture`` says."""
    half = pixels.dtype == np.float16 or float(np.abs(pixels).max(initial=0.0)) <= HALF_MAX
    description = {
        "type": "bitmap",
        "bitmap": mi.Bitmap(np.ascontiguousarray(pixels, np.float16 if half else np.float32)),
        "raw": True,
        "filter_type": "nearest" if (texture.nearest if nearest is None else nearest) else "bilinear",
        "wrap_mode": texture.wrap[0],
    }
    if texture.transform is not None:
        description["to_uv"] = mi.ScalarTransform3f(np.asarray(texture.transform, np.float64).tolist())
    return mi.load_dict(description)


class Product(mi.Texture):
    """Product of two textures ``a`` and ``b``: a picture times the vertex colours of its mesh."""

    def __init__(self, props):
        super().__init__(props)
        self.a, self.b = props["a"], props["b"]

    def eval(self, si, active=True):
        return self.a.eval(si, active) * self.b.eval(si, active)

    def eval_1(self, si, active=True):
        return self.a.eval_1(si, active) * self.b.eval_1(si, active)

    def eval_3(self, si, active=True):
        return self.a.eval_3(si, active) * self.b.eval_3(si, active)

    def mean(self):
        return self.a.mean() * self.b.mean()

    def is_spatially_varying(self):
        return True

    def traverse(self, callback):
        callback.put("a", self.a, mi.ParamFlags.Differentiable)
        callback.put("b", self.b, mi.ParamFlags.Differentiable)

    def to_string(self):
        return f"Product[{self.a}, {self.b}]"


mi.register_texture("lightwell_product", Product)
