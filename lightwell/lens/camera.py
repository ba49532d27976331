"""Thin-lens camera: from depth to blur in pixels.

Signed circle of confusion, radius in pixels, z the depth along the camera axis:
s(z) = Kc (1/z_f − 1/z),  Kc = (A/2) f z_f / ((z_f − f) p),  A = f/N the aperture's diameter, p the pixel pitch.
s > 0 lies behind the focus distance; for the sky, z = ∞, s = Kc / z_f.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from lightwell.lens.errors import LensError

# Metres in a unit of length.
UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "km": 1e3, "in": 0.0254, "ft": 0.3048}


def distance(text: str | float, what: str = "distance", default_unit: str | None = None) -> float:
    """Parse a length such as ``2.5m`` or ``50mm``.

    Args:
        text: Number and unit.
        what: Name of the option, for messages.
        default_unit: Unit of a number without one: a key of ``UNITS``; None requires a unit.

    Returns:
        Metres.

    Raises:
        LensError: The text is not a length.
    """
    match = re.fullmatch(r"\s*([-+]?\d*\.?\d+(?:[eE][-+]?\d+)?)\s*([a-z]*)\s*", str(text))
    unit = match and (match.group(2) or default_unit)
    if not match or unit not in UNITS:
        known = ", ".join(UNITS)
        raise LensError(f"lens: {what} {text!r} is not a length; write a number and a unit ({known}), for example 2.5m")
    return float(match.group(1)) * UNITS[unit]


@dataclass(frozen=True)
class LensCamera:
    """Thin lens in front of a sensor. Lengths are in metres."""

    focus: float = 2.5
    """Distance of the plane in focus, along the camera axis."""
    fstop: float = 2.8
    """f-number N: focal length over the aperture's diameter. Infinity is a pinhole."""
    focal: float = 0.050
    """Focal length."""
    sensor: float = 0.036
    """Width of the sensor."""
    shutter: float = 0.5
    """Share of the frame's time during which the shutter is open; 0.5 is 180°."""
    scene_unit: float = 1.0
    """Metres per unit of the depth given."""

    def __post_init__(self) -> None:
        for name in ("focus", "fstop", "focal", "sensor", "shutter", "scene_unit"):
            value = getattr(self, name)
            if not isinstance(value, (int, float, np.floating)) or np.isnan(value):
                raise LensError(f"lens: {name} is {value!r}; give a number")
        if not 0 < self.focal < np.inf:
            raise LensError(f"lens: focal length {self.focal * 1e3:g} mm; give one above 0, for example 50mm")
        if not self.focus > self.focal:
            raise LensError(
                f"lens: focus at {self.focus:g} m is not beyond the focal length of {self.focal * 1e3:g} mm, where no "
                "picture forms; focus farther away or use a shorter lens (--scene-unit says what one unit of depth is)"
            )
        if not self.fstop > 0:
            raise LensError(f"lens: f-number {self.fstop:g}; give one above 0, for example 2.8")
        if not 0 < self.sensor < np.inf or not 0 < self.scene_unit < np.inf:
            raise LensError("lens: sensor width and scene unit must be above 0; a full frame is 36mm, a metre is 1m")
        if not 0 <= self.shutter <= 16:
            raise LensError(f"lens: shutter {self.shutter:g} of a frame; use 0 to 16, 0.5 is 180 degrees")

    def strength(self, width: int) -> float:
        """Compute the constant Kc of the circle of confusion.

        Args:
            width: Width of the picture, pixels.

        Returns:
            Kc, pixels × scene units.
        """
        aperture = self.focal / self.fstop
        if np.isinf(self.focus):
            return aperture / 2 * self.focal / (self.sensor / width) / self.scene_unit
        image = self.focal * self.focus / (self.focus - self.focal)
        return aperture / 2 * image / (self.sensor / width) / self.scene_unit

    def confusion(self, depth: np.ndarray, width: int) -> np.ndarray:
        """Compute the signed circle of confusion.

        Args:
            depth: Depth along the camera axis, any shape, > 0, scene units; infinity is the sky.
            width: Width of the picture, pixels.

        Returns:
            Signed radius in pixels, same shape; > 0 behind the focus distance.
        """
        focus = self.focus / self.scene_unit
        return self.strength(width) * (1 / focus - 1 / np.asarray(depth, np.float64))


def from_thin_lens(width: int, fov_x: float, radius: float, focus: float, shutter: float = 1.0) -> LensCamera:
    """Make the camera that matches a renderer's thin-lens sensor.

    The renderer fixes the image distance v = f z_f/(z_f − f) with width/(2 tan(fov/2)) = v/p. Any f that is small
    against z_f gives the same blur, so f is chosen as a hundredth of it.

    Args:
        width: Width of the picture, pixels.
        fov_x: Horizontal field of view, degrees.
        radius: Radius of the aperture, scene units; 0 is a pinhole.
        focus: Focus distance, scene units.
        shutter: Share of the frame's time during which the shutter is open.

    Returns:
        The camera, with one scene unit per metre.
    """
    focal = focus / 100
    image = focal * focus / (focus - focal)
    return LensCamera(
        focus=focus,
        focal=focal,
        fstop=focal / (2 * radius) if radius > 0 else np.inf,
        sensor=2 * image * np.tan(np.deg2rad(fov_x) / 2),
        shutter=shutter,
    )
