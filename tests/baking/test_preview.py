"""First light: a page from the first moment of a bake, better weights as they come, pause and good enough."""

import json
import threading
import urllib.error
import urllib.request
from types import SimpleNamespace

import numpy as np
import pytest

from lightwell.asset.container import unpack
from lightwell.asset.records import EXTENSION
from lightwell.baking import preview as module
from lightwell.baking.pipeline import bake
from lightwell.baking.preview import Preview, PreviewScene
from lightwell.core.progress import Progress
from lightwell.core.work import Work
from lightwell.fields.protocol import GoodEnough, Job
from lightwell.fields.registry import find_field
from lightwell.fields.request import Request
from lightwell.fields.surface.clock import Clock
from lightwell.fields.surface.options import SurfaceOptions
from lightwell.scenes import load
from lightwell.scenes.assemble import assemble
from lightwell.scenes.default_light import under_sky
from lightwell.scenes.scene import Light, Material
from lightwell.serving.server import LocalServer
from tests.transport.rooms import WHITE, box, build, diffuse, quad, room_walls

from .conftest import small


class Learned:
    """A learner of a known error."""

    def __init__(self, error):
        self.state = SimpleNamespace(best_error=error)

    def lower(self):
        return f"graph of {self.state.best_error}"


class Shown:
    """Stands for the scene of the page; keeps what was written."""

    roles = ("indirect",)

    def __init__(self):
        self.written = []

    def glb(self, graphs):
        self.written.append(dict(graphs))
        return json.dumps(graphs).encode()


@pytest.fixture
def page():
    now = SimpleNamespace(seconds=0.0)
    preview = Preview(clock=lambda: now.seconds)
    preview.shown = Shown()
    preview.publish("first light")
    return preview, now


def test_a_better_fit_is_shown_and_a_worse_one_is_not(page):
    preview, now = page
    for seconds, error in ((5, 0.4), (6, 0.3), (11, 0.2), (20, 0.25)):
        now.seconds = seconds
        preview.evaluated("indirect", Learned(error))
    assert preview.shown.written == [{}, {"indirect": "graph of 0.4"}, {"indirect": "graph of 0.2"}]
    state = preview.state()
    assert state["version"] == 3 and state["best"] == {"indirect": 0.2}
    assert state["curve"]["indirect"] == [(5, 0.4), (6, 0.3), (11, 0.2), (20, 0.25)]


def test_pause_holds_the_training_until_it_goes_on_and_good_enough_ends_it(page):
    preview, _ = page
    preview.command("pause")
    done = threading.Event()
    thread = threading.Thread(target=lambda: (preview.evaluated("indirect", Learned(0.4)), done.set()))
    thread.start()
    assert not done.wait(0.2)
    preview.command("go on")
    assert done.wait(5)
    preview.command("enough")
    with pytest.raises(GoodEnough):
        preview.evaluated("indirect", Learned(0.3))
    # Also where nothing can be shown yet: light maps, and lamps with switches.
    with pytest.raises(GoodEnough):
        preview.waited()
    with pytest.raises(ValueError, match="choose one of pause, go on, enough"):
        preview.command("stop")


class Enough:
    """An observer who is content at the second look."""

    def __init__(self):
        self.looks = 0

    def waited(self):
        self.looks += 1
        if self.looks > 1:
            raise GoodEnough
        return 0.0


def test_lamps_with_switches_end_when_they_are_good_enough(tmp_path):
    walls = [*room_walls(), quad("lamp", (-0.2, 1.9, -0.2), (0.4, 0, 0), (0, 0, 0.4))]
    shine = {"type": "area", "radiance": {"type": "rgb", "value": [5.0] * 3}}
    scene = build("lit", walls, [diffuse(WHITE)] * len(walls), [*[None] * (len(walls) - 1), shine])
    request, looks = Request(shards=1, steps=4000, quality="draft", lamps=("all",)), Enough()
    work = Work(small(tmp_path / "out"), scene.digest)
    job = Job(scene, request, SurfaceOptions(), work, Progress(quiet=True), observer=looks)
    field = find_field("factored")
    state = field.prepare(job)
    fit = field.fit(state, "static", field.sample(state, "static"))
    # An evaluation every hundred steps.
    assert looks.looks == 2 and fit.training.steps == 200 and fit.lower().graph.nbytes > 0


