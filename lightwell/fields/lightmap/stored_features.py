"""Feature textures as they are stored: pictures of three channels, and what a viewer reads back of them.

Notation: C channels, T texels of a texture.
"""

from __future__ import annotations

import numpy as np

from lightwell.graph.pictures import Picture, encode
from lightwell.networks.atlas_texture import AtlasTexture

# Channels of a picture.
CHANNELS = 3


def feature_pictures(
    values: np.ndarray, texture: AtlasTexture, channels: int, codec: str, mips: int = 0
) -> list[Picture]:
    """Encode the features of a texture.

    Args:
        values: [T, C] features in [0, 1].
        texture: Its size.
        channels: Number of channels that are used, ≤ C.
        codec: As for ``lightwell.graph.pictures.encode``.
        mips: Mip level up to which no texel mixes places that do not lie together.

    Returns:
        ⌈channels / 3⌉ pictures; channels beyond the last are 0.
    """
    shape = (texture.height, texture.width, values.shape[1])
    texels = np.floor(np.clip(values, 0, 1) * 255 + 0.5).astype(np.uint8).reshape(shape)
    made = []
    for begin in range(0, channels, CHANNELS):
        three = np.zeros((*shape[:2], CHANNELS), np.uint8)
        held = texels[..., begin : min(begin + CHANNELS, channels)]
        three[..., : held.shape[2]] = held
        made.append(encode(three, codec, mips))
    return made


def read_back(pictures: list[Picture], texture: AtlasTexture, channels: int) -> np.ndarray:
    """Decode pictures of features.

    Args:
        pictures: Result of ``feature_pictures``.
        texture: Size of the texture.
        channels: Number of channels that are used.

    Returns:
        [T, C] float32 features in [0, 1], with the channels of the texture; those that are not used are 0.
    """
    texels = np.concatenate([picture.texels for picture in pictures], axis=2).reshape(-1, CHANNELS * len(pictures))
    table = np.zeros((len(texels), texture.channels), np.float32)
    table[:, :channels] = texels[:, :channels].astype(np.float32) / 255
    return table


def codec_error(values: np.ndarray, texture: AtlasTexture, channels: int, codec: str) -> np.ndarray:
    """Compute what encoding and decoding adds to rounded features.

    Args:
        values: [T, C] features in [0, 1].
        texture: Size of the texture.
        channels: Number of channels that are used.
        codec: As for ``feature_pictures``.

    Returns:
        [T, C] float32 error; 0 for channels that are not used.
    """
    error = read_back(feature_pictures(values, texture, channels, codec), texture, channels)
    error[:, :channels] -= np.floor(np.clip(values[:, :channels], 0, 1) * 255 + 0.5) / 255
    return error
