"""Families of kernels: their axes, the kernel of each node, and what is rotated at run time."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from lightwell.lens import psf
from lightwell.lens.aperture import DISC, Aperture
from lightwell.lens.errors import LensError
from lightwell.lens.grid import THRESHOLD, Axis, length_axis, radius_axis, uniform_axis
from lightwell.lens.prescription import MountedLens

# Noise of flat areas that the radius axis allows: 0.0025 is 52 dB. With a second axis kernels are larger, nodes fewer.
NOISE, NOISE_JOINT = 0.0025, 0.03
# Smallest step of the radius axis where there is a second one, pixels.
FINEST_JOINT = 0.06
# Step of the length axis, pixels at short lengths.
LENGTH_STEP = 1.0
# Baked angles of a shaped aperture in motion: half a turn. A step moves the ends of a 24 px streak by 0.4 px.
ANGLES = 90
# Nodes of the field radius.
FIELD_NODES = 9

# Families that ``lens bake`` writes, and those of library files.
NAMES = ("depth", "depth-speed", "shaped-speed", "cats-eye")
STORED = (*NAMES, "prescription")


@dataclass(frozen=True)
class Family:
    """Set of kernels over one to three axes; the first is always the magnitude of the circle of confusion."""

    name: str
    """``depth`` · ``depth-speed`` (round, turned at run time) · ``shaped-speed`` (angle baked) · ``cats-eye`` ·
    ``prescription``."""
    radius: Axis
    length: Axis = field(default_factory=lambda: Axis("length", (0.0,)))
    """Second axis: length of the motion, or field radius of the cat's eye."""
    angle: Axis = field(default_factory=lambda: Axis("angle", (0.0,)))
    """Third axis: baked angle of the motion, radians in [0, π]; or side of the focus, 0 in front, 1 behind."""
    aperture: Aperture = DISC
    strength: float = 0.0
    """Shift of the cat's eye at the corner, radii."""
    lens: MountedLens | None = field(default=None, compare=False)
    """Lens of the family ``prescription``; None where a library of it was only read."""

    @property
    def turns(self) -> bool:
        """Whether points are rotated at run time, each then writing to four pixels."""
        return self.name == "depth-speed" or self.by_field

    @property
    def by_field(self) -> bool:
        """Whether the second axis is the distance from the middle of the picture, and not the length of a motion."""
        return self.name in ("cats-eye", "prescription")

    @property
    def size(self) -> int:
        """Number of nodes."""
        return len(self.radius) * len(self.length) * len(self.angle)

    def node(self, index: int) -> tuple[float, float, float]:
        """Return the axis values of a node.

        Args:
            index: Node, 0 to ``size`` − 1.

        Returns:
            Radius in pixels, value on the second axis, angle in radians.
        """
        n_r, n_l = len(self.radius), len(self.length)
        return (
            self.radius.values[index % n_r],
            self.length.values[index // n_r % n_l],
            self.angle.values[index // (n_r * n_l)],
        )

    def passes(self, index: int) -> bool:
        """Whether a node leaves the picture unchanged: no blur and no motion of a pixel or more.

        Args:
            index: Node, 0 to ``size`` − 1.

        Returns:
            Whether its kernel is a single pixel.
        """
        radius, second, _ = self.node(index)
        return radius < THRESHOLD and (self.by_field or second < 2 * THRESHOLD)

    def kernel(self, index: int) -> np.ndarray:
        """Draw the dense kernel of a node.

        Args:
            index: Node, 0 to ``size`` − 1.

        Returns:
            Point spread function [2·hy+1, 2·hx+1], sum 1.

        Raises:
            LensError: The prescription of the lens is not known.
        """
        radius, second, angle = self.node(index)
        if self.passes(index):
            return np.ones((1, 1))
        if self.name == "cats-eye":
            return psf.cats_eye(radius, second, self.strength)
        if self.name == "prescription":
            if self.lens is None:
                raise LensError("lens: a library of a prescription lacks a node; give the file with --prescription")
            return self.lens.kernel(radius if angle > 0 else -radius, second)
        if self.aperture.round:
            return psf.capsule(radius, second)
        return psf.shaped(self.aperture, radius, second, angle)

    def describe(self) -> dict[str, Any]:
        """Describe the family for the header of a library file.

        Returns:
            JSON-serialisable data: name, key of the aperture, axes, strength.
        """
        facts = {
            "family": self.name,
            "aperture": self.aperture.key(),
            "axes": [{"name": a.name, "values": list(a.values)} for a in (self.radius, self.length, self.angle)],
        }
        return facts | ({"strength": self.strength} if self.name == "cats-eye" else {})


def depth(largest: float, aperture: Aperture = DISC, noise: float = NOISE) -> Family:
    """Make a family over the circle of confusion alone, for any aperture; s < 0 mirrors the offsets.

    Args:
        largest: Largest radius, pixels, 0 to 4096.
        aperture: Shape of the opening.
        noise: Noise of flat areas that the spacing of nodes allows, relative.

    Returns:
        The family.
    """
    return Family("depth", radius_axis(_checked(largest), noise), aperture=aperture)


def depth_speed(largest: float, longest: float, noise: float = NOISE_JOINT, step: float = LENGTH_STEP) -> Family:
    """Make a family for a round aperture and straight motion, drawn along x and rotated at run time.

    Args:
        largest: Largest radius, pixels, 0 to 4096.
        longest: Longest motion, pixels, 0 to 4096.
        noise: Noise of flat areas that the spacing of radii allows, relative.
        step: Step of the length axis at short lengths, pixels.

    Returns:
        The family.
    """
    return Family("depth-speed", _joint(largest, noise), length_axis(_checked(longest), step))


def shaped_speed(
    largest: float, longest: float, aperture: Aperture, angles: int = ANGLES, noise: float = NOISE_JOINT
) -> Family:
    """Make a family for any aperture in motion; the angle between shape and motion is an axis.

    Args:
        largest: Largest radius, pixels, 0 to 4096.
        longest: Longest motion, pixels, 0 to 4096.
        aperture: Shape of the opening.
        angles: Number of steps over half a turn.
        noise: Noise of flat areas that the spacing of radii allows, relative.

    Returns:
        The family.
    """
    axes = _joint(largest, noise), length_axis(_checked(longest), LENGTH_STEP)
    return Family("shaped-speed", *axes, uniform_axis("angle", 0.0, np.pi, angles + 1), aperture)


def cats_eye(largest: float, strength: float, noise: float = NOISE_JOINT) -> Family:
    """Make a family for a round aperture with mechanical vignetting by field radius, rotated by the field azimuth.

    Args:
        largest: Largest radius, pixels, 0 to 4096.
        strength: Shift of the vignetting disc at the corner of the picture, in radii, 0 to 1.8 (exclusive).
        noise: Noise of flat areas that the spacing of radii allows, relative.

    Returns:
        The family.

    Raises:
        LensError: The strength is out of range.
    """
    if not 0 <= strength < 1.8:
        raise LensError(f"lens: a cat's eye of strength {strength:g}; use 0 (none) or more, below 1.8 (closed)")
    field_axis = uniform_axis("field", 0.0, 1.0, FIELD_NODES)
    return Family("cats-eye", _joint(largest, noise), field_axis, strength=strength)


def prescription(largest: float, lens: MountedLens, noise: float = NOISE_JOINT) -> Family:
    """Make a family for a real lens: by field radius and by the side of the focus, rotated by the field azimuth.

    Args:
        largest: Largest radius, pixels, 0 to 4096.
        lens: The lens on its camera.
        noise: Noise of flat areas that the spacing of radii allows, relative.

    Returns:
        The family.
    """
    axes = _joint(largest, noise), uniform_axis("field", 0.0, 1.0, FIELD_NODES), Axis("side", (0.0, 1.0))
    return Family("prescription", *axes, Aperture("mask", mask=(b"", 0), label=lens.key()), lens=lens)


def _joint(largest: float, noise: float) -> Axis:
    return radius_axis(_checked(largest), noise, FINEST_JOINT)


def _checked(value: float) -> float:
    if not (np.isfinite(value) and 0 <= value <= 4096):
        raise LensError(f"lens: a library for blur of {value:g} px; use 0 to 4096")
    return float(value)
