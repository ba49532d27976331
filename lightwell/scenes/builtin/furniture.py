"""Furniture of the courtyard house: boxes, rods, lathes and a plant; each stands on the origin unless stated."""

from __future__ import annotations

import numpy as np

from .shapes import MeshPart, board, box, cylinder, lathe, leaf, merge, move, quad, rod, rotate, tube

# Oak boards and tops are this thick, metres.
BOARD = 0.045

GOLDEN_ANGLE = 137.507764


def table(length: float, width: float, height: float) -> MeshPart:
    """Make a table on two trestles, along x.

    Args:
        length: Along x, metres.
        width: Along z, metres.
        height: Top of the table, metres.

    Returns:
        Its triangles.
    """
    x, z = length / 2, width / 2
    top = board((-x, height - BOARD, -z), (x, height, z))
    parts = [top]
    for side in (-1, 1):
        foot = side * (x - 0.28)
        for end in (-1, 1):
            leg = end * (z - 0.1)
            parts.append(
                board((foot - 0.035, 0, leg - 0.035), (foot + 0.035, height - BOARD, leg + 0.035), ("-y", "+y"))
            )
        parts.append(board((foot - 0.025, 0.12, -z + 0.13), (foot + 0.025, 0.18, z - 0.13), ("-z", "+z")))
    return merge(parts)


def bench(length: float, depth: float = 0.38, height: float = 0.44) -> MeshPart:
    """Make a plank bench along x: a thick seat on two slab legs.

    Args:
        length: Along x, metres.
        depth: Along z, metres.
        height: Top of the seat, metres.

    Returns:
        Its triangles.
    """
    x, z = length / 2, depth / 2
    seat = board((-x, height - 0.06, -z), (x, height, z))
    legs = [
        board((s - 0.03, 0, -z + 0.03), (s + 0.03, height - 0.06, z - 0.03), ("-y", "+y")) for s in (0.3 - x, x - 0.3)
    ]
    return merge([seat, *legs])


def throw(width: float, depth: float, height: float, drop: float) -> MeshPart:
    """Make a cloth laid over a bench: a slab on the seat that hangs down in front and behind.

    Args:
        width: Along x, metres.
        depth: Depth of the bench, metres.
        height: Height of the bench, metres.
        drop: Length that hangs down in front, metres.

    Returns:
        Its triangles.
    """
    x, z, thick = width / 2, depth / 2 + 0.006, 0.012
    parts = [box((-x, height, -z), (x, height + thick, z))]
    for side, low in ((1, height - drop), (-1, height - 0.6 * drop)):
        near, far = sorted((side * z, side * (z + thick)))
        parts.append(box((-x, low, near), (x, height + thick, far)))
    return merge(parts)


def stool(radius: float, height: float) -> MeshPart:
    """Make a round stool: a disc on three splayed legs.

    Args:
        radius: Radius of the seat, metres.
        height: Top of the seat, metres.

    Returns:
        Its triangles.
    """
    seat = move(cylinder(radius, 0.035, 32), (0, height - 0.035, 0))
    legs = []
    for angle in 2 * np.pi * np.arange(3) / 3 + 0.4:
        out = radius * np.array([np.cos(angle), 0.0, np.sin(angle)])
        legs.append(rod(1.02 * out + (0, 0.006, 0), 0.6 * out + (0, height - 0.03, 0), 0.016, 10))
    return merge([seat, *legs])


def bowl(radius: float) -> MeshPart:
    """Make a thin bowl.

    Args:
        radius: Radius of the rim, metres.

    Returns:
        Its triangles.
    """
    outer = [(0.0, 0.0), (0.42, 0.0), (0.5, 0.03), (0.82, 0.22), (1.0, 0.46)]
    inner = [(0.96, 0.46), (0.78, 0.25), (0.46, 0.07), (0.0, 0.05)]
    return lathe([(radius * r, radius * y) for r, y in outer + inner], 40)


def vase(height: float) -> MeshPart:
    """Make a bottle-shaped vase, open at the top.

    Args:
        height: Metres.

    Returns:
        Its triangles.
    """
    y = np.linspace(0, 1, 15)
    r = 0.10 + 0.16 * np.sin(np.pi * np.clip(y * 1.25, 0, 1)) ** 1.2 * (1 - 0.2 * y)
    outer = [(0.0, 0.0), *zip(height * r, height * y)]
    inner = [(0.085 * height, 0.999 * height), (0.085 * height, 0.7 * height), (0.0, 0.7 * height)]
    return lathe(outer + inner, 32)


def pot(radius: float, height: float) -> MeshPart:
    """Make a tapered planter with a rim, open down to 6 cm below it, where ``soil`` lies.

    Args:
        radius: Radius at the rim, metres.
        height: Metres.

    Returns:
        Its triangles.
    """
    wall, rim = 0.035, 0.05
    return lathe(
        [
            (0.72 * radius, 0.0),
            (0.97 * radius, height - rim),
            (1.05 * radius, height - rim),
            (1.05 * radius, height),
            (0.97 * radius - wall, height),
            (0.95 * radius - wall, height - 0.07),
        ],
        40,
    )


def soil(radius: float, height: float) -> MeshPart:
    """Make the soil in a ``pot``.

    Args:
        radius: Radius of the pot, metres.
        height: Height of the pot, metres.

    Returns:
        Its triangles.
    """
    return lathe([(0.96 * radius - 0.035, height - 0.06), (0.0, height - 0.045)], 40)


