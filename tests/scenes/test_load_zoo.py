"""Every scene of ../shared/zoo loads; small ones are rendered (``slow``: all of them)."""

from pathlib import Path

import pytest

from lightwell.cli import main
from lightwell.scenes import load

ZOO = Path(__file__).parents[3] / "shared" / "zoo"
pytestmark = pytest.mark.skipif(not ZOO.is_dir(), reason="the zoo is not beside the checkout")

# What loads in a second or two.
SMALL = ("bakedgi-building", "bevy-barn-lamp", "flowerbed-sandbox", "vr-gallery", "vulkan-subpass-scene", "webxr-cave",
         "webxr-sound-room")  # fmt: skip


def _scenes() -> list:
    if not ZOO.is_dir():
        return []
    found = sorted(p for folder in ZOO.iterdir() for p in folder.glob("*") if p.suffix in (".glb", ".gltf", ".xml"))
    return [
        pytest.param(p, id=p.parent.name, marks=[] if p.parent.name in SMALL else [pytest.mark.slow]) for p in found
    ]


@pytest.mark.parametrize("path", _scenes())
def test_it_loads(path):
    scene = load(path)
    assert scene.meshes
    assert all("\n" not in warning for warning in scene.warnings)


@pytest.mark.slow
@pytest.mark.parametrize("path", _scenes())
def test_it_renders(path, tmp_path):
    assert main(["render", str(path), "-o", str(tmp_path / "picture.png"), "--size", "96x64", "--spp", "4"]) == 0
    assert (tmp_path / "picture.png").stat().st_size > 100
