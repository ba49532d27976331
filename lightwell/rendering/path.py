"""Pictures of a scene by path tracing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from lightwell.cluster.attach import attached
from lightwell.core.environment_text import ROTATED, ROTATED_EXAMPLE, parse_turn
from lightwell.core.lamps import DAY, parse_day, parse_lamps, parse_settings
from lightwell.core.mover_texts import parse_movers
from lightwell.core.sun_path import DAY_EXAMPLE
from lightwell.rendering.deep import write_deep
from lightwell.rendering.settings import RenderSettings, check_picture
from lightwell.rendering.shot import Shot, write_shot
from lightwell.scenes.dimmed import dimmed
from lightwell.scenes.lamps import group_lamps
from lightwell.scenes.posing import in_state
from lightwell.scenes.variables import Sun, Turning, first_settings, has_sky, surrounds
from lightwell.transport.camera import total_image
from lightwell.transport.deep import deep_image

# What ``--set`` calls the light that is not of the scene.
POINT_LIGHT = "light"


def render_path(settings: RenderSettings) -> dict[str, Any]:
    """Path-trace and write a picture with all light: the scene's own and a point light.

    Args:
        settings: Settings of the picture.

    Returns:
        Size, paths, light, mean radiance, seconds, warnings; JSON values.

    Raises:
        ValueError: A deep picture of a light with a sky is asked for, or a node that is not there.
        OSError: The picture cannot be written.
    """
    check_picture(settings.out)
    shot = Shot.of(settings)
    moved, texts = parse_movers(settings.set)
    hour, texts = parse_day(texts)
    angle, texts = parse_turn(texts)
    place, intensity, state = _place(shot, hour, angle), shot.intensity, parse_settings(texts)
    if settings.options.deep and surrounds(shot.variable):
        dropped = "the day" if has_sky(shot.variable) else ROTATED
        raise ValueError(f"render: --deep has no sky; leave out --deep, or {dropped}")
    declared, color = first_settings(settings.vary)
    red, green, blue = np.multiply(state.pop(POINT_LIGHT, (1.0, 1.0, 1.0)), color).tolist()
    candela = (declared or 1.0) if intensity is None else intensity
    light: dict[str, Any] = {"intensity": candela, "color": (red, green, blue)}
    scene = in_state(shot.scene, moved, settings.vary)
    groups = group_lamps(scene, parse_lamps(settings.lamps)) if state else ()
    start = perf_counter()
    view = (scene, shot.camera, place, shot.variable, *settings.size, settings.spp)
    here = attached(scene, settings.loading, settings, lambda line: None)
    with here, dimmed(scene, groups, state):
        if settings.options.deep:
            radiance, depth = deep_image(*view, settings.options.deep, settings.seed, **light)
            write_deep(Path(settings.out), radiance, depth)
            return _facts(settings, shot, place, radiance[0], perf_counter() - start)
        picture = total_image(*view, settings.seed, **light, with_static=True)
    seconds = perf_counter() - start
    # Further channels show what the picture shows: nodes where --set has moved them.
    write_shot(settings, replace(shot, scene=scene), picture, None if intensity is None else 1.0)
    return _facts(settings, shot, place, picture, seconds)


def _place(shot: Shot, hour: float | None, angle: float | None) -> np.ndarray:
    """[3] place of the point light, direction to the sun at an hour, or of the map's north at an angle."""
    if angle is not None:
        if not isinstance(shot.variable, Turning):
            raise ValueError(f"set: '{ROTATED}' needs a map that turns; declare it with --vary {ROTATED_EXAMPLE}")
        try:
            return shot.variable.at(angle)
        except ValueError as error:
            raise ValueError(f"set: {error}") from None
    if hour is None:
        return shot.good_light
    if not isinstance(shot.variable, Sun):
        raise ValueError(f"set: '{DAY}' needs a day; declare one with --vary {DAY_EXAMPLE}")
    try:
        return shot.variable.at_hour(hour)
    except ValueError as error:
        raise ValueError(f"set: {error}") from None


def _facts(
    settings: RenderSettings, shot: Shot, place: np.ndarray, picture: np.ndarray, seconds: float
) -> dict[str, Any]:  # fmt: skip
    """Facts about a picture; JSON values."""
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