def test_a_pause_is_left_out_of_the_clock():
    clock = Clock()
    clock.skip(100.0)
    assert clock.seconds < 0


def test_the_page_is_served_and_takes_commands(page):
    preview, _ = page
    preview.shown.scene, preview.shown.camera = load("cornell"), load("cornell").cameras[0]
    with LocalServer(preview.application(), 0, "bake") as server:

        def get(path, data=None):
            return urllib.request.urlopen(urllib.request.Request(server.url + path, data)).read()

        html = get("").decode()
        assert 'id="bake-enough"' in html and module.PLACEHOLDER not in html
        assert get("scene.glb?version=1") == b"{}" and json.loads(get("page.json"))["title"]
        assert json.loads(get("state.json"))["version"] == 1
        get("command", b"enough")
        assert preview.enough
        for path, data in (("nothing", None), ("result/index.html", None), ("command", b"stop"), ("command", None)):
            with pytest.raises(urllib.error.HTTPError):
                get(path, data)


def test_the_first_page_is_a_valid_asset():
    shown = PreviewScene.of(load("cornell"), Request())
    assert shown.glb({})[:4] == b"glTF" and shown.intensity > 0 and np.isfinite(shown.light).all()
    samples = shown.samples(4, "indirect", 1)
    assert len(samples) == 4 * module.POINTS and np.isfinite(samples.half_a).all()


def test_a_surface_without_air_is_shown_in_the_light_of_its_own():
    """As it is baked: no light moves where there is no air for it and nobody has declared one."""
    floor, lamp = quad("floor", (-2, 0, -2), (0, 0, 4), (4, 0, 0)), Light("point", "lamp", (0.0, 2.0, 0.0))
    scene = assemble("one", [floor], [Material("grey", metallic=0.0)], lights=[lamp], digest="1")
    shown = PreviewScene.of(scene, Request())
    assert shown.variable is None and shown.roles == ("static",) and shown.glb({})[:4] == b"glTF"
    assert shown.samples(4, "static", 1).half_a.max() > 0
    for request in (Request(vary=("light.radius=0.1",)), Request(static=False)):
        with pytest.raises(ValueError, match="lies inside geometry"):
            PreviewScene.of(scene, request)


@pytest.mark.slow
def test_a_bake_with_a_page_shows_light_and_ends_when_it_is_good_enough(tmp_path):
    preview = Preview()
    preview.evaluated = lambda role, learner: (_ for _ in ()).throw(GoodEnough)
    report = bake(small(tmp_path / "out", steps=400), preview=preview)
    assert preview.state()["version"] > 2 and preview.state()["stage"] == "done"
    assert preview.graphs.keys() == {"indirect"} and report["relative_error"] < 2


def test_the_lamp_of_the_page_is_as_bright_as_the_part_that_is_looked_at_asks_for():
    town = [box(f"house {k}", (8.0 * k, 0, 0), (8.0 * k + 4, 6, 4)) for k in range(6)]
    alone = PreviewScene.of(build("town", town, [diffuse(WHITE)] * 6), Request())
    ground = box("ground", (-1000, -1, -1000), (1000, 0, 1000))
    wide = PreviewScene.of(build("wide", [ground, *town], [diffuse(WHITE)] * 7), Request())
    assert alone.intensity <= wide.intensity < 3 * alone.intensity


def test_the_first_page_shows_what_surrounds_a_scene():
    houses = [box(f"house {k}", (8.0 * k, 0, 0), (8.0 * k + 4, 6, 4)) for k in range(2)]
    scene = under_sky(build("houses", houses, [diffuse(WHITE)] * 2))
    document, _ = unpack(PreviewScene.of(scene, Request()).glb({}))
    assert document["extensions"][EXTENSION]["environment"] == {"radiance": [1.0, 1.0, 1.0]}
