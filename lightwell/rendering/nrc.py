"""Pictures of a scene with the radiance cache."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np

from lightwell.backend import mi
from lightwell.cache.integrator import NrcIntegrator
from lightwell.cache.live_scene import Lamp, LiveScene
from lightwell.cache.radiance_cache import RadianceCache
from lightwell.cache.settings import CacheSettings
from lightwell.cache.warm_start import BakedLight, warm_start
from lightwell.rendering.settings import RenderSettings, check_picture
from lightwell.rendering.shot import Shot, write_shot


class Film:
    """A scene, a film of the requested size, and a camera that can turn around its target."""

    def __init__(self, settings: RenderSettings) -> None:
        """Load the scene.

        Args:
            settings: Settings of the picture.

        Raises:
            ValueError: A cluster is asked for.
        """
        if settings.cluster:
            raise ValueError("render: the radiance cache learns in one process; leave --cluster out")
        shot = self.shot = Shot.of(settings)
        width, height = settings.size
        lamp = None
        if shot.light is not None or shot.intensity is not None:
            lamp = Lamp(shot.good_light, 1.0 if shot.intensity is None else shot.intensity)
        elif not shot.scene.has_static_light:
            # In free air, in front of the camera: the middle of the scene may lie in a wall.
            lamp = Lamp(shot.good_light, shot.scene.core_extent**2)
        self.live = LiveScene(shot.scene, 16, shot.camera, lamp)
        self.spp = settings.spp
        self.exposure = None if shot.intensity is None else 1.0
        """Of pictures for screens; None: automatic."""
        self.sensor = mi.load_dict(
            {
                "type": "perspective",
                "fov": self.live.camera.fov,
                "fov_axis": "y",
                "to_world": self.live.camera.pose(),
                "sampler": {"type": "independent", "sample_count": settings.spp},
                "film": {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"}},
            }
        )

    @staticmethod
    def checked(settings: RenderSettings) -> Film:
        """Check the settings of a single picture and load the scene.

        Args:
            settings: Settings of the picture.

        Returns:
            The film.

        Raises:
            ValueError: The picture's name is of no known kind.
            OSError: The picture cannot be written.
        """
        check_picture(settings.out)
        return Film(settings)

    def turn(self, radians: float) -> None:
        """Turn the camera around its target.

        Args:
            radians: Angle about the vertical axis.
        """
        self.live.camera.orbit(radians, 0, 0)
        self.live.camera.apply(self.sensor)

    def render(self, integrator: Any, seed: int) -> np.ndarray:
        """Render the picture.

        Args:
            integrator: Mitsuba integrator.
            seed: Seed of the sampler.

        Returns:
            [H, W, 3] float32 linear radiance.
        """
        image = mi.render(self.live.scene, sensor=self.sensor, integrator=integrator, spp=self.spp, seed=seed)
        return np.array(image)[..., :3]


def render_nrc(settings: RenderSettings, cache: CacheSettings) -> dict[str, Any]:
    """Render and write one picture with the radiance cache.

    Args:
        settings: Settings of the picture.
        cache: Settings of the radiance cache.

    Returns:
        Facts about the picture; JSON values, None where a number is infinite or unknown.

    Raises:
        ValueError: The cache would start from a bake, but is not used.
    """
    if settings.options.cache_from is not None and not cache.caching:
        raise ValueError(
            "render: with estimator=guided or termination_c=inf no path ends in a cache; leave out --cache-from"
        )
    film = Film.checked(settings)
    integrator = NrcIntegrator(settings=cache)
    start = time.perf_counter()
    if settings.options.cache_from is not None:
        integrator.cache = RadianceCache(cache)
        baked = BakedLight.read(settings.options.cache_from)
        warm_start(integrator.cache, film.live, film.shot.scene, baked, settings.seed)
    picture = film.render(integrator, settings.seed)
    seconds = time.perf_counter() - start
    write_shot(settings, film.shot, picture, film.exposure)
    image = integrator.last
    assert image is not None
    stats = [t for t in image.stats if t.steps]
    width, height = settings.size
    c = cache.paths.termination_c
    facts = {
        "scene": film.live.name, "width": width, "height": height, "spp": settings.spp, "integrator": "lightwell_nrc",
        "seconds": seconds, "training_seconds": image.seconds["train"],
        "training_steps": sum(t.steps for t in stats), "records_dropped": sum(t.dropped for t in image.stats),
        "termination_c": c, "termination_sdk_t": math.sqrt(c) / (4 * math.pi),
        "loss": stats[-1].loss if stats else None,
        "bias": [_finite(x) for x in stats[-1].bias] if stats else None,
        "mean_radiance": float(picture.mean()),
    }  # fmt: skip
    return {name: _finite(value) for name, value in facts.items()}


def _finite(value: Any) -> Any:
    """A value as JSON knows it, which has no infinite numbers: None in place of one."""
    return None if isinstance(value, float) and not math.isfinite(value) else value
