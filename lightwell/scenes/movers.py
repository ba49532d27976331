"""The parts of a scene that a bake moves: a node that turns about an axis or slides along one, or a clip of the file.

Notation: v a value, in degrees, metres or shares of a clip; t = (v − low) / (high − low) the slider, 0 to 1. At rest
the scene is as its file has it. A pose is one slider for each mover of a scene.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, Literal

import numpy as np

from lightwell.core.sobol import Sobol

Vector = tuple[float, float, float]
# Things that move in one bake, at most.
MOST_MOVERS = 3
Pose = tuple[float, ...]
"""A slider, 0 to 1, for each mover of a scene."""


class RigidPart(ABC):
    """Meshes and lights that move together, without a change of their shape."""

    meshes: tuple[int, ...]
    lights: tuple[int, ...]

    @abstractmethod
    def motion(self, slider: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Compute the motions from the rest pose to poses.

        Args:
            slider: [N] sliders.

        Returns:
            Rotations [N, 3, 3] and translations [N, 3], metres: a point x of the rest pose moves to R x + c.
        """

    def moved(self, slider: float, points: np.ndarray, directions: bool = False) -> np.ndarray:
        """Move points or directions from the rest pose to a pose.

        Args:
            slider: 0 to 1.
            points: [N, 3] positions in metres, or directions.
            directions: Whether they are directions.

        Returns:
            [N, 3] float64.
        """
        turn, offset = self.motion(np.array([slider]))
        return np.asarray(points, np.float64) @ turn[0].T + (0 if directions else offset[0])


class Mover(ABC):
    """What one variable of a bake moves."""

    name: str
    low: float
    high: float

    @property
    @abstractmethod
    def parts(self) -> Sequence[RigidPart]:
        """What moves, part by part."""

    @property
    @abstractmethod
    def unit(self) -> str:
        """Unit of a value: 'degrees', 'metres' or 'share'."""

    @property
    @abstractmethod
    def initial(self) -> float:
        """The slider that a page shows first."""

    @abstractmethod
    def caption(self, slider: float) -> str:
        """Describe a pose in words.

        Args:
            slider: 0 to 1.

        Returns:
            For example 'Door at 45°'.
        """

    @abstractmethod
    def json(self) -> dict[str, Any]:
        """Describe the mover for reports.

        Returns:
            JSON values.
        """

    @property
    def moving_meshes(self) -> tuple[int, ...]:
        """Meshes that move, indices into ``Scene.meshes``."""
        return tuple(sorted(mesh for part in self.parts for mesh in part.meshes))

    def value(self, slider: float) -> float:
        """Convert a slider to a value.

        Args:
            slider: 0 to 1.

        Returns:
            The value, in the unit.
        """
        return self.low + (self.high - self.low) * slider

    def slider(self, value: float) -> float:
        """Convert a value to a slider.

        Args:
            value: The value, in the unit.

        Returns:
            0 at the first value, 1 at the last one.
        """
        return (value - self.low) / (self.high - self.low)


