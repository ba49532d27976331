"""Variables of a baked field: the light that may change at run time, and how it is declared, sampled and stored.

Directions from the scene to the sun are given as azimuth and elevation in degrees: azimuth 0 is north (-Z) and grows
clockwise seen from above (90 is east, +X; 180 is south, +Z), elevation is the angle above the horizon.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeGuard

import numpy as np

from lightwell.core.sobol import Sobol
from lightwell.core.vary import OF_SUN
from lightwell.core.vary import Declaration as Declaration
from lightwell.core.vary import parse_vary as parse_vary
from lightwell.scenes.sky import Sky
from lightwell.scenes.suns import Sun as Sun
from lightwell.scenes.suns import declared_sun
from lightwell.scenes.suns import sun_arc as sun_arc
from lightwell.scenes.suns import toward as toward
from lightwell.scenes.turning import Turning as Turning
from lightwell.scenes.vectors import Vector, vector

if TYPE_CHECKING:
    from .scene import Scene

# The light keeps this share of its box's longest edge away from every surface: nearer, indirect light is singular.
CLEARANCE = 0.025
# Share of a box that must be free air for the default clearance; twice what the sampling of lights requires.
LEAST_AIR = 0.04
# Points at which a box is tested, and how often the clearance is halved.
PROBES, HALVINGS = 512, 8


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


Variable = PointLight | Sun | Turning


def has_sky(variable: Variable | None) -> TypeGuard[Sun]:
    """Test whether a variable is a sun that comes with its sky.

    Args:
        variable: The variable; None: no light varies.

    Returns:
        True for a sun with a sky.
    """
    return isinstance(variable, Sun) and variable.sky is not None


def surrounds(variable: Variable | None) -> TypeGuard[Sun | Turning]:
    """Test whether a variable is light from all around: a sun with its sky, or an environment map.

    Args:
        variable: The variable; None: no light varies.

    Returns:
        True where a field learns its light whole, from the first hit on.
    """
    return has_sky(variable) or isinstance(variable, Turning)


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
    points = low + Sobol(3, 0).random(PROBES) * (high - low)
    air = free_air(scene)
    for halving in range(HALVINGS):
        clearance = first / 2**halving
        if air.accepts(points, clearance).mean() >= LEAST_AIR:
            return clearance
    return first


def declare(texts: Sequence[str], scene: Scene) -> Variable:
    """Make the variable that declarations describe.

    Parameters that they do not declare come from the scene's own suggestion (``Scene.vary``), unless that is of a sun
    and they are of a lamp or the other way round, and then from ``default_variable``.

    Args:
        texts: Declarations, see ``parse_vary``.
        scene: Scene to place the light in.

    Returns:
        The variable.

    Raises:
        ValueError: The declarations name several lights, or contradict each other.
    """
    found = [d for d in map(parse_vary, texts) if d.learned and not d.moves]
    if found and found[0].turns:
        return _turning(found, scene)
    suggested = [d for d in map(parse_vary, scene.vary) if d.learned]
    name = found[0].name if found else ""
    suns = [any(d.parameter in OF_SUN for d in declared) for declared in (found, suggested)]
    # A suggestion of the other kind says nothing about the light that is declared.
    if not suns[0] and not (found and suns[1]):
        found = [replace(d, name=name or d.name) for d in suggested] + found
    names = list(dict.fromkeys(d.name for d in found))
    if len(names) > 1:
        raise ValueError(
            f"vary: one light can move here, not {len(names)} ({', '.join(names)}); declare one of them: only a bake "
            "of --field factored takes several"
        )
    given = {d.parameter: d.values for d in found}
    if given.keys() & set(OF_SUN):
        return declared_sun(given, names[0])
    return _point_light(given, scene, names[0] if names else "light")


def by_light(texts: Sequence[str]) -> list[tuple[str, ...]]:
    """Sort declarations by the light that they are of; each light can then be declared by itself.

    Args:
        texts: Declarations, see ``parse_vary``; those of nodes and clips are left out.

    Returns:
        The declarations of each light whose place, direction or size varies, in order; one empty list where none does.

    Raises:
        ValueError: Of several lights, an intensity or a colour is of none.
    """
    found = [(text, d) for text in texts if not (d := parse_vary(text)).moves]
    names = list(dict.fromkeys(d.name for _, d in found if d.learned))
    strange = next((text for text, d in found if d.name not in names), None)
    if strange is not None and len(names) > 1:
        raise ValueError(f"vary: '{strange}' is of none of the lights that vary, {', '.join(names)}; name one of them")
    groups = [tuple(text for text, d in found if d.name == name) for name in names]
    return groups or [tuple(text for text, _ in found)]


def first_settings(texts: Sequence[str], name: str | None = None) -> tuple[float | None, Vector]:
    """Read the initial intensity and colour of a light: ``light.intensity`` and ``light.color``.

    Args:
        texts: Declarations, see ``parse_vary``.
        name: Name of the light; None: there is one.

    Returns:
        Intensity, cd or lx (None: not declared), and linear RGB colour.
    """
    declared = [d for d in map(parse_vary, texts) if not d.learned and d.values]
    given = {d.parameter: d.values for d in declared if name in (None, d.name)}
    intensity = given.get("intensity", (None,))[0]
    return intensity, vector(given.get("color", (1.0, 1.0, 1.0)))


def _turning(found: Sequence[Declaration], scene: Scene) -> Turning:
    """The environment map that turns; declarations of other lights beside it are refused."""
    if len(found) > 1:
        raise ValueError(
            f"vary: one light can vary here, not the environment and {found[1].name}.{found[1].parameter}; declare one "
            "of them: only a bake of --field factored takes several"
        )
    if scene.surrounding is None:
        raise ValueError("vary: environment.rotation is for bake, compare and render; leave it out here")
    first, last = found[0].values
    return Turning(first, last)


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
    own: dict[str, Any]
    if isinstance(variable, Turning):
        middle, own = vector(variable.direction(variable.initial)), {"range": [variable.first, variable.last]}
    elif isinstance(variable, Sun):
        middle = variable.middle
        own = {key: [float(v) for v in getattr(variable, key)] for key in ("start", "middle", "end")}
        own |= {"sky": variable.sky.json()} if variable.sky else {}
    else:
        middle = vector(variable.sample(np.full((1, 3), 0.5))[0])
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
    makers: dict[Any, Callable[[dict[str, Any]], Variable]] = {
        "point": _point_from_json,
        "sun": _sun_from_json,
        "environment": _turning_from_json,
    }
    if kind not in makers:
        raise ValueError(
            f"variable '{name}': kind is {kind!r}, expected 'point', 'sun' or 'environment'; write the asset again"
        )
    try:
        return makers[kind](entry)
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"variable '{name}': a {kind} cannot be read ({error!r}); write the asset again") from error


def _point_from_json(entry: dict[str, Any]) -> PointLight:
    clearance, radius = float(entry["clearance"]), float(entry.get("radius", 0))
    return PointLight(vector(entry["low"]), vector(entry["high"]), clearance, radius, entry["name"])


def _turning_from_json(entry: dict[str, Any]) -> Turning:
    first, last = (float(angle) for angle in entry["range"])
    return Turning(first, last, entry["name"])


def _sun_from_json(entry: dict[str, Any]) -> Sun:
    sky = Sky.of(entry["sky"]) if "sky" in entry else None
    return Sun(vector(entry["start"]), vector(entry["middle"]), vector(entry["end"]), name=entry["name"], sky=sky)
