"""Pictures as buffers: [H, W, 3] bytes of a graph as PNG, WebP or JPEG (format/LIGHTMAP.md)."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np
from PIL import Image

from lightwell.graph.buffers import Buffer

if TYPE_CHECKING:
    from lightwell.graph import Graph

# A byte stands for its share of 255, as in a texture of a GPU.
BYTE = np.float32(1 / 255)
FORMATS = ("PNG", "WEBP", "JPEG")
# WebP's slowest and smallest setting.
EFFORT = 6


MIMES: dict[str, Literal["image/png", "image/webp", "image/jpeg"]] = {
    "png": "image/png",
    "webp": "image/webp",
    "jpeg": "image/jpeg",
}


@dataclass(frozen=True)
class Picture:
    """A picture as it is stored in a file."""

    data: bytes
    """Encoded bytes."""
    mime: Literal["image/png", "image/webp", "image/jpeg"]
    mips: int = 0
    """Mip level up to which no texel mixes places that do not lie together."""

    def buffer(self, level: int = 0) -> Buffer:
        """Decode the picture into a buffer of a graph.

        Args:
            level: Level of the mip chain, as a viewer far away reads it; 0: full size.

        Returns:
            [H / 2^level, W / 2^level, 3] bytes with a step of 1/255.
        """
        return Buffer(minified(self.texels, level), "uint8", BYTE)

    @cached_property
    def texels(self) -> np.ndarray:
        """Decode the picture.

        Returns:
            [H, W, 3] uint8.
        """
        return decoded(self.data)

    def level(self, far: int, size: int) -> int:
        """Find the level of this picture that goes with a level of an atlas.

        Args:
            far: Level at which the atlas is read.
            size: Texels along an edge of the atlas.

        Returns:
            Level from 0 to ``mips``.
        """
        return int(np.clip(far - round(np.log2(size / len(self.texels))), 0, self.mips))


@dataclass(frozen=True)
class Fallback:
    """An ordinary light map for viewers that do not know the extension (MOZ_lightmap)."""

    picture: Picture
    """Diffuse irradiance, linear, divided by ``intensity``; read at TEXCOORD_1."""
    intensity: float
    """Factor on the texels, ≥ 0."""


def encode(texels: np.ndarray, codec: str = "webp", mips: int = 0) -> Picture:
    """Encode texels; no colour profile, no gamma, no alpha: the numbers are data.

    Args:
        texels: [H, W, 3] uint8.
        codec: "png", "webp" (lossless), or "jpegQ" and "webpQ" with a quality Q of 1 to 100.
        mips: Mip level up to which no texel mixes places that do not lie together.

    Returns:
        The picture.

    Raises:
        ValueError: The texels are not [H, W, 3] bytes, or the codec is unknown.
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
    return Picture(stream.getvalue(), MIMES[kind], mips)


def decoded(data: bytes) -> np.ndarray:
    """Decode a PNG, WebP or JPEG file as every browser does.

    Args:
        data: The bytes of the file.

    Returns:
        [H, W, 3] uint8.
    """
    with Image.open(io.BytesIO(data), formats=FORMATS) as image:
        return np.asarray(image.convert("RGB"))


def minified(texels: np.ndarray, level: int) -> np.ndarray:
    """Compute a level of a mip chain: means of 2 × 2 texels, rounded at every level as GPUs do.

    Args:
        texels: [H, W, C] uint8 with edges that are multiples of 2^level.
        level: How often to halve, ≥ 0.

    Returns:
        [H / 2^level, W / 2^level, C] uint8.
    """
    for _ in range(level):
        height, width, channels = texels.shape
        mean = texels.reshape(height // 2, 2, width // 2, 2, channels).mean(axis=(1, 3))
        texels = np.floor(mean + 0.5).astype(np.uint8)
    return texels


def seen_from_afar(graph: Graph, pictures: Mapping[str, Picture], size: int, level: int) -> Graph:
    """Replace the pictures of a graph by levels of their mip chains, as a viewer far away reads them.

    Args:
        graph: Graph of a light map.
        pictures: Buffer name to picture.
        size: Texels along an edge of the atlas.
        level: Level at which the atlas is read.

    Returns:
        The graph with smaller buffers.
    """
    far = {name: p.buffer(p.level(level, size)) for name, p in pictures.items() if name in graph.buffers}
    return replace(graph, buffers={**graph.buffers, **far})
