"""A loft in the evening: one long room with a sleeping gallery, lit by nine lamps of its own and nothing else.

Plan (metres, x to the right, z towards the viewer)::

        +--[ kitchen counter, shelf ]------------+
        | cove   o o o  pendants    |  bath      |
        |   table under them        [ door, lamp |
        |                           +------------+   upper floor: bed under
        |  desk       rug, sofa        floor lamp|   the slope, two wall lamps
        |  [lamp]     low table        paper ball|
        +----------------------------------------+
"""

from __future__ import annotations

from collections.abc import Sequence

from ..scene import Camera, Material, Scene
from . import courtyard_finishes, furniture
from .kit import Kit
from .masonry import Finish, Masonry
from .shapes import MeshPart, board, box, cylinder, lathe, move, quad, rod, rotate, sphere

VERSION = 1

# The room, and the gallery over its back half.
WIDTH, DEPTH, HEIGHT = 8.4, 7.2, 4.6
GALLERY_DEPTH, GALLERY, SLAB = 3.0, 2.45, 0.22
# Corners of the air.
X0, X1, Z0, Z1 = -WIDTH / 2, WIDTH / 2, -DEPTH / 2, DEPTH / 2
# Front edge of the gallery, and its level.
EDGE, UPPER = Z0 + GALLERY_DEPTH, GALLERY + SLAB
# The bath below the gallery, behind a wall with a door.
BATH = 2.1
WALL = 0.12

# Radiance of the lamps, linear, and what they look like: warm bulbs, one cool screen, a daylight tube.
WARM, AMBER, NEUTRAL, COOL = (1.0, 0.77, 0.54), (1.0, 0.66, 0.38), (1.0, 0.9, 0.78), (0.55, 0.72, 1.0)

# Where a moving light may be: the air in the middle of the room.
LAMP = (-3.4, 0.3, -0.3, 3.4, 4.1, 3.1)


def build() -> Scene:
    """Build the loft with its furniture, lamps and cameras.

    Returns:
        The scene.
    """
    kit = Kit("loft", VERSION)
    courtyard_finishes.register(kit)
    kit.material(Material("brass", base_color=(0.62, 0.44, 0.2, 1.0), metallic=1.0, roughness=0.35))
    kit.material(Material("sofa_cloth", base_color=(0.13, 0.24, 0.27, 1.0), metallic=0.0, roughness=1.0))
    kit.material(Material("white", base_color=(0.8, 0.8, 0.79, 1.0), metallic=0.0, roughness=0.6))
    kit.material(Material("paper", base_color=(0.85, 0.83, 0.78, 1.0), metallic=0.0, roughness=0.9))
    for material, part in _room().build().items():
        kit.add(f"loft_{material}", material, part)
    for furnish in (_kitchen, _dining, _sofa, _desk, _bath, _gallery, _pictures):
        furnish(kit)
    scene = kit.scene(_cameras())
    scene.vary = (f"light.position=box({','.join(f'{v:g}' for v in LAMP)})",)
    return scene


def _room() -> Masonry:
    room = Masonry((X0 - 0.3, -0.3, Z0 - 0.3), (X1 + 0.3, HEIGHT + 0.3, Z1 + 0.3))
    finish = Finish("plaster", "oak_floor", "ceiling")
    room.carve((X0, 0, Z0), (X1, HEIGHT, Z1), finish)
    room.fill((X0, GALLERY, Z0), (X1, UPPER, EDGE))
    # The stair comes up at the left wall.
    room.carve((X0, GALLERY, EDGE - 2.2), (X0 + 0.95, UPPER, EDGE), finish)
    room.fill((X1 - BATH - WALL, 0, Z0), (X1 - BATH, GALLERY, EDGE))
    room.fill((X1 - BATH, 0, EDGE - WALL), (X1, GALLERY, EDGE))
    room.carve((X1 - 1.35, 0, EDGE - WALL), (X1 - 0.5, 2.05, EDGE), finish)
    room.paint((X0, 0, Z0), (X0, HEIGHT, Z1), ["+x"], "brick")
    room.paint((X1 - BATH - WALL, 0, Z0), (X1, GALLERY, EDGE), ["-x"], "ink")
    room.paint((X1 - BATH, 0, Z0), (X1, 0, EDGE - WALL), ["+y"], "tiles")
    room.paint((X1 - BATH, 0, Z0), (X1, GALLERY, Z0), ["+z"], "celadon")
    room.paint((X0, UPPER, Z0), (X1, HEIGHT, Z0), ["+z"], "terracotta")
    return room


