"""Declarations of what may move: the texts of ``--vary``. Imports nothing slow, so that mistakes are told at once."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

from lightwell.core.environment_text import ENVIRONMENT, ROTATION, turn_range
from lightwell.core.mover_texts import is_mover, parse_mover
from lightwell.core.suggest import did_you_mean
from lightwell.core.sun_path import DAY_EXAMPLE, EXAMPLE, sun_day, sun_hours

# Parameters of the sun and its sky.
OF_SUN = ("direction", "day", "north", "turbidity")
# ... and those that give it a sky.
OF_SKY = ("day", "turbidity")
# Haze that Mitsuba's sky knows.
TURBIDITY = (1.0, 10.0)
# Haze of a clear day in the country.
USUAL_TURBIDITY = 3.0
_DAY = re.compile(r"day\s*=(.*)", re.DOTALL)

# Two directions count as one when all their components differ by less.
SAME_DIRECTION = 1e-4


@dataclass(frozen=True)
class Declaration:
    """One parsed ``--vary`` option: ``NAME.PARAMETER=VALUE`` or ``day=VALUE``."""

    name: str
    """Name of the light, such as 'light' or 'sun'."""
    parameter: str
    """'position', 'radius', 'clearance', 'direction', 'day', 'north', 'turbidity', 'intensity' or 'color'; of a node
    'rotation' or 'translation'; of a clip 'animation'; of the environment map 'rotation'."""
    values: tuple[float, ...] = ()
    """box: 6 numbers, arc: 4, direction by day(...): 9 (three directions), day: 12 (three directions and three hours),
    radius, clearance, north and turbidity: 1; intensity 1 or none, color 3 or none (their first setting); rotation: an
    axis and two angles, degrees; translation: two offsets, metres; animation: two shares of the clip; rotation
    of the environment: two angles, degrees."""

    text: str = ""
    """What declares a node or clip, without its range: 'node:Door.rotation', 'animation:Open'; empty for lights."""

    @property
    def moves(self) -> bool:
        """Whether it declares a node or clip that moves, instead of a light."""
        return bool(self.text)

    @property
    def turns(self) -> bool:
        """Whether it declares an environment map that turns."""
        return self.parameter == ROTATION and not self.moves

    @property
    def learned(self) -> bool:
        """Whether the parameter changes the field; intensity and colour are linear, always variable, never learned."""
        return self.parameter not in ("intensity", "color")


@dataclass(frozen=True)
class _Form:
    """Syntax of the value of a parameter."""

    call: str
    """Word before the parentheses, or nothing."""
    names: str
    """Names of the numbers."""
    example: str
    optional: bool = False


_FORMS = {
    "position": _Form("box", "x0,y0,z0,x1,y1,z1", "light.position=box(-1,0.2,-1,1,2,1)"),
    "radius": _Form("", "metres", "light.radius=0.05"),
    "clearance": _Form("", "metres", "light.clearance=0.1"),
    "direction": _Form("arc", "az0,el0,az1,el1", "sun.direction=arc(90,10,270,10)"),
    "north": _Form("", "degrees", "day.north=30"),
    "turbidity": _Form("", "1 to 10", "day.turbidity=3"),
    "intensity": _Form("", "candela or lux", "light.intensity=20", optional=True),
    "color": _Form("", "r,g,b", "light.color=1,0.9,0.8", optional=True),
}


def _wrong(text: str, what: str, example: str) -> str:
    end = "" if what.endswith("?") else ";"
    return f"vary: '{text}': {what}{end} write for example {example}"


def _unknown(text: str, parameter: str) -> str:
    near = did_you_mean(parameter, _FORMS)
    shown = near.split("'")[1] if near else "position"
    cure = near or f"only {', '.join(_FORMS)} can"
    what = f"'{parameter}' cannot vary, {cure}"
    return _wrong(text, what, _FORMS[shown].example)


def parse_vary(text: str) -> Declaration:
    """Parse one declaration.

    Args:
        text: ``light.position=box(x0,y0,z0,x1,y1,z1)``, ``light.radius=0.05``, ``light.clearance=0.1``,
            ``sun.direction=arc(az0,el0,az1,el1)`` or ``day(YYYY-MM-DD,latitude,longitude)``,
            ``day=YYYY-MM-DD,latitude,longitude``, ``day.north=30``, ``day.turbidity=3``, ``light.intensity`` or
            ``light.color``; ``node:NAME.rotation=y:0..110`` or ``node:NAME.translation=(0,0,0)..(0,0,1.2)``;
            ``animation:NAME=0..1``; ``environment.rotation=0..360``.

    Returns:
        The declaration.

    Raises:
        ValueError: The text has another form, or a value is out of range.
    """
    if is_mover(text):
        node = parse_mover(text)
        return Declaration(node.name, node.path, node.values, node.what)
    if turn := turn_range(text):
        return Declaration(ENVIRONMENT, ROTATION, turn)
    if whole := _DAY.fullmatch(text.strip()):
        try:
            return Declaration("day", "day", sun_hours(whole.group(1)))
        except ValueError as error:
            raise ValueError(_wrong(text, str(error), DAY_EXAMPLE)) from None
    match = re.fullmatch(r"([A-Za-z_]\w*)\.([a-z]+)(?:=(.*))?", text.strip(), re.DOTALL)
    if not match:
        raise ValueError(_wrong(text, "expected NAME.PARAMETER=VALUE", _FORMS["position"].example))
    name, parameter, value = match.groups()
    if parameter not in _FORMS:
        raise ValueError(_unknown(text, parameter))
    day = re.fullmatch(r"day\s*\((.*)\)", (value or "").strip(), re.DOTALL) if parameter == "direction" else None
    if day:
        try:
            return Declaration(name, parameter, sun_day(day.group(1)))
        except ValueError as error:
            raise ValueError(_wrong(text, str(error), EXAMPLE)) from None
    values = _numbers(text, _FORMS[parameter], (value or "").strip())
    _check_range(text, parameter, values)
    return Declaration(name, parameter, values)


def of_options(texts: Sequence[str], sky: bool = False, **options: float | None) -> tuple[str, ...]:
    """Add options of the sun to declarations.

    Args:
        texts: Declarations.
        sky: Whether the sun has a sky, which a day has anyway and a turbidity gives.
        **options: ``north`` and ``turbidity``; None: not given.

    Returns:
        The declarations with those of the options.

    Raises:
        ValueError: No sun is declared, or a number is out of range.
    """
    asked = next((name for name, value in options.items() if value is not None), "sky")
    given = {name: f"{value:g}" for name, value in options.items() if value is not None}
    if sky and not any(d.parameter in ("day", "turbidity") for d in map(parse_vary, texts)):
        given.setdefault("turbidity", f"{USUAL_TURBIDITY:g}")
    if not (given or sky):
        return tuple(texts)
    suns = [d.name for d in map(parse_vary, texts) if d.parameter in ("direction", "day")]
    if not suns:
        raise ValueError(f"vary: --{asked} is for a sun; add --vary {DAY_EXAMPLE}, or leave it out")
    added = [f"{suns[0]}.{name}={value}" for name, value in given.items()]
    for text in added:
        parse_vary(text)
    return (*texts, *(text for text in added if text not in texts))


def _numbers(text: str, form: _Form, value: str) -> tuple[float, ...]:
    """Parse the numbers of ``value`` in the syntax of ``form``."""
    if not value and form.optional:
        return ()
    body = value
    if form.call:
        match = re.fullmatch(rf"{form.call}\s*\((.*)\)", value, re.DOTALL)
        if not match:
            raise ValueError(_wrong(text, f"expected {form.call}({form.names})", form.example))
        body = match.group(1)
    words = [w.strip() for w in body.split(",")] if body.strip() else []
    try:
        values = tuple(float(w) for w in words)
    except ValueError:
        raise ValueError(_wrong(text, f"'{body}' is not a list of numbers", form.example)) from None
    expected = form.names.count(",") + 1
    if len(values) != expected:
        raise ValueError(_wrong(text, f"expected {expected} numbers ({form.names}), got {len(values)}", form.example))
    if not all(map(math.isfinite, values)):
        raise ValueError(_wrong(text, "every number must be finite", form.example))
    return values


def _check_range(text: str, parameter: str, values: tuple[float, ...]) -> None:
    example = _FORMS[parameter].example
    if parameter == "position" and not all(a < b for a, b in zip(values[:3], values[3:])):
        raise ValueError(_wrong(text, "the second corner must be larger than the first in x, y and z", example))
    if parameter == "direction" and any(abs(e) > 90 for e in values[1::2]):
        raise ValueError(_wrong(text, "an elevation lies between -90 and 90 degrees", example))
    if parameter == "direction" and _same_direction(values[:2], values[2:]):
        raise ValueError(_wrong(text, "the arc starts where it ends", example))
    if parameter == "turbidity" and not TURBIDITY[0] <= values[0] <= TURBIDITY[1]:
        raise ValueError(_wrong(text, f"a turbidity lies between {TURBIDITY[0]:g} and {TURBIDITY[1]:g}", example))
    if parameter in ("radius", "clearance", "intensity", "color") and any(v < 0 for v in values):
        raise ValueError(_wrong(text, f"a {parameter} is not negative", example))
    if parameter == "intensity" and values == (0.0,):
        raise ValueError(_wrong(text, "an intensity is above 0", example))


def _same_direction(first: Sequence[float], second: Sequence[float]) -> bool:
    """Compare two directions, each an azimuth and an elevation in degrees."""
    return all(abs(a - b) < SAME_DIRECTION for a, b in zip(_direction(*first), _direction(*second)))


def _direction(azimuth: float, elevation: float) -> tuple[float, float, float]:
    az, el = math.radians(azimuth), math.radians(elevation)
    return math.cos(el) * math.sin(az), math.sin(el), -math.cos(el) * math.cos(az)
