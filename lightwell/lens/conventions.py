"""Depth and motion as programs write them, turned into what the lens wants.

The lens wants camera-axis depth in scene units with infinity for the sky, and motion in pixels per frame, forward in
time, x right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates

from lightwell.lens.camera import Camera
from lightwell.lens.errors import LensError

DEPTHS = ("auto", "planar", "ray", "ray-from-near", "inverse")
# Depth at or beyond this is the sky; Blender writes 1e10, others the largest half float.
SKY = 60000.0
UNITS = ("pixels", "ndc", "uv")


@dataclass(frozen=True)
class Motion:
    """What the two numbers of a motion vector mean."""

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
        """[height, width, 2] forward, pixels, y down."""
        scale = {"pixels": (1, 1), "ndc": (width / 2, height / 2), "uv": (width, height)}[self.unit]
        sign = -1.0 if self.backward else 1.0
        return (motion * np.array([scale[0] * sign, scale[1] * sign * (-1 if self.y_up else 1)])).astype(np.float32)

    def __str__(self) -> str:
        return f"{self.unit}, {'backward' if self.backward else 'forward'}, y {'up' if self.y_up else 'down'}"


ALL_MOTIONS = tuple(Motion(unit, back, up) for unit in UNITS for back in (False, True) for up in (False, True))


def planar_depth(
    values: np.ndarray, kind: str, camera: Camera, full_width: int, centre: tuple[float, float], near: float = 0.01
) -> np.ndarray:
    """Camera-axis depth of raw values [height, width]; ``centre`` is the principal point in pixels of the array.

    ``ray``: distance along the ray from the eye; ``ray-from-near``: from the near plane, as Mitsuba's AOV ``depth``;
    ``inverse``: 1/z. Zero is the sky in all three and planar depth of 0 is no depth.
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
    """The convention under which a frame, carried along its vectors, looks most like the following one.

    raw [height, width, 2], frames [height, width, channels]. Returns it and the mean error of every convention over
    the pixels that move under any; LensError when nothing moves.
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
    return min(errors, key=errors.get), errors
