"""The courtyard house: two storeys of windowless rooms around a light well. All daylight in them is indirect.

Plan (metres, x to the right, z towards the viewer, the shaft around the origin)::

                  dining  (terracotta)                upper floor: bedroom
        +-------------------------------+
        |                               |
        +----------[ teal door ]--------+
        | study |                | stair up     gallery north and west of the shaft,
        |       ]  shaft         | x pantry     a wide opening to the library in the south
        +-------+--[ opening ]---+--+---+
        |                           ] |
        |   living                      |
        +-------------------------------+
"""

from __future__ import annotations

from collections.abc import Callable

from ..scene import Camera, Scene
from . import courtyard_finishes, furniture
from .kit import Kit
from .masonry import Finish, Masonry
from .shapes import MeshPart, board, box, cylinder, move, rotate

VERSION = 1

# Half the edge of the shaft, and the levels: ceiling of the ground floor, upper floor, its ceiling, parapet.
SHAFT = 2.2
CEILING, UPPER, UPPER_CEILING, PARAPET = 3.0, 3.3, 6.0, 6.9

# Depth of the gallery behind the shaft's edge, and the thickness of the walls.
GALLERY, WALL = 1.3, 0.3

# The lamp of the house hangs in the shaft: the rooms get only indirect light.
LAMP = (-1.7, 0.4, -1.7, 1.1, 6.5, 1.7)

# The longest day in Málaga: at noon the sun reaches the floor of the shaft.
DAY = "day=2026-06-21,36.7,-4.4,1"

# The stair: 17 risers from the shaft's floor to the gallery.
RISERS, RUN, STAIR_WIDTH = 17, 0.24, 0.95
RISE = UPPER / RISERS


def build() -> Scene:
    """Build the courtyard house with its furniture and cameras.

    Returns:
        The scene.
    """
    kit = Kit("courtyard", VERSION)
    _furnish(kit, _half_open_door)
    scene = kit.scene(_cameras())
    scene.vary = (f"light.position=box({','.join(f'{v:g}' for v in LAMP)})",)
    return scene


def build_day() -> Scene:
    """Build the courtyard house for a day of sun and sky; its node ``Door`` opens when it slides by 1.39 m along x.

    Returns:
        The scene; the door is shut.
    """
    kit = Kit("courtyard-day", VERSION)
    _furnish(kit, _sliding_door)
    scene = kit.scene(_cameras())
    scene.vary = (DAY,)
    return scene


def _furnish(kit: Kit, door: Callable[[Kit], None]) -> None:
    courtyard_finishes.register(kit)
    for material, part in _house().build().items():
        kit.add(f"house_{material}", material, part)
    for furnish in (_shaft, _gallery, _living, door, _dining, _study, _pantry, _upstairs):
        furnish(kit)


def _house() -> Masonry:
    """Make the walls: cut boxes are air."""
    edge = SHAFT + WALL
    house = Masonry((-6.3, -0.3, -6.7), (5.5, PARAPET, 6.9))
    plain = Finish("plaster", "tiles", "ceiling")
    upstairs = Finish("plaster", "oak_floor", "ceiling")
    house.carve((-4.6, 0, edge), (4.6, CEILING, 6.6), plain)
    house.carve((-4.6, 0, -6.2), (4.6, CEILING, -edge), plain)
    house.carve((-6.0, 0, -SHAFT), (-edge, CEILING, SHAFT), plain)
    house.carve((edge, 0, -SHAFT), (5.2, CEILING, SHAFT), plain)
    _upper_rooms(house, upstairs)
    # The shaft, last: its brick replaces the finishes that it cuts through.
    house.carve((-SHAFT, 0, -SHAFT), (SHAFT, PARAPET, SHAFT), Finish("brick", "tiles", "ceiling"))
    _openings(house, edge)
    # A terracotta wall behind the dining table, a dark one in the study.
    house.paint((-4.6, 0, -6.2), (4.6, CEILING, -6.2), ["+z"], "terracotta")
    house.paint((-6.0, 0, -SHAFT), (-6.0, CEILING, SHAFT), ["+x"], "ink")
    return house


def _upper_rooms(house: Masonry, finish: Finish) -> None:
    edge, back = SHAFT + WALL, SHAFT + GALLERY
    # The gallery: north and west of the shaft, open to it.
    house.carve((-back, UPPER, -back), (SHAFT, UPPER_CEILING, SHAFT), finish)
    house.carve((-4.6, UPPER, -6.4), (4.6, UPPER_CEILING, -back - WALL), finish)
    house.carve((-6.0, UPPER, -back), (-back - WALL, UPPER_CEILING, SHAFT), finish)
    house.carve((-4.6, UPPER, edge), (4.6, UPPER_CEILING, 6.6), finish)


