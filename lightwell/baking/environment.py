"""What surrounds a scene as its file stores it: one radiance, or a small picture for the background of viewers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lightwell.asset.records import EnvironmentEntry
from lightwell.core.color import WHITE
from lightwell.graph.pictures import encode
from lightwell.scenes.lamps import LampGroup
from lightwell.scenes.scene import Scene
from lightwell.transport.environment import environment_picture

# Rows of the picture, 0.7 degrees each, and how it is encoded.
HEIGHT, CODEC = 256, "webp95"
# Difference of directions, relative to the brightest one, that is none.
SAME = 1e-4
# A byte is a logarithm: so many factors of two from 255 down to 0, which is black. A step is 4 %.
STOPS = 14


def environment_entry(scene: Scene, lamps: Sequence[LampGroup], exposure: float | None) -> EnvironmentEntry | None:
    """Store what surrounds a scene, for viewers to show behind it.

    Args:
        scene: The scene as it was traced.
        lamps: Groups of its own lights that have a switch.
        exposure: Factor on radiance before tone mapping that suits the scene; None: not known.

    Returns:
        The entry of the file; None where nothing surrounds the scene, or nothing that shines.
    """
    picture = environment_picture(scene, HEIGHT)
    if picture is None or not picture.any():
        return None
    # One that turns is none of the scene's own emitters: it follows its variable.
    numbers = [k for k, emitter in enumerate(scene.mi.emitters()) if emitter.is_environment()]
    lamp = next((k for k, group in enumerate(lamps) if set(numbers) & set(group.emitters)), None)
    if np.ptp(picture, axis=(0, 1)).max() <= SAME * picture.max():
        return EnvironmentEntry(_color(picture.mean(axis=(0, 1))), lamp=lamp)
    # What is brighter, such as a sun, is as white in a viewer.
    white = min(float(picture.max()), WHITE / (exposure or _usual_exposure(picture)))
    texels = _logarithms(picture / white)
    return EnvironmentEntry(_color([white] * 3), encode(texels, CODEC), lamp)


def _logarithms(values: np.ndarray) -> np.ndarray:
    """The bytes of values from 0 to 1; what is brighter is 255."""
    return np.rint(255 * (1 + np.log2(np.clip(values, 2.0**-STOPS, 1)) / STOPS)).astype(np.uint8)


def _usual_exposure(picture: np.ndarray) -> float:
    """An exposure that shows the mean of a sky as white."""
    return 1 / max(float(picture.mean()), 1e-30)


def _color(values: Sequence[float] | np.ndarray) -> tuple[float, float, float]:
    red, green, blue = (float(f"{float(v):.6g}") for v in values)
    return red, green, blue
