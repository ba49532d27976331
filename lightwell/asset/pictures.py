"""Pictures in a glTF file that hold the numbers of a field, and the ordinary light map beside it."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from PIL import Image

from lightwell.asset.container import Binary
from lightwell.asset.records import Fallback
from lightwell.graph.pictures import BYTE, FORMATS, Picture, decoded

# glTF sampler constants (section 5.26): linear between texels and levels, clamped at the edge.
SAMPLER = {"magFilter": 9729, "minFilter": 9987, "wrapS": 33071, "wrapT": 33071}
WEBP = "EXT_texture_webp"
LIGHTMAP = "MOZ_lightmap"
# The second set of texture coordinates is the light map's.
TEX_COORD = 1


def add_texture(document: dict[str, Any], binary: Binary, picture: Picture) -> int:
    """Append a picture with its sampler to the tables of ``document``; return the index of its texture."""
    images, samplers = document.setdefault("images", []), document.setdefault("samplers", [])
    images.append({"bufferView": binary.add_view(picture.data), "mimeType": picture.mime})
    if SAMPLER not in samplers:
        samplers.append(dict(SAMPLER))
    texture: dict[str, Any] = {"sampler": samplers.index(SAMPLER)}
    if picture.mime == "image/webp":
        texture["extensions"] = {WEBP: {"source": len(images) - 1}}
        _use(document, WEBP)
    else:
        texture["source"] = len(images) - 1
    textures = document.setdefault("textures", [])
    textures.append(texture)
    return len(textures) - 1


def add_fallback(document: dict[str, Any], binary: Binary, fallback: Fallback) -> None:
    """Give every lit material the ordinary light map."""
    info = {"index": add_texture(document, binary, fallback.picture), "texCoord": TEX_COORD}
    for material in document.get("materials", []):
        extensions = material.setdefault("extensions", {})
        if "KHR_materials_unlit" not in extensions:
            extensions[LIGHTMAP] = {**info, "intensity": float(fallback.intensity)}
    _use(document, LIGHTMAP)


def _use(document: dict[str, Any], extension: str) -> None:
    document["extensionsUsed"] = sorted({*document.get("extensionsUsed", ()), extension})


def image_index(texture: dict[str, Any]) -> Any:
    """The image that a texture shows, unchecked."""
    extensions = texture.get("extensions")
    webp = extensions.get(WEBP) if isinstance(extensions, dict) else None
    return webp.get("source") if isinstance(webp, dict) else texture.get("source")


def check_picture(name: str, picture: Picture, array: np.ndarray) -> None:
    """What is shipped must be what was scored."""
    if not np.array_equal(decoded(picture.data), array):
        raise ValueError(f"asset: buffer '{name}' differs from its own picture; decode the picture into the buffer")


def decoded_texels(data: bytes, buffer: dict[str, Any], where: str) -> np.ndarray:
    """[H, W, 3] uint8 of a stranger's picture; its size is checked before anything is decoded."""
    height, width, channels = buffer["shape"] if len(buffer["shape"]) == 3 else (0, 0, 0)
    if buffer["type"] != "uint8" or channels != 3 or abs(np.float32(buffer.get("scale", 0)) - BYTE) > 1e-9:
        raise ValueError(f"{where}: a picture holds uint8 texels of 3 channels with the scale 1/255")
    try:
        with Image.open(io.BytesIO(data), formats=FORMATS) as image:
            if image.size != (width, height) or image.mode != "RGB":
                raise ValueError(f"{where}: its picture is {image.mode} {image.size}, expected RGB {(width, height)}")
            return np.array(image)
    except (OSError, SyntaxError, Image.DecompressionBombError) as error:
        raise ValueError(f"{where}: its picture cannot be decoded ({str(error)[:80]})") from error
