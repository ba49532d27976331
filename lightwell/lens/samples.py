"""Reconstruction from few stochastic lens and time samples per pixel.

A renderer traces 1 to 16 rays per pixel through random points of the lens at random times. Each sample is treated as
if its surface point were visible through the whole lens during the whole shutter: it is moved back to where the lens
centre would see it at mid-shutter, y = x − s(z) u − m (t − ½), and spread over its own point spread function. Because
samples look around occluders, partial occlusion needs no layers; a partly hidden surface spreads over its whole
kernel, which is a small bias.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lightwell.lens.camera import LensCamera
from lightwell.lens.errors import LensError
from lightwell.lens.pipeline import Lens
from lightwell.lens.pyramid import fill
from lightwell.lens.report import Report
from lightwell.lens.settings import LensSettings

# A pixel with less than this weight is filled from its neighbours.
FAINT = 0.02


@dataclass(frozen=True)
class LensSamples:
    """Rays of one frame, in any order."""

    x: np.ndarray
    """[n] raster position, pixels; a pixel's centre is at +0.5."""
    y: np.ndarray
    """[n]"""
    rgb: np.ndarray
    """[n, 3] linear radiance"""
    depth: np.ndarray
    """[n] along the camera axis, scene units; infinity is the sky"""
    lens: np.ndarray
    """[n, 2] point on the unit lens, image axes: x right, y down"""
    time: np.ndarray | None = None
    """[n] in [0, 1] over the open shutter; None is ½"""
    motion: np.ndarray | None = None
    """[n, 2] displacement in pixels per frame; None is at rest"""
    shape: np.ndarray | None = None
    """[n] index in ``scene.shapes()`` of the hit, −1 for none; for callers that compute motion, not used here."""


def reconstruct(
    samples: LensSamples, height: int, width: int, camera: LensCamera, settings: LensSettings | None = None
) -> tuple[np.ndarray, Report]:
    """Reconstruct a picture with depth of field and motion blur from few samples: scatter, solve, divide by the weight.

    Samples that are not finite are left out and counted; samples of which none is usable raise ``LensError``.

    Args:
        samples: Rays of one frame.
        height: Height of the picture, pixels.
        width: Width of the picture, pixels.
        camera: The camera that the samples were traced with.
        settings: Settings; None for the defaults. Layers and edges are not used.

    Returns:
        Picture [height, width, 4] float32, linear, alpha 1; and a report.
    """
    samples, bad = _checked(samples)
    settings = replace(settings or LensSettings(), edges="dark", layers=1)
    lens, report = Lens(settings), Report()
    report.bad = bad
    s = camera.confusion(samples.depth, width).astype(np.float32)
    report.largest = float(np.abs(s).max())
    limit = min(settings.largest, max(height, width) / 2)
    report.clamped = int((np.abs(s) > limit).sum())
    s = np.clip(s, -limit, limit)
    motion = None if samples.motion is None else (samples.motion * camera.shutter).astype(np.float32)
    x = samples.x - s * samples.lens[:, 0]
    y = samples.y - s * samples.lens[:, 1]
    if motion is not None:
        t = np.float32(0) if samples.time is None else (samples.time - 0.5).astype(np.float32)
        x, y = x - motion[:, 0] * t, y - motion[:, 1] * t
        report.longest = float(np.hypot(*motion.T).max())
    rgba = np.concatenate([samples.rgb, np.ones((len(s), 1))], 1).astype(np.float32)
    return _spread(lens, report, x, y, s, motion, rgba, height, width), report


def _spread(
    lens: Lens,
    report: Report,
    x: np.ndarray,
    y: np.ndarray,
    s: np.ndarray,
    motion: np.ndarray | None,
    rgba: np.ndarray,
    height: int,
    width: int,
) -> np.ndarray:
    """Split every sample over the four pixels around its position; those outside the frame still reach into it.

    Whole pixels would take a quarter of the time, but leave holes where few samples land: twice the error at one sample
    per pixel.
    """
    margin = int(np.ceil(min(report.largest, lens.settings.largest) + report.longest)) + 2
    margin = min(margin, 2 * max(height, width))
    ix, iy = np.floor(x - 0.5).astype(np.int64), np.floor(y - 0.5).astype(np.int64)
    fx, fy = x - 0.5 - ix, y - 0.5 - iy
    shape = height + 2 * margin, width + 2 * margin
    seen = (ix >= -margin) & (iy >= -margin) & (ix < width + margin - 1) & (iy < height + margin - 1)
    corners = []
    for ox, wx in ((0, 1 - fx), (1, fx)):
        for oy, wy in ((0, 1 - fy), (1, fy)):
            light = rgba[seen] * (wx * wy)[seen, None]
            corners.append((ix[seen] + ox + margin, iy[seen] + oy + margin, light.astype(np.float32)))
    at_x, at_y, lights = (np.concatenate(parts) for parts in zip(*corners))
    moved = None if motion is None else np.tile(motion[seen], (4, 1))
    picture = lens.blur_samples(at_x, at_y, lights, np.tile(s[seen], 4), moved, shape, report, margin)
    picture = picture[margin : margin + height, margin : margin + width]
    weight = picture[..., 3:]
    rgb = np.maximum(picture[..., :3], 0) / np.maximum(weight, FAINT)
    if (weight < FAINT).any():
        # No sample is near: extrapolate from the surroundings.
        smooth = fill(np.ascontiguousarray(rgb.transpose(2, 0, 1)), np.clip(weight[..., 0], 0, 1)).transpose(1, 2, 0)
        rgb = np.where(weight < FAINT, smooth, rgb)
    return np.concatenate([rgb, np.ones_like(weight)], -1).astype(np.float32)


def _checked(samples: LensSamples) -> tuple[LensSamples, int]:
    """Return the samples without those that are not finite, and how many were left out."""
    n = len(samples.x)
    shapes = {"y": (n,), "rgb": (n, 3), "depth": (n,), "lens": (n, 2), "time": (n,), "motion": (n, 2), "shape": (n,)}
    good = np.isfinite(samples.x)
    for name, shape in shapes.items():
        value = getattr(samples, name)
        if value is None:
            continue
        if np.shape(value) != shape:
            raise LensError(f"lens: samples' {name} has shape {np.shape(value)}; expected {shape}")
        ok = value > 0 if name == "depth" else np.isfinite(value)
        good &= ok if ok.ndim == 1 else ok.all(1)
    if not good.any():
        raise LensError("lens: no sample has finite colour and a depth above 0; write them with the AOV integrator")
    kept = {name: v[good] for name in ("x", *shapes) if (v := getattr(samples, name)) is not None}
    return replace(samples, **kept), int((~good).sum())
