"""Pictures as buffers: what was written comes back, what strangers wrote is refused, the fallback is there."""

import copy
import importlib.util
import json
import subprocess
from pathlib import Path

import numpy as np
import pytest

from lightwell.asset import EXTENSION, read_fields
from lightwell.asset.container import pack, unpack
from lightwell.asset.records import FieldEntry
from lightwell.asset.write import glb_bytes
from lightwell.graph import evaluate
from lightwell.graph.pictures import BYTE, encode

HERE = Path(__file__).parent
ROOT = HERE.parents[1]


@pytest.fixture(scope="module")
def example():
    """The module that writes the example of format/LIGHTMAP.md."""
    spec = importlib.util.spec_from_file_location("lightmap_example", ROOT / "tools/lightmap_example.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def baked(example, tmp_path_factory):
    path = tmp_path_factory.mktemp("lightmap") / "example.glb"
    example.main(path)
    return path


def test_what_was_written_comes_back(baked):
    fields, variables = read_fields(baked)
    assert variables == [] and fields[0].role == "static"
    rows = json.loads(baked.with_suffix(".json").read_text())
    inputs = {name: np.float32(value) for name, value in rows["inputs"].items()}
    found = evaluate(fields[0].graph, inputs)["radiance"]
    assert np.abs(found - np.float32(rows["outputs"]["radiance"])).max() < 1e-5


def test_bytes_are_those_of_the_picture(example, baked):
    buffer = read_fields(baked)[0][0].graph.buffers["e"]
    assert np.array_equal(buffer.array, example.ramp())
    assert buffer.scale == BYTE and buffer.offset == 0


def test_every_lit_material_has_the_ordinary_light_map(baked):
    document, _ = unpack(baked.read_bytes())
    maps = [material["extensions"]["MOZ_lightmap"] for material in document["materials"]]
    assert len(maps) == 2 and all(m["texCoord"] == 1 and m["intensity"] == 2.0 for m in maps)
    assert {EXTENSION, "MOZ_lightmap", "EXT_texture_webp"} <= set(document["extensionsUsed"])
    assert "extensionsRequired" not in document
    assert all("TEXCOORD_1" in p["attributes"] for mesh in document["meshes"] for p in mesh["primitives"])


def test_no_picture_has_alpha_or_a_colour_profile(baked):
    import io

    from PIL import Image

    document, binary = unpack(baked.read_bytes())
    for entry in document["images"]:
        view = document["bufferViews"][entry["bufferView"]]
        data = binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        with Image.open(io.BytesIO(data)) as image:
            assert image.mode == "RGB" and not {"icc_profile", "gamma", "srgb"} & set(image.info)


def _buffer(document, name="e"):
    return document["extensions"][EXTENSION]["fields"][0]["graph"]["buffers"][name]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: _buffer(d).update(texture=99), "textures[99] does not exist"),
        (lambda d: _buffer(d).update(shape=[8, 16, 3]), "expected RGB (16, 8)"),
        (lambda d: _buffer(d).update(scale=1.0), "scale 1/255"),
        (lambda d: _buffer(d).update(type="int8"), "uint8"),
        (lambda d: _buffer(d).update(accessor=0), "accessor"),
        (lambda d: _buffer(d).pop("texture"), "accessor"),
        (lambda d: d["textures"][_buffer(d)["texture"]].update(source=99), "images[99] does not exist"),
        (lambda d: d["images"][0].update(bufferView=0), "cannot be decoded"),
        (lambda d: d["bufferViews"][d["images"][0]["bufferView"]].update(byteLength=10**9), "do not lie inside"),
    ],
)
def test_refusals(baked, tmp_path, change, words):
    document, binary = unpack(baked.read_bytes())
    altered = copy.deepcopy(document)
    # The fallback's picture comes first; image 0 of the change is that of buffer e.
    order = sorted(
        range(len(altered["images"])), key=lambda i: i != altered["textures"][_buffer(altered)["texture"]]["source"]
    )
    if "images" in words or "decoded" in words or "inside" in words:
        source = order[0]
        altered["images"][0], altered["images"][source] = altered["images"][source], altered["images"][0]
        altered["textures"][_buffer(altered)["texture"]]["source"] = 0
    change(altered)
    path = tmp_path / "hostile.glb"
    path.write_bytes(pack(altered, binary))
    with pytest.raises(ValueError) as caught:
        read_fields(path)
    assert words in str(caught.value) and "\n" not in str(caught.value)


def test_a_picture_that_is_not_the_buffer_is_not_written(example):
    stored = example.pictures()
    entry = FieldEntry(
        "lightmap", "static", example.graph(stored), pictures=stored | {"e": encode(255 - example.ramp(), "png")}
    )
    with pytest.raises(ValueError, match="differs from its own picture"):
        glb_bytes(example.scene(), [entry], [])


def test_khronos_validator_finds_no_error(baked):
    root = ROOT / "web"
    command = ["node", str(HERE / "validate.mjs"), str(baked), str(root)]
    report = json.loads(subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout)
    assert report["issues"]["numErrors"] == 0, report["issues"]["messages"]
