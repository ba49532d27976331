"""Passes whose light at the first hit comes from reservoirs, and the reservoirs of the last pass."""

from __future__ import annotations

from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.cache import restir, restir_gi
from lightwell.cache.frames import Rays, evaluator
from lightwell.cache.path_loop import CachePath
from lightwell.cache.radiance_cache import RadianceCache
from lightwell.cache.render_paths import render_path
from lightwell.cache.reservoir_merge import shade
from lightwell.cache.settings import EstimationSettings


class ReservoirHistory:
    """Reservoirs of direct light of the last pass, which the next one reuses."""

    def __init__(self, settings: EstimationSettings) -> None:
        """Start without reservoirs.

        Args:
            settings: Candidates and reuse of the reservoirs.
        """
        self._settings = settings
        self._unbiased = settings.restir_reuse == "unbiased"
        self._neighbours = restir.NEIGHBOURS[settings.restir_reuse]
        self.held: restir.Reservoirs | None = None
        """One per pixel; None: there are none that can be reused."""
        self._film: Any = None
        self._pose = ""
        # Weights W and candidates M of the last pass, after merging.
        self._merged: tuple[mi.Float, mi.Float] = (mi.Float(0), mi.Float(0))

    def forget(self) -> None:
        """Discard the reservoirs, after a change of the scene."""
        self.held = None

    def saw(self, sensor: Any) -> None:
        """Remember the camera that the reservoirs belong to.

        Args:
            sensor: Mitsuba sensor of the last pass.
        """
        self._pose = str(sensor.world_transform())
        self._film = restir.world_to_film(sensor)

    def direct(self, scene: Any, rays: Rays, sensor: Any, block: int) -> mi.Spectrum:
        """Compute direct light at the first hits, with temporal reuse that follows the surfaces.

        Args:
            scene: Mitsuba scene.
            rays: Camera rays of the pass.
            sensor: Mitsuba sensor that they start from.
            block: Samples per pixel of the pass; reservoirs are only kept where it is 1.

        Returns:
            [N] radiance.
        """
        ray, sampler = mi.Ray3f(rays[0]), rays[3]
        width, height = (int(x) for x in sensor.film().crop_size())
        before = self.held
        temporal = (
            not self._unbiased and block == 1 and before is not None and dr.width(before.W) == width * height
            and (self._film is not None or self._pose == str(sensor.world_transform()))
        )  # fmt: skip
        numbers = [dr.opaque(mi.UInt32, x) for x in (self._settings.restir_candidates, width, height, block)]
        candidates, *size = numbers
        past = before if temporal else restir.Reservoirs()
        held = restir.choose(scene, ray, sampler, candidates, past, temporal, self._film, *size[:2])
        dr.eval(held)
        self.held = held if block == 1 else None
        self.saw(sensor)
        L, weight, count = shade(scene, ray, sampler, held, tuple(size), self._neighbours, self._unbiased)
        self._merged = weight, count
        dr.eval(L)
        return L

    def picture(self, sensor: Any) -> np.ndarray:
        """Show the reservoirs of the last pass after merging.

        Args:
            sensor: Mitsuba sensor of the pass, which had one sample per pixel.

        Returns:
            [H, W, 3] red: logarithm of the weight W; green: candidates M over the largest number of one frame.
        """
        width, height = (int(x) for x in sensor.film().crop_size())
        weight, count = (np.array(x) for x in self._merged)
        most = self._settings.restir_candidates * (1 + restir.HISTORY) * (1 + restir.NEIGHBOURS["biased"])
        picture = np.stack([np.log1p(weight), count / most, 0 * weight], -1).astype(np.float32)
        return picture.reshape(height, width, 3)

    def bounced(
        self, scene: Any, cache: RadianceCache, rays: Rays, sensor: Any, block: int, caching: bool
    ) -> tuple[mi.Spectrum, mi.Bool]:
        """Compute the radiance along camera rays, with indirect light at the first hit from reservoirs.

        Rays that hit a mirror first follow plain paths.

        Args:
            scene: Mitsuba scene.
            cache: Cache of the scene.
            rays: Camera rays of the pass.
            sensor: Mitsuba sensor that they start from.
            block: Samples per pixel of the pass.
            caching: Whether paths may end in the cache.

        Returns:
            Radiance [N], and mask of the rays that hit a surface [N].
        """
        ray, sampler = mi.Ray3f(rays[0]), rays[3]
        sizes = [dr.opaque(mi.UInt32, int(x)) for x in (*sensor.film().crop_size(), block)]
        context, evaluate = cache.region.context, evaluator(cache)
        held, rest, usable = restir_gi.choose(scene, ray, sampler, context, evaluate, caching)
        dr.eval(held, rest, usable, sampler)
        shared, *_ = shade(scene, ray, sampler, held, tuple(sizes), self._neighbours, self._unbiased)
        path = CachePath(ray)
        path.active = ~usable
        plain, valid, *_ = render_path(
            scene, sampler, path, context, evaluate, mi.Float(1), caching, "biased", True
        )  # fmt: skip
        L = dr.select(usable, rest + shared, dr.select(dr.all(dr.isfinite(plain)), plain, 0))
        dr.eval(L)
        return L, valid | usable
