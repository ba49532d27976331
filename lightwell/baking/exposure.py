"""The exposure of a bake: what its page shows, and what its file declares for every other viewer."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lightwell.baking.evaluate import lights_of_views, lit_views
from lightwell.baking.poses import standing, view_pose
from lightwell.baking.view_setup import ViewSetup
from lightwell.core.color import LUMINANCE, MIDDLE_GREY
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable
from lightwell.transport.camera import total_image

# What is metered: so many views, their pixels, and paths a pixel. None follows the settings of the report.
METER_VIEWS, METER_SIZE, METER_PATHS = 4, (56, 35), 64
# Luminance of a pixel that counts as black, and the range of an exposure in a file (format/FORMAT.md).
BLACK, LEAST, MOST = 1e-6, 1e-6, 1e6


def metered_exposure(scene: Scene, variable: Variable | None, stage: ViewSetup, seed: int, with_static: bool) -> float:
    """Meter the exposure of a scene in small path-traced pictures of its views.

    Views, pixels and paths are the same however a bake is scored and however long it may take, so that the bytes of a
    file do not depend on it.

    Args:
        scene: The scene.
        variable: Ranges of the light; None: no light varies.
        stage: Intensity and colour of the light; its views are taken where they are as many as are metered.
        seed: Seed of the bake.
        with_static: Let the scene's own emitters shine too.

    Returns:
        Factor on radiance before tone mapping, two significant digits.
    """
    known = stage.views if len(stage.views) == METER_VIEWS else None
    views = known or lit_views(scene, variable, METER_VIEWS, seed)
    width, height = METER_SIZE
    cameras = [camera for camera, _ in views]
    places = [light.places if known else lights_of_views(scene, light.variable, cameras, seed) for light in stage.more]
    pictures = []
    for k, (camera, light) in enumerate(views):
        shown = standing(scene, view_pose(scene, k))
        size = (width, height, METER_PATHS, k)
        first = {"intensity": stage.intensity, "color": stage.color, "with_static": with_static}
        picture = total_image(shown, camera, light, variable, *size, **first)
        for other, of_views in zip(stage.more, places):
            options = {"intensity": other.intensity, "color": other.color}
            picture = picture + total_image(shown, camera, of_views[k], other.variable, *size, **options)
        pictures.append(picture)
    return exposure_of(pictures)


def exposure_of(pictures: Sequence[np.ndarray]) -> float:
    """Compute an exposure: log-average luminance at middle grey (Reinhard et al. 2002).

    It lies half way between those of the first and of the brightest picture, so that both are legible.

    Args:
        pictures: [H, W, 3] radiance each; what is not finite is left out.

    Returns:
        Factor on radiance, two significant digits, 1e-6 to 1e6; 1 where all is black.
    """
    averages = []
    for picture in pictures:
        luminance = picture.reshape(-1, 3) @ LUMINANCE
        lit = luminance[np.isfinite(luminance) & (luminance > BLACK)]
        if len(lit):
            averages.append(float(np.mean(np.log(lit))))
    if not averages:
        return 1.0
    factor = MIDDLE_GREY / np.exp(0.5 * (averages[0] + max(averages)))
    return float(f"{np.clip(factor, LEAST, MOST):.2g}")
