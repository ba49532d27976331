"""Live session: a scene whose camera, lights and objects are moved while the cache keeps training."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.cache.frames import sobol_pass
from lightwell.cache.live_commands import Command, parse_command
from lightwell.cache.radiance_cache import RadianceCache, bounds_of
from lightwell.cache.settings import CacheSettings
from lightwell.cache.views import view
from lightwell.core.color import srgb_bytes
from lightwell.core.image_io import encoded
from lightwell.scenes import load
from lightwell.scenes.scene import Camera, Scene

# Panels of the page. All but the first two are rendered every other frame.
PANELS = ("cache-image", "path", "cache", "error")
# Largest number of frames averaged while nothing moves; points of the loss curve that are kept.
MOST_FRAMES, CURVE = 512, 240
JPEG_QUALITY = 88
# Limits of accumulated commands: exponent of e of one camera step; distance of the camera over the scene's extent (and
# its inverse); factor of a light.
CLOSER, FARTHEST, GAINS = 5.0, 1e3, (1e-6, 1e6)


@dataclass(frozen=True)
class Lamp:
    """Point light that is added to a scene."""

    place: np.ndarray
    """[3] position, metres."""
    intensity: float
    """Radiant intensity, relative linear units."""


class LiveScene:
    """Mitsuba scene with one sensor, and its movable camera, lights and objects."""

    def __init__(self, loaded: Scene, size: int, camera: Camera | None = None, lamp: Lamp | None = None) -> None:
        """Build the Mitsuba scene of a session.

        Args:
            loaded: The scene.
            size: Edge of the sensor's square film, pixels.
            camera: Initial view; None: the scene's first camera, or else one outside of its bounds.
            lamp: Point light to add; None: one is added only if the scene has no emitter.
        """
        self.name = loaded.name
        content: dict[str, Any] = {"type": "scene"}
        for k, shape in enumerate(loaded.mi.shapes()):
            content[f"shape{k}"] = shape
        if (environment := loaded.mi.environment()) is not None:
            content["environment"] = environment
        low, high = bounds_of(loaded.mi)
        self.center, self.extent = (low + high) / 2, float((high - low).max())
        self.gains: dict[int, float] = {}
        """Index of a light to the factor of its radiance so far."""
        if lamp is None and not loaded.mi.emitters():
            lamp = Lamp(self.center + np.array([0, 0.3 * (high - low)[1], 0]), self.extent**2)
        self.own_lamp = lamp is not None
        if lamp is not None:
            power = {"type": "rgb", "value": lamp.intensity}
            content["lamp"] = {"type": "point", "position": np.asarray(lamp.place).tolist(), "intensity": power}
        camera = camera or (loaded.cameras[0] if loaded.cameras else self._outside(low, high))
        self.position, self.target = np.array(camera.position, float), np.array(camera.target, float)
        self.up, self.fov = np.array(camera.up, float), camera.fov_y
        # Orbit about what the camera looks at: a target right in front of the camera is moved to the scene's centre
        # depth.
        forward = self.target - self.position
        forward /= np.linalg.norm(forward)
        self.target = self.position + forward * max(float((self.center - self.position) @ forward), 0.2 * self.extent)
        content["sensor"] = {
            "type": "perspective", "fov": self.fov, "fov_axis": "y", "to_world": self._pose(),
            "film": {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}},
        }  # fmt: skip
        self.scene = mi.load_dict(content)
        self.sensor = self.scene.sensors()[0]
        self.parameters = mi.traverse(self.scene)
        names = [m.name or f"surface {k}" for k, m in enumerate(loaded.meshes)]
        shapes = self.scene.shapes()
        self.things = [
            {"index": k, "name": names[k] if k < len(names) else f"surface {k}", "light": s.emitter() is not None}
            for k, s in enumerate(shapes)
            if f"shape{k}.vertex_positions" in self.parameters
        ]
        if self.own_lamp:
            self.things.insert(0, {"index": -1, "name": "lamp", "light": True})

    @staticmethod
    def _outside(low: np.ndarray, high: np.ndarray) -> Camera:
        center, extent = (low + high) / 2, float((high - low).max())
        return Camera(tuple(center + np.array([0.6, 0.4, 1.2]) * extent), tuple(center))

    def _pose(self) -> Any:
        return mi.ScalarTransform4f().look_at(
            origin=self.position.tolist(), target=self.target.tolist(), up=self.up.tolist()
        )

    def orbit(self, right: float, up: float, closer: float) -> None:
        """Rotate the camera about the target and move it closer by a factor e^``closer``.

        Args:
            right: Angle about the vertical axis, radians.
            up: Elevation angle, radians; not applied near the poles.
            closer: Exponent of the approach, clamped to ±``CLOSER``.
        """
        offset = self.position - self.target
        axis = self.up / np.linalg.norm(self.up)
        offset = _turned(offset, axis, -right)
        side = np.cross(axis, offset)
        side /= max(np.linalg.norm(side), 1e-9)
        tilted = _turned(offset, side, -up)
        if abs(tilted @ axis) < 0.985 * np.linalg.norm(tilted):
            offset = tilted
        distance = np.linalg.norm(offset) * np.exp(-np.clip(closer, -CLOSER, CLOSER))
        distance = np.clip(distance, self.extent / FARTHEST, self.extent * FARTHEST)
        self.position = self.target + offset * (distance / np.linalg.norm(offset))
        sensor = mi.traverse(self.sensor)
        sensor["to_world"] = mi.Transform4f(self._pose().matrix)
        sensor.update()

    def move(self, index: int, by: np.ndarray) -> None:
        """Translate an object or the added lamp.

        Args:
            index: Index of the object; -1: the added lamp.
            by: [3] vector in units of the scene's extent.
        """
        step = np.asarray(by, float) * self.extent
        if index < 0:
            key = "lamp.position"
            self.parameters[key] = mi.Point3f(self.parameters[key]) + mi.Vector3f(*step.tolist())
        else:
            key = f"shape{index}.vertex_positions"
            places = np.array(self.parameters[key]).reshape(-1, 3) + step
            self.parameters[key] = mi.Float(places.astype(np.float32).ravel())
        self.parameters.update()

    def brighten(self, index: int, factor: float) -> None:
        """Multiply the radiance of a light; the accumulated factor stays within ``GAINS``.

        Args:
            index: Index of an emitting object; -1: the added lamp.
            factor: Factor, > 0.
        """
        before = self.gains.get(index, 1.0)
        self.gains[index] = float(np.clip(before * factor, *GAINS))
        factor = self.gains[index] / before
        start = "lamp.intensity" if index < 0 else f"shape{index}.emitter.radiance"
        for key in list(self.parameters.keys()):
            if key.startswith(start) and key.endswith((".value", ".data")):
                self.parameters[key] = self.parameters[key] * factor
        self.parameters.update()


def _turned(v: np.ndarray, axis: np.ndarray, angle: float) -> np.ndarray:
    """Rodrigues' rotation."""
    c, s = np.cos(angle), np.sin(angle)
    return v * c + np.cross(axis, v) * s + axis * (axis @ v) * (1 - c)


