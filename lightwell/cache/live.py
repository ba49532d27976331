"""The live session: a scene whose camera, lights and objects move while the cache follows."""

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

# Panels of the page. Every panel but the first two is made on every other frame.
PANELS = ("cache-image", "path", "cache", "error")
# Frames that are averaged at most while nothing moves; points of the curves that are kept.
MOST_FRAMES, CURVE = 512, 240
JPEG_QUALITY = 88
# How far commands may lead when many of them follow each other: the power of e of one step of the camera, its distance
# as a multiple and a part of the scene's extent, the light of a lamp.
CLOSER, FARTHEST, GAINS = 5.0, 1e3, (1e-6, 1e6)


@dataclass(frozen=True)
class Lamp:
    """A point light that is added to a scene."""

    place: np.ndarray
    """[3] metres."""
    intensity: float
    """Candela."""


class LiveScene:
    """A Mitsuba scene with one sensor, and what can be moved in it."""

    def __init__(self, loaded: Scene, size: int, camera: Camera | None = None, lamp: Lamp | None = None) -> None:
        """Put together what a session needs.

        Args:
            loaded: The scene.
            size: Edge of the sensor's square film, pixels.
            camera: Where the view begins; None: the scene's first camera, else one outside of its bounds.
            lamp: A point light to add; None: one where nothing else shines.
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
        """Index of a lamp to what its light has been multiplied with."""
        if lamp is None and not loaded.mi.emitters():
            lamp = Lamp(self.center + np.array([0, 0.3 * (high - low)[1], 0]), self.extent**2)
        self.own_lamp = lamp is not None
        if lamp is not None:
            power = {"type": "rgb", "value": lamp.intensity}
            content["lamp"] = {"type": "point", "position": np.asarray(lamp.place).tolist(), "intensity": power}
        camera = camera or (loaded.cameras[0] if loaded.cameras else self._outside(low, high))
        self.position, self.target = np.array(camera.position, float), np.array(camera.target, float)
        self.up, self.fov = np.array(camera.up, float), camera.fov_y
        # Orbit about what the camera looks at, not about a point right before it.
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
        """Turn round the target by angles in radians and come closer by a factor e^closer."""
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
        """Shift a thing by a vector, in parts of the scene's extent."""
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
        """Multiply the light of a lamp, within ``GAINS`` of what it was."""
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
    """Renders in a thread; the page reads ``state`` and sends ``command``s."""

    def __init__(self, source: str, settings: CacheSettings, size: int = 256, **options: Any) -> None:
        """``options`` are those of ``lightwell.scenes.load``."""
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
        """Queue what the page asks for, a JSON object; ValueError for what is no command."""
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
        """Begin the averages anew."""
        self.still = 0
        for total in self.sums.values():
            total[:] = 0

    # ------------------------------------------------------------------ frames

    def loop(self) -> None:
        """Until ``running`` is taken away; a failure is shown on the page."""
        while self.running:
            try:
                self._obey()
                self.frame()
            except Exception as error:
                self.failure = " ".join(str(error).split())[:500]
                self.running = False

    def frame(self) -> None:
        """One frame: train, render both, and now and then the other panels."""
        seed = self.frames & 0xFFFFFF
        # A cache that is cold, or whose scene has just changed, learns from larger frames, and pictures made meanwhile
        # are not averaged.
        if self.cache.eager:
            self._forget_pictures()
        with dr.suspend_grad():
            start = time.perf_counter()
            told = self.cache.train_frame(self.live.scene, self.live.sensor, 1)
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
        if np.isfinite(told.loss):
            self.curve.append((self.frames, told.loss))
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
        """What the page shows beside the pictures."""
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
