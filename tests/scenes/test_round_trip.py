"""Built-in scenes through OBJ and USD: the same surfaces, materials and lamps come back."""

import numpy as np
import pytest
from scene_writers import write_obj, write_usd

from lightwell.scenes import load
from lightwell.scenes.scene import Scene


def surfaces(scene: Scene) -> dict[tuple, np.ndarray]:
    """Area and centre of the surface of each kind of material: colour, finish, light, picture."""
    found: dict[tuple, np.ndarray] = {}
    for mesh in scene.meshes:
        material = scene.materials[mesh.material]
        textured = material.base_color_texture is not None
        color = (1.0, 1.0, 1.0) if textured else material.base_color[:3]
        kind = (*np.round([*color, material.roughness, material.metallic, *material.emissive], 4).tolist(), textured)
        areas = mesh.triangle_areas
        middle = mesh.positions[mesh.indices].mean(axis=1)
        moments = np.array([areas.sum(), *(areas[:, None] * middle).sum(axis=0)])
        found[kind] = found.get(kind, 0) + moments
    return found


def same(found: Scene, expected: Scene) -> None:
    ours, theirs = surfaces(found), surfaces(expected)
    assert ours.keys() == theirs.keys()
    for kind, moments in theirs.items():
        np.testing.assert_allclose(ours[kind], moments, rtol=1e-4, atol=1e-3)


@pytest.mark.parametrize("name", ["two-rooms", pytest.param("courtyard", marks=pytest.mark.slow)])
def test_a_scene_comes_back_from_obj_and_usd(name, tmp_path):
    scene = load(name)
    write_obj(scene, tmp_path / "room.obj")
    drawn = load(tmp_path / "room.obj")
    same(drawn, scene)
    # Objects stay apart, though they share a material.
    assert len(drawn.meshes) == len(scene.meshes)
    write_usd(scene, tmp_path / "room.usdc")
    read = load(tmp_path / "room.usdc")
    same(read, scene)
    lamps = [light for light in scene.lights if light.kind == "point"]
    assert len(read.lights) == len(lamps)
    for found, lamp in zip(read.lights, lamps):
        assert found.position == pytest.approx(lamp.position, abs=1e-4)
        assert found.intensity == pytest.approx(lamp.intensity, rel=1e-4)
