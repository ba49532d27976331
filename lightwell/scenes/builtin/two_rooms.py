"""Two closed rooms connected by one door in a thin wall: with a light in one, leaks of light into the other are
visible.
"""

from __future__ import annotations

from ..scene import Camera, Material, Scene
from .kit import Kit
from .masonry import Finish, Masonry
from .shapes import box, cylinder, move

VERSION = 1

# Metres: rooms are LENGTH x HEIGHT x DEPTH, the wall between them WALL thick.
LENGTH, HEIGHT, DEPTH, WALL = 3.0, 2.5, 3.4, 0.05

# The doorway in the wall: from z = DOOR[0] to DOOR[1], DOOR_HEIGHT high.
DOOR, DOOR_HEIGHT = (0.55, 1.35), 2.05


def build() -> Scene:
    """Build a warm room at -x and a cool room at +x, closed on all sides.

    Returns:
        The scene.
    """
    kit = Kit("two-rooms", VERSION)
    for name, color in {
        "warm_white": (0.74, 0.66, 0.56),
        "cool_white": (0.60, 0.68, 0.74),
        "floor": (0.42, 0.40, 0.38),
        "ceiling": (0.76, 0.76, 0.75),
        "orange": (0.74, 0.28, 0.08),
        "blue": (0.10, 0.24, 0.52),
    }.items():
        kit.material(Material(name, base_color=(*color, 1.0), metallic=0.0, roughness=0.9))
    for material, part in _rooms().build().items():
        kit.add(material, material, part)
    kit.add("crate", "blue", box((2.05, 0, -1.2), (2.65, 0.6, -0.6), skip=("-y",)))
    kit.add("drum", "orange", move(cylinder(0.28, 0.75, bottom=False), (1.1, 0, -0.9)))
    kit.add("plinth", "orange", box((-2.4, 0, -1.3), (-1.8, 0.9, -0.7), skip=("-y",)))
    return kit.scene(_cameras())


def _rooms() -> Masonry:
    half, reach, side = WALL / 2, WALL / 2 + LENGTH, DEPTH / 2
    rooms = Masonry((-reach - WALL, -WALL, -side - WALL), (reach + WALL, HEIGHT + WALL, side + WALL))
    rooms.carve((-reach, 0, -side), (-half, HEIGHT, side), Finish("warm_white", "floor", "ceiling"))
    rooms.carve((half, 0, -side), (reach, HEIGHT, side), Finish("cool_white", "floor", "ceiling"))
    rooms.carve((-half, 0, DOOR[0]), (half, DOOR_HEIGHT, DOOR[1]), Finish("ceiling", "floor", "ceiling"))
    return rooms


def _cameras() -> list[Camera]:
    return [
        Camera((2.75, 1.55, 1.45), (0.3, 1.0, -0.6), fov_y=70.0, name="home"),
        Camera((-2.75, 1.55, -1.45), (0.0, 1.1, 0.8), fov_y=65.0, name="to the door"),
        Camera((2.7, 1.3, -1.4), (0.0, 1.1, 0.7), fov_y=65.0, name="dark room"),
        Camera((-0.5, 1.5, 1.3), (-2.4, 0.7, -1.1), fov_y=65.0, name="warm room"),
        Camera((0.45, 0.5, -1.45), (0.05, 0.12, 0.6), fov_y=60.0, name="foot of the thin wall"),
    ]
