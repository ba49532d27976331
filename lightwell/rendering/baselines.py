"""Pictures of a scene with the baselines of the literature."""

from __future__ import annotations

import time
from typing import Any

from lightwell.backend import mi
from lightwell.rendering import irradiance_cache, virtual_point_lights
from lightwell.rendering.nrc import Film
from lightwell.rendering.settings import RenderSettings
from lightwell.rendering.shot import write_shot


def integrator_of(settings: RenderSettings) -> Any:
    """Make the integrator that the settings name.

    Args:
        settings: Settings of the picture, with integrator 'vpl' or 'irradiance-cache'.

    Returns:
        Mitsuba integrator.
    """
    options = settings.options
    if settings.integrator == "vpl":
        virtual_point_lights.register()
        return mi.load_dict({"type": "lightwell_vpl", "paths": options.paths, "clamp": options.clamp})
    irradiance_cache.register()
    return mi.load_dict({"type": "lightwell_irradiance_cache", "accuracy": options.accuracy})


def render_baseline(settings: RenderSettings) -> dict[str, Any]:
    """Render and write one picture with virtual point lights or an irradiance cache.

    Args:
        settings: Settings of the picture.

    Returns:
        Facts about the picture; JSON values.
    """
    film, integrator = Film.checked(settings), integrator_of(settings)
    start = time.perf_counter()
    picture = film.render(integrator, settings.seed)
    seconds = time.perf_counter() - start
    write_shot(settings, film.shot, picture, film.exposure)
    width, height = settings.size
    return {
        "scene": film.live.name, "width": width, "height": height, "spp": settings.spp,
        "integrator": settings.integrator, "seconds": seconds, "mean_radiance": float(picture.mean()),
    }  # fmt: skip
