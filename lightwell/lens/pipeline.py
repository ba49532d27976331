"""The lens on arrays: a sharp frame with depth and motion in, depth of field and motion blur together out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import distance_transform_edt

from lightwell.lens import families
from lightwell.lens.aperture import DISC, Aperture
from lightwell.lens.camera import LensCamera
from lightwell.lens.engine import TOLERANCE, Engine, SolvePlan, timed
from lightwell.lens.errors import LensError
from lightwell.lens.layers import Layer, composite, extend, over_coverage, split, tidy
from lightwell.lens.library_cache import LibraryCache
from lightwell.lens.recipes import Recipe
from lightwell.lens.report import Report
from lightwell.lens.splat import Frame, guard_for, splat

PRESETS = ("default", "best", "paper")
EDGES = ("extend", "renormalise", "dark")
# Largest radii of libraries, so that frames of similar blur share one.
SIZES = (64, 128, 256, 512, 1024)
# Motion shorter than this is ignored, pixels.
STILL = 0.25
# The largest picture, pixels.
MOST_PIXELS = 1 << 28


@dataclass(frozen=True)
class LensSettings:
    """Settings of the lens; the defaults are those of the command line."""

    aperture: Aperture = DISC
    """Shape of the opening."""
    layers: int = 2
    """Depth layers, 1 to 16. One layer ignores occlusion."""
    preset: str = "default"
    """``default`` (least squares, exact solve), ``best`` (more points), ``paper`` (the published recipe, pyramid)."""
    edges: str = "extend"
    """Light from outside the frame: ``extend`` repeats the border, ``renormalise`` divides by coverage, ``dark``."""
    solver: str = ""
    """``dst``, ``fft``, ``7/5``, ``5/3``; empty takes the preset's."""
    choice: str = "auto"
    """Node of a value between two: ``stochastic`` (dithered) or ``nearest``; ``auto``: nearest where steps are fine."""
    cats_eye: float = 0.0
    """Strength of mechanical vignetting at the corners, 0 to 1.8; without motion and with a round aperture."""
    largest: float = 256.0
    """Largest blur radius, pixels; larger blur is clamped. At most half the longer side of the frame is used."""
    tolerance: float = TOLERANCE
    """Error, relative to ``white``, above which a bright pixel uses lossless points; infinity: never."""
    white: float = 1.0
    """Scene-referred value that is displayed as white."""
    deterministic: bool = False
    """Add in integers: the same bytes on every run, thread count and machine."""

    def __post_init__(self) -> None:
        for name, known in (("preset", PRESETS), ("edges", EDGES), ("choice", ("auto", "stochastic", "nearest"))):
            if getattr(self, name) not in known:
                raise LensError(f"lens: {name} {getattr(self, name)!r}; choose {', '.join(known)}")
        if not (isinstance(self.layers, int) and 1 <= self.layers <= 16):
            raise LensError(f"lens: {self.layers} layers; use 1 to 16")
        if not self.largest > 0 or not self.white > 0 or not self.tolerance >= 0:
            raise LensError("lens: largest blur, white and tolerance must be above 0")

    def recipe(self) -> Recipe:
        """Return how the preset makes spreadlets.

        Returns:
            The recipe.
        """
        if self.preset == "best":
            return Recipe("best", base=40.0, slope=4.0, share=0.3)
        if self.preset == "paper":
            return Recipe("paper", share=0.093, anneal="working")
        return Recipe(self.preset)


