"""Light of a sun near and below the horizon, where Mitsuba's ``sunsky`` ends.

* The sun: below ``SUN_OF_MODEL`` it is dimmed by the air in between, Beer and Lambert's law with the relative air mass
  of Kasten and Young 1989. The extinction of each colour is that between two higher suns of the model, so that what
  remains is red. Its disc sets: the share above the horizon shines.
* The sky: below ``HORIZON`` it keeps the colours of the lowest sun of the model. Its illuminance of the ground follows
  the polynomials of Seidelmann 1992 (Janiczek and DeYoung 1987) in the altitude of the sun; at the join it is the
  model's.

References:
    Kasten, Young, *Revised optical air mass tables and approximation formula*, Applied Optics 28 (1989).
    Seidelmann (ed.), *Explanatory Supplement to the Astronomical Almanac* (1992), § 9.34; from Janiczek, DeYoung,
    *Computer Programs for Sun and Moon Illuminance*, U.S. Naval Observatory Circular 171 (1987).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lightwell.core.color import LUMINANCE
from lightwell.scenes.sky import cell_directions, evaluate

# Elevations in degrees: below the first the sun of the model is the same; of two suns that tell the extinction; of the
# lowest sun whose sky the model has; and half the aperture of the disc.
SUN_OF_MODEL, CLEAR, HORIZON, DISC = 2.0, (5.0, 10.0), 0.1, 0.267
# log10 of the illuminance in lux is a polynomial of altitude / 90 degrees, from each altitude on.
ILLUMINANCE = (
    (20.0, (3.74, 3.97, -4.07, 1.47)),
    (5.0, (3.05, 13.28, -45.98, 64.33)),
    (-0.8, (2.88, 22.26, -207.64, 1034.30)),
    (-5.0, (2.88, 21.81, -258.11, -858.36)),
    (-12.0, (2.70, 12.17, -431.69, -1899.83)),
)


def illuminance(altitude: float) -> float:
    """Compute the illuminance of the ground under a clear sky.

    Args:
        altitude: Of the sun, degrees, -12 to 90.

    Returns:
        Lux.
    """
    numbers = next((row for low, row in ILLUMINANCE if altitude >= low), ILLUMINANCE[-1][1])
    return float(10 ** np.polynomial.polynomial.polyval(altitude / 90, numbers))


def air_mass(altitude: float) -> float:
    """Compute the relative optical air mass.

    Args:
        altitude: Of the sun, degrees; the horizon below it.

    Returns:
        1 towards the zenith, 38 towards the horizon.
    """
    height = max(altitude, 0.0)
    return float(1 / (np.sin(np.radians(height)) + 0.50572 * (height + 6.07995) ** -1.6364))


def above_horizon(altitude: float) -> float:
    """Compute the share of the sun's disc that is above the horizon.

    Args:
        altitude: Of its middle, degrees.

    Returns:
        0 to 1.
    """
    x = float(np.clip(altitude / DISC, -1, 1))
    return float(0.5 + (np.arcsin(x) + x * np.sqrt(1 - x * x)) / np.pi)


def altitude_of(direction: np.ndarray) -> float:
    """Compute the altitude of a direction.

    Args:
        direction: [3] unit direction.

    Returns:
        Degrees above the horizon.
    """
    return float(np.degrees(np.arcsin(np.clip(direction[1], -1, 1))))


def low_sunlight(direction: np.ndarray, lowest: np.ndarray, clear: Sequence[np.ndarray]) -> np.ndarray:
    """Compute the irradiance of a low sun at normal incidence.

    Args:
        direction: [3] unit direction to it, lower than ``SUN_OF_MODEL``.
        lowest: [3] irradiance at ``SUN_OF_MODEL``.
        clear: [3] irradiance at each elevation of ``CLEAR``.

    Returns:
        [3] linear RGB; 0 where the disc has set.
    """
    altitude, (low, high) = altitude_of(direction), clear
    # A colour that has no light is extinguished whatever its extinction.
    ratio = np.log(np.maximum(high, 1e-12) / np.maximum(low, 1e-12))
    extinction = np.maximum(ratio, 0) / (air_mass(CLEAR[0]) - air_mass(CLEAR[1]))
    through = np.exp(-extinction * (air_mass(altitude) - air_mass(SUN_OF_MODEL)))
    return np.maximum(lowest, 0) * through * above_horizon(altitude)


def twilight(direction: np.ndarray, seen: np.ndarray, model: np.ndarray) -> float:
    """Compute the factor of a sky whose sun is below ``HORIZON``.

    Args:
        direction: [3] unit direction to the sun.
        seen: [3] that of the sun of the model.
        model: [3, 9] numbers of its sky.

    Returns:
        1 for a sun above ``HORIZON``.
    """
    altitude = altitude_of(direction)
    if altitude >= HORIZON:
        return 1.0
    here, join = _on_ground(model, direction), _on_ground(model, seen)
    return illuminance(altitude) / illuminance(HORIZON) * join / here


def _on_ground(model: np.ndarray, sun: np.ndarray) -> float:
    """Luminance times 2π of the irradiance of the ground under a sky, up to the constant of the cells."""
    cells = cell_directions()
    radiance = np.maximum(evaluate(model, cells[..., 1], cells @ sun), 0)
    return float((radiance * cells[..., 1:2]).mean(axis=(0, 1)) @ np.asarray(LUMINANCE))
