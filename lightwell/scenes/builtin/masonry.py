"""Walls by subtraction: rooms, doorways and shafts are cut as boxes out of a solid block.

The faces between the remaining solid and the cut boxes are the walls: no hidden or overlapping faces, no T-junctions,
and walls of the intended thickness. The block has no outer faces, because it is seen from inside only; a cut that
reaches its surface is open there (the sky above a light well).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from .shapes import FACES, MeshPart

Corner = Sequence[float]


@dataclass(frozen=True)
class Finish:
    """The materials of a room's surfaces."""

    walls: str
    floor: str
    ceiling: str

    def facing(self, direction: str) -> str:
        """Select the material of a face.

        Args:
            direction: Direction of its normal, such as '+y' for the floor.

        Returns:
            Name of the material.
        """
        return {"+y": self.floor, "-y": self.ceiling}.get(direction, self.walls)


@dataclass
class Masonry:
    """A solid block between two corners, out of which rooms are cut; later cuts and fills override earlier ones."""

    low: Corner
    high: Corner
    _steps: list[tuple[np.ndarray, Finish | None]] = field(default_factory=list)
    _paint: list[tuple[np.ndarray, str, tuple[str, ...]]] = field(default_factory=list)

    def carve(self, low: Corner, high: Corner, finish: Finish) -> None:
        """Cut out a box.

        Args:
            low: Smallest corner, metres.
            high: Largest corner, metres.
            finish: Materials of its walls, floor and ceiling.
        """
        self._steps.append((np.array([low, high], dtype=np.float64), finish))

    def fill(self, low: Corner, high: Corner) -> None:
        """Make a box solid again (a parapet, a plinth); its faces get the finish of the air around it.

        Args:
            low: Smallest corner, metres.
            high: Largest corner, metres.
        """
        self._steps.append((np.array([low, high], dtype=np.float64), None))

    def paint(self, low: Corner, high: Corner, facing: Sequence[str], material: str) -> None:
        """Give faces inside a box another material.

        Args:
            low: Smallest corner, metres.
            high: Largest corner, metres.
            facing: Directions of the normals of these faces.
            material: Name of the material.
        """
        self._paint.append((np.array([low, high], dtype=np.float64), material, tuple(facing)))

    def build(self) -> dict[str, MeshPart]:
        """Make the faces of all walls.

        Returns:
            Triangles by material.
        """
        planes = [self._planes(axis) for axis in range(3)]
        finishes = [step[1] for step in self._steps]
        air = self._cells(planes)
        found: dict[str, list[tuple[np.ndarray, ...]]] = {}
        for axis in range(3):
            near, far = np.moveaxis(air, axis, 0)[:-1], np.moveaxis(air, axis, 0)[1:]
            for sign, cut, wall in (("-", near, far), ("+", far, near)):
                direction = sign + "xyz"[axis]
                where = np.argwhere((cut >= 0) & (wall < 0))
                which = cut[(cut >= 0) & (wall < 0)]
                low, high = _rectangles(planes, where, axis)
                names = [finishes[k].facing(direction) for k in which]
                self._repaint(names, (low + high) / 2, direction)
                for name in dict.fromkeys(names):
                    rows = np.array([n == name for n in names])
                    found.setdefault(name, []).append(_quads(low[rows], high[rows], direction))
        return {name: _join(quads) for name, quads in found.items()}

    def _planes(self, axis: int) -> np.ndarray:
        """Sort the cutting planes along one axis."""
        boxes = [box for box, _ in self._steps] + [box for box, _, _ in self._paint]
        cuts = np.concatenate([[self.low[axis], self.high[axis]], *[box[:, axis] for box in boxes]])
        return np.unique(np.round(np.clip(cuts, self.low[axis], self.high[axis]), 6))

    def _cells(self, planes: list[np.ndarray]) -> np.ndarray:
        """Compute [nx, ny, nz] int: index of the cut that made a cell air, -1 where it is solid."""
        middles = [(p[1:] + p[:-1]) / 2 for p in planes]
        air = np.full([len(m) for m in middles], -1)
        for k, (box, finish) in enumerate(self._steps):
            inside = [(m > box[0, a]) & (m < box[1, a]) for a, m in enumerate(middles)]
            air[np.ix_(*inside)] = -1 if finish is None else k
        return air

    def _repaint(self, names: list[str], centers: np.ndarray, direction: str) -> None:
        for box, material, facing in self._paint:
            if direction in facing:
                # Half a millimetre of tolerance: the face itself lies on the box's boundary.
                inside = np.all((centers > box[0] - 5e-4) & (centers < box[1] + 5e-4), axis=1)
                for row in np.flatnonzero(inside):
                    names[row] = material


def _rectangles(planes: list[np.ndarray], where: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Compute corners [K, 3] of the faces above the cells ``where`` [K, 3] (axis first) along ``axis``."""
    order = [axis] + [a for a in range(3) if a != axis]
    low, high = np.empty((len(where), 3)), np.empty((len(where), 3))
    for column, a in enumerate(order):
        cell = where[:, column]
        low[:, a] = planes[a][cell + 1] if a == axis else planes[a][cell]
        high[:, a] = planes[a][cell + 1]
    return low, high


def _quads(low: np.ndarray, high: np.ndarray, direction: str) -> tuple[np.ndarray, ...]:
    """Make positions [K, 4, 3], normals and metric uv of flat rectangles that face along ``direction``."""
    outward, u, v = FACES[direction]
    start = np.where(u + v < 0, high, low)
    edge_u, edge_v = u * (high - low), v * (high - low)
    positions = np.stack([start, start + edge_u, start + edge_u + edge_v, start + edge_v], axis=1)
    uv = np.stack([positions @ u, -(positions @ v)], axis=-1)
    return positions, np.broadcast_to(outward, positions.shape), uv


def _join(quads: list[tuple[np.ndarray, ...]]) -> MeshPart:
    """Join all rectangles to one part."""
    positions, normals, uv = (np.concatenate([q[k] for q in quads]) for k in range(3))
    first = 4 * np.arange(len(positions))[:, None]
    indices = np.concatenate([first + np.array(corners) for corners in ([0, 1, 2], [0, 2, 3])])
    return MeshPart(positions.reshape(-1, 3), normals.reshape(-1, 3), uv.reshape(-1, 2), indices)