def _glow(kit: Kit, name: str, color: tuple[float, float, float], radiance: float, *parts: MeshPart) -> None:
    """Add a lamp: an emissive mesh with a material of its own."""
    red, green, blue = color
    emitted = (radiance * red, radiance * green, radiance * blue)
    kit.material(
        Material(f"{name}_glow", base_color=(0.9, 0.9, 0.9, 1.0), metallic=0.0, roughness=0.8, emissive=emitted)
    )
    kit.add(name, f"{name}_glow", *parts)


def _beside(place: Sequence[float], x: float, y: float, z: float) -> tuple[float, float, float]:
    return place[0] + x, place[1] + y, place[2] + z


def _shade(bottom: float, top: float, height: float) -> MeshPart:
    """A conical shade, open at both ends, seen from both sides."""
    outer = [(bottom, 0.0), (top, height)]
    inner = [(top - 0.006, height), (bottom - 0.006, 0.0)]
    return lathe([*outer, *inner, outer[0]], 40)


def _kitchen(kit: Kit) -> None:
    """A counter along the back wall, a shelf over it with a strip of light below it, a cove on the gallery's edge."""
    kit.add("worktop", "oak", board((X0 + 1.5, 0.86, Z0), (1.7, 0.9, Z0 + 0.64)))
    kit.add("cabinet", "teal", board((X0 + 1.5, 0.08, Z0), (1.7, 0.86, Z0 + 0.6), ("-y", "+y", "-z")))
    kit.add("wall_shelf", "oak", board((X0 + 1.7, 1.52, Z0), (1.4, 1.56, Z0 + 0.26), ("-z",)))
    _glow(kit, "counter", NEUTRAL, 22.0, quad((X0 + 1.9, 1.515, Z0 + 0.13), (3.1, 0, 0), (0, 0, 0.05)))
    kit.add("kitchen_bowl", "celadon", move(furniture.bowl(0.17), (-1.9, 0.9, Z0 + 0.33)))
    kit.add("kitchen_vase", "clay", move(furniture.vase(0.3), (-0.9, 1.56, Z0 + 0.13)))
    for k in range(6):
        kit.add("jars", "white", move(cylinder(0.055, 0.16, 24), (-0.2 + 0.17 * k, 1.56, Z0 + 0.13)))
    pan = lathe([(0.0, 0.0), (0.13, 0.0), (0.14, 0.09), (0.132, 0.09), (0.124, 0.01), (0.0, 0.01)], 32)
    kit.add("pan", "steel", move(pan, (0.7, 0.9, Z0 + 0.34)))
    _glow(kit, "cove", AMBER, 9.0, quad((X0 + 1.2, UPPER + 0.03, EDGE - 0.14), (0, 0, 0.06), (WIDTH - 1.4, 0, 0)))
    kit.add("cove_lip", "white", box((X0 + 1.2, UPPER, EDGE - 0.05), (X1 - 0.2, UPPER + 0.1, EDGE - 0.02)))


def _dining(kit: Kit) -> None:
    """A table for six under three pendants, which have one switch."""
    center, top = -1.5, 1.62
    kit.add("table", "oak", move(furniture.table(2.3, 0.9, 0.74), (center, 0, -1.1)))
    for z in (-1.85, -0.35):
        kit.add("benches", "oak", move(furniture.bench(2.0), (center, 0, z)))
    bulbs = []
    for k, x in enumerate((-0.75, 0.0, 0.75)):
        kit.add("pendant_shades", "brass", move(_shade(0.17, 0.035, 0.2), (center + x, top, -1.1)))
        cord = rod((center + x, top + 0.2, -1.1), (center + x, GALLERY, -1.1), 0.006)
        kit.add("pendant_cords", "steel", cord)
        bulbs.append(move(sphere(0.06), (center + x, top + 0.04, -1.1)))
        if k != 1:
            plate = lathe([(0.0, 0.0), (0.09, 0.0), (0.125, 0.018), (0.118, 0.018), (0.085, 0.006), (0.0, 0.006)], 32)
            kit.add("plates", "white", move(plate, (center + x, 0.742, -1.3)))
    kit.add("table_bowl", "clay", move(furniture.bowl(0.19), (center, 0.74, -1.05)))
    _glow(kit, "pendants", WARM, 70.0, *bulbs)