@dataclass(frozen=True)
class NodeMover(Mover, RigidPart):
    """A node whose rotation or translation is a variable of a bake."""

    name: str
    """Name of the node."""
    path: Literal["rotation", "translation"]
    axis: Vector
    """Unit direction in world space at rest: the axis of the rotation, or the way of the translation."""
    pivot: Vector
    """A point of the axis of a rotation, metres; what a translation by 0 adds to the rest position, metres."""
    low: float
    """First value: degrees from rest, or 0 metres."""
    high: float
    """Last value: degrees from rest, or metres from the first."""
    meshes: tuple[int, ...]
    """Meshes that move, indices into ``Scene.meshes``."""
    lights: tuple[int, ...] = ()
    """Punctual lights that move, indices into ``Scene.lights``."""

    @property
    def unit(self) -> str:
        """Unit of a value: 'degrees' or 'metres'."""
        return "degrees" if self.path == "rotation" else "metres"

    @property
    def parts(self) -> Sequence[RigidPart]:
        """The node itself."""
        return (self,)

    @property
    def initial(self) -> float:
        """The slider that a page shows first: the rest pose where it lies in the range, else the first value."""
        at = self.slider(0.0)
        return at if self.path == "rotation" and 0 <= at <= 1 else 0.0

    def caption(self, slider: float) -> str:
        """Describe a pose in words.

        Args:
            slider: 0 to 1.

        Returns:
            For example 'Door at 45°'.
        """
        return f"{self.name} at {self.value(slider):.3g}{'°' if self.path == 'rotation' else ' m'}"

    def motion(self, slider: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Compute the motions from the rest pose to poses.

        Args:
            slider: [N] sliders.

        Returns:
            Rotations [N, 3, 3] and translations [N, 3], metres: a point x of the rest pose moves to R x + c.
        """
        v = self.low + (self.high - self.low) * np.asarray(slider, np.float64).reshape(-1)
        axis, pivot = np.asarray(self.axis), np.asarray(self.pivot)
        if self.path == "translation":
            return np.broadcast_to(np.eye(3), (len(v), 3, 3)), pivot + v[:, None] * axis
        x, y, z = axis
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        angle = np.radians(v)[:, None, None]
        # Rodrigues' formula.
        turn = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * (cross @ cross)
        return turn, pivot - turn @ pivot

    def json(self) -> dict[str, Any]:
        """Describe the mover for reports.

        Returns:
            JSON values.
        """
        return {"name": self.name, "path": self.path, "unit": self.unit, "range": [self.low, self.high]}

    def variable_json(self, node: int, initial: float) -> dict[str, Any]:
        """Write the mover as an entry of ``variables`` in the glTF extension (format/FORMAT.md).

        Args:
            node: Index of the node of the asset that moves.
            initial: First slider, 0 to 1.

        Returns:
            JSON-compatible object.
        """
        more = {"offset": [float(c) for c in self.pivot]} if self.path == "translation" else {}
        return {
            "name": self.name,
            "kind": "node",
            "node": node,
            "path": self.path,
            "axis": [float(c) for c in self.axis],
            "range": [float(self.low), float(self.high)],
            "unit": self.unit,
            "initial": float(self.value(initial)),
        } | more


def moving_meshes(movers: Sequence[Mover]) -> tuple[int, ...]:
    """List the meshes that move.

    Args:
        movers: Movers of a scene.

    Returns:
        Indices into ``Scene.meshes``, increasing.
    """
    return tuple(sorted(mesh for mover in movers for mesh in mover.moving_meshes))


def pose_nodes(count: int, movers: int = 1) -> np.ndarray:
    """Choose the poses that are traced: dense towards both end stops of every mover.

    One mover takes Clenshaw–Curtis nodes. Several take all combinations of their end stops, where these are at most
    half of the poses, and points of a Sobol sequence.

    Args:
        count: K, ≥ 2.
        movers: M, ≥ 1.

    Returns:
        [K, M] sliders from 0 to 1; increasing for one mover.
    """
    if movers == 1:
        return (0.5 - 0.5 * np.cos(math.pi * np.arange(count) / (count - 1)))[:, None]
    stops = np.array(list(product((0.0, 1.0), repeat=movers)))
    if 2 * len(stops) > count:
        stops = stops[[0, -1]]
    return np.concatenate([stops, sobol_poses(count - len(stops), movers, 0)])


def sobol_poses(count: int, movers: int, seed: int) -> np.ndarray:
    """Spread poses over all combinations of sliders, dense towards the end stops.

    Args:
        count: K.
        movers: M, ≥ 1.
        seed: Seed of the sequence.

    Returns:
        [K, M] sliders in [0, 1].
    """
    return 0.5 - 0.5 * np.cos(math.pi * Sobol(movers, seed).random(count))