class Lens:
    """A lens for one or many frames; keeps libraries open between them."""

    def __init__(self, settings: LensSettings | None = None, shelf: LibraryCache | None = None) -> None:
        """Make a lens.

        Args:
            settings: Settings; None for the defaults.
            shelf: Libraries; None for those of the user's store.
        """
        self.settings = settings or LensSettings()
        self.shelf = shelf or LibraryCache()
        # Engines by family, size of the blur and length of the motion.
        self._engines: dict[tuple[int, int], Engine] = {}

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
            shapes do not match, nothing in the frame is usable, or settings exclude each other.
        """
        report = Report()
        with timed(report, "plan"):
            full_width = full_width or np.shape(depth)[-1]
            rgba, s, moved = self._prepare(rgba, depth, motion, camera, report, full_width)
            layers = self._layers(rgba, s, moved, behind, peel, camera, report, full_width)
        opaque = bool((rgba[..., 3] > 0.999).all()) and not behind
        pictures = []
        for number, layer in enumerate(layers):
            layer, pad = self._widen(layer, report)
            picture = self.blur(layer, report, frame_number * 16 + number)
            pictures.append(tidy(picture[pad : picture.shape[0] - pad, pad : picture.shape[1] - pad]))
        with timed(report, "composite"):
            out = composite(pictures)
            if opaque and self.settings.edges != "dark":
                out = over_coverage(out)
            out[..., 3] = np.minimum(out[..., 3], 1)
        return out.astype(np.float32), report

    def blur(self, layer: Layer, report: Report, frame_number: int = 0) -> np.ndarray:
        """Blur one layer: static pixels by the library without motion, moving ones by the joint one, with one solve.

        Args:
            layer: The layer.
            report: Report to change.
            frame_number: Frame number, for the dither.

        Returns:
            Blurred layer [height, width, 4] float32, premultiplied.
        """
        plans, engine = [], None
        for part, largest, longest in self._parts(layer):
            engine = self._engine(largest, longest)
            plans.append(engine.plan(part, report, frame_number))
        if engine is None:
            return np.zeros((*layer.s.shape, 4), np.float32)
        return self._render(engine, plans, layer.s.shape, report)

    def _render(self, engine: Engine, plans: list[SolvePlan], shape: tuple[int, int], report: Report) -> np.ndarray:
        """Scatter all plans into one image and solve it once."""
        guard = max(guard_for(plan.points, plan.turned) for plan in plans)
        frame = Frame(*shape, guard)
        report.guard = max(report.guard, guard)
        with timed(report, "splat"):
            scatter = self._scatter()
            planes = scatter(frame, plans[0].points, plans[0].sources)
            for plan in plans[1:]:
                planes = planes + scatter(frame, plan.points, plan.sources)
        with timed(report, "solve"):
            return engine.integrate(frame, planes)

    def blur_samples(
        self,
        x: np.ndarray,
        y: np.ndarray,
        rgba: np.ndarray,
        s: np.ndarray,
        motion: np.ndarray | None,
        shape: tuple[int, int],
        report: Report,
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

        Returns:
            Picture [height, width, 4] float32.
        """
        length = np.zeros(len(s), np.float32) if motion is None else np.hypot(motion[:, 0], motion[:, 1])
        plans, engine = [], None
        for mine, moving in ((length < STILL, False), (length >= STILL, True)):
            if not mine.any():
                continue
            engine = self._engine(float(np.abs(s[mine]).max()), float(length[mine].max()) if moving else 0.0)
            part = motion[mine] if moving else None
            place = x[mine].astype(np.int32), y[mine].astype(np.int32)
            plans.append(engine.plan_samples(*place, rgba[mine], s[mine], part, shape, report))
        return self._render(engine, plans, shape, report)

    def _scatter(self):
        if not self.settings.deterministic:
            return splat
        from lightwell.lens.fixed import splat as fixed

        return lambda frame, points, sources: fixed(frame, points, sources, self.settings.white)

    def _parts(self, layer: Layer) -> Iterator[tuple[Layer, float, float]]:
        """Yield (layer, largest radius, longest motion) of the static and of the moving pixels, where there are any."""
        shining = layer.rgba.any(-1)
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

    def _engine(self, largest: float, longest: float) -> Engine:
        """Return the engine for blur up to a radius and motion up to a length."""
        set_ = self.settings
        radius = next((size for size in SIZES if size >= largest), SIZES[-1])
        length = next((size for size in SIZES if size >= longest), SIZES[-1]) if longest else 0
        key = (radius, length)
        if key not in self._engines:
            if set_.cats_eye and not length:
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
            self._engines[key] = Engine(family, set_.recipe(), self.shelf, solver, set_.choice, tolerance, set_.white)
        return self._engines[key]

    # ------------------------------------------------------------------ input

    def _prepare(self, rgba, depth, motion, camera: LensCamera, report: Report, full_width: int):
        """Return checked arrays: light, signed circle of confusion, displacement while the shutter is open."""
        rgba, depth, motion = _checked(rgba, depth, motion)
        height, width = depth.shape
        # Depth and motion are undefined where there is neither light nor coverage.
        dark = ~rgba.any(-1)
        depth = np.where(dark & ~(depth > 0), np.inf, depth)
        good = np.isfinite(rgba).all(-1) & (depth > 0)
        if motion is not None:
            motion = np.where(dark[..., None], 0, motion)
            good &= np.isfinite(motion).all(-1)
        report.bad = int((~good).sum())
        if not good.any():
            raise LensError(
                "lens: no pixel has finite colour and a depth above 0; check the depth channel and its convention"
            )
        if report.bad:
            # An invalid pixel is replaced by its nearest valid one, so that nothing spreads and no hole is left.
            rows, columns = distance_transform_edt(~good, return_distances=False, return_indices=True)
            rgba, depth = rgba[rows, columns], depth[rows, columns]
            motion = None if motion is None else motion[rows, columns]
        s = camera.confusion(depth, full_width).astype(np.float32)
        report.largest = float(np.abs(s).max())
        limit = min(self.settings.largest, max(height, width) / 2)
        over = np.abs(s) > limit
        report.clamped += int(over.sum())
        s = np.clip(s, -limit, limit)
        if motion is not None:
            motion = _displacement(motion, camera.shutter, max(height, width), report)
        if self.settings.cats_eye and motion is not None:
            raise LensError(
                "lens: a cat's eye together with motion is not baked; set the shutter or the cat's eye to 0"
            )
        if self.settings.cats_eye and not self.settings.aperture.round:
            raise LensError("lens: a cat's eye needs the round aperture; use --aperture disc")
        report.layers = self.settings.layers
        return rgba, s, motion

    def _layers(
        self, rgba, s, motion, behind, peel, camera: LensCamera, report: Report, full_width: int
    ) -> list[Layer]:
        if len(behind):
            layers = [Layer(rgba, s, motion), *(self._behind(one, camera, s.shape, full_width) for one in behind)]
        else:
            reach = min(report.largest, self.settings.largest)
            second = None if peel is None else self._behind(peel, camera, s.shape, full_width)
            layers = split(rgba, s, motion, self.settings.layers, reach + report.longest / 2, second)
        report.layers = len(layers)
        return layers

    def _behind(self, given, camera: LensCamera, shape, full_width: int) -> Layer:
        """Prepare a layer behind the nearest surfaces, as rendered: a second depth peel, or deep samples."""
        rgba, depth, motion = (*given, None)[:3]
        if np.shape(depth) != shape:
            raise LensError(f"lens: a layer behind is {np.shape(depth)}, the frame {shape}; render both at one size")
        return Layer(*self._prepare(rgba, depth, motion, camera, Report(), full_width))

    def _widen(self, layer: Layer, report: Report) -> tuple[Layer, int]:
        """Extrapolate light from outside the frame, as far as the blur of the border reaches inside."""
        if self.settings.edges != "extend":
            return layer, 0
        border = np.zeros(layer.s.shape, bool)
        band = min(4, min(border.shape))
        border[:band], border[-band:], border[:, :band], border[:, -band:] = True, True, True, True
        border &= layer.rgba.any(-1)
        if not border.any():
            return layer, 0
        reach = np.abs(layer.s[border]).max()
        if layer.motion is not None:
            reach += np.hypot(*layer.motion[border].T).max() / 2
        pad = int(np.ceil(reach))
        if pad == 0:
            return layer, 0
        motion = None if layer.motion is None else np.pad(layer.motion, ((pad, pad), (pad, pad), (0, 0)), mode="edge")
        return (
            Layer(extend(layer.rgba, pad, self.settings.white), np.pad(layer.s, pad, mode="edge"), motion),
            pad,
        )


def _displacement(motion: np.ndarray, shutter: float, side: int, report: Report) -> np.ndarray | None:
    """Return the displacement while the shutter is open, clamped; None where nothing moves.

    ``side`` is the longer side of the frame, pixels.
    """
    motion = motion * np.float32(shutter)
    length = np.hypot(motion[..., 0], motion[..., 1])
    report.longest = float(length.max())
    most = min(float(side), SIZES[-1])
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