def _sofa(kit: Kit) -> None:
    """A sofa with a paper ball on the floor, an arc lamp over it, a rug and a low table."""
    kit.add("rug", "yellow", box((-0.9, 0, 0.75), (2.3, 0.014, 3.1), ("-y",)))
    x0, x1, z0, z1 = 2.55, 3.55, 0.7, 3.1
    kit.add("sofa", "sofa_cloth", box((x0, 0.12, z0), (x1, 0.42, z1), ("-y",)))
    kit.add("sofa", "sofa_cloth", box((x1 - 0.25, 0.42, z0), (x1, 0.82, z1), ("-y",)))
    for z in (z0, z1 - 0.2):
        kit.add("sofa", "sofa_cloth", box((x0, 0.42, z), (x1 - 0.25, 0.6, z + 0.2), ("-y",)))
    for z in (1.42, 2.1):
        kit.add("cushions", "linen", move(rotate(board((-0.08, 0, -0.26), (0.08, 0.42, 0.26)), 8, "z"), (3.2, 0.42, z)))
    kit.add("low_table", "oak", move(furniture.stool(0.42, 0.34), (1.2, 0, 1.8)))
    kit.add("low_vase", "celadon", move(furniture.vase(0.28), (1.3, 0.34, 1.7)))
    pole = rod((3.85, 0.02, 0.35), (3.85, 1.75, 0.35), 0.014)
    arm = rod((3.85, 1.74, 0.35), (3.35, 1.9, 0.75), 0.012)
    kit.add("floor_lamp_stand", "steel", pole, arm, move(cylinder(0.15, 0.02), (3.85, 0, 0.35)))
    kit.add("floor_lamp_shade", "linen", move(_shade(0.22, 0.13, 0.24), (3.35, 1.62, 0.75)))
    _glow(kit, "floor", WARM, 60.0, move(sphere(0.06), (3.35, 1.74, 0.75)))
    _glow(kit, "ball", NEUTRAL, 3.2, move(sphere(0.24, 20, 36), (3.72, 0.24, 3.36)))


def _desk(kit: Kit) -> None:
    """A desk at the brick wall with a lamp and a screen, a shelf of books, a plant."""
    kit.add("desk_table", "oak", move(rotate(furniture.table(1.7, 0.72, 0.74), 90), (X0 + 0.42, 0, 1.5)))
    kit.add("desk_stool", "oak", move(furniture.stool(0.19, 0.45), (X0 + 1.15, 0, 1.55)))
    foot = (X0 + 0.28, 0.74, 0.95)
    kit.add("desk_lamp_stand", "brass", move(cylinder(0.08, 0.015), foot))
    elbow, head = _beside(foot, 0.06, 0.36, 0.0), _beside(foot, 0.3, 0.46, 0.12)
    kit.add("desk_lamp_stand", "brass", rod(foot, elbow, 0.008), rod(elbow, head, 0.008))
    shade = move(_shade(0.1, 0.03, 0.11), _beside(head, 0, -0.09, 0))
    kit.add("desk_lamp_shade", "teal", shade)
    _glow(kit, "desk", WARM, 90.0, move(sphere(0.032), _beside(head, 0, -0.05, 0)))
    screen = box((X0 + 0.2, 0.86, 1.3), (X0 + 0.225, 1.22, 1.94))
    kit.add("monitor", "steel", screen, box((X0 + 0.2, 0.74, 1.58), (X0 + 0.23, 0.88, 1.66)))
    _glow(kit, "screen", COOL, 2.6, quad((X0 + 0.2265, 0.88, 1.92), (0, 0, -0.6), (0, 0.32, 0)))
    kit.add("keyboard", "white", box((X0 + 0.46, 0.74, 1.42), (X0 + 0.6, 0.752, 1.82), ("-y",)))
    kit.add("book_shelf", "oak", move(rotate(furniture.shelf(1.2, 1.9, 0.28, 5), 90), (X0, 0, 2.98)))
    for row in range(3):
        y = 0.12 + (row + 1) * (1.9 - 0.15) / 4
        for color, part in zip(("book_red", "book_cream", "book_blue"), furniture.books(0.9, 50 + row)):
            kit.add("books", color, move(rotate(part, 90), (X0, y - 0.01, 3.5)))
    stalks, leaves = furniture.plant(1.5, 14, 4)
    kit.add("pot", "clay", move(furniture.pot(0.27, 0.42), (-2.1, 0, 3.1)))
    kit.add("soil", "soil", move(furniture.soil(0.27, 0.42), (-2.1, 0, 3.1)))
    kit.add("stems", "stem", move(stalks, (-2.1, 0.37, 3.1)))
    kit.add("leaves", "leaf", move(leaves, (-2.1, 0.37, 3.1)))


