"""Assets, probes and caches that earlier versions wrote are read, and mean what they meant (README.md)."""

from pathlib import Path

import numpy as np
import pytest

import lightwell
from lightwell.backend import mi
from lightwell.cache import NrcIntegrator, RadianceCache, settings_of
from lightwell.graph import evaluate
from lightwell.probes.volume import coefficients

FILES = Path(__file__).parent / "0.1.0"
ASSETS = ("factored", "kdtree", "lightmap", "probes")
# The settings that cache.npz was trained with.
CACHE = {"levels": 2, "entries_log2": 8, "hidden": 8, "layers": 1, "batch": 512, "steps": 2, "train_fraction_max": 1.0,
         "max_vertices": 4, "guide": "never", "mode": "frames"}  # fmt: skip


@pytest.fixture(scope="module")
def expected() -> dict[str, np.ndarray]:
    with np.load(FILES / "expected.npz") as stored:
        return dict(stored)


def _part(expected: dict[str, np.ndarray], prefix: str) -> dict[str, np.ndarray]:
    return {name[len(prefix) :]: value for name, value in expected.items() if name.startswith(prefix)}


@pytest.mark.parametrize("name", ASSETS)
def test_an_asset_evaluates_to_the_stored_values(name, expected):
    fields = lightwell.read(FILES / f"{name}.glb").fields
    assert fields
    for field in fields:
        wanted = _part(expected, f"{name}.{field.name}.out.")
        found = evaluate(field.graph, _part(expected, f"{name}.{field.name}.in."))
        assert wanted.keys() == found.keys() and np.abs(wanted["radiance"]).max() > 1e-3
        for output, values in wanted.items():
            # Libraries of linear algebra add in different orders.
            np.testing.assert_allclose(found[output], values, rtol=1e-4, atol=1e-5, err_msg=f"{field.name}.{output}")


@pytest.mark.parametrize("name", ASSETS)
def test_an_asset_is_a_scene_that_can_be_baked_again(name):
    scene = lightwell.load(FILES / f"{name}.glb")
    assert {"green_wall", "red_wall"} <= {mesh.name for mesh in scene.meshes}


def test_a_file_of_probes_answers_with_the_stored_weights(expected):
    volume = lightwell.read(FILES / "probes.lwp")
    node, share, trust = coefficients(volume, expected["lwp.in.x"], expected["lwp.in.n"])
    assert np.array_equal(node, expected["lwp.out.node"])
    np.testing.assert_allclose(share, expected["lwp.out.share"], rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(trust, expected["lwp.out.trust"], rtol=1e-4, atol=1e-6)


def test_a_radiance_cache_renders_the_stored_picture(expected):
    place = mi.ScalarTransform4f
    scene = mi.load_dict({
        "type": "scene",
        "sensor": {
            "type": "perspective", "fov": 75,
            "to_world": place().look_at(origin=[0, 0, -0.9], target=[0, 0, 1], up=[0, 1, 0]),
            "sampler": {"type": "independent", "sample_count": 1},
            "film": {"type": "hdrfilm", "width": 16, "height": 16, "rfilter": {"type": "box"}},
        },
        "walls": {"type": "cube", "flip_normals": True,
                  "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": [0.6, 0.5, 0.4]}}},
        "lamp": {"type": "rectangle", "to_world": place().translate([0, 0.98, 0]).rotate([1, 0, 0], 90).scale(0.25),
                 "emitter": {"type": "area", "radiance": {"type": "rgb", "value": 8.0}}},
    })  # fmt: skip
    shown = NrcIntegrator(settings=settings_of({**CACHE, "view": "cache"}))
    shown.cache = RadianceCache.load(FILES / "cache.npz", scene)
    shown.cache.freeze()
    picture = np.array(mi.render(scene, integrator=shown, spp=1, seed=9))
    stored = expected["cache.out.picture"]
    # Subpixel positions of the samples may differ between versions; what the cache says there is smooth.
    assert abs(picture.mean() / stored.mean() - 1) < 0.02 and np.abs(picture - stored).mean() < 0.05 * stored.mean()
