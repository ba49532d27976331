"""Pictures as buffers: [H, W, 3] bytes of a graph as PNG, WebP, JPEG or KTX2 (format/LIGHTMAP.md)."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np
from PIL import Image

from lightwell.basisu import codec as basisu
from lightwell.core.image_io import jpeg
from lightwell.graph.buffers import Buffer

if TYPE_CHECKING:
    from lightwell.graph import Graph

# A byte stands for its share of 255, as in a texture of a GPU.
BYTE = np.float32(1 / 255)
FORMATS = ("PNG", "WEBP", "JPEG")
# WebP's slowest and smallest setting.
WEBP_METHOD = 6

Mime = Literal["image/png", "image/webp", "image/jpeg", "image/ktx2"]
MIMES: dict[str, Mime] = {
    "png": "image/png",
    "webp": "image/webp",
    "jpeg": "image/jpeg",
}
KTX2: Mime = "image/ktx2"


@dataclass(frozen=True)
class Picture:
    """A picture as it is stored in a file."""

    data: bytes
    """Encoded bytes."""
    mime: Mime
    mips: int = 0
    """Mip level up to which no texel mixes places that do not lie together."""

    def buffer(self, level: int = 0) -> Buffer:
        """Decode the picture into a buffer of a graph.

        Args:
            level: Level of the mip chain, as a viewer far away reads it; 0: full size.

        Returns:
            [H / 2^level, W / 2^level, 3] bytes with a step of 1/255.
        """
        # The levels of a KTX2 file are stored; those of others are made by the GPU.
        texels = decoded(self.data, level) if level and self.mime == KTX2 else minified(self.texels, level)
        return Buffer(texels, "uint8", BYTE)

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
        codec: "png", "webp" (lossless), "jpegQ" and "webpQ" with a quality Q of 1 to 100, or "uastc" and "etc1s", which
            are blocks of a KTX2 file with its mip levels.
        mips: Mip level up to which no texel mixes places that do not lie together.

    Returns:
        The picture.

    Raises:
        ValueError: The texels are not [H, W, 3] bytes, or the codec is unknown.
    """
    if texels.dtype != np.uint8 or texels.ndim != 3 or texels.shape[2] != 3:
        raise ValueError(f"picture: expected uint8 [height, width, 3], found {texels.dtype} {list(texels.shape)}")
    if codec in basisu.CODECS:
        return Picture(basisu.encode(texels, codec, mips), KTX2, mips)
    kind, quality = codec.rstrip("0123456789"), codec.lstrip("abcdefghijklmnopqrstuvwxyz")
    stream, image = io.BytesIO(), Image.fromarray(np.ascontiguousarray(texels))
    if kind == "png":
        image.save(stream, "PNG", optimize=True)
    elif kind == "webp" and not quality:
        image.save(stream, "WEBP", lossless=True, quality=100, method=WEBP_METHOD, exact=True)
    elif kind == "webp":
        image.save(stream, "WEBP", quality=int(quality), method=WEBP_METHOD)
    elif kind == "jpeg":
        return Picture(jpeg(np.ascontiguousarray(texels), int(quality or 90)), MIMES[kind], mips)
    else:
        raise ValueError(
            f"picture: expected png, webp, webp1 … webp100, jpeg1 … jpeg100, uastc or etc1s, found '{codec}'"
        )
    return Picture(stream.getvalue(), MIMES[kind], mips)


def decoded(data: bytes, level: int = 0) -> np.ndarray:
    """Decode a PNG, WebP, JPEG or KTX2 file as every browser does.

    Args:
        data: The bytes of the file.
        level: Mip level that is read of a KTX2 file; 0 for other files, which have one.

    Returns:
        [H, W, 3] uint8.
    """
    if basisu.is_ktx2(data):
        return basisu.decode(data, level)
    with Image.open(io.BytesIO(data), formats=FORMATS) as image:
        return np.asarray(image.convert("RGB"))


def gpu_bytes(picture: Picture) -> int:
    """Compute the memory that a picture takes on a GPU, with its mip levels.

    Args:
        picture: The picture.

    Returns:
        Bytes: four for a texel, or those of its blocks; a GPU makes all levels of a picture that may be minified, and a
        KTX2 file has those that may be read.
    """
    height, width = picture.texels.shape[:2]
    if picture.mime != KTX2:
        levels = range(max(height, width).bit_length() if picture.mips else 1)
        return sum(4 * max(height >> m, 1) * max(width >> m, 1) for m in levels)
    block, edge = basisu.block_bytes(picture.data), basisu.BLOCK
    return sum(
        block * -(-max(height >> m, 1) // edge) * -(-max(width >> m, 1) // edge) for m in range(picture.mips + 1)
    )


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