def plant(height: float, stems: int, seed: int) -> tuple[MeshPart, MeshPart]:
    """Make a broad-leaved plant rooted at the origin; leaves are single sheets.

    Args:
        height: Metres.
        stems: Number of stems.
        seed: Seed of the shape.

    Returns:
        Stems and leaves.
    """
    random = np.random.default_rng(seed)
    stalks, blades = [], []
    for k in range(stems):
        reach = height * (0.55 + 0.45 * (k + 0.5) / stems)
        lean = np.radians(44 - 32 * (k + 0.5) / stems + random.uniform(-5, 5))
        t = np.linspace(0, 1, 7)
        # The stalk leaves the soil upright and leans outwards more and more.
        bend = lean * t**1.4
        path = np.cumsum(np.stack([np.sin(bend), np.cos(bend), 0 * t], 1) * reach * 0.72 / 7, axis=0)
        path += [0.05, -path[0, 1] - 0.02, 0]
        turn = GOLDEN_ANGLE * k + random.uniform(-12, 12)
        stalks.append(rotate(tube(path, np.linspace(0.014, 0.006, 7), 6), turn))
        length = random.uniform(0.34, 0.46) * height
        blade = leaf(length, 0.40 * length, random.uniform(0.9, 1.5), steps=10)
        blade = rotate(blade, np.degrees(np.pi / 2 - bend[-1]) * 0.75, "z")
        blades.append(rotate(move(blade, path[-1]), turn))
    return merge(stalks), merge(blades)


def picture(width: float, height: float) -> tuple[MeshPart, MeshPart]:
    """Make a picture on a wall behind it: centre at the origin, facing +z, 3 cm deep.

    Args:
        width: Along x, metres.
        height: Along y, metres.

    Returns:
        Frame and canvas.
    """
    x, y, edge, deep = width / 2, height / 2, 0.022, 0.03
    frame = merge(
        [
            board((-x, -y, 0), (-x + edge, y, deep), ("-z",)),
            board((x - edge, -y, 0), (x, y, deep), ("-z",)),
            board((-x + edge, -y, 0), (x - edge, -y + edge, deep), ("-z",)),
            board((-x + edge, y - edge, 0), (x - edge, y, deep), ("-z",)),
        ]
    )
    canvas = quad((-x + edge, -y + edge, 0.012), (width - 2 * edge, 0, 0), (0, height - 2 * edge, 0), fit=True)
    return frame, canvas


def railing(length: float, height: float = 1.0, spacing: float = 0.115) -> tuple[MeshPart, MeshPart]:
    """Make a straight railing along x from the origin.

    Args:
        length: Along x, metres.
        height: Height of the handrail, metres.
        spacing: Distance between bars, metres.

    Returns:
        Steel bars and the oak handrail.
    """
    count = round(length / spacing)
    bars = [
        box((x - 0.007, 0.06, -0.007), (x + 0.007, height, 0.007), ("+y", "-y")) for x in np.linspace(0, length, count)
    ]
    rail = box((0, 0.04, -0.012), (length, 0.06, 0.012))
    grip = board((-0.02, height, -0.028), (length + 0.02, height + 0.045, 0.028))
    return merge([*bars, rail]), grip


def flight(treads: int, rise: float, run: float, width: float, thickness: float = 0.07) -> MeshPart:
    """Make cantilevered treads that climb towards -z; x from 0 to ``width``.

    Args:
        treads: Number of treads.
        rise: Height of a step, metres; the first tread's top is at this height.
        run: Depth of a step, metres.
        width: Along x, metres.
        thickness: Thickness of a tread, metres.

    Returns:
        Their triangles.
    """
    nose = 0.025
    return merge(
        [
            board(
                (0, (k + 1) * rise - thickness, -(k + 1) * run),
                (width, (k + 1) * rise, -k * run + nose),
                ("+x",),
            )
            for k in range(treads)
        ]
    )


def shelf(width: float, height: float, depth: float, boards: int) -> MeshPart:
    """Make an open shelf against a wall behind it (-z), its boards between two sides.

    Args:
        width: Along x, metres.
        height: Along y, metres.
        depth: Along z, metres.
        boards: Number of boards, ≥ 1.

    Returns:
        Its triangles.
    """
    x = width / 2
    parts = [board((s, 0, 0), (s + 0.03, height, depth), ("-y", "-z")) for s in (-x, x - 0.03)]
    for y in np.linspace(0.12, height - 0.03, boards):
        parts.append(board((-x + 0.03, y, 0), (x - 0.03, y + 0.03, depth), ("-x", "+x", "-z")))
    return merge(parts)


def books(width: float, seed: int) -> list[MeshPart]:
    """Make three groups of books on a board at y = 0, for three colours.

    Args:
        width: They stand from x = 0 to this, metres.
        seed: Seed of their sizes.

    Returns:
        Triangles of each group that has a book.
    """
    random = np.random.default_rng(seed)
    groups: list[list[MeshPart]] = [[], [], []]
    x = 0.0
    while x < width - 0.05:
        thick, tall, deep = random.uniform(0.018, 0.045), random.uniform(0.19, 0.28), random.uniform(0.15, 0.2)
        groups[random.integers(3)].append(box((x, 0, 0.02), (x + thick, tall, 0.02 + deep), ("-y",)))
        x += thick + (0.001 if random.random() < 0.9 else 0.16)
    return [merge(g) for g in groups if g]
