"""The lens on arrays: a sharp frame with depth and motion in, depth of field and motion blur together out."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from lightwell.lens import families
from lightwell.lens.camera import LensCamera
from lightwell.lens.engine import Engine, timed
from lightwell.lens.errors import LensError
from lightwell.lens.inputs import STILL, FrameInputs, widen
from lightwell.lens.layers import Layer, composite, lit, over_coverage, tidy
from lightwell.lens.library_cache import LibraryCache
from lightwell.lens.prescription import MountedLens, mount
from lightwell.lens.report import Report
from lightwell.lens.settings import LensSettings
from lightwell.lens.splat import Frame, Planes, Points, Sources, splat

# Rows beyond the blur that a band has, where sparse kernels leak a little.
MARGIN = 16
# Largest radii of libraries, so that frames of similar blur share one.
SIZES = (64, 128, 256, 512, 1024)


class Lens:
    """A lens for one or many frames; keeps libraries open between them."""

    def __init__(self, settings: LensSettings | None = None, libraries: LibraryCache | None = None) -> None:
        """Make a lens.

        Args:
            settings: Settings; None for the defaults.
            libraries: Libraries; None for those of the user's store.
        """
        self.settings = settings or LensSettings()
        self.libraries = libraries or LibraryCache()
        # Engines by family, size of the blur and length of the motion.
        self._engines: dict[tuple[int, int, str], Engine] = {}

    # ------------------------------------------------------------------ frames

    def apply(
        self,
        rgba: np.ndarray,
        depth: np.ndarray,
        motion: np.ndarray | None,
        camera: LensCamera,
        frame_number: int = 0,
        behind: Sequence[tuple[np.ndarray, ...]] = (),
        peel: tuple[np.ndarray, ...] | None = None,
        full_width: int | None = None,
    ) -> tuple[np.ndarray, Report]:
        """Blur one frame.

        Args:
            rgba: Colour [height, width, 3 or 4], linear, premultiplied.
            depth: Depth along the camera axis [height, width], scene units, > 0; infinity is the sky.
            motion: Motion [height, width, 2], pixels per frame, x right, y down, forward in time; None for none.
            camera: The camera.
            frame_number: Frame number, for the dither.
            behind: (rgba, depth[, motion]) of whole layers that the frame covers, front to back, alpha 0 where empty.
            peel: (rgba, depth[, motion]) of the second surface behind every pixel, used where the blur uncovers it.
            full_width: Width of the whole picture, pixels, where the arrays are a part of it; None: that of the arrays.

        Returns:
            Picture [height, width, 4] float32, linear, premultiplied, and a report. ``LensError`` is raised where
            shapes do not match, no pixel is valid, or settings exclude each other.
        """
        report = Report()
        with timed(report, "plan"):
            inputs = FrameInputs(self.settings, camera, full_width or np.shape(depth)[-1])
            layers, opaque = inputs.layers(rgba, depth, motion, behind, peel, report)
        mounted = None
        if self.settings.prescription is not None:
            mounted = mount(self.settings.prescription, camera, full_width or np.shape(depth)[-1], np.shape(depth)[0])
        # Arrays wider than the picture have a band around it on all sides.
        overscan = max(np.shape(depth)[-1] - (full_width or np.shape(depth)[-1]), 0) // 2
        pictures = []
        for number, layer in enumerate(layers):
            layer, pad = widen(layer, self.settings.white) if self.settings.edges == "extend" else (layer, 0)
            picture = self._blurred(layer, report, frame_number * 16 + number, mounted, pad + overscan)
            pictures.append(tidy(picture[pad : picture.shape[0] - pad, pad : picture.shape[1] - pad]))
        with timed(report, "composite"):
            out = composite(pictures)
            if opaque and self.settings.edges != "dark":
                out = over_coverage(out)
            out[..., 3] = np.minimum(out[..., 3], 1)
        return out.astype(np.float32, copy=False), report

    def _blurred(
        self, layer: Layer, report: Report, frame_number: int, mounted: MountedLens | None, border: int
    ) -> np.ndarray:  # fmt: skip
        """Blur a layer, in bands of rows where it is large; a band has what its rows receive from those around it."""
        bands = self._bands(layer, mounted)
        if len(bands) == 1:
            return self.blur(layer, report, frame_number, mounted, border)
        # Channel by channel, as the solve leaves it: what follows reads whole channels.
        height, width = layer.s.shape
        out = np.empty((4, height, width), np.float32).transpose(1, 2, 0)
        for first, last, margin in bands:
            low, high = max(first - margin, 0), min(last + margin, height)
            motion = None if layer.motion is None else layer.motion[low:high]
            part = replace(layer, rgba=layer.rgba[low:high], s=layer.s[low:high], motion=motion)
            out[first:last] = self.blur(part, report, frame_number)[first - low : last - low]
        return out

    def _bands(self, layer: Layer, mounted: MountedLens | None) -> list[tuple[int, int, int]]:
        """(first row, row behind the last, rows of margin) of each band; one where kernels depend on the place."""
        height, width = layer.s.shape
        if height * width <= self.settings.most_pixels or mounted is not None or self.settings.cats_eye:
            return [(0, height, 0)]
        reach = float(np.abs(layer.s).max())
        reach += 0.0 if layer.motion is None else float(np.hypot(layer.motion[..., 0], layer.motion[..., 1]).max()) / 2
        margin = int(np.ceil(reach)) + MARGIN
        # A band is at least as high as its margins: else most of the work would be theirs.
        rows = max(self.settings.most_pixels // width - 2 * margin, 2 * margin, 1)
        count = -(-height // rows)
        edges = [round(k * height / count) for k in range(count + 1)]
        return [(first, last, margin) for first, last in pairwise(edges)]

    def blur(
        self,
        layer: Layer,
        report: Report,
        frame_number: int = 0,
        mounted: MountedLens | None = None,
        border: int = 0,
    ) -> np.ndarray:
        """Blur one layer: static pixels by the library without motion, moving ones by the joint one, with one solve.

        Args:
            layer: The layer.
            report: Report to change.
            frame_number: Frame number, for the dither.
            mounted: Lens of the prescription on its camera; None without one.
            border: Pixels on each side of the layer that lie outside the picture.

        Returns:
            Blurred layer [height, width, 4] float32, premultiplied.
        """
        plans, engine = [], None
        for part, largest, longest in self._parts(layer):
            engine = self._engine(largest, longest, mounted)
            plans.append(engine.plan(part, report, frame_number, border))
        if engine is None:
            return np.zeros((*layer.s.shape, 4), np.float32)
        return engine.render(plans, layer.s.shape, report, self._scatter())

    def blur_samples(
        self,
        x: np.ndarray,
        y: np.ndarray,
        rgba: np.ndarray,
        s: np.ndarray,
        motion: np.ndarray | None,
        shape: tuple[int, int],
        report: Report,
        border: int = 0,
    ) -> np.ndarray:
        """Blur samples at whole pixels, any number per pixel, and add them.

        Args:
            x: Integer x of the samples [n], pixels.
            y: Integer y of the samples [n], pixels.
            rgba: Light of the samples [n, 4], premultiplied.
            s: Signed circle of confusion [n], pixels.
            motion: Displacement while the shutter is open [n, 2], pixels; None for none.
            shape: Height and width of the frame, pixels.
            report: Report to change.
            border: Pixels on each side of the frame that lie outside the picture.

        Returns:
            Picture [height, width, 4] float32.

        Raises:
            LensError: The settings have a prescription.
        """
        if self.settings.prescription is not None:
            raise LensError("lens: samples are not blurred by a prescription; leave it out, or give whole frames")
        length = np.zeros(len(s), np.float32) if motion is None else np.hypot(motion[:, 0], motion[:, 1])
        plans, engine = [], None
        for mine, moving in ((length < STILL, False), (length >= STILL, True)):
            if not mine.any():
                continue
            engine = self._engine(float(np.abs(s[mine]).max()), float(length[mine].max()) if moving else 0.0)
            part = motion[mine] if motion is not None and moving else None
            place = x[mine].astype(np.int32), y[mine].astype(np.int32)
            plans.append(engine.plan_samples(*place, rgba[mine], s[mine], part, shape, report, border=border))
        if engine is None:
            return np.zeros((*shape, 4), np.float32)
        return engine.render(plans, shape, report, self._scatter())

    def _scatter(self) -> Callable[[Frame, Points, Sources], Planes]:
        if not self.settings.deterministic:
            return splat
        from lightwell.lens.fixed import splat as fixed

        return lambda frame, points, sources: fixed(frame, points, sources, self.settings.white)

    def _parts(self, layer: Layer) -> Iterator[tuple[Layer, float, float]]:
        """Yield (layer, largest radius, longest motion) of the static and of the moving pixels, where there are any."""
        shining = lit(layer.rgba)
        largest = float(np.abs(layer.s[shining]).max()) if shining.any() else 0.0
        if not shining.any():
            return
        if layer.motion is None:
            yield layer, largest, 0.0
            return
        length = np.hypot(layer.motion[..., 0], layer.motion[..., 1])
        moving = (length >= STILL) & shining
        if not moving.all():
            still = replace(layer, rgba=np.where(moving[..., None], 0, layer.rgba), motion=None)
            if still.rgba.any():
                yield still, float(np.abs(layer.s[shining & ~moving]).max()), 0.0
        if moving.any():
            part = replace(layer, rgba=np.where(moving[..., None], layer.rgba, 0))
            yield part, float(np.abs(layer.s[moving]).max()), float(length[moving].max())

    def _engine(self, largest: float, longest: float, mounted: MountedLens | None = None) -> Engine:
        """Return the engine for blur up to a radius and motion up to a length."""
        set_ = self.settings
        radius = next((size for size in SIZES if size >= largest), SIZES[-1])
        length = next((size for size in SIZES if size >= longest), SIZES[-1]) if longest else 0
        key = (radius, length, mounted.key() if mounted else "")
        if key not in self._engines:
            if mounted is not None:
                family = families.prescription(radius, mounted)
            elif set_.cats_eye and not length:
                family = families.cats_eye(radius, set_.cats_eye)
            elif not length:
                noise = families.NOISE_JOINT if set_.preset == "paper" else families.NOISE
                family = families.depth(radius, set_.aperture, noise)
            elif set_.aperture.round:
                family = families.depth_speed(radius, length)
            else:
                family = families.shaped_speed(radius, length, set_.aperture)
            solver = set_.solver or ("7/5" if set_.preset == "paper" else "dst")
            tolerance = np.inf if set_.preset == "paper" else set_.tolerance
            self._engines[key] = Engine(
                family, set_.recipe(), self.libraries, solver, set_.choice, tolerance, set_.white
            )
        return self._engines[key]


def apply(
    rgba: np.ndarray,
    depth: np.ndarray,
    motion: np.ndarray | None = None,
    camera: LensCamera | None = None,
    settings: LensSettings | None = None,
) -> np.ndarray:
    """Blur one frame: depth of field and motion blur together.

    Example: ``lens.apply(rgba, depth, motion, lens.Camera(focus=2.5, fstop=1.8, focal=0.05))``

    Args:
        rgba: Colour [height, width, 3 or 4], linear, premultiplied.
        depth: Depth along the camera axis [height, width], scene units, > 0; infinity is the sky.
        motion: Motion [height, width, 2], pixels per frame, x right, y down, forward in time; None for none.
        camera: The camera; None for ``LensCamera()``.
        settings: Settings; None for the defaults.

    Returns:
        Picture [height, width, 4] float32, linear, premultiplied. Arrays that do not match raise ``LensError``.
    """
    return Lens(settings).apply(rgba, depth, motion, camera or LensCamera())[0]
