"""Pictures for display: larger than those that are scored, and without visible noise."""

import numpy as np

from lightwell.asset.page import PageView
from lightwell.baking.display_pictures import reference_picture
from lightwell.baking.reference import with_light
from lightwell.baking.reference_budget import PICTURE_SCALE
from lightwell.scenes import Camera, load
from lightwell.scenes.placing import initial_light
from lightwell.scenes.variables import declare
from lightwell.transport.camera import guide_images, total_image

SIZE = (32, 20)


def test_a_reference_is_larger_and_nearer_to_many_paths():
    scene = load("cornell")
    variable, camera = declare((), scene), scene.cameras[0]
    light = initial_light(scene, variable, camera)
    options = {"intensity": 5.0, "color": (1.0, 1.0, 1.0), "with_static": True}
    width, height = (PICTURE_SCALE * edge for edge in SIZE)
    made = reference_picture(scene, camera, light, variable, SIZE, 8, 0, **options)
    assert made.shape == (height, width, 3)
    noisy = total_image(scene, camera, light, variable, width, height, 8, 0, **options)
    many = total_image(scene, camera, light, variable, width, height, 256, 7, **options)
    error = lambda image: np.mean(((image - many) / (many + 0.05)) ** 2)  # noqa: E731
    assert error(made) < 0.5 * error(noisy)


def test_guides_are_reflectances_and_normals():
    scene = load("cornell")
    albedo, normal = guide_images(scene, scene.cameras[0], 24, 16)
    assert albedo.min() >= 0 and albedo.max() <= 1
    lengths = np.linalg.norm(normal, axis=-1)
    assert lengths.max() <= 1 + 1e-5 and np.median(lengths) > 0.95


def test_black_views_are_left_out_of_the_page_unless_all_are():
    def views(*levels: float) -> list[PageView]:
        camera = Camera((0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
        return [PageView(f"{k}", camera, (0.0, 0.0, 0.0), np.full((2, 3, 3), x)) for k, x in enumerate(levels)]

    assert [view.name for view in with_light(views(1.0, 0.0, 2e-3, 5e-4))] == ["0", "2"]
    assert len(with_light(views(0.0, 0.0))) == 2 and with_light([]) == []
