"""A copy of a GLB whose KTX2 pictures are lossless WebP, for pages without a decoder of KTX2."""

from __future__ import annotations

from lightwell.asset.container import pack, replace_views, unpack, view_bytes
from lightwell.asset.pictures import BASISU, WEBP
from lightwell.graph.pictures import KTX2, decoded, encode


def without_ktx2(glb: bytes) -> bytes:
    """Replace the KTX2 pictures of a file by WebP pictures of the texels that they decode to.

    Args:
        glb: The file.

    Returns:
        A file that shows the same; ``glb`` itself when it has no KTX2 picture.
    """
    if BASISU.encode() not in glb:
        return glb
    document, binary = unpack(glb)
    replaced = {}
    for image in document.get("images", ()):
        if image.get("mimeType") == KTX2:
            replaced[image["bufferView"]] = encode(decoded(view_bytes(document, binary, image["bufferView"]))).data
            image["mimeType"] = "image/webp"
    for texture in document.get("textures", ()):
        extensions = texture.get("extensions", {})
        if BASISU in extensions:
            extensions[WEBP] = extensions.pop(BASISU)
    for names in (document.get("extensionsUsed", []), document.get("extensionsRequired", [])):
        names[:] = sorted({WEBP if name == BASISU else name for name in names})
    return pack(document, replace_views(document, binary, replaced))
