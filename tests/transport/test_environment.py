"""What surrounds a scene, as a picture of all directions."""

import numpy as np

from lightwell.backend import mi
from lightwell.scenes.default_light import under_sky
from lightwell.transport.environment import environment_picture
from tests.transport.rooms import WHITE, box, build, diffuse


def one_box():
    return build("box", [box("box", (0, 0, 0), (1, 1, 1))], [diffuse(WHITE)])


def test_a_scene_without_environment_has_none():
    assert environment_picture(one_box(), 4) is None


def test_a_constant_sky_is_alike_in_all_directions():
    picture = environment_picture(under_sky(one_box()), 4)
    assert picture.shape == (4, 8, 3)
    np.testing.assert_allclose(picture, 1)


def test_a_map_is_seen_where_rays_of_the_scene_see_it():
    texels = np.random.default_rng(1).uniform(0.1, 2, (16, 32, 3)).astype(np.float32)
    turned = mi.ScalarTransform4f().rotate([0.3, 1, 0.1], 50)
    emitter = {"type": "envmap", "bitmap": mi.Bitmap(texels), "to_world": turned}
    scene = one_box()
    shapes = {f"mesh_{k}": shape for k, shape in enumerate(scene.mi.shapes())}
    scene.mi = mi.load_dict({"type": "scene", **shapes, "sky": emitter}, optimize=False)
    height = 64
    picture = environment_picture(scene, height)
    for row, column in [(10, 5), (31, 64), (20, 100), (50, 33), (2, 126)]:
        theta, phi = np.pi * (row + 0.5) / height, np.pi * ((column + 0.5) / height - 1)
        direction = [np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)]
        si = scene.mi.ray_intersect(mi.Ray3f(mi.Point3f(0.5, 5, 0.5), mi.Vector3f(*map(float, direction))))
        seen = np.array(si.emitter(scene.mi).eval(si)).ravel()
        # The mean of a pixel of 3 degrees, of a map of 11 degrees whose texels differ by 1.9 at most.
        np.testing.assert_allclose(picture[row, column], seen, atol=0.12)
