"""The sun's path over a place on a day: three directions, through which its circle on the sky goes."""

from __future__ import annotations

import math
import re
from datetime import date, datetime, time, timedelta, timezone

# The sun is not followed below this elevation, degrees: light along the ground has no arc to be learned on.
LOWEST = 2.0
# Minutes between the times at which it is looked for, and most hours before and after noon where it never sets.
STEP, MOST_HOURS = 2, 11.5
_DAY = re.compile(r"\s*(\d{4})-(\d{2})-(\d{2})\s*,\s*([-+.\deE]+)\s*,\s*([-+.\deE]+)\s*\Z")
EXAMPLE = "sun.direction=day(2026-06-21,48.1,11.6)"


def sun_day(text: str) -> tuple[float, ...]:
    """Compute the path of the sun from morning to evening.

    Azimuth 0 (north) is -Z, 90 (east) is +X.

    Args:
        text: ``YYYY-MM-DD,latitude,longitude``; degrees, north and east are positive.

    Returns:
        Unit directions to the sun when it is ``LOWEST`` high, at noon, and when it is as low again: 9 numbers.

    Raises:
        ValueError: The text is no day and place, or the sun does not rise there.
    """
    match = _DAY.match(text)
    try:
        year, month, day, latitude, longitude = match.groups() if match else ()
        when, place = date(int(year), int(month), int(day)), (float(latitude), float(longitude))
    except ValueError:
        raise ValueError(f"'day({text.strip()[:60]})' is not day(YYYY-MM-DD,latitude,longitude)") from None
    if not (abs(place[0]) <= 90 and abs(place[1]) <= 180):
        raise ValueError("a latitude lies between -90 and 90, a longitude between -180 and 180 degrees")
    return _path(when, *place)


def _path(when: date, latitude: float, longitude: float) -> tuple[float, ...]:
    from astral import Observer
    from astral.sun import azimuth, elevation

    place = Observer(latitude, longitude)
    midday = datetime.combine(when, time(12), timezone.utc) - timedelta(hours=longitude / 15)
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
    up = [k for k in range(noon - reach, noon + reach + 1) if heights[k % len(heights)] > LOWEST]
    first = next(k for k in range(noon, noon - reach - 1, -1) if k - 1 not in up)
    last = next(k for k in range(noon, noon + reach + 1) if k + 1 not in up)
    found = [times[noon] + timedelta(minutes=STEP * (k - noon)) for k in (first, noon, last)]
    angles = [(azimuth(place, at), elevation(place, at, with_refraction=False)) for at in found]
    return tuple(c for angle in angles for c in _toward(*angle))


def _toward(azimuth: float, elevation: float) -> tuple[float, float, float]:
    az, el = math.radians(azimuth), math.radians(elevation)
    return math.cos(el) * math.sin(az), math.sin(el), -math.cos(el) * math.cos(az)
