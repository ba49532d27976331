"""Base of the baselines that add a sum over samples to path-traced direct light."""

from __future__ import annotations

from typing import Any

import numpy as np

from lightwell.backend import mi


class IndirectBaseline(mi.ad.integrators.common.ADIntegrator):
    """Direct light by path tracing; a subclass adds the indirect light in ``_indirect``."""

    plugin: str
    """Name that the integrator is registered by."""

    def __init__(self, props: Any = None) -> None:
        """Read the length of the paths.

        Args:
            props: Mitsuba properties of the plugin; None: the defaults.
        """
        props = mi.Properties(self.plugin) if props is None else props
        self.longest = int(props.get("max_depth", -1))
        """Longest path in edges, -1: unlimited."""
        base = mi.Properties(self.plugin)
        base["max_depth"] = self.longest
        super().__init__(base)

    def render(
        self, scene: Any, sensor: Any = 0, seed: Any = 0, spp: int = 0, develop: bool = True, evaluate: bool = True
    ) -> Any:
        """Render an image.

        Args:
            scene: Mitsuba scene.
            sensor: Mitsuba sensor, or its index in the scene.
            seed: Seed.
            spp: Samples per pixel of the direct light and of the indirect light; 0: those of the sensor's sampler.
            develop: Ignored; the image is always developed.
            evaluate: Ignored; the image is always evaluated.

        Returns:
            [H, W, 3] tensor of linear radiance.
        """
        sensor = scene.sensors()[sensor] if isinstance(sensor, int) else sensor
        spp, first = spp or int(sensor.sampler().sample_count()), int(mi.UInt32(seed)[0])
        direct = mi.load_dict({"type": "path", "max_depth": 2 if self.longest < 0 else min(self.longest, 2)})
        picture = np.array(mi.render(scene, sensor=sensor, integrator=direct, spp=spp, seed=first))[..., :3]
        total = self._indirect(scene, sensor, first, spp, picture.shape[:2])
        return mi.TensorXf((picture + (total / spp).reshape(picture.shape)).astype(np.float32))

    def _indirect(self, scene: Any, sensor: Any, first: int, spp: int, size: tuple[int, int]) -> np.ndarray:
        """[H · W, 3] sum of indirect radiance over ``spp`` samples of a picture of ``size`` (H, W)."""
        raise NotImplementedError
