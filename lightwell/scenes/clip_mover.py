"""A clip of a file as a variable of a bake: its nodes move along their keys, each as a rigid part."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.core.quaternions import slerp
from lightwell.scenes.gltf_nodes import rotations
from lightwell.scenes.movers import Mover, RigidPart, Vector

Quaternion = tuple[float, float, float, float]


@dataclass(frozen=True)
class ClipMotion:
    """World transforms of the nodes that a clip moves."""

    seconds: float
    """Length of the clip."""
    shares: np.ndarray
    """[K] times, shares of the clip, increasing from 0 to 1."""
    nodes: tuple[int, ...]
    """The nodes that are animated or lie below one that is; indices into ``Scene.nodes``."""
    owner: tuple[int, ...]
    """For each of them the nearest animated node: itself or one above; indices into ``Scene.nodes``."""
    worlds: np.ndarray
    """[K, nodes, 4, 4] float64 world transforms, metres."""


@dataclass(frozen=True)
class ClipPart(RigidPart):
    """An animated node with what hangs on it, but for nodes below it that are animated too.

    Keys are read as glTF reads them: rotations by spherical, places by plain linear interpolation.
    """

    name: str
    """Name of the node."""
    meshes: tuple[int, ...]
    """Meshes that move, indices into ``Scene.meshes``."""
    lights: tuple[int, ...]
    """Punctual lights that move, indices into ``Scene.lights``."""
    shares: tuple[float, ...]
    """K times, shares of the clip, increasing from 0 to 1."""
    turns: tuple[Quaternion, ...]
    """K rotations from rest, unit quaternions x, y, z, w."""
    places: tuple[Vector, ...]
    """K places of the node's origin, metres."""
    rest: Vector
    """Place of the node's origin at rest, metres."""
    span: tuple[float, float]
    """Shares of the clip at the sliders 0 and 1."""

    def motion(self, slider: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Compute the motions from the rest pose to poses.

        Args:
            slider: [N] sliders.

        Returns:
            Rotations [N, 3, 3] and translations [N, 3], metres: a point x of the rest pose moves to R x + c.
        """
        low, high = self.span
        at = low + (high - low) * np.asarray(slider, np.float64).reshape(-1)
        shares, turns, places = (np.asarray(x, np.float64) for x in (self.shares, self.turns, self.places))
        first = np.clip(np.searchsorted(shares, at, side="right") - 1, 0, len(shares) - 2)
        f = np.clip((at - shares[first]) / (shares[first + 1] - shares[first]), 0.0, 1.0)[:, None]
        turn = rotations(slerp(turns[first], turns[first + 1], f))
        place = (1 - f) * places[first] + f * places[first + 1]
        return turn, place - turn @ np.asarray(self.rest)


@dataclass(frozen=True)
class ClipMover(Mover):
    """A clip of a file, or a stretch of one."""

    name: str
    """Name of the clip."""
    low: float
    """First share of the clip."""
    high: float
    """Last share of the clip."""
    seconds: float
    """Length of the whole clip."""
    clip_parts: tuple[ClipPart, ...]
    """What moves."""

    @property
    def parts(self) -> tuple[ClipPart, ...]:
        """What moves, part by part."""
        return self.clip_parts

    @property
    def unit(self) -> str:
        """Unit of a value: 'share', of the clip."""
        return "share"

    @property
    def initial(self) -> float:
        """The slider that a page shows first: the beginning."""
        return 0.0

    def caption(self, slider: float) -> str:
        """Describe a pose in words.

        Args:
            slider: 0 to 1.

        Returns:
            For example 'Door at 50 %'.
        """
        return f"{self.name} at {100 * self.value(slider):.3g} %"

    def json(self) -> dict[str, Any]:
        """Describe the mover for reports.

        Returns:
            JSON values.
        """
        return {"name": self.name, "path": "animation", "unit": self.unit, "range": [self.low, self.high]}

    def variable_json(self, animation: int, initial: float) -> dict[str, Any]:
        """Write the mover as an entry of ``variables`` in the glTF extension (format/FORMAT.md).

        Args:
            animation: Index of the animation of the asset.
            initial: First slider, 0 to 1.

        Returns:
            JSON-compatible object.
        """
        return {
            "name": self.name,
            "kind": "clip",
            "animation": animation,
            "range": [float(self.low), float(self.high)],
            "unit": self.unit,
            "initial": float(self.value(initial)),
        }
