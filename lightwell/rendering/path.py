"""Pictures of a scene by path tracing, or with the radiance cache."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from lightwell.core.image_io import check_picture_name, write_picture
from lightwell.rendering.settings import RenderSettings
from lightwell.scenes import load
from lightwell.scenes.placing import initial_light, sample_cameras
from lightwell.scenes.scene import Camera, Scene
from lightwell.scenes.variables import Variable, declare
from lightwell.transport.camera import total_image


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
        scene = load(settings.scene, **settings.loading)
        light = None if settings.light is None else np.asarray(settings.light, np.float32)
        return Shot(scene, _camera(scene, settings.camera), declare((), scene), light, settings.intensity)

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


def render(settings: RenderSettings, quiet: bool = True) -> dict[str, Any]:
    """Render a picture, or a sequence of pictures.

    A mistake of the user is a ``ValueError`` of one line with the cure, a file that cannot be read or written an
    ``OSError``.

    Args:
        settings: Settings of the picture.
        quiet: Whether a sequence shows no progress on standard error.

    Returns:
        Size, paths, light, mean radiance, seconds, warnings; JSON values.
    """
    if settings.integrator == "nrc":
        from lightwell.rendering.nrc import render_nrc

        return render_nrc(settings, quiet)
    return render_path(settings)


def render_path(settings: RenderSettings) -> dict[str, Any]:
    """Path-trace and write a picture with all light: the scene's own and a point light.

    Args:
        settings: Settings of the picture.

    Returns:
        Size, paths, light, mean radiance, seconds, warnings; JSON values.
    """
    check_picture_name(settings.out, "render")
    shot = Shot.of(settings)
    place, intensity = shot.good_light, shot.intensity
    start = perf_counter()
    picture = total_image(
        shot.scene,
        shot.camera,
        place,
        shot.variable,
        *settings.size,
        settings.spp,
        settings.seed,
        intensity=1.0 if intensity is None else intensity,
        with_static=True,
    )
    seconds = perf_counter() - start
    write_picture(Path(settings.out), picture, None if intensity is None else 1.0)
    return {
        "scene": shot.scene.name,
        "width": settings.size[0],
        "height": settings.size[1],
        "spp": settings.spp,
        "light": [float(c) for c in place],
        "mean_radiance": float(picture.mean()),
        "seconds": seconds,
        "warnings": shot.scene.warnings,
    }
