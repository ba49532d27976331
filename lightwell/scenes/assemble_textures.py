"""Textures of the records as Mitsuba textures.

Mitsuba's bitmaps put v = 0 at the top row, as glTF does, so texture coordinates are passed unchanged (Mitsuba's OBJ
reader flips v because OBJ files count it upwards).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from lightwell.backend import dr, mi
from lightwell.core.color import linear
from lightwell.scenes.scene import Image, Texture

# Largest finite half-precision number; brighter textures are stored in single precision.
HALF_MAX = 65504.0


# Linear value of each 8-bit sRGB code, [256] float32.
LINEAR_OF_SRGB8 = linear(np.arange(256) / 255.0).astype(np.float32)


def linear_pixels(image: Image, factor: ArrayLike = (1.0, 1.0, 1.0)) -> np.ndarray:
    """Decode an sRGB image to linear colour, times a factor.

    Args:
        image: Encoded image.
        factor: Factor of each channel, ≥ 0.

    Returns:
        [height, width, 3] linear colour; half precision if its range suffices, else float32.
    """
    table = LINEAR_OF_SRGB8[:, None] * np.array(factor, np.float32)
    return _looked_up(table.astype(np.float16 if table.max() <= HALF_MAX else np.float32), image.pixels)


def raw_pixels(image: Image, channels: slice = slice(0, 3), factor: float = 1.0) -> np.ndarray:
    """Read channels of an image without sRGB decoding, times a factor.

    Args:
        image: Encoded image.
        channels: Channels to read.
        factor: Factor of the values.

    Returns:
        [height, width, C] half precision, in [0, factor].
    """
    pixels = image.pixels[..., channels]
    table = np.arange(256, dtype=np.float32) / 255 * factor
    return _looked_up(np.repeat(table[:, None], pixels.shape[2], axis=1).astype(np.float16), pixels)


def _looked_up(table: np.ndarray, codes: np.ndarray) -> np.ndarray:
    """Look up ``codes`` [..., C or more] in ``table`` [256, C], channel by channel; returns [..., C]."""
    return np.stack([table[:, c][codes[..., c]] for c in range(table.shape[1])], axis=-1)


def bitmap(pixels: np.ndarray, texture: Texture, *, nearest: bool | None = None) -> Any:
    """Make a Mitsuba bitmap texture.

    Args:
        pixels: [height, width, C] linear values.
        texture: Record with wrap mode, filter and transform.
        nearest: Nearest filter; None: that of the record.

    Returns:
        The Mitsuba texture.
    """
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


class Combined(mi.Texture):
    """A texture that is computed from others."""

    def is_spatially_varying(self) -> bool:
        """Tell Mitsuba that the value depends on the position.

        Returns:
            True.
        """
        return True


class Product(Combined):
    """Product of two textures ``a`` and ``b``: an image times the vertex colours of its mesh."""

    def __init__(self, props: Any) -> None:
        """Read the factors.

        Args:
            props: Mitsuba properties with ``a`` and ``b``.
        """
        super().__init__(props)
        self.a, self.b = props["a"], props["b"]

    def eval(self, si: Any, active: Any = True) -> Any:
        """Evaluate the product, as ``mi.Texture.eval``.

        Args:
            si: Surface interactions.
            active: Active lanes.

        Returns:
            Spectrum.
        """
        return self.a.eval(si, active) * self.b.eval(si, active)

    def eval_1(self, si: Any, active: Any = True) -> Any:
        """Evaluate the product of single-channel values.

        Args:
            si: Surface interactions.
            active: Active lanes.

        Returns:
            One number per lane.
        """
        return self.a.eval_1(si, active) * self.b.eval_1(si, active)

    def eval_3(self, si: Any, active: Any = True) -> Any:
        """Evaluate the product of three-channel values.

        Args:
            si: Surface interactions.
            active: Active lanes.

        Returns:
            Colour per lane.
        """
        return self.a.eval_3(si, active) * self.b.eval_3(si, active)

    def mean(self) -> Any:
        """Multiply the means of both factors, an approximation of the mean.

        Returns:
            One number.
        """
        return self.a.mean() * self.b.mean()

    def traverse(self, callback: Any) -> None:
        """List the parameters, as ``mi.Object.traverse``.

        Args:
            callback: Receives the parameters.
        """
        callback.put("a", self.a, mi.ParamFlags.Differentiable)
        callback.put("b", self.b, mi.ParamFlags.Differentiable)

    def to_string(self) -> str:
        """Describe the texture.

        Returns:
            Its name and factors.
        """
        return f"Product[{self.a}, {self.b}]"


mi.register_texture("lightwell_product", Product)


class Cutoff(Combined):
    """1 where a texture ``a`` of one channel is at least ``cutoff``, else 0: an alpha mask."""

    def __init__(self, props: Any) -> None:
        """Read the texture and the threshold.

        Args:
            props: Mitsuba properties with ``a`` and ``cutoff``.
        """
        super().__init__(props)
        self.a, self.cutoff = props["a"], float(props["cutoff"])

    def eval(self, si: Any, active: Any = True) -> Any:
        """Evaluate the mask as a grey spectrum, as ``mi.Texture.eval``.

        Args:
            si: Surface interactions.
            active: Active lanes.

        Returns:
            Spectrum of 0 or 1.
        """
        return mi.Spectrum(self.eval_1(si, active))

    def eval_1(self, si: Any, active: Any = True) -> Any:
        """Evaluate the mask.

        Args:
            si: Surface interactions.
            active: Active lanes.

        Returns:
            0 or 1 per lane.
        """
        return dr.select(self.a.eval_1(si, active) >= self.cutoff, mi.Float(1), mi.Float(0))

    def mean(self) -> Any:
        """Compare the mean of the texture with the threshold, an approximation of the mean.

        Returns:
            One number.
        """
        return dr.select(self.a.mean() >= self.cutoff, 1.0, 0.0)

    def traverse(self, callback: Any) -> None:
        """List the parameters, as ``mi.Object.traverse``.

        Args:
            callback: Receives the parameters.
        """
        callback.put("a", self.a, mi.ParamFlags.Differentiable)

    def to_string(self) -> str:
        """Describe the texture.

        Returns:
            Its name, texture and threshold.
        """
        return f"Cutoff[{self.a}, {self.cutoff}]"


mi.register_texture("lightwell_cutoff", Cutoff)
