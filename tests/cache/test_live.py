"""The live page: who may look, what is a command; the session itself on a small picture; sequences that resume."""

import http.client
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from lightwell.baking.pipeline import bake
from lightwell.baking.settings import BakeSettings
from lightwell.cache import settings_of
from lightwell.cache.live import LiveSession
from lightwell.cache.live_bake import ChildBake
from lightwell.cache.live_baked import baked_image
from lightwell.cache.live_commands import parse_command
from lightwell.cache.live_server import open_live
from lightwell.cache.settings import parse_options
from lightwell.cache.warm_start import BakedLight
from lightwell.cli.live import check_cache
from lightwell.fields.budget import Budget
from lightwell.limits import Limits
from lightwell.rendering.sequence import render_sequence
from lightwell.rendering.settings import RenderSettings
from lightwell.scenes import load
from tests.plain_glb import write_plain

ROOT = Path(__file__).parents[2]
SMALL = {"levels": 2, "entries_log2": 8, "batch": 512, "steps": 1, "train_fraction_max": 1.0, "max_vertices": 4}


class Stub:
    """A session that renders nothing."""

    def __init__(self):
        self.panel, self.orders, self.bake = self, deque(), None

    def state(self):
        return {"frame": 1}

    def jpeg(self):
        return b"x"

    def command(self, order):
        self.orders.append(parse_command(order, (-1, 4), (2,)))


@pytest.fixture
def page():
    session = Stub()
    with open_live(session) as server:
        server.session = session
        yield server


def _ask(server, method, path, body=None, **headers):
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=10)
    connection.request(method, path, body, {"Host": f"127.0.0.1:{server.port}", **headers})
    answer = connection.getresponse()
    return answer.status, answer.read()


def test_the_page_and_its_frames_are_served(page):
    assert b"lightwell live" in _ask(page, "GET", "/")[1]
    assert json.loads(_ask(page, "GET", "/frame")[1])["image"] == "eA=="
    assert _ask(page, "GET", "/etc/passwd")[0] == 404
    assert _ask(page, "GET", "/command")[0] == 405 and _ask(page, "POST", "/")[0] == 405


def test_other_sites_neither_look_nor_act(page):
    assert _ask(page, "GET", "/frame", Host="evil.example")[0] == 403
    order = json.dumps({"do": "orbit", "x": 0.1})
    assert _ask(page, "POST", "/command", order, Origin="http://evil.example")[0] == 403
    assert not page.session.orders
    assert _ask(page, "POST", "/command", order)[0] == 200 and page.session.orders[0].x == 0.1


@pytest.mark.parametrize(
    ("body", "text"),
    [
        (b"", "JSON object"),
        (b"[]", "JSON object"),
        (b"{", "JSON object"),
        (b"[" * 4000, "JSON object"),
        (b"\xff", "JSON object"),
        (b'{"do": "format"}', "no command"),
        (b'{"do": ["orbit"]}', "no command"),
        (b'{"do": "orbit", "w": 1}', "has no 'w'"),
        (b'{"do": "freeze", "x": 1}', "takes nothing"),
        (b'{"do": "orbit", "x": NaN}', "'x' is a number"),
        (b'{"do": "orbit", "x": 1e400}', "'x' is a number"),
        (b'{"do": "orbit", "x": true}', "'x' is a number"),
        (b'{"do": "orbit", "x": "1"}', "'x' is a number"),
        (b'{"do": "orbit", "z": ' + b"9" * 400 + b"}", "'z' is a number"),
        (b'{"do": "move", "thing": 4, "x": 1.5}', "'x' is a number from -1 to 1"),
        (b'{"do": "move", "x": 0.5}', "needs 'thing'"),
        (b'{"do": "move", "thing": 5}', "no such thing"),
        (b'{"do": "move", "thing": true}', "no such thing"),
        (b'{"do": "brighten", "thing": 4, "factor": 0}', "'factor' is a number"),
        (b'{"do": "paint", "red": 1, "green": 1, "blue": 1}', "needs 'material'"),
        (b'{"do": "paint", "material": 4, "roughness": 0.5}', "no such material"),
        (b'{"do": "paint", "material": 2, "roughness": 0.001}', "'roughness' is a number from 0.05 to 1"),
        (b'{"do": "paint", "material": 2, "red": 0.5}', "red, green and blue"),
        (b'{"do": "paint", "material": 2, "red": 2, "green": 0, "blue": 0}', "'red' is a number"),
        (b'{"do": "show"}', "needs 'picture'"),
        (b'{"do": "show", "picture": "../x"}', "no such picture"),
        (b'{"do": "bake", "quality": ["draft"]}', "no such quality"),
        (b'{"do": "bake", "scene": "x"}', "has no 'scene'"),
    ],
)
def test_what_is_no_command_is_refused(page, body, text):
    status, answer = _ask(page, "POST", "/command", body)
    assert status == 400 and text in answer.decode() and not page.session.orders


