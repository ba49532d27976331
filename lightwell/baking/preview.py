"""First light: a page that opens while a bake begins, and shows what is learned so far.

A small field is trained on a few thousand samples at once; the bake's own weights replace it when they are better. The
page asks for ``state.json`` and loads ``scene.glb`` again when its version has changed.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from lightwell.asset.page import PLACEHOLDER, camera_json, viewer_html
from lightwell.asset.records import FieldEntry
from lightwell.asset.write import glb_bytes
from lightwell.baking.environment import environment_entry
from lightwell.baking.evaluate import lit_views
from lightwell.baking.settings import BakeSettings
from lightwell.fields.base import FieldSetup, Learner, NoLight, around_samples, radiance_unit
from lightwell.fields.budget import Budget
from lightwell.fields.features import open_builder
from lightwell.fields.protocol import GoodEnough, Role
from lightwell.fields.registry import DEFAULT, find_field
from lightwell.fields.request import Request
from lightwell.graph import Graph
from lightwell.scenes.placing import sample_lights
from lightwell.scenes.scene import Camera, Scene
from lightwell.scenes.variables import Variable, declare, first_settings, parse_vary, to_json
from lightwell.serving.folder import files_of
from lightwell.serving.server import Answer, Application
from lightwell.serving.server import Request as WebRequest
from lightwell.transport import Samples, draw_surface
from lightwell.transport.collect import collect

PANEL = Path(__file__).with_name("preview_panel.html")
# Preset of the small field, and its rounds: (lights, steps). A light has POINTS points.
PRESET, POINTS, ROUNDS = "draft", 64, ((64, 120), (256, 240))
# Paths of a sample; lights of the samples that the error is measured on; a stream that no bake uses.
PATHS, HELD_OUT_LIGHTS, SEED = 16, 16, 0xF125
# Seconds between two versions of the asset: a browser compiles each.
LEAST_SECONDS = 4.0
# Points of the error curve that are sent, at most.
MOST_POINTS = 400
# Size of a command, bytes.
MOST_COMMAND = 64
# Intensity of the light at first, per square metre of the scene's half edge (cd), or of a sun (lx).
POINT_INTENSITY, SUN_INTENSITY = 4.0, 3.0
# Time of the reference of a bake that was good enough.
SHORT_TRUTH = Budget(5.0)
COMMANDS = ("pause", "go on", "enough")


@dataclass(frozen=True)
class PreviewScene:
    """What the page shows before anything is learned."""

    scene: Scene
    variable: Variable | None
    camera: Camera
    light: np.ndarray
    """[3]."""
    intensity: float
    color: tuple[float, float, float]
    seed: int
    roles: tuple[Role, ...]

    @staticmethod
    def of(scene: Scene, request: Request) -> PreviewScene:
        """Choose camera and light of the page.

        Args:
            scene: The scene.
            request: Settings of the bake.

        Returns:
            The scene with camera and light.
        """
        static = request.static and scene.has_static_light
        variable = _light(scene, request, static)
        camera, light = lit_views(scene, variable, 1, request.seed)[0]
        declared, color = first_settings(request.vary)
        half, kind = scene.core_extent / 2, None if variable is None else variable.kind
        usual = {"sun": SUN_INTENSITY, "environment": 1.0}.get(kind or "", POINT_INTENSITY * half * half)
        roles: tuple[Role, ...] = ("indirect",) if variable is not None else ()
        roles += ("static",) if static else ()
        return PreviewScene(scene, variable, camera, light, declared or usual, color, request.seed, roles)

    def glb(self, graphs: dict[Role, Graph]) -> bytes:
        """Write the asset.

        Args:
            graphs: What is learned, by role.

        Returns:
            A .glb file.
        """
        variables = [] if self.variable is None else [to_json(self.variable, self.light, self.intensity, self.color)]
        known: dict[Role, Graph] = graphs or {self.roles[0]: _no_light()}
        entries = [FieldEntry(role, role, g, 0 if role == "indirect" else None, {}) for role, g in known.items()]
        shines = "static" in self.roles or self.scene.surrounding is not None
        environment = environment_entry(self.scene, (), None) if shines else None
        return glb_bytes(self.scene, entries, variables, environment=environment)

    def samples(self, lights: int, role: Role, seed: int) -> Samples:
        """Trace samples, those of a light in consecutive rows.

        Args:
            lights: Number of lights.
            role: Part of the light.
            seed: Seed of points, lights and paths.

        Returns:
            ``lights * POINTS`` samples.
        """
        draw = draw_surface(self.scene, lights * POINTS, seed, shown=True)
        places = np.zeros((lights, 3), np.float32)
        if self.variable is not None:
            places = sample_lights(self.scene, self.variable, lights, seed)
        order = np.random.default_rng(seed).permutation(lights * POINTS)
        light = places.repeat(POINTS, axis=0)
        options = {"weight": draw.weight[order], "own_light": role == "static"}
        return collect(self.scene, self.variable, draw.points[order], light, PATHS, seed, **options)


class Preview:
    """The state of a page that is shown while a bake runs; see ``lightwell.fields.protocol.Observer``."""

    def __init__(self, opened: Callable[[], None] = lambda: None, clock: Callable[[], float] = perf_counter) -> None:
        """Make a page that shows nothing yet.

        Args:
            opened: Called when the page can be shown.
            clock: Returns seconds.
        """
        self._opened = opened
        self._clock, self._begin = clock, clock()
        self._changed = threading.Condition()
        self._glb, self._version, self._published = b"", 0, -np.inf
        self.graphs: dict[Role, Graph] = {}
        """The best graph of each role so far."""
        self._best: dict[Role, float] = {}
        self._curve: dict[Role, list[tuple[float, float]]] = {}
        self.shown: PreviewScene | None = None
        """What the page shows; None before ``begin``."""
        self._paused, self._stage, self._out = False, "loading", Path()
        self.enough = False
        """Whether the viewer has said that the light is good enough."""

    # ------------------------------------------------------------------ the bake

    def begin(self, scene: Scene, request: Request) -> None:
        """Show the scene with direct light, then train a small field and show it.

        Args:
            scene: The scene.
            request: Settings of the bake.
        """
        self.shown = PreviewScene.of(scene, request)
        self.publish("first light")
        self._opened()
        for number, (lights, steps) in enumerate(ROUNDS):
            for role in self.shown.roles:
                if self.enough:
                    return
                self._learn(role, lights, steps, number)
        self.stage("tracing and training")

    def _learn(self, role: Role, lights: int, steps: int, number: int) -> None:
        """Train a small field for a moment and show it."""
        shown = self.shown
        assert shown is not None
        samples = shown.samples(lights, role, SEED + 2 * number)
        light = None if role == "static" else shown.variable
        try:
            unit = radiance_unit(samples, light)
        except NoLight:
            # The bake says what that means for it.
            return
        setup = FieldSetup.of(shown.scene, unit, light.kind if light else "static", shown.variable)
        learner = find_field(DEFAULT).start(around_samples(setup, samples), PRESET, shown.seed)
        learner.learn_from(samples)
        learner.validate_on(shown.samples(HELD_OUT_LIGHTS, role, SEED + 1))
        learner.train(steps, steps)
        self._note(role, learner)
        self.publish("first light")

    def evaluated(self, role: Role, learner: Learner) -> float:
        """Take note of an evaluation of the bake's own training; wait while it is paused, as ``waited`` does.

        Args:
            role: Part of the light.
            learner: What is trained.

        Returns:
            Seconds of waiting.
        """
        if self._note(role, learner) and self._clock() - self._published >= LEAST_SECONDS:
            self.publish("training")
        return self.waited()

    def waited(self) -> float:
        """Wait while the training is paused, of which the page cannot show what it has learned.

        Returns:
            Seconds of waiting.

        Raises:
            GoodEnough: The training is to end.
        """
        start = self._clock()
        with self._changed:
            while self._paused and not self.enough:
                self._changed.wait(1)
        if self.enough:
            raise GoodEnough
        return self._clock() - start

    def stage(self, name: str) -> None:
        """Say what is being done.

        Args:
            name: A word or two.
        """
        with self._changed:
            self._stage = name

    def scored(self, settings: BakeSettings) -> BakeSettings:
        """Return the settings of the score: a short reference where the viewer does not want to wait.

        Args:
            settings: Settings of the bake.

        Returns:
            The settings.
        """
        self.stage("scoring and writing")
        return replace(settings, truth=settings.truth or SHORT_TRUTH) if self.enough else settings

    def finished(self, out: Path) -> None:
        """Show that the bake is written.

        Args:
            out: Its folder.
        """
        with self._changed:
            self._stage, self._out = "done", out

    def _note(self, role: Role, learner: Learner) -> bool:
        """Keep what is learned where its error is the smallest so far; whether it was."""
        error = float(learner.state.best_error)
        with self._changed:
            self._curve.setdefault(role, []).append((round(self._clock() - self._begin, 2), error))
        if not error < self._best.get(role, np.inf):
            return False
        self._best[role] = error
        self.graphs[role] = learner.lower()
        return True

    def publish(self, stage: str) -> None:
        """Write the asset of the best graphs so far; pages that are open fetch it.

        Args:
            stage: Name of the stage of the bake.
        """
        assert self.shown is not None
        glb = self.shown.glb(self.graphs)
        with self._changed:
            self._glb, self._version, self._stage = glb, self._version + 1, stage
        self._published = self._clock()

    # ------------------------------------------------------------------ the page

    def state(self) -> dict[str, Any]:
        """Describe how far the bake is.

        Returns:
            JSON values.
        """
        with self._changed:
            curve = {role: _thinned(points) for role, points in self._curve.items()}
            return {
                "version": self._version,
                "stage": self._stage,
                "paused": self._paused,
                "enough": self.enough,
                "seconds": round(self._clock() - self._begin, 1),
                "curve": curve,
                "best": {role: error for role, error in self._best.items() if np.isfinite(error)},
                "result": "result/index.html" if self._stage == "done" else "",
            }

    def command(self, name: str) -> None:
        """Pause the training, go on, or end it.

        Args:
            name: One of ``COMMANDS``.

        Raises:
            ValueError: There is no such command.
        """
        if name not in COMMANDS:
            raise ValueError(f"preview: there is no command '{name[:20]}'; choose one of {', '.join(COMMANDS)}")
        with self._changed:
            self._paused = name == "pause" and not self.enough
            self.enough = self.enough or name == "enough"
            self._changed.notify_all()

    def page_data(self) -> dict[str, Any]:
        """Return the data of the page, as a bake's page has it.

        Returns:
            JSON values.
        """
        title = self.shown.scene.name if self.shown else ""
        home = camera_json(self.shown.camera) if self.shown else None
        return {"title": title, "exposure": None, "home": home, "views": [], "report": {}, "links": []}

    def application(self) -> Application:
        """Make the web application of the page.

        Returns:
            Function from requests to answers.
        """
        page = viewer_html().replace(PLACEHOLDER, PANEL.read_text("utf-8")).encode()

        def answer(request: WebRequest) -> Answer:
            if request.path == "/command":
                return self._commanded(request)
            if request.method not in ("GET", "HEAD"):
                return Answer(405, headers=(("Allow", "GET, HEAD"),))
            if request.path.startswith("/result/") and self._stage == "done":
                return files_of(self._out)(replace(request, path=request.path.removeprefix("/result")))
            made: dict[str, Callable[[], Answer]] = {
                "/": lambda: Answer.page(page),
                "/scene.glb": lambda: Answer.of(200, self._glb, "model/gltf-binary"),
                "/page.json": lambda: _json(self.page_data()),
                "/state.json": lambda: _json(self.state()),
            }
            return made[request.path]() if request.path in made else Answer.of(404, b"there is nothing here")

        return answer

    def _commanded(self, request: WebRequest) -> Answer:
        if request.method != "POST":
            return Answer(405, headers=(("Allow", "POST"),))
        try:
            self.command(request.body[:MOST_COMMAND].decode())
        except ValueError as error:
            return Answer.of(400, str(error).encode())
        return Answer.of(200, b"{}", "application/json")


def _light(scene: Scene, request: Request, static: bool) -> Variable | None:
    """The light that varies; None where nobody has declared one, there is no air for it, and the scene has its own."""
    variable = declare(request.vary, scene)
    try:
        sample_lights(scene, variable, 1, request.seed)
    except ValueError:
        if not static or any(d.learned and not d.moves for d in map(parse_vary, (*request.vary, *scene.vary))):
            raise
        return None
    return variable


def _no_light() -> Graph:
    """A field that is black everywhere: what is shown before anything is learned."""
    b = open_builder()
    return b.build(radiance=b.scale("reflectance", 0.0))


def _json(value: Any) -> Answer:
    return Answer.of(200, json.dumps(value, allow_nan=False).encode(), "application/json")


def _thinned(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """At most ``MOST_POINTS`` points, the last one among them."""
    step = -(-len(points) // MOST_POINTS)
    return points[::-1][::step][::-1] if step else []
