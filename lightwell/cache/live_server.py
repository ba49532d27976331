"""The page of the live session, served on this machine only."""

from __future__ import annotations

import base64
import http.server
import json
import threading
import webbrowser
from pathlib import Path
from typing import Any

from lightwell.cache.live import LiveSession
from lightwell.cache.settings import CacheSettings

LOOPBACK = "127.0.0.1"
# Bytes of a command at most.
MOST_BYTES = 4096
PAGE = Path(__file__).with_name("live.html")


class _Handler(http.server.BaseHTTPRequestHandler):
    """GET / the page, GET /frame pictures and numbers, POST /command."""

    server: Any
    protocol_version = "HTTP/1.1"

    def log_message(self, *args: Any) -> None:
        """Silent: the page asks many times a second."""

    def _is_local(self) -> bool:
        """Another site that resolves to this machine must neither look nor act."""
        host = (self.headers.get("Host") or "").rsplit(":", 1)[0]
        origin = self.headers.get("Origin")
        port = self.server.server_address[1]
        return host in (LOOPBACK, "localhost") and origin in (
            None, f"http://{LOOPBACK}:{port}", f"http://localhost:{port}",
        )  # fmt: skip

    def _answer(self, code: int, kind: str, body: bytes) -> None:
        try:
            self.send_response(code)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
            self.send_header("Cache-Control", "no-store")
            self.end_headers()
            self.wfile.write(body)
        except (BrokenPipeError, ConnectionResetError):
            self.close_connection = True  # The page was closed meanwhile.

    def do_GET(self) -> None:
        """The page or the newest frame."""
        session: LiveSession = self.server.session
        if not self._is_local():
            self._answer(403, "text/plain", b"this page is for this machine only")
        elif self.path == "/":
            self._answer(200, "text/html; charset=utf-8", PAGE.read_bytes())
        elif self.path.startswith("/frame"):
            with session.lock:
                pictures = {k: base64.b64encode(v).decode() for k, v in session.pictures.items()}
            body = json.dumps(session.state() | {"pictures": pictures}, allow_nan=False).encode()
            self._answer(200, "application/json", body)
        else:
            self._answer(404, "text/plain", b"there is nothing here")

    def do_POST(self) -> None:
        """A command as JSON."""
        try:
            length = int(self.headers.get("Content-Length") or 0)
            if not self._is_local() or self.path != "/command" or not 0 < length <= MOST_BYTES:
                raise ValueError("live: not a command of this page")
            order = json.loads(self.rfile.read(length))
            if not isinstance(order, dict):
                raise ValueError("live: a command is an object")
            self.server.session.command(order)
        except (ValueError, TypeError) as error:
            self.close_connection = True
            self._answer(400, "text/plain", str(error).encode()[:200])
            return
        self._answer(200, "application/json", b"{}")


def open_live(session: LiveSession, port: int = 0) -> http.server.ThreadingHTTPServer:
    """A server for the session on 127.0.0.1; port 0 takes any free one."""
    try:
        server = http.server.ThreadingHTTPServer((LOOPBACK, port), _Handler)
    except OSError as error:
        raise ValueError(
            f"live: port {port} cannot be opened ({error.strerror}); choose another with --port"
        ) from error
    server.daemon_threads = True
    server.session = session  # type: ignore[attr-defined]
    return server


def live(
    source: str, settings: CacheSettings, size: int = 256, port: int = 0, browser: bool = True, **options: Any
) -> None:
    """Serve the page until interrupted. ``options`` are those of ``lightwell.scenes.load``."""
    session = LiveSession(source, settings, size, **options)
    server = open_live(session, port)
    url = f"http://{LOOPBACK}:{server.server_address[1]}/"
    print(f"{url}  (Ctrl-C ends)", flush=True)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    if browser:
        webbrowser.open(url)
    try:
        session.loop()
        if session.failure:
            raise RuntimeError(f"live: {session.failure}")
    except KeyboardInterrupt:
        pass
    finally:
        session.running = False
        server.shutdown()
        server.server_close()