def test_a_long_command_is_not_read(page):
    assert _ask(page, "POST", "/command", "x" * 5000)[0] == 413


def test_every_command_of_the_page_is_one():
    for order in (
        {"do": "orbit", "x": 20.0, "y": -3.0}, {"do": "orbit", "z": -0.08}, {"do": "freeze"}, {"do": "reset"},
        {"do": "move", "thing": -1, "x": 0, "y": -0.04, "z": 0}, {"do": "brighten", "thing": 4, "factor": 0.5},
        {"do": "paint", "material": 2, "red": 1, "green": 0.5, "blue": 0}, {"do": "bake", "quality": "draft"},
        {"do": "paint", "material": 2, "roughness": 0.3}, {"do": "show", "picture": "first-hit"}, {"do": "bake"},
    ):  # fmt: skip
        assert parse_command(json.dumps(order).encode(), (-1, 4), (2,)).do == order["do"]


@pytest.mark.parametrize(
    ("option", "said"),
    [
        ("estimator=guided", "no cache is learned"),
        ("termination_c=inf", "no cache is learned"),
        ("estimator=residual", "--nrc estimator=… is for 'lightwell render'"),
        ("first_hit=restir-di", "--nrc first_hit=…"),
        ("view=cache", "--nrc view=…"),
        ("denoise=true", "--nrc denoise=…"),
        ("seconds=3", "--nrc seconds=…"),
        ("mode=still", "--nrc mode=…"),
        ("guide=true", "--nrc guide=…"),
        ("still_unbiased=0.5", "--nrc still_unbiased=…"),
    ],
)
def test_options_that_the_page_would_ignore_are_refused(option, said):
    with pytest.raises(ValueError, match=said):
        check_cache(parse_options([option]))
    check_cache(parse_options(["preset=paper", "levels=4", "tail_attenuation=0.9", "budget=low"]))


def test_a_session_renders_obeys_and_goes_on():
    session = LiveSession("cornell", settings_of(SMALL), 24)
    session.frame()
    session.frame()
    assert session.panel.jpeg().startswith(b"\xff\xd8") and session.panel.number == 2
    light = next(t["index"] for t in session.live.things if t["light"])
    with pytest.raises(ValueError, match="no such thing"):
        session.command({"do": "move", "thing": 999})
    with pytest.raises(ValueError, match="is a number from"):
        session.command({"do": "orbit", "x": float("nan")})
    before = session.live.camera.position.copy()
    session.command({"do": "orbit", "x": 0.3, "y": 0.1, "z": 0.1})
    session.command({"do": "move", "thing": light, "x": 0.05})
    session.command({"do": "brighten", "thing": light, "factor": 0.5})
    session.obey()
    assert (
        not np.allclose(before, session.live.camera.position)
        and session.state()["still"] == 0
        and session.cache.changes == 2
    )
    for name in ("path", "first-hit", "difference"):
        session.command({"do": "show", "picture": name})
        session.obey()
        number = session.panel.number
        session.frame()
        assert session.panel.number == number + 1 and session.state()["shown"] == name
    json.dumps(session.state(), allow_nan=False)


def test_an_automatic_budget_holds_for_the_page():
    session = LiveSession("cornell", settings_of({**SMALL, "batch": 16, "steps": 64, "budget": "auto"}), 24)
    for _ in range(16):
        session.frame()
    # Training takes far more of a frame of so small a picture than a quarter.
    assert session.cache.schedule.steps < 60


def test_commands_that_do_not_fit_into_the_queue_are_refused_not_dropped():
    session = LiveSession("cornell", settings_of(SMALL), 24)
    session.command({"do": "show", "picture": "path"})
    with pytest.raises(ValueError, match="commands wait for the next frame"):
        for _ in range(1000):
            session.command({"do": "orbit", "x": 1e-4})
    session.obey()
    assert session.shown == "path"
    session.command({"do": "orbit", "x": 1e-4})


