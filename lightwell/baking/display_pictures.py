"""Path-traced pictures that the page shows beside the learned light. They are larger than the scored views and
denoised; no figure is computed from them.
"""

from __future__ import annotations

import numpy as np

from lightwell.baking.reference_budget import PICTURE_SCALE
from lightwell.core.denoise import denoise, missing
from lightwell.scenes.scene import Camera, Scene
from lightwell.scenes.variables import Variable
from lightwell.transport.camera import guide_images, total_image


def reference_picture(
    scene: Scene,
    camera: Camera,
    light: np.ndarray,
    variable: Variable | None,
    view_size: tuple[int, int],
    spp: int,
    seed: int,
    *,
    intensity: float,
    color: tuple[float, float, float],
    with_static: bool,
) -> np.ndarray:
    """Path-trace a picture for display and remove its noise where a denoiser is installed.

    Args:
        scene: Scene to look at.
        camera: Pinhole camera.
        light: [3] position of the declared light (direction to the sun).
        variable: What the declared light is; None: there is none.
        view_size: Width and height of the scored views, pixels; the picture is ``PICTURE_SCALE`` times as large.
        spp: Paths per pixel.
        seed: Seed of the sampler.
        intensity: Candela (lux) of the declared light.
        color: Linear RGB of the declared light.
        with_static: Let the emitters of the scene shine too.

    Returns:
        [H, W, 3] float32 linear radiance.
    """
    width, height = (PICTURE_SCALE * edge for edge in view_size)
    options = {"intensity": intensity, "color": color, "with_static": with_static}
    picture = total_image(scene, camera, light, variable, width, height, spp, seed, **options)
    return picture if missing() else denoise(picture, *guide_images(scene, camera, width, height))
