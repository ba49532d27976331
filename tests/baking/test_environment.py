"""What surrounds a scene as its file stores it."""

import io

import numpy as np
from PIL import Image

from lightwell.backend import mi
from lightwell.baking.environment import environment_entry
from lightwell.core.lamps import parse_lamps
from lightwell.scenes.default_light import under_sky
from lightwell.scenes.lamps import group_lamps
from tests.transport.rooms import WHITE, box, build, diffuse


def surrounded(emitter):
    scene = build("box", [box("box", (0, 0, 0), (1, 1, 1))], [diffuse(WHITE)])
    shapes = {f"mesh_{k}": shape for k, shape in enumerate(scene.mi.shapes())}
    scene.mi = mi.load_dict({"type": "scene", **shapes, "sky": emitter}, optimize=False)
    return scene


def test_a_constant_sky_is_one_radiance():
    scene = under_sky(build("box", [box("box", (0, 0, 0), (1, 1, 1))], [diffuse(WHITE)]))
    entry = environment_entry(scene, (), None)
    assert entry.radiance == (1, 1, 1) and entry.picture is None and entry.lamp is None


def test_a_black_sky_and_none_are_left_out():
    black = surrounded({"type": "constant", "radiance": {"type": "rgb", "value": 0.0}})
    assert environment_entry(black, (), None) is None
    bare = build("box", [box("box", (0, 0, 0), (1, 1, 1))], [diffuse(WHITE)])
    assert environment_entry(bare, (), None) is None


def test_a_map_is_a_small_picture_whose_sun_is_white():
    texels = np.full((32, 64, 3), 0.2, np.float32)
    texels[:16, :, 2], texels[8, 20] = 0.6, 500
    scene = surrounded({"type": "envmap", "bitmap": mi.Bitmap(texels)})
    entry = environment_entry(scene, (), 2.0)
    assert entry.radiance == (2, 2, 2) and len(entry.picture.data) < 30_000
    stored = np.array(Image.open(io.BytesIO(entry.picture.data)))
    assert stored.shape == (256, 512, 3) and stored.max() == 255
    shown = 2 * 2.0 ** (14 * (stored[[100, 200], 300] / 255 - 1))
    np.testing.assert_allclose(shown, [[0.2, 0.2, 0.6], [0.2, 0.2, 0.2]], rtol=0.06)


def test_a_sky_with_a_switch_names_its_lamp():
    scene = surrounded({"type": "constant", "radiance": {"type": "rgb", "value": [0.1, 0.2, 0.3]}})
    lamps = group_lamps(scene, parse_lamps(["sky=environment"]))
    entry = environment_entry(scene, lamps, None)
    np.testing.assert_allclose(entry.radiance, (0.1, 0.2, 0.3), rtol=1e-5)
    assert entry.lamp == 0
