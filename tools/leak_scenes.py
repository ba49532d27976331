"""Test scenes for light leaks: thin walls, doorways, columns, storeys and corners, with their own light.

Each is a ``LeakScene``: the scene, and a function that returns the connected region of a point.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from lightwell.backend import mi
from lightwell.scenes.builtin.kit import Kit
from lightwell.scenes.builtin.masonry import Finish, Masonry
from lightwell.scenes.builtin.shapes import box
from lightwell.scenes.default_light import under_sky
from lightwell.scenes.scene import Camera, Material, Scene

# Thickness of outer walls, metres.
OUTER = 0.1
# Intensity of the lamp in the lit room relative to that in the dark room.
CONTRAST = 1000.0
WHITE = Finish("white", "floor", "white")


@dataclass(frozen=True)
class LeakScene:
    """A scene with its light, and the connected regions of its air."""

    name: str
    """Short name for tables."""
    scene: Scene
    """The scene with its emitters."""
    region: Callable[[np.ndarray], np.ndarray]
    """Maps points [N, 3] to [N] int: index of the connected region; -1: not scored, such as inside walls."""
    bounds: np.ndarray
    """[2, 3] box of the queries, metres."""


def _kit(name: str) -> Kit:
    kit = Kit(name, 1)
    for material, color in {
        "white": (0.75, 0.75, 0.75),
        "floor": (0.5, 0.48, 0.45),
        "red": (0.7, 0.12, 0.1),
        "green": (0.15, 0.6, 0.15),
    }.items():
        kit.material(Material(material, base_color=(*color, 1.0), metallic=0.0, roughness=1.0, ior=1.0))
    return kit


def _finish(kit: Kit, masonry: Masonry, *lamps) -> Scene:
    """The scene under lamps (x, y, z, candela); none: under the sky."""
    for material, part in masonry.build().items():
        kit.add(material, material, part)
    scene = kit.scene([Camera((0.5, 1.5, 0.5), (0, 1, 0), name="home")])
    shapes = {f"mesh_{k:06d}": shape for k, shape in enumerate(scene.mi.shapes())}
    emitters = {
        f"lamp_{k}": {"type": "point", "position": [x, y, z], "intensity": power}
        for k, (x, y, z, power) in enumerate(lamps)
    }
    built = mi.load_dict({"type": "scene", **shapes, **emitters}, optimize=False)
    return replace(scene, mi=built, digest=f"{scene.digest}:{lamps}")


def _block(low, high) -> Masonry:
    return Masonry(np.asarray(low) - OUTER, np.asarray(high) + OUTER)


def two_rooms(wall: float = 0.05, door: bool = False, shut: bool = False) -> LeakScene:
    """Build S1 or S2: two rooms of 3 x 2.6 x 3 m with a wall between them, the left one lit.

    Args:
        wall: Thickness of the wall, metres.
        door: Cut a doorway into the wall (S2).
        shut: Close the doorway with a door leaf.

    Returns:
        The scene.
    """
    half = wall / 2
    low, high = np.array([-3 - half, 0, 0]), np.array([3 + half, 2.6, 3])
    rooms = _block(low, high)
    rooms.carve(low, (-half, 2.6, 3), WHITE)
    rooms.carve((half, 0, 0), high, WHITE)
    if door:
        rooms.carve((-half, 0, 1.0), (half, 2.0, 1.9), WHITE)
    kit = _kit(f"two-rooms-{wall}-{door}-{shut}")
    if shut:
        kit.add("leaf", "white", box((-0.8 * half, 0, 1.0), (0.8 * half, 2.0, 1.9)))
    # The dark room has a lamp too, a thousandth as bright: without it the relative leak would always be 1.
    scene = _finish(kit, rooms, (-1.6, 2.2, 1.4, 10.0), (1.7, 2.2, 1.6, 10.0 / CONTRAST))

    def region(x):
        return np.where(x[:, 0] < -half, 0, np.where(x[:, 0] > half, 1, -1))

    return LeakScene("S2 doorway" if door else f"S1 wall {100 * wall:g} cm", scene, region, np.stack([low, high]))


def column() -> LeakScene:
    """Build S3: thin columns in one room, which hide a probe from places close to it.

    Returns:
        The scene.
    """
    low, high = np.zeros(3), np.array([5, 2.6, 4])
    room = _block(low, high)
    room.carve(low, high, WHITE)
    kit = _kit("column")
    for x, z in ((1.7, 1.6), (3.2, 2.4)):
        kit.add(f"column{x}", "red", box((x, 0, z), (x + 0.22, 2.6, z + 0.22), skip=("-y", "+y")))
    scene = _finish(kit, room, (2.5, 2.2, 0.5, 10.0))
    return LeakScene("S3 column", scene, lambda x: np.zeros(len(x), int), np.stack([low, high]))


def storeys() -> LeakScene:
    """Build S4: two storeys with a slab of 10 cm and a stair hole between them, the upper one lit.

    Returns:
        The scene.
    """
    low, high = np.zeros(3), np.array([5, 5.1, 4])
    house = _block(low, high)
    house.carve(low, (5, 2.5, 4), WHITE)
    house.carve((0, 2.6, 0), high, WHITE)
    house.carve((3.9, 2.5, 2.6), (5, 2.6, 4), WHITE)
    scene = _finish(_kit("storeys"), house, (1.5, 4.5, 1.5, 10.0))
    region = lambda x: np.where(x[:, 1] < 2.5, 0, np.where(x[:, 1] > 2.6, 1, -1))  # noqa: E731
    return LeakScene("S4 storeys", scene, region, np.stack([low, high]))


def corridor() -> LeakScene:
    """Build S5: an L-shaped corridor lit at one end, where light reaches the other end only around the corner.

    Returns:
        The scene.
    """
    low, high = np.zeros(3), np.array([6, 2.4, 6])
    way = _block(low, high)
    way.carve((0, 0, 0), (6, 2.4, 1.4), WHITE)
    way.carve((4.6, 0, 1.4), (6, 2.4, 6), WHITE)
    scene = _finish(_kit("corridor"), way, (0.7, 2.0, 0.7, 10.0))
    inside = lambda x: (x[:, 2] < 1.4) | (x[:, 0] > 4.6)  # noqa: E731
    return LeakScene("S5 corridor", scene, lambda x: np.where(inside(x), 0, -1), np.stack([low, high]))


def shed() -> LeakScene:
    """Build S6: a shed with walls of 5 cm and a slit, under a bright sky.

    Returns:
        The scene.
    """
    low, high = np.array([-3.0, 0, -3]), np.array([3.0, 3.0, 3])
    kit = _kit("shed")
    kit.add("ground", "floor", box((-5, -0.1, -5), (5, 0, 5)))
    w, t = 1.5, 0.05
    parts = [
        box((-w, 0, -w), (w, 2.2, -w + t)),
        box((-w, 0, w - t), (w, 2.2, w)),
        box((-w, 0, -w + t), (-w + t, 2.2, w - t)),
        box((w - t, 0, -w + t), (w, 2.15, w - t)),
        box((-w, 2.2, -w), (w, 2.25, w)),
    ]
    kit.add("shed", "white", *parts)
    scene = kit.scene([Camera((4, 2, 4), (0, 1, 0), name="home")])

    def region(x):
        inner = np.all(np.abs(x[:, [0, 2]]) < w - t, axis=1) & (x[:, 1] < 2.2)
        outer = np.any(np.abs(x[:, [0, 2]]) > w, axis=1) | (x[:, 1] > 2.25)
        return np.where(inner, 0, np.where(outer, 1, -1))

    return LeakScene("S6 shed", under_sky(scene), region, np.stack([low, high]))


def dividers() -> LeakScene:
    """Build S7: a coloured box of 3 m with thin walls that are not aligned with the lattice.

    Returns:
        The scene.
    """
    low, high = np.zeros(3), np.array([3.0, 3.0, 3.0])
    room = _block(low, high)
    room.carve(low, high, WHITE)
    for side, color in ((("+x",), "red"), (("-x",), "green")):
        room.paint(low, high, side, color)
    kit = _kit("dividers")
    for angle, (x, z) in ((0.5, (1.0, 1.9)), (-0.7, (2.1, 1.2))):
        part = box((-0.7, 0, -0.015), (0.7, 2.2, 0.015))
        c, s = np.cos(angle), np.sin(angle)
        turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
        part = replace(part, positions=part.positions @ turn.T + [x, 0, z], normals=part.normals @ turn.T)
        kit.add(f"divider{x}", "white", part)
    scene = _finish(kit, room, (0.4, 2.7, 0.4, 10.0))
    return LeakScene("S7 dividers", scene, lambda x: np.zeros(len(x), int), np.stack([low, high]))


SCENES: dict[str, Callable[[], LeakScene]] = {
    **{f"s1-{cm}": (lambda cm=cm: two_rooms(cm / 100)) for cm in (1, 2, 5, 10, 20, 50)},
    "s2": lambda: two_rooms(0.05, door=True),
    "s2-shut": lambda: two_rooms(0.05, door=True, shut=True),
    "s3": column,
    "s4": storeys,
    "s5": corridor,
    "s6": shed,
    "s7": dividers,
}