class Forgotten:
    """A cache whose history another thread empties after it was looked at once."""

    def __init__(self, cache):
        self.cache, self.reads = cache, 0

    def __getattr__(self, name):
        return getattr(self.cache, name)

    @property
    def history(self):
        self.reads += 1
        return self.cache.history if self.reads == 1 else deque()


def test_the_state_can_be_read_while_everything_is_forgotten():
    session = LiveSession("cornell", settings_of(SMALL), 24)
    session.frame()
    session.cache = Forgotten(session.cache)
    assert session.state()["records"] > 0


def test_painted_walls_change_the_picture_and_the_material():
    session = LiveSession("cornell", settings_of(SMALL), 24)
    session.command({"do": "show", "picture": "path"})
    white = next(m["index"] for m in session.live.materials if m["name"] == "white")
    means = []
    for color in (None, {"red": 0.7, "green": 0.02, "blue": 0.02}):
        if color:
            session.command({"do": "paint", "material": white, **color})
        session.obey()
        for _ in range(8):
            session.frame()
        means.append(np.array(session.pictures["path"].image).reshape(-1, 3).mean(axis=0))
    assert means[1][1] < 0.5 * means[0][1] and means[1][0] > 0.6 * means[0][0]
    assert session.live.edits.painted[white].color == (0.7, 0.02, 0.02)
    # A second colour replaces the first.
    session.command({"do": "paint", "material": white, "red": 0.725, "green": 0.71, "blue": 0.68})
    session.obey()
    for _ in range(8):
        session.frame()
    again = np.array(session.pictures["path"].image).reshape(-1, 3).mean(axis=0)
    assert np.allclose(again, means[0], rtol=0.1)


class Baker:
    """Bakes nothing: says how far a bake is."""

    def __init__(self, out):
        self.out, self.running, self.asked = out, True, []

    def __call__(self, edits, quality):
        self.asked.append((edits, quality))
        return self

    def state(self):
        return {"running": self.running, "seconds": 1.0, "line": "tracing", "failed": ""}


@pytest.mark.slow
def test_a_bake_is_taken_over_and_shown(tmp_path):
    settings = BakeSettings("cornell", tmp_path, shards=1, steps=20, budget=Budget(20.0), views=1)
    bake(settings)
    baker = Baker(tmp_path)
    session = LiveSession("cornell", settings_of(SMALL), 32, baker=baker)
    with pytest.raises(ValueError, match="nothing is baked yet"):
        session.command({"do": "show", "picture": "baked"})
    session.command({"do": "move", "thing": 4, "x": 0.05})
    session.command({"do": "bake", "quality": "good"})
    session.command({"do": "bake"})
    session.obey()
    (edits, quality), *more = baker.asked
    assert not more and quality == "good" and set(edits.moved) == {4}
    assert session.state()["bake"]["running"] and not session.state()["baked"]
    baker.running = False
    thread = threading.Thread(target=session.loop, daemon=True)
    thread.start()
    try:
        wait_for(lambda: session.baked is not None)
        session.command({"do": "show", "picture": "baked"})
        wait_for(lambda: session.state()["shown"] == "baked")
        number = session.panel.number
        wait_for(lambda: session.panel.number > number)
    finally:
        # Another scene must not be made while the last frame of this one is drawn.
        session.running = False
        thread.join(60)
    assert not session.failure


def test_a_bake_that_cannot_begin_is_said_and_ends_nothing(tmp_path):
    (tmp_path / "out").write_text("a file")
    baker = partial(ChildBake.start, "cornell", tmp_path / "out", [])
    session = LiveSession("cornell", settings_of(SMALL), 24, baker=baker)
    session.command({"do": "move", "thing": 4, "x": 0.05})
    session.command({"do": "bake"})
    session.obey()
    session.frame()
    state = session.state()
    assert "start again with another -o" in state["bake"]["failed"] and not state["failure"] and not state["baked"]


@pytest.mark.parametrize("found", ["nothing", "a light map"])
def test_a_bake_that_cannot_be_shown_is_said_and_ends_nothing(tmp_path, found):
    if found == "a light map":
        shutil.copy(ROOT / "web/test/fixtures/lightmap.glb", tmp_path / "scene.glb")
    baker = Baker(tmp_path)
    session = LiveSession("cornell", settings_of(SMALL), 24, baker=baker)
    session.command({"do": "bake"})
    session.obey()
    baker.running = False
    thread = threading.Thread(target=session.loop, daemon=True)
    thread.start()
    try:
        wait_for(lambda: session.state()["bake"]["failed"])
        number = session.frames
        wait_for(lambda: session.frames > number)
    finally:
        session.running = False
        thread.join(60)
    assert "the bake cannot be shown: " in session.state()["bake"]["failed"]
    assert not session.failure and not session.state()["baked"]
    with pytest.raises(ValueError, match="nothing is baked yet"):
        session.command({"do": "show", "picture": "baked"})


