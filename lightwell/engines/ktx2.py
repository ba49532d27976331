"""Writes KTX 2.0 files of half floats.

References: Khronos, *KTX File Format Specification 2.0*; *Khronos Data Format Specification 1.3*.
"""

from __future__ import annotations

import struct

import numpy as np

IDENTIFIER = b"\xabKTX 20\xbb\r\n\x1a\n"
# VK_FORMAT_R16G16B16A16_SFLOAT.
VK_RGBA16F = 97
HEADER_BYTES = 80
# Basic descriptor: colour model RGBSDA, primaries BT.709, linear transfer.
MODEL_RGBSDA, PRIMARIES_BT709, TRANSFER_LINEAR = 1, 1, 1
# Channels of that model, each a signed float: R, G, B, A.
CHANNELS, FLOAT_SIGNED = (0, 1, 2, 15), 0xC0
BLOCK_HEADER_BYTES, SAMPLE_BYTES = 24, 16
MINUS_ONE, ONE = 0xBF800000, 0x3F800000


def encode_rgba16f(values: np.ndarray) -> bytes:
    """Write a texture of one level.

    Args:
        values: [H, W, 4] for a picture or [D, H, W, 4] for a volume; numbers within the range of half floats.

    Returns:
        Bytes of the file.

    Raises:
        ValueError: A number is not finite as a half float.
    """
    with np.errstate(over="ignore"):
        half = np.ascontiguousarray(values, "<f2")
    if not np.isfinite(half).all():
        raise ValueError("export: light beyond 65504, the range of half floats; bake with a lower --unit or exposure")
    depth, (height, width) = (values.shape[0] if values.ndim == 4 else 0), values.shape[-3:-1]
    descriptor = _descriptor()
    first = -(-(HEADER_BYTES + 24 + len(descriptor)) // 16) * 16
    header = IDENTIFIER + struct.pack("<9I", VK_RGBA16F, 2, width, height, depth, 0, 1, 1, 0)
    header += struct.pack("<4I2Q", HEADER_BYTES + 24, len(descriptor), 0, 0, 0, 0)
    level = struct.pack("<3Q", first, half.nbytes, half.nbytes)
    return (header + level + descriptor).ljust(first, b"\0") + half.tobytes()


def _descriptor() -> bytes:
    """The data format descriptor of four half floats."""
    size = BLOCK_HEADER_BYTES + SAMPLE_BYTES * len(CHANNELS)
    block = struct.pack(
        "<IHH4B4B8B", 0, 2, size, MODEL_RGBSDA, PRIMARIES_BT709, TRANSFER_LINEAR, 0, *[0] * 4, 8, *[0] * 7
    )
    for i, channel in enumerate(CHANNELS):
        block += struct.pack("<HBB4B2I", 16 * i, 15, channel | FLOAT_SIGNED, *[0] * 4, MINUS_ONE, ONE)
    return struct.pack("<I", 4 + size) + block
