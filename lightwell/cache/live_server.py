"""HTTP server of the live session, on the loopback interface only."""

from __future__ import annotations

import base64
import json
import threading
import webbrowser
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from lightwell.cache.live import LiveSession
from lightwell.cache.live_bake import ChildBake
from lightwell.cache.settings import CacheSettings
from lightwell.core.scene_edits import SceneEdits
from lightwell.serving.folder import files_of
from lightwell.serving.server import Answer, Application, LocalServer, Request

PAGE = Path(__file__).with_name("live.html")


def open_live(session: LiveSession, port: int = 0) -> LocalServer:
    """Serve the page of a session on 127.0.0.1; the server raises ``ValueError`` when the port is not free.

    Args:
        session: Session to show.
        port: Port; 0: any free one.

    Returns:
        Running server, a context manager.
    """
    return LocalServer(page_of(session), port, "live")


def page_of(session: LiveSession) -> Application:
    """Make the web application of a session: GET / is the page, GET /frame the picture and numbers, POST /command,
    GET /baked/… what a bake of the session has written.

    Args:
        session: Session to show.

    Returns:
        Function from requests to answers.
    """

    frames = _Frames(session)

    def answer(request: Request) -> Answer:
        if request.path.startswith("/baked/") and session.bake is not None:
            return files_of(session.bake.out)(replace(request, path=request.path.removeprefix("/baked")))
        known = {"/": "GET, HEAD", "/frame": "GET, HEAD", "/command": "POST"}.get(request.path)
        if known is None:
            return Answer.of(404, b"there is nothing here")
        if request.method not in known.split(", "):
            return Answer(405, headers=(("Allow", known),))
        if request.path == "/":
            return Answer.page(PAGE.read_bytes())
        if request.path == "/frame":
            return frames.answer()
        try:
            session.command(request.body)
        except ValueError as error:
            return Answer.of(400, str(error).encode())
        return Answer.of(200, b"{}", "application/json")

    return answer


class _Frames:
    """Answers of /frame, each encoded once however often it is asked for: encoding takes time from rendering."""

    def __init__(self, session: LiveSession) -> None:
        self._session, self._lock = session, threading.Lock()
        self._state: dict[str, Any] = {}
        self._body = b""

    def answer(self) -> Answer:
        """The newest picture and numbers."""
        with self._lock:
            state = self._session.state()
            if state != self._state:
                image = base64.b64encode(self._session.panel.jpeg()).decode()
                self._body = json.dumps(state | {"image": image}, allow_nan=False).encode()
                self._state = state
            return Answer.of(200, self._body, "application/json")


def live(
    source: str,
    settings: CacheSettings,
    size: int = 512,
    port: int = 0,
    browser: bool = True,
    cache_from: Path | None = None,
    baker: Callable[[SceneEdits, str], ChildBake] | None = None,
    **options: Any,
) -> None:
    """Serve the live page until interrupted.

    Ctrl-C raises ``KeyboardInterrupt``, an unusable scene or port ``ValueError``, a failed session ``RuntimeError``.

    The session runs in a thread of its own, so that Ctrl-C does not interrupt native code. After Ctrl-C that thread is
    still active: end the process with ``os._exit``, as the command line does.

    Args:
        source: Scene file or name of a built-in scene.
        settings: Settings of the cache.
        size: Edge of the square image, pixels.
        port: Port; 0: any free one.
        browser: Whether to open the page in the default browser.
        cache_from: ``scene.glb`` of a bake of the scene, from which the cache starts; None: untrained.
        baker: Starts a bake of the scene with edits, at a quality; None: the page has no such button.
        **options: Options of ``lightwell.scenes.load``.
    """
    failures: list[Exception] = []

    def work() -> None:
        try:
            session = LiveSession(source, settings, size, cache_from, baker, **options)
            with open_live(session, port) as server:
                print(f"{server.url}  (Ctrl-C ends)", flush=True)
                if browser:
                    webbrowser.open(server.url)
                session.loop()
            if session.failure:
                raise RuntimeError(f"live: {session.failure}")
        except Exception as error:
            failures.append(error)

    worker = threading.Thread(target=work, name="live", daemon=True)
    worker.start()
    while worker.is_alive():
        # In steps: a wait without a timeout cannot be interrupted on Windows.
        worker.join(1)
    _raise_first(failures)


def _raise_first(failures: list[Exception]) -> None:
    if failures:
        raise failures[0]
