"""Variables of a baked field: the light that may change at run time, and how it is declared, sampled and stored.

Directions from the scene to the sun are given as azimuth and elevation in degrees: azimuth 0 is north (-Z) and grows
clockwise seen from above (90 is east, +X; 180 is south, +Z), elevation is the angle above the horizon.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.stats import qmc

from lightwell.core.vary import Declaration as Declaration
from lightwell.core.vary import parse_vary as parse_vary
from lightwell.scenes.vectors import Vector, vector

if TYPE_CHECKING:
    from .scene import Scene

# The light keeps this share of its box's longest edge away from every surface: nearer, indirect light is singular.
CLEARANCE = 0.025
# Share of a box that must be free air for the default clearance; twice what the sampling of lights requires.
LEAST_AIR = 0.04
# Points at which a box is tested, and how often the clearance is halved.
PROBES, HALVINGS = 512, 8

# Elevation in the middle of an arc of half a turn (sunrise to sunset), degrees: noon in a temperate summer.
NOON_ELEVATION = 60.0


@dataclass(frozen=True)
class PointLight:
    """A small light that moves in a box. The field is learned for 1 cd of white; intensity and colour are linear."""

    low: tuple[float, float, float]
    """Smallest corner of the box, metres."""
    high: tuple[float, float, float]
    """Largest corner of the box, metres."""
    clearance: float
    """Distance that the light keeps from every surface, metres."""
    radius: float = 0.0
    """Radius of the emitting sphere, metres; 0 is a point."""
    name: str = "light"
    kind: str = "point"

    def sample(self, u: np.ndarray) -> np.ndarray:
        """Map random numbers to positions, uniformly in the box; the geometry is not tested.

        Args:
            u: [N, 3] numbers in [0, 1).

        Returns:
            [N, 3] float32 positions, metres.
        """
        low, high = np.asarray(self.low), np.asarray(self.high)
        return (low + np.asarray(u) * (high - low)).astype(np.float32)


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
        center, radius, other, half, full = self._circle()
        angle = np.where(t < 0.5, 2 * t * half, half + (2 * t - 1) * (full - half))
        found = center + np.cos(angle) * radius + np.sin(angle) * other
        return found / np.linalg.norm(found, axis=-1, keepdims=True)

    def sample(self, u: np.ndarray) -> np.ndarray:
        """Map random numbers to directions.

        Args:
            u: [N] or [N, 1] times in [0, 1).

        Returns:
            [N, 3] float32 unit directions.
        """
        return self.direction(np.asarray(u).reshape(-1)).astype(np.float32)

    def _circle(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Compute centre, two perpendicular radii [3] (the first to ``start``), angles of ``middle`` and ``end``."""
        start, middle, end = (np.asarray(d, dtype=np.float64) for d in (self.start, self.middle, self.end))
        axis = np.cross(middle - start, end - middle)
        axis /= np.linalg.norm(axis)
        center = axis * (axis @ start)
        radius = start - center
        other = np.cross(axis, radius)
        half, full = (np.arctan2((d - center) @ other, (d - center) @ radius) % (2 * np.pi) for d in (middle, end))
        return center, radius, other, half, full


Variable = PointLight | Sun


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


def default_variable(scene: Scene) -> PointLight:
    """Make a point light that may be anywhere in the scene's air: its core (``Scene.core``), reduced by the clearance.

    The clearance is 2.5 % of the box's longest edge, but at most an eighth of the scene's shortest. Along an edge that
    is too short for it (a flat scene) the box is the middle half. Free air is tested when lights are placed.

    Args:
        scene: Scene to place the light in.

    Returns:
        The light.
    """
    low, high = scene.core
    size = high - low
    inset = np.minimum(CLEARANCE * float(size.max()), size / 4)
    low, high = low + inset, high - inset
    clearance, shortest = CLEARANCE * float((high - low).max()), float(size.min())
    if shortest > 0:
        clearance = min(clearance, shortest / 8)
    return PointLight(vector(low), vector(high), clearance=clearance)


def _fitting_clearance(scene: Scene, default: PointLight) -> float:
    """Choose the distance that a light keeps from surfaces when neither it nor the box was declared, metres.

    Long scenes have low rooms: the default is halved until a part ``LEAST_AIR`` of the box is free air. A box without
    any free air keeps the default; placing lights in it then says why it cannot.
    """
    from lightwell.scenes.free_air import free_air

    first, low, high = default.clearance, np.array(default.low), np.array(default.high)
    points = low + qmc.Sobol(3, scramble=True, seed=0).random(PROBES) * (high - low)
    air = free_air(scene)
    for halving in range(HALVINGS):
        clearance = first / 2**halving
        if air.accepts(points, clearance).mean() >= LEAST_AIR:
            return clearance
    return first


