"""A small scene with one of everything that an asset can hold."""

import io

import numpy as np
import pytest
from PIL import Image as PillowImage

from lightwell.asset import FieldEntry
from lightwell.graph import Builder, Graph, pack
from lightwell.scenes.scene import Camera, Image, Light, Material, Mesh, Scene, Texture

VARIABLE = {
    "name": "light",
    "kind": "point",
    "low": [-0.5, 0.2, -0.5],
    "high": [0.5, 0.8, 0.5],
    "clearance": 0.1,
    "radius": 0,
    "initial": [0, 0.5, 0],
    "intensity": 20.0,
    "color": [1, 1, 1],
}


def picture(kind: str = "PNG", color=(200, 100, 50)) -> Image:
    """A tiny 4x4 picture."""
    stream = io.BytesIO()
    PillowImage.new("RGB", (4, 4), color).save(stream, kind)
    return Image(f"a {kind}", stream.getvalue(), f"image/{kind.lower()}")


def quad(name: str, material: int, **attributes) -> Mesh:
    """A unit square in the plane y = 0."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]], np.float32)
    return Mesh(name, corners, np.array([[0, 2, 1], [0, 3, 2]], np.uint32), material, **attributes)


def materials() -> list[Material]:
    wood, normal = picture("PNG"), picture("JPEG", (128, 128, 255))
    turned = ((1.9999, 0.02, 0.1), (-0.02, 1.9999, 0.2), (0.0, 0.0, 1.0))
    textured = Material(
        "textured ✓",
        base_color_texture=Texture(wood, ("mirror", "clamp"), uv_set=1),
        metallic_roughness_texture=Texture(wood, nearest=True, transform=turned),
        normal_texture=Texture(normal),
        normal_scale=0.5,
        emissive=(2.0, 1.0, 0.0),
        emissive_texture=Texture(wood),
    )
    glass = Material(
        "glass", metallic=0.0, transmission=0.9, thickness=0.2, ior=1.7, clearcoat=1.0, sheen=0.3, alpha_mode="BLEND"
    )
    return [textured, glass, Material("flat", unlit=True, alpha_mode="MASK", double_sided=True)]


@pytest.fixture
def scene() -> Scene:
    """Four squares: textured, glass without normals, unlit with colours, and a lamp."""
    up = np.tile(np.float32([0, 1, 0]), (4, 1))
    uv = np.float32([[0, 0], [1, 0], [1, 1], [0, 1]])
    meshes = [
        quad("floor", 0, normals=up * 1.5, uv0=uv, uv1=uv * 0.5),
        quad("pane", 1),
        quad("sign", 2, normals=up * 0, colors=np.full((4, 4), 0.5, np.float32)),
        quad("lamp", 1, normals=up, emission=(5.0, 5.0, 5.0)),
    ]
    lights = [
        Light("point", "bulb", (0.0, 1.0, 0.0), color=(2.0, 1.0, 1.0), intensity=3.0),
        Light("spot", "spot", (0.0, 1.0, 0.0), direction=(0.0, -1.0, 0.0), range=4.0, outer_cone=0.5),
        Light("directional", "sun", direction=(0.6, -0.8, 0.0)),
    ]
    cameras = [Camera((0.0, 1.0, 3.0), (0.0, 0.5, 0.0), name="front"), Camera((0.0, 4.0, 0.0), (0.0, 0.0, 0.0))]
    return Scene("room", meshes, materials(), None, lights, cameras)


@pytest.fixture
def variable() -> dict:
    return dict(VARIABLE)


def graph(seed: int = 1) -> Graph:
    """A small network with buffers of every type."""
    rng = np.random.default_rng(seed)
    b = Builder(position=3, light=3)
    h = b.frequency(b.concat("position", "light"), octaves=2)
    for type in ("int8", "float16", "uint8"):
        width = 24 if type == "int8" else 5
        h = b.linear(h, pack(rng.normal(size=(5, width)), type), pack(rng.normal(size=5), "float32"))
        h = b.activate(h, "silu")
    return b.build(radiance=b.linear(h, rng.normal(size=(3, 5)), rng.normal(size=3)))


@pytest.fixture
def entry() -> FieldEntry:
    return FieldEntry("indirect", "indirect", graph(), 0)
