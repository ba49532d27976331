"""The Cornell box with its measured proportions (Cornell University Program of Computer Graphics, 1998), 2 m high."""

from __future__ import annotations

import numpy as np

from ..scene import Camera, Material, Scene
from .kit import Kit
from .masonry import Finish, Masonry
from .shapes import MeshPart, box, move, prism

VERSION = 1

# The published box measures 556 x 548.8 x 559.2 mm; this many metres per published millimetre make it 2 m high.
SCALE = 2.0 / 548.8
WIDTH, HEIGHT, DEPTH = 556.0 * SCALE, 2.0, 559.2 * SCALE

# Floor corners (x, z) of the blocks and their heights, in published millimetres.
SHORT_BLOCK: tuple[list[tuple[float, float]], float] = ([(130, 65), (82, 225), (240, 272), (290, 114)], 165.0)
TALL_BLOCK: tuple[list[tuple[float, float]], float] = ([(423, 247), (265, 296), (314, 456), (472, 406)], 330.0)

# The lamp's patch in the ceiling, published millimetres: x and z ranges.
LAMP = ((213.0, 343.0), (227.0, 332.0))

WALL = 0.1


def build() -> Scene:
    """Build the Cornell box: open front towards +z, red left, green right, two blocks, a white patch instead of the
    lamp.

    Returns:
        The scene.
    """
    kit = Kit("cornell", VERSION)
    for name, color in {
        "white": (0.725, 0.71, 0.68),
        "red": (0.63, 0.065, 0.05),
        "green": (0.14, 0.45, 0.091),
        "lamp": (0.78, 0.78, 0.78),
    }.items():
        kit.material(Material(name, base_color=(*color, 1.0), metallic=0.0, roughness=1.0))
    for material, part in _shell().build().items():
        kit.add("box" if material == "white" else f"{material}_wall", material, part)
    kit.add("short_block", "white", _block(*SHORT_BLOCK))
    kit.add("tall_block", "white", _block(*TALL_BLOCK))
    kit.add("lamp_patch", "lamp", _lamp_patch())
    return kit.scene(_cameras())


def _shell() -> Masonry:
    half_x, half_z = WIDTH / 2, DEPTH / 2
    shell = Masonry((-half_x - WALL, -WALL, -half_z - WALL), (half_x + WALL, HEIGHT + WALL, half_z))
    shell.carve((-half_x, 0, -half_z), (half_x, HEIGHT, half_z), Finish("white", "white", "white"))
    shell.paint((-half_x, 0, -half_z), (-half_x, HEIGHT, half_z), ["+x"], "red")
    shell.paint((half_x, 0, -half_z), (half_x, HEIGHT, half_z), ["-x"], "green")
    return shell


def _turned(x: float, z: float) -> tuple[float, float]:
    """Convert published floor coordinates: centred, metres, camera at +z (a half turn, so nothing is mirrored)."""
    return WIDTH / 2 - x * SCALE, DEPTH / 2 - z * SCALE


def _block(corners: list[tuple[float, float]], height: float) -> MeshPart:
    ring = np.array([_turned(x, z) for x, z in corners])
    x, z = ring.T
    # Counter-clockwise seen from above, where z points down the page.
    if np.sum(x * np.roll(z, -1) - np.roll(x, -1) * z) > 0:
        ring = ring[::-1]
    return prism(ring, height * SCALE)


def _lamp_patch() -> MeshPart:
    """Make a plate 1 cm thick under the ceiling."""
    (x0, x1), (z0, z1) = LAMP
    (right, front), (left, back) = _turned(x0, z0), _turned(x1, z1)
    return move(box((left, -0.01, back), (right, 0.0, front), skip=("+y",)), (0, HEIGHT, 0))


def _cameras() -> list[Camera]:
    front = DEPTH / 2
    return [
        Camera((0.0, 0.995, front + 2.72), (0.0, 0.995, 0.0), fov_y=39.3, name="home"),
        Camera((0.0, 1.0, front - 0.05), (0.0, 0.85, -1.0), fov_y=75.0, name="inside"),
        Camera((0.82, 1.55, 0.85), (-0.45, 0.55, -0.55), fov_y=70.0, name="from above right"),
        Camera((-0.8, 0.35, 0.9), (0.35, 0.65, -0.6), fov_y=70.0, name="low left"),
        Camera((0.85, 0.9, -0.85), (-0.5, 0.5, 0.6), fov_y=75.0, name="behind the short block"),
        Camera((-0.1, 0.25, 0.95), (-0.75, 0.75, -0.75), fov_y=65.0, name="red glow"),
    ]
