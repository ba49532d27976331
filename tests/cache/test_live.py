"""The live page: who may look, what is a command; the session itself on a small picture; sequences that resume."""

import http.client
import json
import threading
from collections import deque

import numpy as np
import pytest

from lightwell.cache import settings_of
from lightwell.cache.live import LiveSession
from lightwell.cache.live_server import open_live
from lightwell.cache.rendering import render_animation

SMALL = {"levels": 2, "entries_log2": 8, "batch": 512, "steps": 1, "train_fraction_max": 1.0, "max_vertices": 4}


class Stub:
    """A session that renders nothing."""

    def __init__(self):
        self.lock, self.pictures, self.orders = threading.Lock(), {"path": b"x"}, deque()

    def state(self):
        return {"frame": 1}

    def command(self, order):
        if order.get("do") != "orbit":
            raise ValueError("live: there is no command")
        self.orders.append(order)


@pytest.fixture
def page():
    server = open_live(Stub())
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield server
    server.shutdown()
    server.server_close()


def _ask(server, method, path, body=None, **headers):
    port = server.server_address[1]
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    connection.request(method, path, body, {"Host": f"127.0.0.1:{port}", **headers})
    answer = connection.getresponse()
    return answer.status, answer.read()


def test_the_page_and_its_frames_are_served(page):
    assert b"lightwell live" in _ask(page, "GET", "/")[1]
    assert json.loads(_ask(page, "GET", "/frame")[1])["pictures"] == {"path": "eA=="}
    assert _ask(page, "GET", "/etc/passwd")[0] == 404


def test_other_sites_neither_look_nor_act(page):
    assert _ask(page, "GET", "/frame", Host="evil.example")[0] == 403
    order = json.dumps({"do": "orbit", "x": 0.1})
    assert _ask(page, "POST", "/command", order, Origin="http://evil.example")[0] == 400
    assert _ask(page, "POST", "/command", order)[0] == 200 and len(page.session.orders) == 1


@pytest.mark.parametrize("body", ["", "[]", "{", '{"do": "format"}', "x" * 5000])
def test_what_is_no_command_is_refused(page, body):
    assert _ask(page, "POST", "/command", body)[0] == 400


def test_a_session_renders_obeys_and_goes_on():
    session = LiveSession("cornell", settings_of(SMALL), 24)
    session.frame()
    session.frame()
    assert set(session.pictures) == {"cache-image", "path", "cache", "error"} and session.still == 1
    light = next(t["index"] for t in session.live.things if t["light"])
    with pytest.raises(ValueError, match="no such thing"):
        session.command({"do": "move", "thing": 999})
    with pytest.raises(ValueError, match="a number that is none"):
        session.command({"do": "orbit", "x": float("nan")})
    before = session.live.position.copy()
    session.command({"do": "orbit", "x": 0.3, "y": 0.1, "z": 0.1})
    session.command({"do": "move", "thing": light, "x": 0.05})
    session.command({"do": "brighten", "thing": light, "factor": 0.5})
    session._obey()
    assert not np.allclose(before, session.live.position) and session.still == 0 and session.cache.changes == 2
    session.frame()
    json.dumps(session.state(), allow_nan=False)


def test_a_sequence_resumes_and_refuses_another_plan(tmp_path):
    run = lambda **more: render_animation(  # noqa: E731
        "cornell", tmp_path, settings_of(SMALL), 16, 12, 1, 3, kind="png", quiet=True, **more
    )
    assert run()["rendered"] == 3
    (tmp_path / "frame-0002.png").unlink()
    assert run(resume=True)["rendered"] == 1 and (tmp_path / "frame-0002.png").exists()
    with pytest.raises(ValueError, match="another animation"):
        run(resume=True, degrees=90.0)