def _openings(house: Masonry, edge: float) -> None:
    """Doorways and windows, all onto the shaft or from room to room."""
    reveal, upper = Finish("plaster", "tiles", "ceiling"), Finish("plaster", "oak_floor", "ceiling")
    back = SHAFT + GALLERY
    house.carve((-1.9, 0, SHAFT), (1.9, 2.75, edge), reveal)
    house.carve((-1.15, 0, -edge), (0.75, 2.4, -SHAFT), reveal)
    house.carve((-edge, 0, -0.75), (-SHAFT, 2.4, 0.85), reveal)
    house.carve((3.1, 0, SHAFT), (4.1, 2.2, edge), reveal)
    house.carve((-1.3, UPPER, -back - WALL), (0.1, UPPER + 2.2, -back), upper)
    house.carve((-back - WALL, UPPER, -1.0), (-back, UPPER + 2.2, 0.4), upper)
    house.carve((-1.8, UPPER + 0.75, SHAFT), (1.8, UPPER + 2.3, edge), reveal)


def _shaft(kit: Kit) -> None:
    """The stair on the east wall, a planted pot, a bench along the north wall."""
    flight = furniture.flight(RISERS - 1, RISE, RUN, STAIR_WIDTH)
    kit.add("stair", "oak", move(flight, (SHAFT - STAIR_WIDTH, 0, SHAFT - 0.2)))
    _potted(kit, "plant", (-1.5, 0, -1.5), radius=0.36, height=0.62, plant=1.9, stems=17, seed=5)
    _potted(kit, "small_plant", (1.0, 0, -1.1), radius=0.21, height=0.34, plant=0.85, stems=11, seed=8)


def _potted(
    kit: Kit,
    name: str,
    at: tuple[float, float, float],
    radius: float,
    height: float,
    plant: float,
    stems: int,
    seed: int,
) -> None:
    stalks, leaves = furniture.plant(plant, stems, seed)
    top = (at[0], at[1] + height - 0.05, at[2])
    kit.add(f"{name}_pot", "clay", move(furniture.pot(radius, height), at))
    kit.add(f"{name}_soil", "soil", move(furniture.soil(radius, height), at))
    kit.add(f"{name}_stems", "stem", move(stalks, top))
    kit.add(f"{name}_leaves", "leaf", move(leaves, top))


def _gallery(kit: Kit) -> None:
    """Railings along the shaft's north and west edge, and a slender column under the roof's corner."""
    kit.add(
        "gallery_column", "steel", move(cylinder(0.06, UPPER_CEILING - UPPER), (-SHAFT - 0.08, UPPER, -SHAFT - 0.08))
    )
    stair = SHAFT - STAIR_WIDTH
    for length, turn, at in (
        (SHAFT + stair - 0.06, 0.0, (-SHAFT, UPPER, -SHAFT - 0.06)),
        (2 * SHAFT, 90.0, (-SHAFT - 0.06, UPPER, SHAFT)),
    ):
        bars, grip = furniture.railing(length)
        kit.add("railing_bars", "steel", move(rotate(bars, turn), at))
        kit.add("railing_grip", "oak", move(rotate(grip, turn), at))
    _hang(kit, "gallery_picture", "painting_hills", (0.9, 0.7), (1.0, UPPER + 1.55, -SHAFT - GALLERY), 0.0)


def _hang(
    kit: Kit, name: str, art: str, size: tuple[float, float], at: tuple[float, float, float], turn: float
) -> None:
    """A framed picture; it faces +z turned by ``turn`` degrees."""
    frame, canvas = furniture.picture(*size)
    kit.add(f"{name}_frame", "oak", move(rotate(frame, turn), at))
    kit.add(name, art, move(rotate(canvas, turn), at))


def _living(kit: Kit) -> None:
    """Table and bench before the opening, a round column, pictures."""
    kit.add("column", "concrete", move(cylinder(0.14, CEILING, 48, bottom=False), (-1.78, 0, 4.2)))
    for material, part in (("oak", furniture.bench(1.7)), ("yellow", furniture.throw(0.62, 0.38, 0.44, 0.28))):
        shift = (0.0, 0, 0) if material == "oak" else (0.32, 0, 0)
        kit.add("bench", material, move(rotate(move(part, shift), 14), (0.75, 0, 3.75)))
    kit.add("table", "oak", move(furniture.table(2.2, 0.9, 0.74), (-3.1, 0, 5.5)))
    kit.add("bowl", "clay", move(furniture.bowl(0.2), (-2.75, 0.74, 5.4)))
    kit.add("vase", "celadon", move(furniture.vase(0.34), (-3.35, 0.74, 5.55)))
    kit.add("stool", "oak", move(furniture.stool(0.19, 0.45), (-1.55, 0, 3.35)))
    _hang(kit, "living_picture", "painting_sun", (0.7, 0.9), (2.5, 1.6, SHAFT + WALL), 0.0)
    _hang(kit, "east_picture", "painting_arches", (0.75, 1.0), (4.6, 1.55, 5.2), -90.0)


def _half_open_door(kit: Kit) -> None:
    """A teal sliding door, half open."""
    front = -SHAFT + 0.035
    panel = board((0.02, 0.02, front), (1.12, 2.5, front + 0.05))
    kit.add("teal_door", "teal", panel)
    kit.add("door_handle", "steel", box((0.09, 0.95, front + 0.05), (0.115, 1.25, front + 0.085), ("-z",)))
    kit.add("door_rail", "steel", box((-1.2, 2.56, -SHAFT), (1.2, 2.6, front + 0.03), ("-z",)))
    for x in (0.2, 0.94):
        kit.add("door_rail", "steel", box((x - 0.015, 2.44, front + 0.05), (x + 0.015, 2.6, front + 0.06), ("-z",)))


