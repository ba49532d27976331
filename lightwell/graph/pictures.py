"""Pictures as buffers: [H, W, 3] bytes of a graph as PNG, WebP or JPEG (format/LIGHTMAP.md)."""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import Literal

import numpy as np
from PIL import Image

from lightwell.graph.buffers import Buffer

# A byte stands for its share of 255, as in a texture of a GPU.
BYTE = np.float32(1 / 255)
FORMATS = ("PNG", "WEBP", "JPEG")
# WebP's slowest and smallest setting.
EFFORT = 6


@dataclass(frozen=True)
class Picture:
    """A picture as it is stored in a file."""

    data: bytes
    """Encoded bytes."""
    mime: Literal["image/png", "image/webp", "image/jpeg"]
    mips: int = 0
    """Mip level up to which no texel mixes places that do not lie together."""

    def buffer(self) -> Buffer:
        """The graph's buffer: what every reader decodes."""
        return Buffer(decoded(self.data), "uint8", BYTE)


def encode(texels: np.ndarray, codec: str = "webp", mips: int = 0) -> Picture:
    """[H, W, 3] uint8 → Picture. ``codec``: png, webp (lossless), jpegQ or webpQ with a quality of 1 … 100.

    No colour profile, no gamma, no alpha: the numbers are data.
    """
    if texels.dtype != np.uint8 or texels.ndim != 3 or texels.shape[2] != 3:
        raise ValueError(f"picture: expected uint8 [height, width, 3], found {texels.dtype} {list(texels.shape)}")
    kind, quality = codec.rstrip("0123456789"), codec.lstrip("abcdefghijklmnopqrstuvwxyz")
    stream, image = io.BytesIO(), Image.fromarray(np.ascontiguousarray(texels))
    if kind == "png":
        image.save(stream, "PNG", optimize=True)
    elif kind == "webp" and not quality:
        image.save(stream, "WEBP", lossless=True, quality=100, method=EFFORT, exact=True)
    elif kind == "webp":
        image.save(stream, "WEBP", quality=int(quality), method=EFFORT)
    elif kind == "jpeg":
        image.save(stream, "JPEG", quality=int(quality or 90), subsampling=0, optimize=True)
    else:
        raise ValueError(f"picture: expected png, webp, webp1 … webp100 or jpeg1 … jpeg100, found '{codec}'")
    return Picture(stream.getvalue(), f"image/{kind}", mips)


def decoded(data: bytes) -> np.ndarray:
    """[H, W, 3] uint8 of an encoded picture, as every browser decodes it."""
    with Image.open(io.BytesIO(data), formats=FORMATS) as image:
        return np.asarray(image.convert("RGB"))
