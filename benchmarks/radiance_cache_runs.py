"""Timed renderings that the figures of the radiance cache share."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from radiance_cache_truth import pixels

from lightwell.backend import dr
from lightwell.cache import NrcIntegrator, settings_of


def timed(run: Callable[[], Any]) -> tuple[np.ndarray, float]:
    """(picture, wall seconds)."""
    wall = time.perf_counter()
    image = run()
    dr.eval(image)
    dr.sync_thread()
    return pixels(image), time.perf_counter() - wall


def cold(options: dict[str, Any], scene: Any) -> NrcIntegrator:
    """A new integrator whose tables of the scene are ready and which has learned nothing."""
    nrc = NrcIntegrator(settings=settings_of(options))
    nrc.cache_of(scene)
    return nrc