def declare(texts: Sequence[str], scene: Scene) -> Variable:
    """Make the variable that declarations describe.

    Parameters that they do not declare come from the scene's own suggestion (``Scene.vary``), which a declared sun
    replaces, and then from ``default_variable``.

    Args:
        texts: Declarations, see ``parse_vary``.
        scene: Scene to place the light in.

    Returns:
        The variable.

    Raises:
        ValueError: The declarations name several lights, or contradict each other.
    """
    found = [d for d in map(parse_vary, texts) if d.learned]
    suggested = [d for d in map(parse_vary, scene.vary) if d.learned]
    name = found[0].name if found else ""
    if all(d.parameter != "direction" for d in found):
        found = [replace(d, name=name or d.name) for d in suggested] + found
    names = list(dict.fromkeys(d.name for d in found))
    if len(names) > 1:
        raise ValueError(
            f"vary: one light can move, not {len(names)} ({', '.join(names)}); bake one field per light, they add up"
        )
    given = {d.parameter: d.values for d in found}
    if "direction" in given:
        if len(given) > 1:
            raise ValueError(f"vary: '{names[0]}' is a sun, it has a direction only; drop {', '.join(given)} or it")
        return _sun(given["direction"], names[0])
    return _point_light(given, scene, names[0] if names else "light")


def _sun(values: tuple[float, ...], name: str) -> Sun:
    """The sun of ``arc(...)``, 4 numbers, or of ``day(...)``, three directions."""
    if len(values) == 4:
        az0, el0, az1, el1 = values
        return sun_arc(az0, el0, az1, el1, name=name)
    return Sun(vector(values[:3]), vector(values[3:6]), vector(values[6:]), name=name)


def first_settings(texts: Sequence[str]) -> tuple[float | None, Vector]:
    """Read the initial intensity and colour of the light: ``light.intensity`` and ``light.color``.

    Args:
        texts: Declarations, see ``parse_vary``.

    Returns:
        Intensity, cd or lx (None: not declared), and linear RGB colour.
    """
    given = {d.parameter: d.values for d in map(parse_vary, texts) if not d.learned and d.values}
    intensity = given.get("intensity", (None,))[0]
    return intensity, vector(given.get("color", (1.0, 1.0, 1.0)))


def _point_light(given: dict[str, tuple[float, ...]], scene: Scene, name: str) -> PointLight:
    default = default_variable(scene)
    box = given.get("position", (*default.low, *default.high))
    _check_place(box, scene, name)
    if not given.keys() & {"position", "clearance"}:
        given = {**given, "clearance": (_fitting_clearance(scene, default),)}
    edge = max(b - a for a, b in zip(box[:3], box[3:]))
    clearance = given.get("clearance", (CLEARANCE * edge,))[0]
    radius = given.get("radius", (0.0,))[0]
    # A sphere must not intersect the wall from which its centre keeps the clearance.
    return PointLight(vector(box[:3]), vector(box[3:]), max(clearance, radius), radius, name)


def _check_place(box: Sequence[float], scene: Scene, name: str) -> None:
    """Check that the box is not farther from the scene than the scene is large, where it would light almost nothing."""
    low, high = scene.bounds
    if np.any(np.asarray(box[:3]) > high + scene.extent) or np.any(np.asarray(box[3:]) < low - scene.extent):
        bounds = ",".join(f"{v:g}" for v in (*low, *high))
        raise ValueError(
            f"vary: {name}.position=box({','.join(f'{v:g}' for v in box)}) lies far outside the scene, "
            f"whose bounds are ({bounds}) in metres; move the box into it"
        )


def to_json(
    variable: Variable,
    initial: Sequence[float] | None = None,
    intensity: float = 1.0,
    color: Sequence[float] = (1.0, 1.0, 1.0),
) -> dict[str, Any]:
    """Write a variable as an entry of ``variables`` in the glTF extension (format/FORMAT.md).

    Args:
        variable: The declared light.
        initial: [3] first position, metres, or direction; None: the middle.
        intensity: Initial intensity, cd or lx.
        color: [3] initial linear RGB colour.

    Returns:
        JSON-compatible object.
    """
    if isinstance(variable, Sun):
        middle = variable.middle
        own: dict[str, Any] = {key: [float(v) for v in getattr(variable, key)] for key in ("start", "middle", "end")}
    else:
        middle = variable.sample(np.full((1, 3), 0.5))[0]
        own = {"low": [float(v) for v in variable.low], "high": [float(v) for v in variable.high]}
        own |= {"clearance": float(variable.clearance), "radius": float(variable.radius)}
    first = [float(v) for v in (middle if initial is None else initial)]
    shown = {"initial": first, "intensity": float(intensity), "color": [float(v) for v in color]}
    return {"name": variable.name, "kind": variable.kind} | own | shown


def from_json(entry: dict[str, Any]) -> Variable:
    """Read an entry that ``to_json`` wrote.

    Args:
        entry: JSON object.

    Returns:
        The variable.

    Raises:
        ValueError: The kind is unknown, or a value is missing or wrong.
    """
    name, kind = entry.get("name", "?"), entry.get("kind")
    makers: dict[Any, Callable[[dict[str, Any]], Variable]] = {"point": _point_from_json, "sun": _sun_from_json}
    if kind not in makers:
        raise ValueError(f"variable '{name}': kind is {kind!r}, expected 'point' or 'sun'; write the asset again")
    try:
        return makers[kind](entry)
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"variable '{name}': a {kind} cannot be read ({error!r}); write the asset again") from error


def _point_from_json(entry: dict[str, Any]) -> PointLight:
    clearance, radius = float(entry["clearance"]), float(entry.get("radius", 0))
    return PointLight(vector(entry["low"]), vector(entry["high"]), clearance, radius, entry["name"])


def _sun_from_json(entry: dict[str, Any]) -> Sun:
    return Sun(vector(entry["start"]), vector(entry["middle"]), vector(entry["end"]), name=entry["name"])
