"""The page of the live session, served on this machine only."""

from __future__ import annotations

import base64
import json
import threading
import webbrowser
from pathlib import Path
from typing import Any

from lightwell.cache.live import LiveSession
from lightwell.cache.settings import CacheSettings
from lightwell.local_server import Answer, Application, LocalServer, Request

PAGE = Path(__file__).with_name("live.html")


def open_live(session: LiveSession, port: int = 0) -> LocalServer:
    """Serve the page of a session on 127.0.0.1; port 0 takes any free one.

    Raises:
        ValueError: The port cannot be opened.
    """
    return LocalServer(page_of(session), port, "live")


def page_of(session: LiveSession) -> Application:
    """The application of a session: GET / the page, GET /frame pictures and numbers, POST /command."""

    def answer(request: Request) -> Answer:
        known = {"/": "GET, HEAD", "/frame": "GET, HEAD", "/command": "POST"}.get(request.path)
        if known is None:
            return Answer.of(404, b"there is nothing here")
        if request.method not in known.split(", "):
            return Answer(405, headers=(("Allow", known),))
        if request.path == "/":
            return Answer.page(PAGE.read_bytes())
        if request.path == "/frame":
            return _frame(session)
        try:
            session.command(request.body)
        except ValueError as error:
            return Answer.of(400, str(error).encode())
        return Answer.of(200, b"{}", "application/json")

    return answer


def _frame(session: LiveSession) -> Answer:
    with session.lock:
        pictures = {name: base64.b64encode(data).decode() for name, data in session.pictures.items()}
    body = json.dumps(session.state() | {"pictures": pictures}, allow_nan=False).encode()
    return Answer.of(200, body, "application/json")


def live(
    source: str, settings: CacheSettings, size: int = 256, port: int = 0, browser: bool = True, **options: Any
) -> None:
    """Serve the page until interrupted. ``options`` are those of ``lightwell.scenes.load``.

    The session works in a thread of its own, so that Ctrl-C never lands in native code. After Ctrl-C that thread is
    still at work: end the process with ``os._exit``, as the command line does.

    Raises:
        KeyboardInterrupt: The user pressed Ctrl-C.
        ValueError: The scene cannot be used, or the port cannot be opened.
        RuntimeError: The session has failed.
    """
    failures: list[Exception] = []

    def work() -> None:
        try:
            session = LiveSession(source, settings, size, **options)
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
        # In steps: a wait without an end cannot be interrupted on Windows.
        worker.join(1)
    if failures:
        raise failures[0]
