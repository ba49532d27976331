"""The live page: who may look, what is a command; the session itself on a small picture; sequences that resume."""

import http.client
import json
import os
import signal
import subprocess
import sys
import time
from collections import deque

import numpy as np
import pytest

from lightwell.cache import settings_of
from lightwell.cache.live import LiveSession
from lightwell.cache.live_commands import parse_command
from lightwell.cache.live_server import open_live
from lightwell.limits import Limits
from lightwell.rendering.sequence import render_sequence
from lightwell.rendering.settings import RenderSettings

SMALL = {"levels": 2, "entries_log2": 8, "batch": 512, "steps": 1, "train_fraction_max": 1.0, "max_vertices": 4}


class Stub:
    """A session that renders nothing."""

    def __init__(self):
        self.panels, self.orders = self, deque()

    def state(self):
        return {"frame": 1}

    def jpegs(self):
        return {"path": b"x"}

    def command(self, order):
        self.orders.append(parse_command(order, (-1, 4)))


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
    assert json.loads(_ask(page, "GET", "/frame")[1])["pictures"] == {"path": "eA=="}
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
    ):  # fmt: skip
        assert parse_command(json.dumps(order).encode(), (-1, 4)).do == order["do"]


def test_a_session_renders_obeys_and_goes_on():
    session = LiveSession("cornell", settings_of(SMALL), 24)
    session.frame()
    session.frame()
    assert set(session.panels.jpegs()) == {"cache-image", "path", "cache", "error"} and session.panels.still == 1
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
        and session.panels.still == 0
        and session.cache.changes == 2
    )
    session.frame()
    json.dumps(session.state(), allow_nan=False)


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
