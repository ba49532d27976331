"""A lit room and a dark one with a door between them: what a door lets through, and that a shut one lets nothing."""

from __future__ import annotations

from ..scene import Camera, Material, Scene
from .kit import Kit
from .masonry import Finish, Masonry
from .shapes import box, cylinder, move

VERSION = 1

# Metres: rooms are LENGTH x HEIGHT x DEPTH, the wall between them WALL thick.
LENGTH, HEIGHT, DEPTH, WALL = 2.6, 2.4, 2.8, 0.1

# The doorway in the wall: from z = OPENING[0] to OPENING[1], OPENING_HEIGHT high.
OPENING, OPENING_HEIGHT = (-0.45, 0.45), 2.0

# The leaf lies on the wall in the dark room, this much wider and higher than the doorway on each side.
OVERLAP, LEAF = 0.04, 0.04

# Radiance of the lamp under the ceiling of the lit room.
LAMP = (11.0, 10.0, 8.6)


def build() -> Scene:
    """Build a room with a lamp at -x, a dark room at +x, and the node ``Door``, which a turn about y by 0 to 90 degrees
    opens.

    Returns:
        The scene; the door is shut.
    """
    kit = Kit("doorway", VERSION)
    for name, color in {
        "warm_white": (0.74, 0.66, 0.56),
        "cool_white": (0.66, 0.70, 0.74),
        "floor": (0.42, 0.38, 0.34),
        "ceiling": (0.76, 0.76, 0.75),
        "leaf": (0.62, 0.44, 0.26),
        "red": (0.62, 0.12, 0.08),
        "blue": (0.10, 0.24, 0.52),
    }.items():
        kit.material(Material(name, base_color=(*color, 1.0), metallic=0.0, roughness=0.9))
    kit.material(Material("glow", base_color=(0.9, 0.9, 0.9, 1.0), metallic=0.0, roughness=0.8, emissive=LAMP))
    for material, part in _rooms().build().items():
        kit.add(material, material, part)
    half = WALL / 2
    kit.add("lamp", "glow", box((-1.7, HEIGHT - 0.06, -0.35), (-1.0, HEIGHT - 0.02, 0.35)))
    low, high = OPENING[0] - OVERLAP, OPENING[1] + OVERLAP
    kit.add("Door", "leaf", box((half, 0, low), (half + LEAF, OPENING_HEIGHT + OVERLAP, high), skip=("-y",)))
    # The hinge is the edge of the leaf that lies on the wall.
    kit.pivot("Door", (half, 0.0, low))
    kit.add("crate", "blue", box((1.75, 0, -1.1), (2.25, 0.5, -0.6), skip=("-y",)))
    kit.add("drum", "red", move(cylinder(0.24, 0.7, bottom=False), (1.5, 0, 0.75)))
    kit.add("plinth", "red", box((-2.3, 0, -1.1), (-1.8, 0.8, -0.6), skip=("-y",)))
    return kit.scene(_cameras())


def _rooms() -> Masonry:
    half, reach, side = WALL / 2, WALL / 2 + LENGTH, DEPTH / 2
    rooms = Masonry((-reach - WALL, -WALL, -side - WALL), (reach + WALL, HEIGHT + WALL, side + WALL))
    rooms.carve((-reach, 0, -side), (-half, HEIGHT, side), Finish("warm_white", "floor", "ceiling"))
    rooms.carve((half, 0, -side), (reach, HEIGHT, side), Finish("cool_white", "floor", "ceiling"))
    rooms.carve((-half, 0, OPENING[0]), (half, OPENING_HEIGHT, OPENING[1]), Finish("ceiling", "floor", "ceiling"))
    return rooms


def _cameras() -> list[Camera]:
    return [
        Camera((2.5, 1.55, 1.25), (0.3, 0.9, -0.5), fov_y=70.0, name="home"),
        Camera((2.5, 1.4, -1.2), (0.2, 0.9, 0.6), fov_y=65.0, name="dark room"),
        Camera((-2.5, 1.5, -1.2), (0.0, 1.0, 0.5), fov_y=65.0, name="to the door"),
        Camera((-0.4, 1.5, 1.2), (-2.2, 0.6, -0.9), fov_y=65.0, name="lit room"),
        Camera((1.6, 1.3, 0.0), (0.0, 1.0, 0.0), fov_y=65.0, name="doorway"),
    ]