def _bath(kit: Kit) -> None:
    """A basin under a panel of light behind the wall; its light comes out through the doorway."""
    kit.add("basin", "white", box((X1 - 1.5, 0.7, Z0), (X1 - 0.6, 0.86, Z0 + 0.46), ("-z",)))
    _glow(kit, "bath", NEUTRAL, 14.0, quad((X1 - 1.5, 1.3, Z0 + 0.02), (0.9, 0, 0), (0, 0.6, 0)))


def _gallery(kit: Kit) -> None:
    """A bed upstairs between two wall lamps, a railing, and the stair along the brick wall."""
    kit.add("bed", "oak", board((0.9, UPPER, Z0 + 0.1), (2.8, UPPER + 0.28, Z0 + 2.25), ("-y",)))
    kit.add("mattress", "linen", box((0.95, UPPER + 0.28, Z0 + 0.15), (2.75, UPPER + 0.48, Z0 + 2.2), ("-y",)))
    kit.add("pillows", "white", board((1.05, UPPER + 0.48, Z0 + 0.2), (1.8, UPPER + 0.6, Z0 + 0.62)))
    kit.add("pillows", "white", board((1.9, UPPER + 0.48, Z0 + 0.2), (2.65, UPPER + 0.6, Z0 + 0.62)))
    kit.add("blanket", "terracotta", box((0.94, UPPER + 0.2, Z0 + 1.2), (2.76, UPPER + 0.5, Z0 + 2.22), ("-y",)))
    for side, x in (("left", 0.55), ("right", 3.15)):
        at = (x, UPPER + 1.05, Z0 + 0.12)
        kit.add("bed_lamp_shades", "paper", move(_shade(0.1, 0.07, 0.2), _beside(at, 0, -0.1, 0)))
        _glow(kit, f"bed_{side}", AMBER, 34.0, move(sphere(0.042), at))
    bars, grip = furniture.railing(WIDTH - 1.0)
    kit.add("railing_bars", "steel", move(bars, (X0 + 1.0, UPPER, EDGE - 0.02)))
    kit.add("railing_grip", "oak", move(grip, (X0 + 1.0, UPPER, EDGE - 0.02)))
    flight = furniture.flight(14, UPPER / 15, 0.22, 0.9)
    kit.add("stair", "oak", move(flight, (X0 + 0.02, 0, EDGE + 0.95)))


def _pictures(kit: Kit) -> None:
    for art, at, turn, size in (
        ("painting_arches", (X1, 1.75, 1.9), -90.0, (0.9, 1.2)),
        ("painting_hills", (0.2, UPPER + 1.1, Z0), 0.0, (0.8, 0.6)),
        ("painting_sun", (X1 - BATH - WALL, 1.6, -1.9), -90.0, (0.7, 0.9)),
    ):
        frame, canvas = furniture.picture(*size)
        kit.add(f"{art}_frame", "oak", move(rotate(frame, turn), at))
        kit.add(art, art, move(rotate(canvas, turn), at))


def _cameras() -> list[Camera]:
    return [
        Camera((3.0, 1.65, 3.45), (-1.9, 1.45, -1.2), fov_y=62.0, name="home"),
        Camera((-3.6, 1.6, 3.3), (1.5, 1.4, -0.8), fov_y=62.0, name="from the desk"),
        Camera((1.6, 1.5, -0.3), (-4.0, 0.95, 1.5), fov_y=58.0, name="desk"),
        Camera((-2.6, UPPER + 1.5, Z0 + 1.4), (2.4, UPPER + 0.5, Z0 + 0.6), fov_y=62.0, name="gallery"),
        Camera((0.9, 1.5, 0.9), (-1.6, 1.0, -3.0), fov_y=60.0, name="kitchen"),
        Camera((-0.6, 1.5, 3.3), (3.5, 1.1, -1.2), fov_y=62.0, name="sofa"),
    ]