def test_the_picture_of_a_frozen_cache_gets_better_after_a_change():
    session = LiveSession("cornell", settings_of(SMALL), 24)
    light = next(t["index"] for t in session.live.things if t["light"])
    session.command({"do": "freeze"})
    session.command({"do": "brighten", "thing": light, "factor": 0.5})
    session.obey()
    assert session.cache.schedule.eager
    for _ in range(12):
        session.frame()
    # Each frame adds a sample to a quarter of the pixels.
    assert session.pictures["cache"].spp == 3
    session.command({"do": "show", "picture": "difference"})
    session.obey()
    for _ in range(8):
        session.frame()
    assert session.pictures["cache"].spp == session.pictures["path"].spp == 2


def wait_for(holds, seconds=30):
    """Wait until something holds."""
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.05)


@pytest.mark.slow
def test_the_baked_light_is_seen_from_the_camera_of_the_page(tmp_path):
    # A checked field: radiance equal to a constant albedo times one, so that only what the camera sees matters.
    session = LiveSession("cornell", settings_of(SMALL), 32)
    for _ in range(4 * 24):
        session.frame()
    cached = np.array(session.pictures["cache"].image).reshape(32, 32, 3)
    bake(BakeSettings("cornell", tmp_path, shards=2, steps=300, budget=Budget(40.0), views=1))
    seen = baked_image(session.live, BakedLight.read(tmp_path / "scene.glb"), 32)
    # The left wall is red and the right wall green in both; one is not the mirror image of the other.
    for picture in (cached, seen):
        assert picture[16, 2, 0] > 2 * picture[16, 2, 1] and picture[16, 29, 1] > 2 * picture[16, 29, 0]
    assert np.corrcoef(cached.ravel(), seen.ravel())[0, 1] > 0.8


def test_a_sequence_resumes_and_refuses_another_plan(tmp_path):
    def run(degrees: float = 360.0, resume: bool = True, kind: str = "png", **more):
        options = {"frames": 3, "format": kind, "resume": resume}
        asked = RenderSettings("cornell", tmp_path, (16, 12), 1, integrator="nrc", options=options, **more)
        return render_sequence(asked, settings_of(SMALL), degrees)

    assert run(resume=False)["rendered"] == 3
    assert run()["rendered"] == 0
    assert run(limits=Limits(lights=5))["rendered"] == 0
    for other in ({"degrees": 90.0}, {"unit": 0.01}, {"kind": "exr"}, {"allow_paths": (tmp_path,)}):
        with pytest.raises(ValueError, match="another animation"):
            run(**other)
    # A frame depends on what those before it have learned, and what is left has learned from it: all are made again.
    (tmp_path / "frame-0002.png").unlink()
    assert run()["rendered"] == 3 and (tmp_path / "frame-0002.png").exists()


def test_a_sequence_of_another_state_of_the_file_is_not_resumed(tmp_path):
    scene, options = tmp_path / "room.glb", {"frames": 1, "resume": True}
    asked = RenderSettings(str(scene), tmp_path / "out", (8, 6), 1, integrator="nrc", options=options)
    write_plain(scene, load("cornell"))
    assert render_sequence(asked, settings_of(SMALL))["rendered"] == 1
    assert render_sequence(asked, settings_of(SMALL))["rendered"] == 0
    write_plain(scene, load("two-rooms"))
    with pytest.raises(ValueError, match="another animation"):
        render_sequence(asked, settings_of(SMALL))


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0.3, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0])
def test_an_interrupt_at_any_time_is_exit_code_130_and_quiet(delay):
    command = [sys.executable, "-m", "lightwell", "live", "cornell", "--no-open", "--size", "32"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    # From imports over the scene and the compilation of kernels to the first frames.
    time.sleep(delay)
    os.kill(process.pid, signal.SIGINT)
    _, err = process.communicate(timeout=30)
    # Before Python itself handles signals, the system ends it; shells call both 130.
    assert process.returncode in (130, -signal.SIGINT) and err == ""