def _sliding_door(kit: Kit) -> None:
    """A teal door that covers the whole opening of the dining room; it slides behind the stair."""
    front, left, right = -SHAFT + 0.02, -1.2, 0.8
    kit.add("Door", "teal", box((left, 0.005, front), (right, 2.5, front + 0.05)))
    kit.add("Door", "steel", box((left + 0.07, 0.95, front + 0.05), (left + 0.095, 1.25, front + 0.085), ("-z",)))
    for x in (left + 0.2, right - 0.2):
        kit.add("Door", "steel", box((x - 0.015, 2.44, front + 0.05), (x + 0.015, 2.6, front + 0.06), ("-z",)))
    kit.add("door_rail", "steel", box((left, 2.56, -SHAFT), (SHAFT, 2.6, front + 0.03), ("-z",)))


def _dining(kit: Kit) -> None:
    """A table with two benches before the terracotta wall."""
    kit.add("dining_table", "oak", move(furniture.table(2.4, 0.95, 0.74), (0.4, 0, -4.6)))
    kit.add(
        "dining_benches",
        "oak",
        move(furniture.bench(2.0), (0.4, 0, -3.75)),
        move(furniture.bench(2.0), (0.4, 0, -5.45)),
    )
    kit.add("dining_bowl", "celadon", move(furniture.bowl(0.2), (0.1, 0.74, -4.6)))


def _study(kit: Kit) -> None:
    """A shelf with books, a desk and a stool."""
    kit.add("study_shelf", "oak", move(furniture.shelf(2.4, 2.1, 0.28, 5), (-4.3, 0, -SHAFT)))
    for row in range(3):
        y = 0.15 + (row + 1) * (2.1 - 0.15) / 4
        for color, part in zip(("book_red", "book_cream", "book_blue"), furniture.books(1.6 + 0.25 * row, 90 + row)):
            kit.add("books", color, move(part, (-5.45, y, -SHAFT)))
    kit.add("desk", "oak", move(rotate(furniture.table(1.6, 0.7, 0.74), 90), (-5.6, 0, 0.6)))
    kit.add("study_stool", "oak", move(furniture.stool(0.19, 0.45), (-4.9, 0, 0.7)))


def _pantry(kit: Kit) -> None:
    """Shelves with jars: the darkest room, two doors away from the light."""
    kit.add("pantry_shelf", "oak", move(furniture.shelf(2.0, 2.0, 0.32, 4), (3.85, 0, -SHAFT)))
    jars = [move(cylinder(0.08, 0.22, 20, bottom=False), (3.2 + 0.26 * k, 0.15, -SHAFT + 0.17)) for k in range(5)]
    kit.add("jars", "celadon", *jars)


def _upstairs(kit: Kit) -> None:
    """A bed in the bedroom, a chest in the library."""
    kit.add("bed", "oak", board((-3.6, UPPER, -5.9), (-1.7, UPPER + 0.3, -4.1), ("-y",)))
    kit.add("mattress", "linen", move(rotate(_mattress(), 0), (-2.65, UPPER + 0.3, -5.0)))
    kit.add("chest", "oak", board((-0.8, UPPER, 5.9), (0.8, UPPER + 0.55, 6.4), ("-y",)))
    kit.add("library_vase", "celadon", move(furniture.vase(0.36), (-0.3, UPPER + 0.55, 6.15)))
    kit.add("rug", "yellow", box((-1.6, UPPER, 3.3), (1.6, UPPER + 0.012, 5.3), ("-y",)))
    _hang(kit, "library_picture", "painting_arches", (0.75, 1.0), (0.0, UPPER + 1.55, 6.6), 180.0)


def _mattress() -> MeshPart:
    return box((-0.9, 0, -0.85), (0.9, 0.2, 0.85), ("-y",))


def _cameras() -> list[Camera]:
    return [
        Camera((-0.75, 1.3, 6.35), (0.1, 1.5, -2.0), fov_y=54.0, name="home"),
        Camera((-1.9, 1.6, 1.95), (1.0, 1.75, -1.6), fov_y=65.0, name="in the shaft"),
        Camera((3.9, 1.55, -2.9), (-1.0, 1.0, -5.3), fov_y=60.0, name="dining"),
        Camera((-5.7, 1.55, 1.75), (-2.9, 1.2, -0.85), fov_y=60.0, name="study"),
        Camera((-3.2, UPPER + 1.6, 1.8), (0.8, UPPER - 0.4, -1.6), fov_y=65.0, name="gallery"),
        Camera((0.9, UPPER + 1.55, 5.6), (-0.6, UPPER + 0.9, -1.5), fov_y=55.0, name="library"),
        Camera((-4.2, 1.5, 6.2), (1.6, 1.2, 2.7), fov_y=60.0, name="living"),
    ]
