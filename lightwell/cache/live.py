"""Live session: a scene whose camera, lights and objects are moved while the cache keeps training."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from lightwell.backend import dr, mi, upload_floats
from lightwell.cache.frames import sobol_pass
from lightwell.cache.live_commands import Command, parse_command
from lightwell.cache.live_scene import LiveScene
from lightwell.cache.radiance_cache import RadianceCache
from lightwell.cache.settings import CacheSettings
from lightwell.cache.views import view
from lightwell.cache.warm_start import BakedLight, warm_start
from lightwell.core.color import SRGB_A, SRGB_GAMMA, SRGB_SLOPE, SRGB_TOE
from lightwell.core.image_io import encoded
from lightwell.scenes import load

# Largest number of frames averaged while nothing moves; points of the loss curve that are kept.
MOST_FRAMES, CURVE = 512, 240
JPEG_QUALITY = 88
# Displayed value of the brightest tenth of an image.
BRIGHT = 0.7


# The exposure looks at one pixel of so many.
SAMPLED = 7


def _codes(linear: mi.Float) -> Any:
    """sRGB codes 0 to 255 as bytes on the device; what is not finite is black."""
    x = dr.clip(dr.select(dr.isfinite(linear), linear, 0), 0, 1)
    curve = (1 + SRGB_A) * dr.power(dr.maximum(x, SRGB_TOE), 1 / SRGB_GAMMA) - SRGB_A
    return dr.uint8_array_t(mi.Float)(dr.select(x <= SRGB_TOE, SRGB_SLOPE * x, curve) * 255 + 0.5)


class LivePanels:
    """Images of the page: averages over the frames since something moved. All panels but these are views."""

    def __init__(self, size: int) -> None:
        """Start without frames.

        Args:
            size: Edge of the square images, pixels.
        """
        self.still = 0
        """Frames since something moved."""
        self._size = size
        self._sums: dict[str, mi.Float] = {}
        self._jpegs: dict[str, bytes] = {}
        self._exposure = 0.0
        self._lock = threading.Lock()

    def restart(self) -> None:
        """Restart the averages."""
        self.still = 0
        self._sums = {}

    def add(self, name: str, image: mi.Float) -> None:
        """Add a frame to an average; ``still`` counts the frames.

        Args:
            name: 'cache-image' or 'path'.
            image: [H * W * 3] radiance on the device.
        """
        self._sums[name] = self._sums[name] + image if name in self._sums else image
        dr.eval(self._sums[name])

    def means(self) -> dict[str, mi.Float]:
        """Return the averages.

        Returns:
            Name to [H * W * 3] radiance; black where there are no frames yet.
        """
        share = dr.opaque(mi.Float, 1 / max(self.still, 1))
        black = dr.zeros(mi.Float, self._size**2 * 3)
        return {name: self._sums.get(name, black) * share for name in ("cache-image", "path")}

    def publish(self, images: Mapping[str, mi.Float]) -> None:
        """Expose and encode images for the page; the exposure follows the rendered one slowly.

        Args:
            images: Name to [H * W * 3] radiance; 'cache-image' among them.
        """
        lane = dr.arange(mi.UInt32, self._size**2 // SAMPLED) * SAMPLED
        sample = np.array(dr.gather(mi.Color3f, images["cache-image"], lane)).mean(axis=0)
        bright = float(np.percentile(sample, 90)) or 1.0
        first = not self._exposure or self.still <= 1
        self._exposure = BRIGHT / bright if first else 0.9 * self._exposure + 0.1 * BRIGHT / bright
        exposure = dr.opaque(mi.Float, self._exposure)
        shown = {name: _codes(image * exposure) for name, image in images.items()}
        dr.eval(shown)
        shape = (self._size, self._size, 3)
        pictures = {name: np.array(codes).reshape(shape) for name, codes in shown.items()}
        made = {name: encoded(picture, "JPEG", quality=JPEG_QUALITY) for name, picture in pictures.items()}
        with self._lock:
            self._jpegs |= made

    def jpegs(self) -> dict[str, bytes]:
        """Return the encoded images; may be called from any thread.

        Returns:
            Name to JPEG file.
        """
        with self._lock:
            return dict(self._jpegs)


class LiveSession:
    """Renders a scene continuously in one thread, while a page reads ``state`` and sends commands from others."""

    def __init__(
        self, source: str, settings: CacheSettings, size: int = 256, cache_from: Path | None = None, **options: Any
    ) -> None:
        """Load a scene and make a cache.

        Args:
            source: Scene file or name of a built-in scene.
            settings: Settings of the cache.
            size: Edge of the square image, pixels.
            cache_from: ``scene.glb`` of a bake of the scene, from which the cache starts; None: untrained.
            **options: Options of ``lightwell.scenes.load``.
        """
        loaded = load(source, **options)
        self.live = LiveScene(loaded, size)
        self._settings, self._size = settings, size
        self.cache = RadianceCache(settings)
        self.cache.prepare(self.live.scene)
        if cache_from is not None:
            warm_start(self.cache, self.live, loaded, BakedLight.read(cache_from), 0)
        self.panels = LivePanels(size)
        self.running = True
        self.frames = 0
        """Frames since the session began."""
        self.failure = ""
        """Why the session has ended; '': it has not."""
        self._commands: deque[Command] = deque(maxlen=256)
        self._curve: deque[tuple[int, float]] = deque(maxlen=CURVE)
        self._milliseconds = {"train": 0.0, "cache-image": 0.0, "path": 0.0, "views": 0.0}

    # ------------------------------------------------------------------ commands

    def command(self, order: bytes | Mapping[str, Any]) -> None:
        """Check a command of the page and add it to the queue.

        Args:
            order: JSON object as text or as a mapping; ``parse_command`` raises ``ValueError`` for an invalid one.
        """
        self._commands.append(parse_command(order, {t["index"] for t in self.live.things}))

    def obey(self) -> None:
        """Execute the commands in the queue."""
        moved = False
        while self._commands:
            order = self._commands.popleft()
            if order.do == "freeze":
                self.cache.frozen = not self.cache.frozen
                continue
            if order.do == "orbit":
                self.live.orbit(order.x, order.y, order.z)
            elif order.do == "reset":
                self.cache = RadianceCache(self._settings, self.cache.region.box)
                self.cache.prepare(self.live.scene)
            else:
                if order.do == "move":
                    self.live.move(order.thing, np.array([order.x, order.y, order.z]))
                else:
                    self.live.brighten(order.thing, order.factor)
                self.cache.scene_changed("light")
            moved = True
        if moved:
            self.panels.restart()

    # ------------------------------------------------------------------ frames

    def loop(self) -> None:
        """Render frames until ``running`` is False; an error ends the loop and is shown on the page."""
        while self.running:
            try:
                self.obey()
                self.frame()
            except Exception as error:
                self.failure = " ".join(str(error).split())[:500]
                self.running = False

    def frame(self) -> None:
        """Train, render with the cache and by path tracing, and every other frame render the other panels."""
        seed = self.frames & 0xFFFFFF
        # An untrained cache, or one whose scene has just changed, trains with larger frames; images rendered meanwhile
        # are not averaged.
        if self.cache.schedule.eager:
            self.panels.restart()
        with dr.suspend_grad():
            start = time.perf_counter()
            stats = self.cache.train_frame(self.live.scene, self.live.sensor, 1)
            self._took("train", start)
            if self.panels.still < MOST_FRAMES:
                for name, caching in (("cache-image", True), ("path", False)):
                    start = time.perf_counter()
                    self.panels.add(name, self._render(caching, seed))
                    self._took(name, start)
                self.panels.still += 1
            start = time.perf_counter()
            means = self.panels.means()
            if self.frames % 2 == 0:
                shown = view(self.live.scene, self.live.sensor, self.cache, "cache", 1, seed)
                means["cache"] = upload_floats(shown.ravel())
                means["error"] = dr.abs(means["cache-image"] - means["path"])
            self._took("views", start)
        if np.isfinite(stats.loss):
            self._curve.append((self.frames, stats.loss))
        self.panels.publish(means)
        self.frames += 1

    def _took(self, name: str, start: float) -> None:
        dr.sync_thread()
        now = 1e3 * (time.perf_counter() - start)
        before = self._milliseconds[name]
        self._milliseconds[name] = now if before == 0 else 0.8 * before + 0.2 * now

    def _render(self, caching: bool, seed: int) -> mi.Float:
        """One sample per pixel, [H * W * 3] on the device."""
        still, size = self.panels.still, self._size
        numbers = [dr.opaque(mi.UInt32, x) for x in (still, 1, seed if still == 0 else 7)]
        L, *_ = sobol_pass(self.live.scene, self.live.sensor, self.cache, numbers, size**2, "biased", 1.0, caching)
        return dr.ravel(L)

    def state(self) -> dict[str, Any]:
        """Return the numbers that the page shows beside the images.

        Returns:
            Dictionary of JSON types.
        """
        last = self.cache.history[-1] if self.cache.history else None
        return {
            "scene": self.live.name, "frame": self.frames, "still": self.panels.still, "frozen": self.cache.frozen,
            "milliseconds": {k: round(v, 1) for k, v in self._milliseconds.items()},
            "curve": [list(p) for p in self._curve.copy()], "things": self.live.things, "failure": self.failure,
            "records": last.records if last else 0, "dropped": last.dropped if last else 0,
            "steps": self.cache.predictor.learner.step, "scale": float(np.nan_to_num(self.cache.predictor.scale.value)),
            "changes": self.cache.changes,
            "bias": list(last.bias) if last and np.isfinite(last.bias).all() else None,
        }  # fmt: skip
