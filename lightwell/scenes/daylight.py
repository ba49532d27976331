"""The clear sky of a path of the sun: Mitsuba's ``sunsky``, read at some times and kept as numbers (``scenes.sky``).

Its sun is the same from 2 degrees down, and its sky ends at the horizon; what is lower is ``scenes.twilight``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import lru_cache
from typing import Any

import numpy as np

from lightwell.backend import dr, mi, upload_floats
from lightwell.scenes.sky import COEFFICIENTS, Sky, cell_directions, evaluate, light_of_sphere
from lightwell.scenes.twilight import CLEAR, DISC, HORIZON, SUN_OF_MODEL, low_sunlight, twilight

# Times at which the sky is read, closer together at both ends; and elevations of a low sun at which it is read besides,
# degrees, where light changes fast.
KEYS = 13
LOW_KEYS = (-5.0, -4.0, -3.0, -2.0, -1.0, -0.5, -DISC, HORIZON, 0.5, 1.0, 2.0, 4.0)
# Steps of a path in which these elevations are looked for, and times that are one.
PATH_STEPS, SAME_TIME = 4096, 2e-3
# Figures of the numbers that are kept.
DIGITS = 6
# Rings and spokes of the quadrature over the sun's disc, and its half aperture in degrees (Mitsuba's default / 2).
RINGS, SPOKES, HALF_APERTURE = 24, 16, 0.5358 / 2
# Directions by which the formula is found: those of the cells, and rings from NEAREST to WIDEST degrees about the sun,
# above LOWEST (sine of the elevation).
NEAR_SUN, NEAREST, WIDEST, LOWEST = 12, 0.5, 40.0, 0.01
# Added to the radiance, relative to its mean, by which an error is divided; evaluations of one search.
DARK, MOST_TRIES = 0.1, 100
# Bounds of a, b, e and h, what a search may start from, and its starts besides the result for a sun that is near.
BOUNDS = ((-20.0, -20.0, -60.0, 0.0), (20.0, 0.0, 5.0, 0.99))
SAFE = ((-19.0, -19.0, -59.0, 0.01), (19.0, -0.01, 4.0, 0.98))
STARTS = ((-1.2, -0.3, -0.4, 0.65), (-1.2, -0.3, -4.0, 0.6), (-1.0, -0.1, -8.0, 0.8))
# Largest relative error of a search after which no other start is tried.
EXACT = 1e-3
# Albedo of the ground in the model of the sky; Mitsuba's default.
GROUND = 0.3
# Which of a … i the radiance is linear in.
LINEAR = np.array([name in "cdfgi" for name in "abcdefghi"])
NONLINEAR = ~LINEAR


@lru_cache(maxsize=8)
def clear_sky(
    times: tuple[float, ...], path: tuple[tuple[float, ...], ...], turbidity: float, hours: tuple[float, ...] = ()
) -> Sky:
    """Read sun and sky along a path.

    Args:
        times: ``key_times`` of the path.
        path: Unit directions to the sun then, down to civil twilight.
        turbidity: Haze of the air, 1 to 10.
        hours: Clock at t = 0, 1/2 and 1; empty where the path is not that of a day.

    Returns:
        The sky.
    """
    directions, suns, models, cells = cell_directions(), [], [], []
    guess = np.zeros((3, COEFFICIENTS))
    guess[:, NONLINEAR] = STARTS[0]
    for direction in np.asarray(path):
        seen = _raised(direction, HORIZON)
        suns.append(_sunlight(direction, turbidity))
        guess, scale = _fitted(seen, turbidity, guess)
        models.append(np.where(LINEAR, guess * scale[:, None], guess))
        lit = twilight(direction, seen, models[-1])
        models[-1] = np.where(LINEAR, models[-1] * lit, models[-1])
        cells.append(evaluate(models[-1], directions[..., 1], directions @ direction).mean(axis=1))
    level = light_of_sphere(np.array(suns), np.array(cells))
    brightest = float(level.max())
    return Sky(
        times,
        tuple(_rounded(sun / brightest) for sun in suns),
        tuple(_rounded(np.where(LINEAR, model / brightest, model)) for model in models),
        _rounded(level / brightest),
        turbidity,
        hours,
    )


def _rounded(values: np.ndarray) -> tuple[float, ...]:
    return tuple(float(f"{v:.{DIGITS}g}") for v in np.ravel(values))


def key_times(path: Callable[[np.ndarray], np.ndarray] | None = None) -> np.ndarray:
    """Return the times at which a sky is read.

    Args:
        path: Directions [N, 3] to the sun at times [N]; None: one that does not come near the horizon.

    Returns:
        Times from 0 to 1: ``KEYS``, and those at which the sun is at one of ``LOW_KEYS``.
    """
    even = 0.5 - 0.5 * np.cos(np.pi * np.arange(KEYS) / (KEYS - 1))
    if path is None:
        return even
    t = np.linspace(0, 1, PATH_STEPS + 1)
    height = np.degrees(np.arcsin(np.clip(path(t)[:, 1], -1, 1)))
    found = []
    for low in LOW_KEYS if height.min() < SUN_OF_MODEL - 0.5 else ():
        k = np.flatnonzero((height[:-1] < low) != (height[1:] < low))
        found.append(t[k] + (low - height[k]) / (height[k + 1] - height[k]) / PATH_STEPS)
    low_times = np.concatenate([np.zeros(0), *found])
    low_times = low_times[(low_times > SAME_TIME) & (low_times < 1 - SAME_TIME)]
    away = np.abs(even[:, None] - low_times).min(axis=1, initial=1)
    kept = even[(away > SAME_TIME) | (even == 0) | (even == 1)]
    return np.sort(np.concatenate([kept, low_times]))


def radiance_of_mitsuba(
    sun: np.ndarray, turbidity: float, directions: np.ndarray, *, sky_scale: float = 1.0, sun_scale: float = 0.0
) -> np.ndarray:
    """Evaluate Mitsuba's ``sunsky``.

    Args:
        sun: [3] unit direction to the sun.
        turbidity: Haze of the air, 1 to 10.
        directions: [N, 3] unit directions, y is up.
        sky_scale: Factor of the sky.
        sun_scale: Factor of the sun.

    Returns:
        [N, 3] radiance.
    """
    si = dr.zeros(mi.SurfaceInteraction3f, len(directions))
    si.wi = -mi.Vector3f(*(upload_floats(np.ascontiguousarray(c, np.float32)) for c in np.asarray(directions).T))
    found = mi.load_dict(sunsky(sun, turbidity, sky_scale=sky_scale, sun_scale=sun_scale)).eval(si)
    return np.array(found, np.float64).T


def sunsky(sun: np.ndarray, turbidity: float, *, sky_scale: float = 1.0, sun_scale: float = 1.0) -> dict[str, Any]:
    """Describe Mitsuba's emitter of sun and sky, with y up.

    Args:
        sun: [3] unit direction to the sun.
        turbidity: Haze of the air, 1 to 10.
        sky_scale: Factor of the sky.
        sun_scale: Factor of the sun.

    Returns:
        Dictionary for ``mi.load_dict``.
    """
    # Mitsuba's sky has z up: its x, y, z are x, -z, y here.
    up = mi.ScalarTransform4f().rotate([1, 0, 0], -90)
    return {
        "type": "sunsky", "sun_direction": [float(c) for c in sun], "turbidity": float(turbidity),
        "sky_scale": sky_scale, "sun_scale": sun_scale, "to_world": up,
        "albedo": {"type": "rgb", "value": [GROUND] * 3},
    }  # fmt: skip


def _raised(direction: np.ndarray, elevation: float) -> np.ndarray:
    """A direction, or that of its azimuth at an elevation in degrees where it is lower."""
    sine = np.sin(np.radians(elevation))
    if direction[1] >= sine:
        return direction
    flat = np.array([direction[0], 0, direction[2]]) / np.hypot(direction[0], direction[2])
    return np.cos(np.radians(elevation)) * flat + np.array([0, sine, 0])


def _sunlight(direction: np.ndarray, turbidity: float) -> np.ndarray:
    """[3] irradiance of the sun's disc at normal incidence, below ``SUN_OF_MODEL`` by the air in between."""
    known = [_raised(direction, elevation) for elevation in (SUN_OF_MODEL, *CLEAR)]
    lowest, *clear = (_disc(way, turbidity) for way in known)
    return lowest if known[0] is direction else low_sunlight(direction, lowest, clear)


