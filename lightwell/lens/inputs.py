"""Check the arrays of a frame and split them into layers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import distance_transform_edt

from lightwell.lens.camera import LensCamera
from lightwell.lens.errors import LensError
from lightwell.lens.layers import Layer, extend, lit, split
from lightwell.lens.report import Report
from lightwell.lens.settings import LensSettings

# Motion shorter than this is ignored, pixels.
STILL = 0.25
# The longest motion, pixels; longer motion is clamped.
MOST_MOTION = 1024
# The largest picture, pixels.
MOST_PIXELS = 1 << 28


class FrameInputs:
    """Prepares the frames of one camera."""

    def __init__(self, settings: LensSettings, camera: LensCamera, full_width: int) -> None:
        """Keep what is the same for all layers of a frame.

        Args:
            settings: Settings of the lens.
            camera: The camera.
            full_width: Width of the whole picture, pixels.
        """
        self.settings, self.camera, self.full_width = settings, camera, full_width

    def layers(
        self,
        rgba: np.ndarray,
        depth: np.ndarray,
        motion: np.ndarray | None,
        behind: Sequence[tuple[np.ndarray, ...]],
        peel: tuple[np.ndarray, ...] | None,
        report: Report,
    ) -> tuple[list[Layer], bool]:
        """Check a frame and split it into layers.

        Args:
            rgba: Colour [height, width, 3 or 4], linear, premultiplied.
            depth: Depth along the camera axis [height, width], scene units, > 0; infinity is the sky.
            motion: Motion [height, width, 2], pixels per frame; None for none.
            behind: (rgba, depth[, motion]) of whole layers that the frame covers, front to back.
            peel: (rgba, depth[, motion]) of the second surface behind every pixel; None for none.
            report: Report to change.

        Returns:
            The layers, front to back, and whether the frame covers every pixel. ``LensError`` is raised where shapes do
            not match, no pixel is valid, or settings exclude each other.
        """
        front = self._layer(rgba, depth, motion, report)
        opaque = bool((front.rgba[..., 3] > 0.999).all()) and not behind
        if len(behind):
            layers = [front, *(self._behind(one, front.s.shape) for one in behind)]
        else:
            reach = min(report.largest, self.settings.largest) + report.longest / 2
            second = None if peel is None else self._behind(peel, front.s.shape)
            count, mixed = self.settings.layers, self.settings.antialiased
            layers = split(front.rgba, front.s, front.motion, count, reach, second, mixed)
        report.layers = len(layers)
        return layers, opaque

    def _layer(self, rgba: np.ndarray, depth: np.ndarray, motion: np.ndarray | None, report: Report) -> Layer:
        """Return checked arrays: light, signed circle of confusion, displacement while the shutter is open."""
        rgba, depth, motion = _valid(*_checked(rgba, depth, motion), report)
        height, width = depth.shape
        s = self.camera.confusion(depth, self.full_width).astype(np.float32)
        report.largest = float(np.abs(s).max())
        limit = min(self.settings.largest, max(height, width) / 2)
        over = np.abs(s) > limit
        report.clamped += int(over.sum())
        s = np.clip(s, -limit, limit)
        if motion is not None:
            motion = _displacement(motion, self.camera.shutter, max(height, width), report)
        if self.settings.cats_eye and motion is not None:
            raise LensError(
                "lens: a cat's eye together with motion is not baked; set the shutter or the cat's eye to 0"
            )
        if self.settings.prescription is not None and motion is not None:
            raise LensError("lens: a prescription together with motion is not baked; leave out one of them")
        if self.settings.cats_eye and not self.settings.aperture.round:
            raise LensError("lens: a cat's eye needs the round aperture; use --aperture disc")
        return Layer(rgba, s, motion)

    def _behind(self, given: tuple[np.ndarray, ...], shape: tuple[int, ...]) -> Layer:
        """Prepare a layer behind the nearest surfaces, as rendered: a second depth peel, or deep samples."""
        rgba, depth, motion = given[0], given[1], given[2] if len(given) > 2 else None
        if np.shape(depth) != shape:
            raise LensError(f"lens: a layer behind is {np.shape(depth)}, the frame {shape}; render both at one size")
        return self._layer(rgba, depth, motion, Report())


def widen(layer: Layer, white: float) -> tuple[Layer, int]:
    """Extrapolate light from outside the frame, as far as the blur of the border reaches inside.

    Args:
        layer: The layer.
        white: Scene-referred value that is displayed as white, > 0.

    Returns:
        The wider layer, and by how many pixels it is wider on each side.
    """
    border = np.zeros(layer.s.shape, bool)
    band = min(4, min(border.shape))
    border[:band], border[-band:], border[:, :band], border[:, -band:] = True, True, True, True
    border[border] = lit(layer.rgba[border])
    if not border.any():
        return layer, 0
    reach = np.abs(layer.s[border]).max()
    if layer.motion is not None:
        reach += np.hypot(*layer.motion[border].T).max() / 2
    pad = int(np.ceil(reach))
    if pad == 0:
        return layer, 0
    motion = None if layer.motion is None else np.pad(layer.motion, ((pad, pad), (pad, pad), (0, 0)), mode="edge")
    return Layer(extend(layer.rgba, pad, white), np.pad(layer.s, pad, mode="edge"), motion), pad


def _valid(
    rgba: np.ndarray, depth: np.ndarray, motion: np.ndarray | None, report: Report
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Replace invalid pixels by their nearest valid one, so that nothing spreads and no hole is left."""
    # Depth and motion are undefined where there is neither light nor coverage.
    dark = ~lit(rgba)
    depth = np.where(dark & ~(depth > 0), np.inf, depth)
    good = depth > 0
    for channel in range(rgba.shape[-1]):
        good &= np.isfinite(rgba[..., channel])
    if motion is not None:
        motion = np.where(dark[..., None], 0, motion)
        good &= np.isfinite(motion).all(-1)
    report.bad = int((~good).sum())
    if not good.any():
        raise LensError(
            "lens: no pixel has finite colour and a depth above 0; check the depth channel and its convention"
        )
    if not report.bad:
        return rgba, depth, motion
    rows, columns = distance_transform_edt(~good, return_distances=False, return_indices=True)
    return rgba[rows, columns], depth[rows, columns], None if motion is None else motion[rows, columns]


