"""The model's textures as a page carries them: WebP in place of PNG. ``scene.glb`` keeps what every engine reads."""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from PIL import Image

from lightwell.asset.container import pack, replace_views, unpack, view_bytes
from lightwell.asset.pictures import LIGHTMAP, WEBP, image_index
from lightwell.asset.records import EXTENSION

# Where a material names its colours; every other texture is data (normals, roughness, …), of which nothing may be lost.
COLOURS = frozenset(
    {
        "baseColorTexture",
        "emissiveTexture",
        "diffuseTexture",
        "specularColorTexture",
        "sheenColorTexture",
        "diffuseTransmissionColorTexture",
    }
)
# WebP qualities for colours, tried in this order until the picture is near enough to the model's.
QUALITIES = (90, 95)
# Decibels on 8-bit values; 40 dB, 2.5 steps of 255 on average, is taken for visually lossless.
NEAR_ENOUGH = 40.0
# WebP's setting between size (6) and speed (0).
LOSSY_METHOD, LOSSLESS_METHOD = 4, 2
# Texels that are encoded for one page, about five seconds of one core; the pictures after them stay as they are.
MOST_TEXELS = 2**24


@dataclass(frozen=True)
class ModelPicture:
    """A picture of the model in a glTF document."""

    view: int
    """Its buffer view."""
    colour: bool
    """It holds colours alone, so that it may be stored with a loss that is not seen."""


def with_smaller_textures(glb: bytes) -> bytes:
    """Write the PNG textures of a model as WebP (EXT_texture_webp).

    Textures that hold numbers (normals, roughness, opacity) and all pictures of learned light keep every value.

    Args:
        glb: A baked asset.

    Returns:
        The asset with smaller textures; the same bytes where none becomes smaller.
    """
    if not glb.startswith(b"glTF"):
        return glb
    document, binary = unpack(glb)
    pictures = model_pictures(document)
    views = document.get("bufferViews", [])
    if not pictures or any(view.get("extensions") or view.get("buffer", 0) for view in views):
        return glb
    stored = {image: view_bytes(document, binary, picture.view) for image, picture in pictures.items()}
    chosen = list(_within(stored, MOST_TEXELS))
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        found = pool.map(lambda image: smaller_picture(stored[image], pictures[image].colour), chosen)
        smaller = {image: data for image, data in zip(chosen, found) if data is not None}
    return _replaced(document, binary, smaller) if smaller else glb


def model_pictures(document: dict[str, Any]) -> dict[int, ModelPicture]:
    """Find the PNG pictures that only textures of materials use.

    Args:
        document: glTF JSON.

    Returns:
        The pictures by the index of their image; those of learned light and of light maps are not among them.
    """
    textures, images = document.get("textures", []), document.get("images", [])
    learned = set(_learned_textures(document.get("extensions", {}).get(EXTENSION, {})))
    kept = {image_index(textures[index]) for index in learned}
    uses: dict[int, set[str]] = {}
    for name, index in _texture_uses(document.get("materials", [])):
        source = textures[index].get("source")
        if name == LIGHTMAP:
            kept.add(image_index(textures[index]))
        elif source is not None:
            uses.setdefault(source, set()).add(name)
    return {
        image: ModelPicture(images[image]["bufferView"], names <= COLOURS)
        for image, names in sorted(uses.items())
        if image not in kept and images[image].get("mimeType") == "image/png" and "bufferView" in images[image]
    }


def smaller_picture(data: bytes, colour: bool) -> bytes | None:
    """Encode a PNG as WebP.

    Args:
        data: Bytes of the PNG.
        colour: It may differ from the PNG by what is not seen; otherwise every value is kept.

    Returns:
        Bytes of a WebP; None where it would not be smaller, or cannot hold the picture (16 bits, sides over 16383).
    """
    with Image.open(io.BytesIO(data), formats=("PNG",)) as png:
        if png.mode not in ("RGB", "RGBA", "L", "LA", "P", "1") or max(png.size) > 16383:
            return None
        picture = png.convert("RGBA" if png.has_transparency_data else "RGB")
    for encoded in _attempts(picture, colour):
        if len(encoded) < len(data):
            return encoded
    return None


def _attempts(picture: Image.Image, colour: bool) -> Iterator[bytes]:
    """The picture as WebP, the smallest first; each is near enough."""
    for quality in QUALITIES if colour else ():
        encoded = _encoded(picture, quality=quality, method=LOSSY_METHOD, exact=True)
        if decibels(picture, encoded) >= NEAR_ENOUGH:
            yield encoded
    yield _encoded(picture, lossless=True, method=LOSSLESS_METHOD, exact=True)


def _encoded(picture: Image.Image, **options: Any) -> bytes:
    out = io.BytesIO()
    # Without a colour profile: textures of glTF have the colour space that the format says.
    picture.save(out, "WEBP", icc_profile="", **options)
    return out.getvalue()


def decibels(picture: Image.Image, encoded: bytes) -> float:
    """Compare a picture with an encoded one.

    Args:
        picture: RGB or RGBA, 8 bits.
        encoded: Bytes of a WebP of the same size.

    Returns:
        Peak signal-to-noise ratio over all channels, dB; infinite where they are equal.
    """
    with Image.open(io.BytesIO(encoded), formats=("WEBP",)) as image:
        other = np.asarray(image.convert(picture.mode), np.float32)
    error = float(np.mean((np.asarray(picture, np.float32) - other) ** 2))
    return float("inf") if error == 0 else float(10 * np.log10(255**2 / error))


def _within(stored: dict[int, bytes], texels: int) -> Iterator[int]:
    """The first images that have no more texels together."""
    for image, data in stored.items():
        with Image.open(io.BytesIO(data), formats=("PNG",)) as png:
            texels -= png.width * png.height
        if texels < 0:
            return
        yield image


def _texture_uses(value: Any, name: str = "") -> Iterator[tuple[str, int]]:
    """Every texture that a part of a document names: the name it goes by, and its index."""
    if isinstance(value, list):
        for entry in value:
            yield from _texture_uses(entry)
    elif isinstance(value, dict):
        if "index" in value and (name.endswith("Texture") or name == LIGHTMAP):
            yield name, value["index"]
        for key, entry in value.items():
            yield from _texture_uses(entry, key)


def _learned_textures(extension: dict[str, Any]) -> Iterator[int]:
    """The textures that hold numbers of fields."""
    for field in extension.get("fields", []):
        for buffer in field["graph"]["buffers"].values():
            if "texture" in buffer:
                yield buffer["texture"]


def _replaced(document: dict[str, Any], binary: bytes, smaller: dict[int, bytes]) -> bytes:
    """The file with other bytes for some images."""
    images = document["images"]
    data_of = {images[image]["bufferView"]: data for image, data in smaller.items()}
    replaced = replace_views(document, binary, data_of)
    for image in smaller:
        images[image]["mimeType"] = "image/webp"
    for texture in document["textures"]:
        if texture.get("source") in smaller:
            texture.setdefault("extensions", {})[WEBP] = {"source": texture.pop("source")}
    for names in ("extensionsUsed", "extensionsRequired"):
        document[names] = sorted({*document.get(names, ()), WEBP})
    return pack(document, replaced)
