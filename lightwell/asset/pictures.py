"""Stores the numbers of a field as pictures of a glTF file, and adds the fallback light map."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from PIL import Image

from lightwell.asset.container import Binary
from lightwell.asset.records import Fallback
from lightwell.basisu import codec as basisu
from lightwell.graph.pictures import BYTE, FORMATS, KTX2, Picture, decoded

# glTF sampler constants (section 5.26): linear between texels and levels, clamped at the edge.
SAMPLER = {"magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071}
WEBP, BASISU = "EXT_texture_webp", "KHR_texture_basisu"
# Extensions that name the image of a texture, by the type of the image.
IMAGE_EXTENSIONS = {"image/webp": WEBP, KTX2: BASISU}
LIGHTMAP = "MOZ_lightmap"
# Light maps use the second set of texture coordinates.
TEX_COORD = 1


def add_texture(document: dict[str, Any], binary: Binary, picture: Picture) -> int:
    """Append a picture with its sampler to a glTF document.

    Args:
        document: glTF JSON; its tables ``images``, ``samplers`` and ``textures`` grow.
        binary: Receives the bytes of the picture.
        picture: Encoded picture.

    Returns:
        Index of the new texture.
    """
    images, samplers = document.setdefault("images", []), document.setdefault("samplers", [])
    images.append({"bufferView": binary.add_view(picture.data), "mimeType": picture.mime})
    if SAMPLER not in samplers:
        samplers.append(dict(SAMPLER))
    texture: dict[str, Any] = {"sampler": samplers.index(SAMPLER)}
    if extension := IMAGE_EXTENSIONS.get(picture.mime):
        texture["extensions"] = {extension: {"source": len(images) - 1}}
        _use(document, extension)
    else:
        texture["source"] = len(images) - 1
    textures = document.setdefault("textures", [])
    textures.append(texture)
    return len(textures) - 1


def add_fallback(document: dict[str, Any], binary: Binary, fallback: Fallback) -> None:
    """Reference the fallback light map from every material.

    Args:
        document: glTF JSON with its materials.
        binary: Receives the bytes of the picture.
        fallback: Light map for viewers that do not know the extension.
    """
    info = {"index": add_texture(document, binary, fallback.picture), "texCoord": TEX_COORD}
    for material in document.get("materials", []):
        material.setdefault("extensions", {})[LIGHTMAP] = {**info, "intensity": float(fallback.intensity)}
    _use(document, LIGHTMAP)


def _use(document: dict[str, Any], extension: str) -> None:
    document["extensionsUsed"] = sorted({*document.get("extensionsUsed", ()), extension})


def image_index(texture: dict[str, Any]) -> Any:
    """Return the image index of a texture as the file gives it, unchecked.

    Args:
        texture: glTF JSON of a texture.

    Returns:
        The index under EXT_texture_webp or KHR_texture_basisu when one is present, else the index under ``source``;
        any JSON value.
    """
    extensions = texture.get("extensions")
    for name in IMAGE_EXTENSIONS.values():
        named = extensions.get(name) if isinstance(extensions, dict) else None
        if isinstance(named, dict):
            return named.get("source")
    return texture.get("source")


def check_picture(name: str, picture: Picture, array: np.ndarray) -> None:
    """Check that a picture decodes to exactly the numbers of its buffer, which were the ones scored.

    Args:
        name: Name of the buffer, for the message.
        picture: Encoded picture.
        array: [H, W, 3] uint8, content of the buffer.

    Raises:
        ValueError: They differ.
    """
    if not np.array_equal(decoded(picture.data), array):
        raise ValueError(f"asset: buffer '{name}' differs from its own picture; decode the picture into the buffer")


def decoded_texels(data: bytes, buffer: dict[str, Any], where: str) -> np.ndarray:
    """Decode an untrusted picture, after its size has been checked.

    Args:
        data: Bytes of the picture.
        buffer: Declared ``shape``, ``type`` and ``scale`` of the graph buffer.
        where: Place in the file, for messages.

    Returns:
        [H, W, 3] uint8.

    Raises:
        ValueError: The buffer cannot be a picture, or the picture has another size or mode, or cannot be decoded.
    """
    height, width, channels = buffer["shape"] if len(buffer["shape"]) == 3 else (0, 0, 0)
    if buffer["type"] != "uint8" or channels != 3 or abs(np.float32(buffer.get("scale", 0)) - BYTE) > 1e-9:
        raise ValueError(f"{where}: a picture holds uint8 texels of 3 channels with the scale 1/255")
    if basisu.is_ktx2(data):
        return _decoded_blocks(data, (width, height), where)
    try:
        with Image.open(io.BytesIO(data), formats=FORMATS) as image:
            if image.size != (width, height) or image.mode != "RGB":
                raise ValueError(f"{where}: its picture is {image.mode} {image.size}, expected RGB {(width, height)}")
            return np.array(image)
    except (OSError, SyntaxError, Image.DecompressionBombError) as error:
        raise ValueError(f"{where}: its picture cannot be decoded ({str(error)[:80]})") from error


def _decoded_blocks(data: bytes, size: tuple[int, int], where: str) -> np.ndarray:
    """Decode an untrusted KTX2 picture, whose size is checked before its blocks are read."""
    try:
        if (found := basisu.size(data)) != size:
            raise ValueError(f"its picture is KTX2 {found}, expected {size}")
        return basisu.decode(data)
    except (RuntimeError, ValueError) as error:
        raise ValueError(f"{where}: {error}") from error
