"""A sun that runs along an arc, alone or with the sky of a clear day."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lightwell.core.sun_path import CIVIL, DAY_EXAMPLE, clock
from lightwell.core.vary import OF_SUN, USUAL_TURBIDITY
from lightwell.scenes.sky import STEPS, Sky, SkyTables, sky_tables
from lightwell.scenes.vectors import vector

# Numbers of ``day=``: three directions and three hours.
DAY_NUMBERS = 12
# The path of a day may be so much (sine) below its ends between them.
SLACK = 0.01

# Elevation in the middle of an arc of half a turn (sunrise to sunset), degrees: noon in a temperate summer.
NOON_ELEVATION = 60.0


@dataclass(frozen=True)
class Sun:
    """A distant light on an arc of directions. The field is learned for 1 lx of white at normal incidence."""

    start: tuple[float, float, float]
    """Unit direction from the scene to the sun at t = 0."""
    middle: tuple[float, float, float]
    """Direction at t = 1/2; the arc is the circle on the sphere through the three directions."""
    end: tuple[float, float, float]
    """Direction at t = 1."""
    name: str = "sun"
    kind: str = "sun"
    sky: Sky | None = None
    """Sky and colour of the sun along the arc; the field is then learned for the light of each time divided by its
    ``level``. None: a white sun alone."""

    def __post_init__(self) -> None:
        ends = (self.start, self.middle, self.end)
        if any(np.allclose(ends[k], ends[k - 1], atol=1e-6) for k in range(3)):
            raise ValueError(f"sun '{self.name}': start, middle and end must differ, got {ends}; declare a longer arc")

    def direction(self, t: float | np.ndarray) -> np.ndarray:
        """Compute directions to the sun, with constant speed on each half of the arc.

        Args:
            t: [...] times in [0, 1].

        Returns:
            [..., 3] unit directions.
        """
        t = np.clip(np.asarray(t, dtype=np.float64), 0, 1)[..., None]
        center, radius, other, half, full = self.circle
        angle = np.where(t < 0.5, 2 * t * half, half + (2 * t - 1) * (full - half))
        found = center + np.cos(angle) * radius + np.sin(angle) * other
        return found / np.linalg.norm(found, axis=-1, keepdims=True)

    def time(self, direction: np.ndarray) -> np.ndarray:
        """Compute when the sun is in a direction of the arc.

        Args:
            direction: [..., 3] directions.

        Returns:
            [...] times in [0, 1]; those of the nearest end beside the arc.
        """
        center, radius, other, half, full = self.circle
        way = np.asarray(direction, np.float64) - center
        angle = np.arctan2(way @ other, way @ radius) % (2 * np.pi)
        angle = np.where(angle > full + (2 * np.pi - full) / 2, 0, np.minimum(angle, full))
        return np.where(angle < half, angle / (2 * half), 0.5 + (angle - half) / (2 * (full - half)))

    @property
    def tables(self) -> SkyTables:
        """Sun and sky along the arc; only with a ``sky``."""
        assert self.sky
        return sky_tables(self.sky, _rows(self.direction(np.linspace(0, 1, STEPS))))

    def level(self, direction: np.ndarray) -> np.ndarray:
        """Compute the brightness of the light, relative to the brightest time.

        Args:
            direction: [..., 3] directions to the sun.

        Returns:
            [...] factors, 1 without a sky.
        """
        t = self.time(direction)
        return np.ones_like(t) if self.sky is None else np.interp(t, np.linspace(0, 1, STEPS), self.tables.level)

    def sunlight(self, direction: np.ndarray) -> np.ndarray:
        """Look up the irradiance of the sun at normal incidence, divided by the level of the time.

        Args:
            direction: [..., 3] directions to the sun.

        Returns:
            [..., 3] float32 linear RGB; only with a ``sky``.
        """
        return self.tables.sun[np.rint(self.time(direction) * (STEPS - 1)).astype(int)]

    def hour(self, direction: np.ndarray) -> float | None:
        """Compute the time of day.

        Args:
            direction: [3] direction to the sun.

        Returns:
            Hours; None where the arc is not that of a day.
        """
        if self.sky is None or not self.sky.hours:
            return None
        return float(np.interp(self.time(direction), (0, 0.5, 1), self.sky.hours))

    def at_hour(self, hour: float) -> np.ndarray:
        """Compute the direction to the sun at a time of day.

        Args:
            hour: Hours, 0 to 24.

        Returns:
            [3] unit direction.

        Raises:
            ValueError: It is night then, or the arc is not that of a day.
        """
        hours = self.sky.hours if self.sky else ()
        if not hours:
            raise ValueError(f"'{self.name}' is no day; declare one with --vary {DAY_EXAMPLE}")
        found = next((h for h in (hour, hour - 24, hour + 24) if hours[0] <= h <= hours[2]), None)
        if found is None:
            raise ValueError(f"it is night at {clock(hour)}; choose {clock(hours[0])} to {clock(hours[2])}")
        return self.direction(np.interp(found, hours, (0, 0.5, 1)))

    def sample(self, u: np.ndarray) -> np.ndarray:
        """Map random numbers to directions.

        Args:
            u: [N] or [N, 1] times in [0, 1).

        Returns:
            [N, 3] float32 unit directions.
        """
        return self.direction(np.asarray(u).reshape(-1)).astype(np.float32)

    @property
    def circle(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, float, float]:
        """Centre and two perpendicular radii [3] (the first to ``start``), angles of ``middle`` and ``end``."""
        start, middle, end = (np.asarray(d, dtype=np.float64) for d in (self.start, self.middle, self.end))
        axis = np.cross(middle - start, end - middle)
        axis /= np.linalg.norm(axis)
        center = axis * (axis @ start)
        radius = start - center
        other = np.cross(axis, radius)
        half, full = (
            float(np.arctan2((d - center) @ other, (d - center) @ radius) % (2 * np.pi)) for d in (middle, end)
        )
        return center, radius, other, half, full


def _rows(values: np.ndarray) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(float(v) for v in row) for row in values)


def toward(azimuth: float, elevation: float) -> np.ndarray:
    """Convert azimuth and elevation to a direction.

    Args:
        azimuth: Degrees, clockwise from north (-Z).
        elevation: Degrees above the horizon.

    Returns:
        [3] unit direction.
    """
    az, el = np.radians(azimuth), np.radians(elevation)
    return np.array([np.cos(el) * np.sin(az), np.sin(el), -np.cos(el) * np.cos(az)])


def sun_arc(az0: float, el0: float, az1: float, el1: float, name: str = "sun") -> Sun:
    """Make the sun on a daily arc.

    The azimuth changes linearly from az0 to az1 (90 to 270 passes south, 90 to -90 passes north). In the middle the sun
    is at the mean azimuth and at the elevation  m + (NOON_ELEVATION - m)⁺ s²,  where m is the mean elevation and s =
    min(|az1 - az0| / 180, 1): half a turn is a whole day and reaches noon, a short arc is nearly straight.

    Args:
        az0: First azimuth, degrees.
        el0: First elevation, degrees.
        az1: Last azimuth, degrees.
        el1: Last elevation, degrees.
        name: Name of the variable.

    Returns:
        The sun.
    """
    mean, span = (el0 + el1) / 2, min(abs(az1 - az0) / 180, 1)
    rise = max(NOON_ELEVATION - mean, 0) * span**2
    start, middle, end = toward(az0, el0), toward((az0 + az1) / 2, mean + rise), toward(az1, el1)
    return Sun(vector(start), vector(middle), vector(end), name=name)


def declared_sun(given: dict[str, tuple[float, ...]], name: str) -> Sun:
    """Make the sun of ``arc(...)``, ``day(...)`` or ``day=``; a sky belongs to the last, and to all with a turbidity.

    Args:
        given: Declared numbers by parameter, see ``core.vary.Declaration``.
        name: Name of the variable.

    Returns:
        The sun.

    Raises:
        ValueError: A parameter is not one of a sun, or there is not one path.
    """
    if strange := sorted(given.keys() - set(OF_SUN)):
        raise ValueError(f"vary: '{name}' is a sun, it has no {' and no '.join(strange)}; drop it")
    paths = [given[parameter] for parameter in ("direction", "day") if parameter in given]
    if len(paths) != 1:
        raise ValueError(f"vary: '{name}' needs one path; write for example --vary {DAY_EXAMPLE}")
    values = paths[0]
    sun = sun_arc(*values, name=name) if len(values) == 4 else _sun_of(values, name)
    if "north" in given:
        start, middle, end = (
            vector(_turned(np.array(way), given["north"][0])) for way in (sun.start, sun.middle, sun.end)
        )
        sun = replace(sun, start=start, middle=middle, end=end)
    if len(values) != DAY_NUMBERS and "turbidity" not in given:
        return sun
    return with_sky(sun, given.get("turbidity", (USUAL_TURBIDITY,))[0], values[9:])


def _sun_of(values: tuple[float, ...], name: str) -> Sun:
    return Sun(vector(values[:3]), vector(values[3:6]), vector(values[6:9]), name=name)


def _turned(way: np.ndarray, north: float) -> np.ndarray:
    """The direction, where north is ``north`` degrees clockwise from -Z seen from above."""
    cosine, sine = np.cos(np.radians(north)), np.sin(np.radians(north))
    return np.array([way[0] * cosine - way[2] * sine, way[1], way[0] * sine + way[2] * cosine])


def with_sky(sun: Sun, turbidity: float, hours: tuple[float, ...] = ()) -> Sun:
    """Add the clear sky and the colour of the sun.

    Args:
        sun: The path of the sun.
        turbidity: Haze of the air, 1 to 10.
        hours: Clock at t = 0, 1/2 and 1; empty where the path is not that of a day.

    Returns:
        The sun with its sky.

    Raises:
        ValueError: A part of the path lies below civil twilight.
    """
    from lightwell.scenes.daylight import clear_sky, key_times

    if sun.direction(key_times())[:, 1].min() < np.sin(np.radians(CIVIL)) - SLACK:
        raise ValueError(
            f"vary: the path of '{sun.name}' goes below {CIVIL:g} degrees, where it is night; begin and end it higher"
        )
    times = key_times(sun.direction)
    return replace(sun, sky=clear_sky(tuple(times.tolist()), _rows(sun.direction(times)), turbidity, hours))
