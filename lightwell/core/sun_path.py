"""The sun's path over a place on a day: three directions, through which its circle on the sky goes, and their times."""

from __future__ import annotations

import math
import re
from datetime import date, datetime, time, timedelta, timezone

# A white sun without a sky is not followed below this elevation, degrees: light along the ground has no arc to be
# learned on. One with a sky is followed to the end of civil twilight.
LOWEST, CIVIL = 2.0, -6.0
# Minutes between the times at which it is looked for, and most hours before and after noon where it never sets.
STEP, MOST_HOURS = 2, 11.5
_NUMBER = r"\s*,\s*([-+.\deE]+)"
_DAY = re.compile(rf"\s*(\d{{4}})-(\d{{2}})-(\d{{2}}){_NUMBER}{_NUMBER}(?:{_NUMBER})?\s*\Z")
EXAMPLE, DAY_EXAMPLE = "sun.direction=day(2026-06-21,48.1,11.6)", "day=2026-06-21,48.1,11.6"
# Degrees of longitude of a time zone, and the farthest zone in hours.
ZONE, FARTHEST_ZONE = 15.0, 14.0
_CLOCK = re.compile(r"(\d{1,2}):(\d{2})\Z")


def sun_day(text: str) -> tuple[float, ...]:
    """Compute the path of the sun from morning to evening.

    Azimuth 0 (north) is -Z, 90 (east) is +X.

    Args:
        text: ``YYYY-MM-DD,latitude,longitude``; degrees, north and east are positive.

    Returns:
        Unit directions to the sun when it is ``LOWEST`` high, at noon, and when it is as low again: 9 numbers.
    """
    return _hours(text, LOWEST)[:9]


def sun_hours(text: str) -> tuple[float, ...]:
    """Compute the path of the sun from dawn to dusk, as ``sun_day`` does, and when it is where.

    Args:
        text: ``YYYY-MM-DD,latitude,longitude`` or ``YYYY-MM-DD,latitude,longitude,hours from UTC``; without the last,
            the zone of the longitude (15 degrees an hour).

    Returns:
        9 numbers as those of ``sun_day``, but from ``CIVIL`` on, and the clock at the three directions in hours; below
        0 and above 24 it is the day before and after.

    Raises:
        ValueError: The text is no day and place, or the sun does not rise there.
    """
    return _hours(text, CIVIL)


def _hours(text: str, lowest: float) -> tuple[float, ...]:
    """``sun_hours`` from an elevation on."""
    match = _DAY.match(text)
    try:
        year, month, day, latitude, longitude, zone = match.groups() if match else ()
        when, place = date(int(year), int(month), int(day)), (float(latitude), float(longitude))
        hours = round(place[1] / ZONE) if zone is None else float(zone)
    except (ValueError, OverflowError):
        raise ValueError(f"'day({text.strip()[:60]})' is not day(YYYY-MM-DD,latitude,longitude)") from None
    if not (abs(place[0]) <= 90 and abs(place[1]) <= 180):
        raise ValueError("a latitude lies between -90 and 90, a longitude between -180 and 180 degrees")
    if not abs(hours) <= FARTHEST_ZONE:
        raise ValueError(f"a time zone lies between -{FARTHEST_ZONE:g} and {FARTHEST_ZONE:g} hours from UTC")
    return _path(when, *place, hours, lowest)


def parse_clock(text: str) -> float:
    """Read a time of day.

    Args:
        text: ``18:30`` or hours such as ``18.5``.

    Returns:
        Hours, 0 to 24.

    Raises:
        ValueError: The text is no time of day.
    """
    match = _CLOCK.match(text.strip())
    try:
        hours = int(match[1]) + int(match[2]) / 60 if match else float(text)
    except ValueError:
        hours = math.nan
    if not 0 <= hours <= 24 or (match and int(match[2]) > 59):
        raise ValueError(f"'{text.strip()[:40]}' is no time of day; write for example 18:30")
    return hours


def clock(hours: float) -> str:
    """Write a time of day.

    Args:
        hours: Hours; those below 0 and above 24 are of another day.

    Returns:
        ``18:30``.
    """
    minutes = round(hours * 60) % (24 * 60)
    return f"{minutes // 60:02d}:{minutes % 60:02d}"


def _path(when: date, latitude: float, longitude: float, zone: float, lowest: float) -> tuple[float, ...]:
    from astral import Observer
    from astral.sun import azimuth, elevation

    place = Observer(latitude, longitude)
    midday = datetime.combine(when, time(12), timezone.utc) - timedelta(hours=longitude / ZONE)
    steps = int(12 * 60 / STEP)
    times = [midday + timedelta(minutes=STEP * k) for k in range(-steps, steps + 1)]
    heights = [elevation(place, at, with_refraction=False) for at in times]
    noon = max(range(len(times)), key=heights.__getitem__)
    if heights[noon] <= LOWEST:
        raise ValueError(
            f"the sun stays below {LOWEST:g} degrees on {when} at latitude {latitude:g}; choose another day or place"
        )
    reach = int(MOST_HOURS * 60 / STEP)
    # Near the poles noon may lie close to the end of the day that was looked at.
    up = [k for k in range(noon - reach, noon + reach + 1) if heights[k % len(heights)] > lowest]
    first = next(k for k in range(noon, noon - reach - 1, -1) if k - 1 not in up)
    last = next(k for k in range(noon, noon + reach + 1) if k + 1 not in up)
    found = [times[noon] + timedelta(minutes=STEP * (k - noon)) for k in (first, noon, last)]
    angles = [(azimuth(place, at), elevation(place, at, with_refraction=False)) for at in found]
    midnight = datetime.combine(when, time(0), timezone.utc)
    hours = tuple((at - midnight).total_seconds() / 3600 + zone for at in found)
    return tuple(c for angle in angles for c in _toward(*angle)) + hours


def _toward(azimuth: float, elevation: float) -> tuple[float, float, float]:
    az, el = math.radians(azimuth), math.radians(elevation)
    return math.cos(el) * math.sin(az), math.sin(el), -math.cos(el) * math.cos(az)
