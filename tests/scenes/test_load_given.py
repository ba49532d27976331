"""The given third-party scenes all load, and the rebuilt Mitsuba scenes render the same picture."""

from pathlib import Path

import numpy as np
import pytest

from lightwell.backend import mi
from lightwell.scenes import load

GIVEN = Path(__file__).parents[3] / "shared" / "scenes"
pytestmark = pytest.mark.skipif(not GIVEN.is_dir(), reason="the given scenes are not beside the checkout")

# Triangles with an area, as the loader counts them.
GLTF = {
    "bevy-cornell/CornellBox.glb": 36,
    "bevy-dof/DepthOfFieldExample.glb": 10610,
    "godot-living-room/living_room.glb": 1551,
    "godot-room/room.glb": 63720,
    "littlest-tokyo/LittlestTokyo-transformed.glb": 88975,
    "tile-game-room/tile-game-room6.glb": 88,
    "zdm2/zdm2.glb": 57638,
}
MITSUBA = ("cornell-box", "veach-ajar", "veach-bidir", "staircase2", "living-room-2")
# One of each kind is loaded in every run; all are scenes of others that `make test-all` is for.
OFTEN = ("bevy-cornell/CornellBox.glb", "godot-living-room/living_room.glb", "cornell-box", "veach-bidir")


def each(names):
    """The scenes as parameters."""
    return [pytest.param(name, marks=[] if name in OFTEN else pytest.mark.slow) for name in names]


def check(scene) -> None:
    """Shapes and records are the same surfaces."""
    assert len(scene.mi.shapes()) == len(scene.meshes)
    for shape, mesh in zip(scene.mi.shapes(), scene.meshes):
        assert shape.face_count() == len(mesh.indices)
        assert shape.vertex_count() == len(mesh.positions)
        low, high = mesh.positions.min(axis=0), mesh.positions.max(axis=0)
        np.testing.assert_allclose(np.array(shape.bbox().min), low, atol=1e-6 * scene.extent)
        np.testing.assert_allclose(np.array(shape.bbox().max), high, atol=1e-6 * scene.extent)
    assert len(scene.digest) == 64


@pytest.mark.parametrize("name", each(GLTF))
def test_gltf(name):
    scene = load(GIVEN / "gltf" / name)
    check(scene)
    assert sum(len(m.indices) for m in scene.meshes) == GLTF[name]


@pytest.mark.parametrize("name", each(MITSUBA))
def test_mitsuba(name):
    scene = load(GIVEN / "mitsuba" / name / "scene_mi3.xml")
    check(scene)
    assert len(scene.cameras) == 1
    assert scene.has_static_light


@pytest.mark.slow
def test_compressed_and_plain_are_the_same_room():
    plain, packed = (load(GIVEN / "gltf" / "room-soft-shadows" / f"room-{k}.glb") for k in ("decoded", "transformed"))
    check(packed)
    assert [len(m.indices) for m in plain.meshes] == [len(m.indices) for m in packed.meshes]
    # Draco quantises positions to 14 bits of the extent of each mesh or better.
    np.testing.assert_allclose(plain.bounds, packed.bounds, atol=plain.extent / 2**13)


@pytest.mark.slow
def test_the_rebuilt_cornell_box_renders_the_same_picture():
    path = GIVEN / "mitsuba" / "cornell-box" / "scene_mi3.xml"
    parameters = {"resx": 64, "resy": 64}
    original = mi.load_file(str(path), optimize=False, **parameters)
    integrator = mi.load_dict({"type": "path", "max_depth": 5})

    def blocks(scene, seed: int) -> np.ndarray:
        """[64, 3] mean radiance in blocks of 8 x 8 pixels."""
        image = mi.render(scene, sensor=original.sensors()[0], integrator=integrator, spp=32, seed=seed)
        return np.array(image)[..., :3].reshape(8, 8, 8, 8, 3).mean(axis=(1, 3)).reshape(64, 3)

    rebuilt = load(path).mi
    a = np.stack([blocks(rebuilt, seed) for seed in range(4)])
    b = np.stack([blocks(original, seed) for seed in range(10, 14)])
    assert a.mean() == pytest.approx(b.mean(), rel=0.01)
    # Welch's t for 192 block means, 4 runs each; the noise is pooled over blocks because 4 runs say little about one.
    relative = (a - b.mean(axis=0)) / np.maximum(b.mean(axis=0), 1e-3), (b - b.mean(axis=0)) / b.mean(axis=0)
    noise = np.sqrt(relative[1].var(axis=0, ddof=1).mean() / 4 * 2)
    z = relative[0].mean(axis=0) / noise
    # Blocks differ in noise by a factor of a few, so the spread of z is about 1 but its tails are longer.
    assert 0.5 < np.sqrt((z**2).mean()) < 1.5
