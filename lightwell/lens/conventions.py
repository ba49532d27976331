"""Convert depth and motion from the conventions of renderers to those of the lens.

The lens expects camera-axis depth in scene units with infinity for the sky, and motion in pixels per frame, forward in
time, x right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates

from lightwell.lens.camera import LensCamera
from lightwell.lens.errors import LensError

DEPTHS = ("auto", "planar", "ray", "ray-from-near", "inverse")
# Depth at or beyond this is the sky; Blender writes 1e10, others the largest half float.
SKY = 60000.0
UNITS = ("pixels", "ndc", "uv")


@dataclass(frozen=True)
class Motion:
    """Convention of motion vectors."""

    unit: str = "pixels"
    """``pixels``, ``ndc`` (the frame is 2 wide and 2 high) or ``uv`` (1 wide and 1 high)."""
    backward: bool = False
    """They point to where the pixel was in the previous frame."""
    y_up: bool = False
    """Positive y points up."""

    def __post_init__(self) -> None:
        if self.unit not in UNITS:
            raise LensError(f"lens: motion unit {self.unit!r}; choose {', '.join(UNITS)}")

    def pixels(self, motion: np.ndarray, width: int, height: int) -> np.ndarray:
        """Convert motion vectors to pixels per frame, forward, y down.

        Args:
            motion: Vectors in this convention [height, width, 2].
            width: Width of the whole picture, pixels.
            height: Height of the whole picture, pixels.

        Returns:
            Pixels per frame [height, width, 2] float32.
        """
        scale = {"pixels": (1, 1), "ndc": (width / 2, height / 2), "uv": (width, height)}[self.unit]
        sign = -1.0 if self.backward else 1.0
        return (motion * np.array([scale[0] * sign, scale[1] * sign * (-1 if self.y_up else 1)])).astype(np.float32)

    def __str__(self) -> str:
        return f"{self.unit}, {'backward' if self.backward else 'forward'}, y {'up' if self.y_up else 'down'}"


ALL_MOTIONS = tuple(Motion(unit, back, up) for unit in UNITS for back in (False, True) for up in (False, True))


def planar_depth(
    values: np.ndarray, kind: str, camera: LensCamera, full_width: int, centre: tuple[float, float], near: float = 0.01
) -> np.ndarray:
    """Convert raw depth values to depth along the camera axis.

    Args:
        values: Raw values [height, width].
        kind: ``planar``: camera-axis depth; ``ray``: distance along the ray from the camera's centre;
            ``ray-from-near``:
            from the near plane, as in Mitsuba's AOV ``depth``; ``inverse``: 1/z. Zero is the sky, except in ``planar``.
        camera: Camera; its image distance gives the angle of a ray.
        full_width: Width of the whole picture, pixels.
        centre: Principal point (x, y), pixels of the array.
        near: Distance of the near plane, scene units; only for ``ray-from-near``.

    Returns:
        Camera-axis depth [height, width] float64, scene units; infinity is the sky.
    """
    values = np.asarray(values, np.float64)
    if kind == "inverse":
        with np.errstate(divide="ignore"):
            return np.where(values == 0, np.inf, 1 / values)
    if kind in ("ray", "ray-from-near"):
        image = camera.focal * camera.focus / (camera.focus - camera.focal)
        pixels = image / (camera.sensor / full_width)
        y, x = np.indices(values.shape)
        cosine = 1 / np.sqrt(1 + ((x + 0.5 - centre[0]) ** 2 + (y + 0.5 - centre[1]) ** 2) / pixels**2)
        z = values * cosine + (near if kind == "ray-from-near" else 0.0)
        return np.where((values == 0) | (values >= SKY), np.inf, z)
    return np.where(values >= SKY, np.inf, values)


def guess_motion(raw: np.ndarray, frame: np.ndarray, following: np.ndarray) -> tuple[Motion, dict[Motion, float]]:
    """Find the convention under which a frame, moved along its vectors, is most similar to the following frame.

    Args:
        raw: Motion vectors [height, width, 2] in an unknown convention.
        frame: Colour [height, width, channels], linear.
        following: Colour of the following frame [height, width, channels].

    Returns:
        The convention, and the mean error of every convention over the moving pixels.

    Raises:
        LensError: Nothing moves in the frame.
    """
    height, width = raw.shape[:2]
    y, x = np.indices((height, width)).astype(np.float32)
    moving = (np.abs(raw).max(-1) > 0) & np.isfinite(raw).all(-1)
    if not moving.any():
        raise LensError("lens: nothing moves in this frame, so the convention of its vectors cannot be told; name it")
    grey, target = (np.nan_to_num(f[..., :3].astype(np.float32)).mean(-1) for f in (frame, following))
    grey, target = (f / (1 + f) for f in (grey, target))
    errors = {}
    for convention in ALL_MOTIONS:
        m = convention.pixels(raw, width, height)
        at = [(y + m[..., 1])[moving], (x + m[..., 0])[moving]]
        errors[convention] = float(np.abs(map_coordinates(target, at, order=1, mode="nearest") - grey[moving]).mean())
    return min(errors, key=lambda convention: errors[convention]), errors