def _disc(direction: np.ndarray, turbidity: float) -> np.ndarray:
    """[3] irradiance of the sun's disc as Mitsuba has it."""
    ring, spoke = np.divmod(np.arange(RINGS * SPOKES), SPOKES)
    # Rings of one area each; the disc is so small that its cosine is 1.
    angle = np.radians(HALF_APERTURE) * np.sqrt((ring + 0.5) / RINGS)
    around = 2 * np.pi * (spoke + 0.5) / SPOKES
    seen = np.cos(angle)[:, None] * direction + np.sin(angle)[:, None] * _circle(direction, around)
    radiance = radiance_of_mitsuba(direction, turbidity, seen, sky_scale=0.0, sun_scale=1.0)
    return np.maximum(radiance.mean(axis=0), 0) * np.pi * np.radians(HALF_APERTURE) ** 2


def _circle(axis: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """[N, 3] unit directions across an axis."""
    across = np.cross(axis, [1.0, 0, 0] if abs(axis[0]) < 0.7 else [0, 1.0, 0])
    across /= np.linalg.norm(across)
    return np.cos(angle)[:, None] * across + np.sin(angle)[:, None] * np.cross(axis, across)


def _fitted(direction: np.ndarray, turbidity: float, guess: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """[3, 9] numbers of the formula that give Mitsuba's sky over its mean, found from a guess, and [3] the means."""
    spread = cell_directions(1)[::3, 0]
    around = np.linspace(0, 2 * np.pi, NEAR_SUN, endpoint=False)
    angles = np.radians(np.geomspace(NEAREST, WIDEST, NEAR_SUN))
    near = np.concatenate([np.cos(a) * direction + np.sin(a) * _circle(direction, around) for a in angles])
    directions = np.concatenate([spread, near[near[:, 1] > LOWEST]])
    height, cosine = directions[:, 1], directions @ direction
    wanted = radiance_of_mitsuba(direction, turbidity, directions)
    scale = wanted.mean(axis=0)
    models = []
    for c in range(3):
        starts = (guess[c][NONLINEAR], *map(np.asarray, STARTS))
        found = (_search(height, cosine, wanted[:, c] / scale[c], start) for start in starts)
        best = min(_until_exact(found), key=lambda pair: pair[1])
        models.append(best[0])
    return np.array(models), scale


def _until_exact(found: Iterator[tuple[np.ndarray, float]]) -> Iterator[tuple[np.ndarray, float]]:
    """Results of searches, up to the first that is exact."""
    for model, error in found:
        yield model, error
        if error < EXACT:
            return


def _search(height: np.ndarray, cosine: np.ndarray, target: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, float]:
    """[9] numbers of one colour, and their error; the linear ones are solved for (variable projection)."""
    from scipy.optimize import least_squares

    weight = 1 / (target + DARK)

    def model(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        whole = np.zeros((6, COEFFICIENTS))
        whole[:, NONLINEAR] = x
        whole[np.arange(5), np.flatnonzero(LINEAR)] = 1
        # Rows: the part of each linear number.
        columns = evaluate(whole[:5], height, cosine) * weight[:, None]
        whole[5, LINEAR] = np.linalg.lstsq(columns, target * weight, rcond=None)[0]
        return whole[5], columns @ whole[5, LINEAR] - target * weight

    found = least_squares(lambda x: model(x)[1], np.clip(start, *SAFE), bounds=BOUNDS, max_nfev=MOST_TRIES)
    return model(found.x)[0], float(np.abs(found.fun).max())
