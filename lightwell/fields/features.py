"""Inputs of the networks, written as a shading graph, so that training and viewer compute the same.

Notation: p surface point, n normal, v direction to the camera, r mirrored view direction, l light, ω direction to the
light, d distance to it; positions are mapped to about [−1, 1]³ by one scale.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.fields.base import FieldSetup
from lightwell.graph import Builder

INPUT_WIDTHS = {
    "position": 3,
    "normal": 3,
    "view": 3,
    "light": 3,
    "reflectance": 3,
    "roughness": 1,
    "metallic": 1,
}

# Softens 1/d and log d where a light almost touches a surface, in units of half the scene's extent.
DISTANCE_SOFTENING = 0.02


@dataclass(frozen=True)
class FeatureOctaves:
    """Octaves of the frequency encoding of positions: sin and cos of 2^k π c for k below these numbers."""

    position: int = 6
    light: int = 4
    falloff: float = 0.5
    """Amplitude of an octave relative to the one below: smaller prefers smooth light where samples are few."""


def open_builder(relief: bool = False, lamps: int = 0, movers: int = 0) -> Builder:
    """Start a graph that has the inputs of a query.

    Args:
        relief: Whether the graph may read normals that normal maps have bent.
        lamps: Number of groups of lamps that have a switch.
        movers: Parts of the scene that move.

    Returns:
        The builder.
    """
    more = ({"shading_normal": 3} if relief else {}) | ({"lamps": 3 * lamps} if lamps else {})
    more |= {"pose": movers, "rest_position": 3, "rest_normal": 3} if movers else {}
    return Builder(**INPUT_WIDTHS, **more)


def normalised(b: Builder, name: str, setup: FieldSetup, per_frame: bool = False) -> str:
    """Map a world position to about [−1, 1]³ by one scale for all axes.

    Args:
        b: Graph to add nodes to.
        name: Name of the node with the position in metres, width 3.
        setup: Bounds of the scene.
        per_frame: Whether the position depends on frame inputs only.

    Returns:
        Name of the new node, width 3.
    """
    scale = 1.0 / setup.half_extent
    return b.affine(name, [scale] * 3, [-c * scale for c in setup.center], per_frame=per_frame)


def raw_features(b: Builder, setup: FieldSetup) -> tuple[list[str], list[str]]:
    """Add the 12 raw inputs of the 2013 report: x, n, incoming view direction, l.

    Args:
        b: Graph to add nodes to.
        setup: Bounds and light of the scene.

    Returns:
        Names of nodes that are evaluated per pixel, and of those that are evaluated per frame.
    """
    incoming = b.scale("view", -1.0)
    light = [] if setup.light == "static" else [_light(b, setup)]
    return [normalised(b, "position", setup), "normal", incoming], light


def waves(b: Builder, value: str, octaves: int, falloff: float, per_frame: bool = False, width: int = 3) -> str:
    """Add sines and cosines of a vector, the k-th octave scaled by falloff^k.

    Args:
        b: Graph to add nodes to.
        value: Name of a node, width W.
        octaves: Number of octaves, ≥ 1.
        falloff: Amplitude of an octave relative to the one below, in (0, 1].
        per_frame: Whether the vector depends on frame inputs only.
        width: W.

    Returns:
        Name of the new node, width 2 W × octaves.
    """
    found = b.frequency(value, octaves, per_frame=per_frame)
    if falloff == 1.0:
        return found
    amplitude = np.tile(np.repeat(falloff ** np.arange(octaves), 2), width)
    return b.affine(found, amplitude, np.zeros_like(amplitude), per_frame=per_frame)


def _light(b: Builder, setup: FieldSetup) -> str:
    """The light's position, normalised, or a sun's direction."""
    return normalised(b, "light", setup, per_frame=True) if setup.light == "point" else "light"


def encoded_features(b: Builder, setup: FieldSetup, octaves: FeatureOctaves) -> tuple[list[str], list[str]]:
    """Add the encoded inputs and the local geometry of light, surface and camera.

    Args:
        b: Graph to add nodes to.
        setup: Bounds and light of the scene.
        octaves: Octaves of the encoding.

    Returns:
        Names of nodes that are evaluated per pixel, and of those that are evaluated per frame.
    """
    p = normalised(b, "position", setup)
    r = b.normalize(b.reflect("normal", "view"))
    pixel = [p, waves(b, p, octaves.position, octaves.falloff), "normal", r, b.dot("normal", "view")]
    pixel += ["reflectance", "roughness", "metallic"]
    if setup.light == "static":
        return pixel, []
    l = _light(b, setup)
    if setup.light == "sun":
        return [*pixel, b.dot("normal", "light"), b.dot(r, "light")], [
            l,
            waves(b, l, octaves.light, octaves.falloff, per_frame=True),
        ]
    to_light = b.subtract(l, p)
    distance = b.length(to_light)
    direction = b.normalize(to_light)
    pixel += [direction, b.dot("normal", direction), b.dot(r, direction)]
    pixel += [b.log(distance, DISTANCE_SOFTENING), b.scale(b.reciprocal(distance, DISTANCE_SOFTENING * 10), 0.25)]
    return pixel, [l, waves(b, l, octaves.light, octaves.falloff, per_frame=True)]


# The hash grid's cube is a little larger than the scene, so that no surface lies on its faces.
GRID_MARGIN = 1.02


def grid_point(b: Builder, setup: FieldSetup, lift: float) -> str:
    """Add the point at which a grid over the scene is read.

    The point lies above the surface on the viewer's side. So the two sides of a wall thinner than a cell, and the faces
    at an edge, read different places.

    Args:
        b: Graph to add nodes to.
        setup: Bounds of the scene.
        lift: Distance from the surface along the normal, in edges of the grid's cube.

    Returns:
        Name of the node with the point in [0, 1]³, width 3.
    """
    scale = 0.5 / (GRID_MARGIN * setup.half_extent)
    # What moves is learned in its own frame.
    position, normal = ("rest_position", "rest_normal") if setup.movers else ("position", "normal")
    place = b.affine(position, [scale] * 3, [0.5 - c * scale for c in setup.center])
    return b.add(place, b.scale(normal, lift))


# Softens the reciprocal of a direction's components; exits farther than this many half edges do not occur. A flat
# scene, a floor alone, is taken to be so thick, relative to its longest edge.
EXIT_SOFTENING, FARTHEST_EXIT, FLAT = 1e-3, 1e4, 1e-3


def mirrored_point(b: Builder, setup: FieldSetup, normal: str = "normal") -> str:
    """Add the point where the mirrored ray leaves the box of the scene: what a glossy surface reflects is near it.

    Args:
        b: Graph to add nodes to.
        setup: Bounds of the scene.
        normal: Input that mirrors.

    Returns:
        Name of the node with the point in [0, 1]³ of the grid's cube, width 3.
    """
    half = np.asarray(setup.size or (2 * setup.half_extent,) * 3) / 2
    half = np.where(half > 0, half, FLAT * setup.half_extent)
    r = b.normalize(b.reflect(normal, "view"))
    # Place and direction in the box [-1, 1]³, and the sign of each component of the direction.
    p = b.affine("position", list(1 / half), [-c / h for c, h in zip(setup.center, half)])
    way = b.affine(r, list(1 / half), [0.0] * 3)
    sign = b.clamp(b.scale(r, 1e6), low=-1.0, high=1.0)
    to_wall = b.clamp(b.subtract(b.affine(sign, [0.0] * 3, [1.0] * 3), b.multiply(sign, p)), low=0.0, high=4.0)
    times = b.multiply(to_wall, b.reciprocal(b.multiply(sign, way), EXIT_SOFTENING))
    nearest = b.slice(times, 0, 1)
    for axis in (1, 2):
        more = b.clamp(b.subtract(nearest, b.slice(times, axis, 1)), low=0.0, high=FARTHEST_EXIT)
        nearest = b.subtract(nearest, more)
    away = b.multiply(r, b.concat(nearest, nearest, nearest))
    scale = 0.5 / (GRID_MARGIN * setup.half_extent)
    place = b.affine("position", [scale] * 3, [0.5 - c * scale for c in setup.center])
    return b.add(place, b.scale(away, scale))


def local_features(b: Builder, setup: FieldSetup, normal: str = "normal") -> list[str]:
    """Add the inputs that a grid cannot provide: the geometry of light and normal and, where a surface is glossy, of
    the view.

    Args:
        b: Graph to add nodes to.
        setup: Bounds and light of the scene.
        normal: Input that light, view and surface are compared by.

    Returns:
        Names of nodes that are evaluated per pixel.
    """
    pixel = [normal]
    if not setup.matte:
        r = b.normalize(b.reflect(normal, "view"))
        pixel += [r, b.dot(normal, "view"), "reflectance", "roughness", "metallic"]
    if setup.light == "sun":
        pixel += [b.dot(normal, "light")] + ([] if setup.matte else [b.dot(r, "light")])
    if setup.light == "point":
        to_light = b.subtract(_light(b, setup), normalised(b, "position", setup))
        distance, direction = b.length(to_light), b.normalize(to_light)
        pixel += [direction, b.dot(normal, direction), b.log(distance, DISTANCE_SOFTENING)]
        pixel += [b.scale(b.reciprocal(distance, DISTANCE_SOFTENING * 10), 0.25)]
        pixel += [] if setup.matte else [b.dot(r, direction)]
    return pixel


def light_features(b: Builder, setup: FieldSetup, octaves: int, falloff: float) -> list[str]:
    """Add the inputs of a network that depends on the light alone: position, encoding, log distances to the scene's
    bounds.

    Args:
        b: Graph to add nodes to.
        setup: Bounds and light of the scene.
        octaves: Octaves of the encoding.
        falloff: Amplitude of an octave relative to the one below, in (0, 1].

    Returns:
        Names of nodes that are evaluated per frame; none without a variable light.
    """
    pose = pose_features(b, setup.movers) if setup.movers else []
    if setup.light == "static":
        return pose
    l = _light(b, setup)
    encoded = waves(b, l, octaves, falloff, per_frame=True)
    if setup.light == "sun":
        return [l, encoded, *pose]
    walls = []
    for sign in (-1.0, 1.0):
        half = [0.5 * edge / setup.half_extent for edge in setup.size or (2 * setup.half_extent,) * 3]
        walls.append(b.log(b.affine(l, [sign] * 3, half, per_frame=True), DISTANCE_SOFTENING, per_frame=True))
    return [l, *walls, encoded, *pose]


# Octaves of a slider, and the amplitude of each relative to the one below.
POSE_OCTAVES, POSE_FALLOFF = 4, 0.6
# Share of the range in which an end stop is left: light through a door begins with a step where it opens.
END_STOP = 0.01


def pose_features(b: Builder, movers: int) -> list[str]:
    """Add the inputs of a network that depends on a pose: each slider t, waves of it, and two numbers that are 1 at an
    end stop and 0 beside it, so that what is shut can be learned apart from what is ajar.

    Args:
        b: Graph to add nodes to.
        movers: Number of sliders.

    Returns:
        Names of nodes that are evaluated per frame.
    """
    t = b.affine("pose", [2.0] * movers, [-1.0] * movers, per_frame=True)
    waved = waves(b, "pose", POSE_OCTAVES, POSE_FALLOFF, per_frame=True, width=movers)
    first = b.affine("pose", [-1 / END_STOP] * movers, [1.0] * movers, per_frame=True)
    last = b.affine("pose", [1 / END_STOP] * movers, [1.0 - 1 / END_STOP] * movers, per_frame=True)
    stops = [b.clamp(end, low=0.0, high=1.0, per_frame=True) for end in (first, last)]
    return [t, waved, *stops]