def _displacement(motion: np.ndarray, shutter: float, side: int, report: Report) -> np.ndarray | None:
    """Return the displacement while the shutter is open, clamped; None where nothing moves.

    ``side`` is the longer side of the frame, pixels.
    """
    motion = motion * np.float32(shutter)
    length = np.hypot(motion[..., 0], motion[..., 1])
    report.longest = float(length.max())
    most = min(float(side), MOST_MOTION)
    report.clamped += int((length > most).sum())
    motion = (motion * np.minimum(1, most / np.maximum(length, 1e-9))[..., None]).astype(np.float32)
    return None if report.longest < STILL else motion


def _checked(
    rgba: np.ndarray, depth: np.ndarray, motion: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Return float32 arrays of one size; alpha is 1 where none is given."""
    rgba, depth = np.asarray(rgba, np.float32), np.asarray(depth, np.float32)
    if rgba.ndim != 3 or rgba.shape[2] not in (3, 4):
        raise LensError(f"lens: colour has shape {rgba.shape}; expected [height, width, 3 or 4]")
    if depth.shape != rgba.shape[:2]:
        raise LensError(f"lens: depth has shape {depth.shape} and colour {rgba.shape[:2]}; both must be of one size")
    if depth.size == 0 or depth.size > MOST_PIXELS:
        raise LensError(f"lens: a frame of {depth.shape[1]}x{depth.shape[0]} pixels; use 1 to {MOST_PIXELS} pixels")
    if rgba.shape[2] == 3:
        rgba = np.concatenate([rgba, np.ones((*depth.shape, 1), np.float32)], -1)
    if motion is not None:
        motion = np.asarray(motion, np.float32)
        if motion.shape != (*depth.shape, 2):
            raise LensError(f"lens: motion has shape {motion.shape}; expected [{depth.shape[0]}, {depth.shape[1]}, 2]")
    return rgba, depth, motion
