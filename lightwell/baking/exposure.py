"""The exposure of a bake: what its page shows, and what its file declares for every other viewer."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lightwell.baking.reference import ViewSetup
from lightwell.core.color import LUMINANCE, MIDDLE_GREY
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable
from lightwell.transport.camera import total_image

# The metered pictures have so many times fewer pixels a side than the views that are scored, and so many paths a pixel.
METER_SHARE, METER_PATHS = 4, 64
# Luminance of a pixel that counts as black, and the range of an exposure in a file (format/FORMAT.md).
BLACK, LEAST, MOST = 1e-6, 1e-6, 1e6


def metered_exposure(
    scene: Scene, variable: Variable | None, stage: ViewSetup, size: tuple[int, int], with_static: bool
) -> float:
    """Meter the exposure of a scene in small path-traced pictures of its views.

    The numbers of pixels and paths are the same however long a bake may take, so that the bytes of a file do not depend
    on it.

    Args:
        scene: The scene.
        variable: Ranges of the light; None: no light varies.
        stage: Views and their lights.
        size: Width and height of the views that are scored, pixels.
        with_static: Let the scene's own emitters shine too.

    Returns:
        Factor on radiance before tone mapping, two significant digits.
    """
    width, height = (max(edge // METER_SHARE, 1) for edge in size)
    pictures = [
        total_image(
            scene,
            camera,
            light,
            variable,
            width,
            height,
            METER_PATHS,
            k,
            intensity=stage.intensity,
            color=stage.color,
            with_static=with_static,
        )
        for k, (camera, light) in enumerate(stage.views)
    ]
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
