"""Live session: a scene whose camera, lights, objects and materials change while the cache keeps training."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from lightwell.backend import dr, mi, upload_floats
from lightwell.cache.live_bake import ChildBake
from lightwell.cache.live_baked import baked_image, read_shown
from lightwell.cache.live_commands import Command, parse_command
from lightwell.cache.live_panel import LivePanel
from lightwell.cache.live_picture import LivePicture
from lightwell.cache.live_scene import Lamp, LiveScene
from lightwell.cache.radiance_cache import RadianceCache
from lightwell.cache.settings import CacheSettings
from lightwell.cache.views import view
from lightwell.cache.warm_start import BakedLight, warm_start
from lightwell.core.scene_edits import SceneEdits
from lightwell.scenes import load
from lightwell.scenes.placing import initial_light, sample_cameras
from lightwell.scenes.scene import Camera, Scene
from lightwell.scenes.variables import declare

# Points of the loss curve that are kept.
CURVE = 240
# Frames of the cache at the first hit that are averaged; pixels of the baked field per edge while something moves.
FIRST_HIT_FRAMES, BAKED_SHARE = 16, 4
# One frame of so many is trained on while the camera moves.
MOVING_TRAINED = 4
# Commands that may wait for a frame, the first of which compiles kernels.
MOST_WAITING = 256
# Seconds without a frame while a bake has the processor and nothing moves.
YIELDED = 0.25


def first_view(loaded: Scene) -> tuple[Camera, Lamp | None]:
    """Choose the first camera of a session, and a lamp where the scene has no light.

    Args:
        loaded: The scene.

    Returns:
        The scene's first camera, or one in free air; and a point light that lights much of what it sees, or None.
    """
    variable = declare((), loaded)
    camera = loaded.cameras[0] if loaded.cameras else sample_cameras(loaded, variable, 1, 0)[0]
    if loaded.has_static_light:
        return camera, None
    return camera, Lamp(initial_light(loaded, variable, camera), loaded.core_extent**2)


def _enlarged(live: LiveScene, baked: BakedLight, size: int, share: int) -> mi.Float:
    """[3 N] baked radiance at one pixel of ``share`` along both edges."""
    picture = baked_image(live, baked, max(size // share, 1))
    whole = picture.repeat(share, axis=0).repeat(share, axis=1)
    edge = size - len(whole)
    return upload_floats(np.pad(whole, ((0, edge), (0, edge), (0, 0)), mode="edge").ravel())


def _bake_state(bake: ChildBake | None, refusal: str) -> dict[str, Any] | None:
    """What the page shows of the last bake, or of why it could not begin or be shown."""
    if refusal:
        return {"running": False, "seconds": 0.0, "line": "", "failed": refusal}
    return None if bake is None else bake.state()


class LiveSession:
    """Renders a scene continuously in one thread, while a page reads ``state`` and sends commands from others."""

    def __init__(
        self,
        source: str,
        settings: CacheSettings,
        size: int = 512,
        cache_from: Path | None = None,
        baker: Callable[[SceneEdits, str], ChildBake] | None = None,
        **options: Any,
    ) -> None:
        """Load a scene and make a cache.

        Args:
            source: Scene file or name of a built-in scene.
            settings: Settings of the cache.
            size: Edge of the square image, pixels.
            cache_from: ``scene.glb`` of a bake of the scene, from which the cache starts; None: untrained.
            baker: Starts a bake of the scene with edits, at a quality; None: the page has no such button.
            **options: Options of ``lightwell.scenes.load``.
        """
        loaded = load(source, **options)
        self.live = LiveScene(loaded, size, *first_view(loaded))
        self._settings, self._size = settings, size
        self.cache = RadianceCache(settings)
        self.cache.prepare(self.live.scene)
        self.baked: BakedLight | None = None
        """Fields of a bake of the scene; None: there is none yet."""
        if cache_from is not None:
            self.baked = BakedLight.read(cache_from)
            warm_start(self.cache, self.live, loaded, self.baked, 0)
        self.panel = LivePanel(size)
        self.shown = "cache"
        """What the page shows, one of ``live_commands.PICTURES``."""
        self.pictures = {name: LivePicture(size, name == "cache") for name in ("cache", "path")}
        """Progressive pictures."""
        self.running = True
        self.frames = 0
        """Frames since the session began."""
        self._still = 0
        self.failure = ""
        """Why the session has ended; '': it has not."""
        self.bake: ChildBake | None = None
        """The last bake that was started; None: none."""
        self._baker = baker
        self._taken_over = True
        # Why the last bake could not begin or be shown; '': it could.
        self._refusal = ""
        self._first_hit: np.ndarray | None = None
        self._baked_at = 0
        self._commands: deque[Command] = deque()
        self._curve: deque[tuple[int, float]] = deque(maxlen=CURVE)
        self._milliseconds = {"train": 0.0, "picture": 0.0, "encode": 0.0}

    # ------------------------------------------------------------------ commands

    def command(self, order: bytes | Mapping[str, Any]) -> None:
        """Check a command of the page and add it to the queue.

        Args:
            order: JSON object as text or as a mapping; ``parse_command`` raises ``ValueError`` for an invalid one.

        Raises:
            ValueError: The command is invalid, cannot be executed now, or too many wait.
        """
        things = {t["index"] for t in self.live.things}
        command = parse_command(order, things, {m["index"] for m in self.live.materials})
        if command.picture == "baked" and self.baked is None:
            raise ValueError("live: nothing is baked yet; bake the scene first, or start with --cache-from")
        if command.do == "bake" and self._baker is None:
            raise ValueError("live: this session does not bake")
        if len(self._commands) == MOST_WAITING:
            raise ValueError(f"live: {MOST_WAITING} commands wait for the next frame; send this one again after it")
        self._commands.append(command)

    def obey(self) -> None:
        """Execute the commands in the queue."""
        while self._commands:
            order = self._commands.popleft()
            if order.do == "freeze":
                self.cache.frozen = not self.cache.frozen
            elif order.do == "bake":
                self._start_bake(order.quality)
            elif order.do == "orbit":
                self.live.orbit(order.x, order.y, order.z)
                self._restart(lambda picture: picture.moved())
            elif order.do == "show":
                self._show(order.picture)
            else:
                self._change(order)

    def _change(self, order: Command) -> None:
        """Change the scene, or forget what was learned of it."""
        if order.do == "reset":
            self.cache = RadianceCache(self._settings, self.cache.region.box)
            self.cache.prepare(self.live.scene)
            return self._restart(lambda picture: picture.forget())
        if order.do == "move":
            self.live.move(order.thing, np.array([order.x, order.y, order.z]))
        elif order.do == "brighten":
            self.live.brighten(order.thing, order.factor)
        else:
            self.live.paint(order.material, order.color, order.roughness)
        self.cache.scene_changed("material" if order.do == "paint" else "light", self.live.scene)
        self._restart(lambda picture: picture.changed())

    def _restart(self, begin: Callable[[LivePicture], None]) -> None:
        """Begin all pictures anew."""
        for picture in self.pictures.values():
            begin(picture)
        self._first_hit, self._still, self._baked_at = None, 0, 0

    def _show(self, name: str) -> None:
        """Show another picture: those that were not shown have not followed the camera."""
        self.shown = name
        self._restart(lambda picture: picture.forget())

    def _start_bake(self, quality: str) -> None:
        if self._baker is None or (self.bake is not None and self.bake.state()["running"]):
            return
        try:
            self.bake, self._taken_over, self._refusal = self._baker(self.live.edits, quality), False, ""
        except OSError as error:
            # The page goes on: nothing of it depends on a bake.
            self._refusal = f"live: cannot write '{error.filename}' ({error.strerror}); start again with another -o"

    def _take_over(self) -> None:
        """Read what a bake has written, once it is there."""
        if self.bake is None or self._taken_over:
            return
        state = self.bake.state()
        if state["running"]:
            return
        self._taken_over = True
        try:
            if not state["failed"]:
                self.baked, self._baked_at = read_shown(self.live, self.bake.out / "scene.glb"), 0
        except (ValueError, OSError) as error:
            self._refusal = f"live: the bake cannot be shown: {error}"

    # ------------------------------------------------------------------ frames

    def loop(self) -> None:
        """Render frames until ``running`` is False; an error ends the loop and is shown on the page."""
        while self.running:
            try:
                self.obey()
                self._take_over()
                self.frame()
                if self._still > 1 and self.bake is not None and not self._taken_over:
                    time.sleep(YIELDED)
            except Exception as error:
                self.failure = " ".join(str(error).split())[:500]
                self.running = False

    def frame(self) -> None:
        """Train, render what is shown, and encode it where it has changed."""
        # An untrained cache, or one whose scene has just changed, trains with larger frames; the light of its pictures
        # has little weight. A frozen one would stay as it is, and its picture would begin anew for ever.
        if self.cache.schedule.eager and not self.cache.frozen:
            self.pictures["cache"].changed()
        begun, trained = time.perf_counter(), 0.0
        with dr.suspend_grad():
            # While the camera moves, pictures come before training.
            if self._still or self.cache.schedule.eager or self.frames % MOVING_TRAINED == 0:
                self._train()
                trained = time.perf_counter() - begun
            start = time.perf_counter()
            image = self._image()
            self._took("picture", start)
            start = time.perf_counter()
            if image is not None:
                self.panel.publish(image, self.shown != "difference")
                self._took("encode", start)
        # A frame without a picture, at rest, leaves all of its time to training.
        if self._settings.training.budget == "auto" and image is not None and trained > 0 and not self.cache.frozen:
            self.cache.schedule.balance(trained, time.perf_counter() - begun)
        self.frames += 1
        self._still += 1

    def _train(self) -> None:
        """Train on one frame."""
        start = time.perf_counter()
        stats = self.cache.train_frame(self.live.scene, self.live.sensor, 1)
        self._took("train", start)
        if np.isfinite(stats.loss):
            self._curve.append((self.frames, stats.loss))

    def _image(self) -> mi.Float | None:
        """[3 N] radiance of what is shown; None where it is as before."""
        if self.shown == "baked":
            return self._baked_image()
        if self.shown == "first-hit":
            return self._first_hit_image()
        names = ("cache", "path") if self.shown == "difference" else (self.shown,)
        scene, sensor = self.live.scene, self.live.sensor
        new = [self.pictures[name].advance(scene, sensor, self.cache, self.panel.exposure) for name in names]
        if not any(new):
            return None
        images = [self.pictures[name].image for name in names]
        return images[0] if len(images) == 1 else dr.abs(images[0] - images[1])

    def _baked_image(self) -> mi.Float | None:
        """The baked field: coarse while something moves, once at full size at rest."""
        assert self.baked is not None
        coarse = self._still == 0
        if self._baked_at == 2 or (self._baked_at == 1 and coarse):
            return None
        self._baked_at = 1 if coarse else 2
        return _enlarged(self.live, self.baked, self._size, BAKED_SHARE if coarse else 1)

    def _first_hit_image(self) -> mi.Float | None:
        """The mean of the cache's values at what the camera sees; it follows the training."""
        shown = view(self.live.scene, self.live.sensor, self.cache, "cache", 1, self.frames & 0xFFFFFF)
        count = min(self._still + 1, FIRST_HIT_FRAMES)
        before = shown if self._first_hit is None else self._first_hit
        self._first_hit = before + (shown - before) / count
        return upload_floats(self._first_hit.ravel())

    def _took(self, name: str, start: float) -> None:
        dr.sync_thread()
        now = 1e3 * (time.perf_counter() - start)
        before = self._milliseconds[name]
        self._milliseconds[name] = now if before == 0 else 0.8 * before + 0.2 * now

    def state(self) -> dict[str, Any]:
        """Return the numbers that the page shows beside the image.

        Returns:
            Dictionary of JSON types.
        """
        # Read once: the render thread replaces the cache where everything is forgotten.
        cache = self.cache
        history = cache.history
        last = history[-1] if history else None
        picture = self.pictures.get(self.shown, self.pictures["cache"])
        return {
            "scene": self.live.name, "frame": self.frames, "picture": self.panel.number, "still": self._still,
            "shown": self.shown, "samples": picture.spp, "frozen": cache.frozen, "size": self._size,
            "milliseconds": {k: round(v, 1) for k, v in self._milliseconds.items()},
            "curve": [list(p) for p in self._curve.copy()], "things": self.live.things,
            "materials": self.live.materials, "failure": self.failure,
            "records": last.records if last else 0, "dropped": last.dropped if last else 0,
            "steps": cache.predictor.learner.step, "scale": float(np.nan_to_num(cache.predictor.scale.value)),
            "changes": cache.changes, "bakes": self._baker is not None, "bake": _bake_state(self.bake, self._refusal),
            "baked": self.baked is not None,
            "bias": list(last.bias) if last and np.isfinite(last.bias).all() else None,
        }  # fmt: skip