class LiveSession:
    """Renders a scene continuously in one thread, while a page reads ``state`` and sends commands from others."""

    def __init__(self, source: str, settings: CacheSettings, size: int = 256, **options: Any) -> None:
        """Load a scene and make an untrained cache.

        Args:
            source: Scene file or name of a built-in scene.
            settings: Settings of the cache.
            size: Edge of the square image, pixels.
            **options: Options of ``lightwell.scenes.load``.
        """
        self.live = LiveScene(load(source, **options), size)
        self.settings, self.size = settings, size
        self.cache = RadianceCache(settings)
        self.cache.prepare(self.live.scene)
        self.lock = threading.Lock()
        self.commands: deque[Command] = deque(maxlen=256)
        self.running = True
        self.paused_training = False
        self.frames = 0
        """Frames since the session began."""
        self.still = 0
        """Frames since something moved."""
        self.sums = {name: np.zeros((size, size, 3)) for name in ("cache-image", "path")}
        self.pictures: dict[str, bytes] = {}
        self.curve: deque[tuple[int, float]] = deque(maxlen=CURVE)
        self.milliseconds = {"train": 0.0, "cache-image": 0.0, "path": 0.0, "views": 0.0}
        self.exposure = 0.0
        self.failure = ""

    # ------------------------------------------------------------------ commands

    def command(self, order: bytes | Mapping[str, Any]) -> None:
        """Check a command of the page and add it to the queue.

        Args:
            order: JSON object as text or as a mapping; ``parse_command`` raises ``ValueError`` for an invalid one.
        """
        self.commands.append(parse_command(order, {t["index"] for t in self.live.things}))

    def _obey(self) -> None:
        moved = False
        while self.commands:
            order = self.commands.popleft()
            if order.do == "freeze":
                self.cache.frozen = not self.cache.frozen
                continue
            if order.do == "orbit":
                self.live.orbit(order.x, order.y, order.z)
            elif order.do == "reset":
                self.cache = RadianceCache(self.settings, self.cache.box)
                self.cache.prepare(self.live.scene)
            else:
                if order.do == "move":
                    self.live.move(order.thing, np.array([order.x, order.y, order.z]))
                else:
                    self.live.brighten(order.thing, order.factor)
                self.cache.scene_changed("light")
            moved = True
        if moved:
            self._forget_pictures()

    def _forget_pictures(self) -> None:
        """Restart the averages."""
        self.still = 0
        for total in self.sums.values():
            total[:] = 0

    # ------------------------------------------------------------------ frames

    def loop(self) -> None:
        """Render frames until ``running`` is False; an error ends the loop and is shown on the page."""
        while self.running:
            try:
                self._obey()
                self.frame()
            except Exception as error:
                self.failure = " ".join(str(error).split())[:500]
                self.running = False

    def frame(self) -> None:
        """Train, render with the cache and by path tracing, and every other frame render the other panels."""
        seed = self.frames & 0xFFFFFF
        # An untrained cache, or one whose scene has just changed, trains with larger frames; images rendered meanwhile
        # are not averaged.
        if self.cache.eager:
            self._forget_pictures()
        with dr.suspend_grad():
            start = time.perf_counter()
            stats = self.cache.train_frame(self.live.scene, self.live.sensor, 1)
            self._took("train", start)
            if self.still < MOST_FRAMES:
                for name, caching in (("cache-image", True), ("path", False)):
                    start = time.perf_counter()
                    self.sums[name] += self._render(caching, seed)
                    self._took(name, start)
                self.still += 1
            start = time.perf_counter()
            means = {name: total / max(self.still, 1) for name, total in self.sums.items()}
            if self.frames % 2 == 0 or not self.pictures:
                means["cache"] = view(self.live.scene, self.live.sensor, self.cache, "cache", 1, seed)
                means["error"] = np.abs(means["cache-image"] - means["path"])
            self._took("views", start)
        if np.isfinite(stats.loss):
            self.curve.append((self.frames, stats.loss))
        self._publish(means)
        self.frames += 1

    def _took(self, name: str, start: float) -> None:
        now = 1e3 * (time.perf_counter() - start)
        before = self.milliseconds[name]
        self.milliseconds[name] = now if before == 0 else 0.8 * before + 0.2 * now

    def _render(self, caching: bool, seed: int) -> np.ndarray:
        """One sample per pixel, [H, W, 3]."""
        numbers = [dr.opaque(mi.UInt32, x) for x in (self.still, 1, seed if self.still == 0 else 7)]
        L, *_ = sobol_pass(
            self.live.scene, self.live.sensor, self.cache, numbers, self.size**2, "biased", 1.0, caching
        )  # fmt: skip
        return np.array(L).T.reshape(self.size, self.size, 3)

    def _publish(self, means: dict[str, np.ndarray]) -> None:
        lit = means["cache-image"].mean(axis=-1)
        bright = float(np.percentile(lit, 90)) or 1.0
        self.exposure = 0.7 / bright if not self.exposure or self.still <= 1 else 0.9 * self.exposure + 0.07 / bright
        made = {name: _jpeg(picture * self.exposure) for name, picture in means.items()}
        with self.lock:
            self.pictures |= made

    def state(self) -> dict[str, Any]:
        """Return the numbers that the page shows beside the images.

        Returns:
            Dictionary of JSON types.
        """
        last = self.cache.history[-1] if self.cache.history else None
        return {
            "scene": self.live.name, "frame": self.frames, "still": self.still, "frozen": self.cache.frozen,
            "milliseconds": {k: round(v, 1) for k, v in self.milliseconds.items()},
            "curve": [list(p) for p in self.curve.copy()], "things": self.live.things, "failure": self.failure,
            "records": last.records if last else 0, "dropped": last.dropped if last else 0,
            "steps": self.cache.learner.step, "scale": float(np.nan_to_num(self.cache.scale.value)),
            "changes": self.cache.changes,
            "bias": list(last.bias) if last and np.isfinite(last.bias).all() else None,
        }  # fmt: skip


def _jpeg(linear: np.ndarray) -> bytes:
    return encoded(srgb_bytes(np.nan_to_num(linear)), "JPEG", quality=JPEG_QUALITY)
