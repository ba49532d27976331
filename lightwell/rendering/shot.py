"""The scene, camera and light of a picture."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lightwell.core.environment_text import ROTATED
from lightwell.core.image_io import write_picture
from lightwell.rendering.settings import RenderSettings
from lightwell.scenes import load
from lightwell.scenes.placing import initial_light, sample_cameras
from lightwell.scenes.scene import Camera, Scene
from lightwell.scenes.variables import Variable, declare
from lightwell.transport.environment import with_turning


@dataclass(frozen=True)
class Shot:
    """A loaded scene, one of its cameras, and a light."""

    scene: Scene
    camera: Camera
    variable: Variable
    light: np.ndarray | None
    """[3] position of the point light, metres; None: the integrator's default."""
    intensity: float | None
    """Candela; None: 1, and pictures for screens are exposed automatically."""

    @staticmethod
    def of(settings: RenderSettings) -> Shot:
        """Load the scene and find camera and light.

        Args:
            settings: Settings of the picture.

        Returns:
            Scene, camera and light.
        """
        scene = with_turning(load(settings.scene, **settings.loading), settings.vary)
        if scene.surrounding is not None and settings.cluster:
            raise ValueError(f"render: --cluster traces what stands still; leave it out, or drop {ROTATED} from --vary")
        light = None if settings.light is None else np.asarray(settings.light, np.float32)
        return Shot(scene, _camera(scene, settings.camera), declare(settings.vary, scene), light, settings.intensity)

    @property
    def good_light(self) -> np.ndarray:
        """[3] requested position of the light, or one that lights much of the picture."""
        return initial_light(self.scene, self.variable, self.camera) if self.light is None else self.light


def _camera(scene: Scene, index: int) -> Camera:
    if not scene.cameras and index == 0:
        return sample_cameras(scene, declare((), scene), 1, 0)[0]
    if not 0 <= index < len(scene.cameras):
        raise ValueError(f"render: the scene has {len(scene.cameras)} cameras, --camera {index} is none of them")
    return scene.cameras[index]


def write_shot(settings: RenderSettings, shot: Shot, picture: np.ndarray, exposure: float | None) -> None:
    """Write a picture, with the output variables that are asked for.

    Args:
        settings: Settings of the picture.
        shot: Scene and camera.
        picture: [H, W, 3] linear radiance.
        exposure: Factor on the radiance for a .png; None: automatic.
    """
    if not settings.aov:
        return write_picture(Path(settings.out), picture, exposure)
    from lightwell.rendering.aov import channels, write_with_channels

    write_with_channels(Path(settings.out), picture, channels(shot.scene, shot.camera, *settings.size, settings.aov))
