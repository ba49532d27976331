"""The page carries the model's textures as WebP: colours without visible loss, numbers without any."""

import io

import numpy as np
import pytest
from PIL import Image

from lightwell.asset.container import Binary, pack, unpack
from lightwell.asset.page_textures import NEAR_ENOUGH, decibels, with_smaller_textures
from lightwell.asset.records import EXTENSION

SIDE = 64


def png(texels: np.ndarray) -> bytes:
    out = io.BytesIO()
    Image.fromarray(texels).save(out, "PNG")
    return out.getvalue()


def smooth(channels: int = 3) -> np.ndarray:
    """A ramp with a little grain, as plaster has; alpha is cut out."""
    grain = np.random.default_rng(1).integers(0, 6, (SIDE, SIDE, channels))
    texels = np.linspace(40, 200, SIDE)[:, None, None] + grain
    if channels == 4:
        texels[..., 3] = 255 * (np.arange(SIDE) % 16 < 8)
    return texels.astype(np.uint8)


# Name of the picture: how it is used, and its texels.
PICTURES = {
    "colour": smooth(),
    "leaf": smooth(4),
    "saturated": np.random.default_rng(2).integers(0, 2, (SIDE, SIDE, 3), np.uint8) * np.uint8([255, 90, 0]),
    "normals": smooth()[::-1],
    "lightmap": smooth()[:, ::-1],
    "learned": smooth()[::-1, ::-1],
}


@pytest.fixture(scope="module")
def glb() -> bytes:
    binary = Binary()
    order = list(PICTURES)
    images = [
        {"bufferView": binary.add_view(png(PICTURES[name])), "mimeType": "image/png", "name": name} for name in order
    ]
    numbers = binary.add_accessor(np.arange(7, dtype=np.float32))
    at = {name: {"index": order.index(name)} for name in order}
    graph = {"buffers": {"w0": {"texture": at["learned"]["index"]}, "w1": {"accessor": numbers}}}
    plaster = {
        "pbrMetallicRoughness": {"baseColorTexture": at["colour"]},
        "normalTexture": at["normals"],
        "extensions": {"MOZ_lightmap": at["lightmap"]},
    }
    document = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": len(binary.data)}],
        "bufferViews": binary.views,
        "accessors": binary.accessors,
        "images": images,
        "textures": [{"source": index} for index in range(len(order))],
        "materials": [
            plaster,
            *({"pbrMetallicRoughness": {"baseColorTexture": at[name]}} for name in ("leaf", "saturated")),
        ],
        "extensions": {EXTENSION: {"fields": [{"graph": graph}]}},
        "extensionsUsed": [EXTENSION],
    }
    return pack(document, bytes(binary.data))


def pictures_of(glb: bytes) -> dict[str, tuple[str, bytes]]:
    document, binary = unpack(glb)
    found = {}
    for image in document["images"]:
        view = document["bufferViews"][image["bufferView"]]
        data = binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        found[image["name"]] = image["mimeType"], data
    return found


def test_colours_look_the_same_and_numbers_are_the_same(glb):
    before, after = pictures_of(glb), pictures_of(with_smaller_textures(glb))
    for name in ("colour", "leaf"):
        mime, data = after[name]
        assert mime == "image/webp" and len(data) < 0.4 * len(before[name][1]), name
        assert NEAR_ENOUGH <= decibels(Image.fromarray(PICTURES[name]), data) < 60, name
    # Alpha decides what is cut out.
    assert np.array_equal(np.asarray(Image.open(io.BytesIO(after["leaf"][1])))[..., 3], PICTURES["leaf"][..., 3])
    # Colour is stored at half resolution where there is loss: a picture that this would change has none.
    for name in ("saturated", "normals"):
        assert np.array_equal(np.asarray(Image.open(io.BytesIO(after[name][1])).convert("RGB")), PICTURES[name]), name
    assert {name: after[name] for name in ("lightmap", "learned")} == {
        name: before[name] for name in ("lightmap", "learned")
    }


def test_the_rest_of_the_file_stays(glb):
    (before, old), (after, new) = unpack(glb), unpack(with_smaller_textures(glb))
    for index in (index for index, texture in enumerate(after["textures"]) if "extensions" in texture):
        assert after["textures"][index] == {"extensions": {"EXT_texture_webp": {"source": index}}}
        assert after["images"][index]["mimeType"] == "image/webp"
    assert "EXT_texture_webp" in after["extensionsRequired"] and EXTENSION not in after["extensionsRequired"]
    assert after["buffers"][0]["byteLength"] == len(new)
    for document, binary in ((before, old), (after, new)):
        view = document["bufferViews"][document["accessors"][0]["bufferView"]]
        start = view["byteOffset"]
        assert np.frombuffer(binary[start : start + 28], "<f4").tolist() == [0, 1, 2, 3, 4, 5, 6]
    assert with_smaller_textures(glb) == with_smaller_textures(glb)


def test_what_cannot_become_smaller_keeps_its_bytes(glb):
    document, binary = unpack(glb)
    del document["materials"]
    bare = pack(document, binary)
    assert with_smaller_textures(bare) == bare
    # A file whose views are compressed otherwise is left alone.
    document, binary = unpack(glb)
    document["bufferViews"][0]["extensions"] = {"EXT_meshopt_compression": {}}
    packed = pack(document, binary)
    assert with_smaller_textures(packed) == packed
