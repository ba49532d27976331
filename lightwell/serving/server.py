"""HTTP server on the loopback interface, for the pages of ``view`` and ``live``.

Waitress handles HTTP: it keeps all connections in one thread, parses requests strictly and runs the application in a
fixed number of threads. This module adds a time limit for requests, a limit on connections, a check of the request's
origin, and the security headers of every answer.
"""

from __future__ import annotations

import base64
import contextlib
import gzip
import hashlib
import io
import logging
import re
import select
import socket
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Any, BinaryIO

from waitress import wasyncore
from waitress.channel import HTTPChannel
from waitress.server import TcpWSGIServer

LOOPBACK = "127.0.0.1"
# Threads that answer; seconds in which a request must arrive, and after which an idle connection is closed.
THREADS, SECONDS = 4, 10
# Connections at once; further ones get 503. Fewer than the 1,024 files that Linux lets a process open, and than the 512
# sockets that Windows, which has no poll, can wait for.
MOST_CLIENTS = 800 if hasattr(select, "poll") else 400
# Connections that may wait to be accepted.
BACKLOG = 1024
# Bytes of a request's headers and of its body.
MOST_HEADERS, MOST_BODY = 16384, 4096
# Bytes of a body that is compressed.
LEAST_GZIP, MOST_GZIP = 1024, 1 << 25
GZIP_LEVEL = 5
BUSY = b"HTTP/1.1 503 Service Unavailable\r\nConnection: close\r\nRetry-After: 10\r\nContent-Length: 0\r\n\r\n"

# Inline scripts of a page; the policy lists their hashes, so that no other inline script runs. A script that a page
# carries compressed and runs later says its hash itself.
SCRIPT = re.compile(rb"<script\b([^>]*)>(.*?)</script", re.DOTALL | re.IGNORECASE)
UNPACKED = re.compile(rb'\sdata-sha256="([A-Za-z0-9+/]{43}=)"')
POLICY = (
    "default-src 'self'; script-src 'self' 'wasm-unsafe-eval'{hashes}; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data: blob:; connect-src 'self' data: blob:; font-src 'self' data:; worker-src 'self' blob:; "
    "object-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS = (
    ("Cache-Control", "no-store"),
    ("Cross-Origin-Opener-Policy", "same-origin"),
    ("Cross-Origin-Resource-Policy", "same-origin"),
    ("Referrer-Policy", "no-referrer"),
    ("X-Content-Type-Options", "nosniff"),
    ("X-Frame-Options", "DENY"),
)


@dataclass(frozen=True)
class Request:
    """A request, as an application receives it."""

    method: str
    path: str
    """Decoded; begins with a slash."""
    body: bytes
    byte_range: str
    """The header Range, or nothing."""


@dataclass(frozen=True)
class Answer:
    """An application's answer to a request."""

    status: int
    kind: str = "text/plain; charset=utf-8"
    """MIME type."""
    body: BinaryIO = field(default_factory=io.BytesIO)
    """Read from its current position."""
    length: int = 0
    """Bytes of the body."""
    headers: tuple[tuple[str, str], ...] = ()

    @classmethod
    def of(cls, status: int, data: bytes, kind: str = "text/plain; charset=utf-8") -> Answer:
        """Make an answer with a body in memory.

        Args:
            status: HTTP status code.
            data: The body.
            kind: MIME type.

        Returns:
            The answer.
        """
        return cls(status, kind, io.BytesIO(data), len(data))

    @classmethod
    def page(cls, data: bytes) -> Answer:
        """Make an answer with an HTML page whose content security policy allows only the page's own inline scripts.

        Args:
            data: The page, UTF-8.

        Returns:
            The answer, with status 200.
        """
        hashes = set()
        for attributes, script in SCRIPT.findall(data):
            said = UNPACKED.search(attributes)
            found = hashlib.sha256(script.replace(b"\r\n", b"\n")).digest()
            hashes.add((said[1] if said else base64.b64encode(found)).decode())
        named = "".join(f" 'sha256-{h}'" for h in sorted(hashes))
        policy = (("Content-Security-Policy", POLICY.format(hashes=named)),)
        return cls(200, "text/html; charset=utf-8", io.BytesIO(data), len(data), policy)


Application = Callable[[Request], Answer]


class LocalServer:
    """Runs an application on 127.0.0.1; use as a context manager. It answers requests as soon as it is made.

    Args:
        application: Answers requests; called from several threads.
        port: Port, 0 to 65535; 0 for any free one.
        verb: The verb of the command line, for messages.

    Raises:
        ValueError: The port cannot be opened.
    """

    def __init__(self, application: Application, port: int, verb: str) -> None:
        if not 0 <= port < 1 << 16:
            raise ValueError(f"{verb}: port {port} cannot be opened; choose one from 0 to 65535 with --port")
        # Waitress logs malformed requests and closed connections; neither concerns the user.
        logging.getLogger("waitress").addHandler(logging.NullHandler())
        logging.getLogger("waitress").propagate = False
        # Waitress's table of open connections, by number.
        self._sockets: dict[int, Any] = {}
        try:
            self._server = _Server(
                _Gate(application, self), map=self._sockets, host=LOOPBACK, port=port, threads=THREADS,
                channel_timeout=SECONDS, cleanup_interval=1, connection_limit=2 * MOST_CLIENTS, backlog=BACKLOG,
                ident=None, max_request_header_size=MOST_HEADERS, max_request_body_size=MOST_BODY,
                asyncore_use_poll=hasattr(select, "poll"), log_socket_errors=False,
            )  # fmt: skip
        except OSError as error:
            reason = error.strerror or str(error)
            raise ValueError(f"{verb}: port {port} cannot be opened ({reason}); choose another with --port") from error
        self.port = int(self._server.effective_port)
        self.url = f"http://{LOOPBACK}:{self.port}/"
        self._thread = threading.Thread(target=self._server.run, name="server", daemon=True)
        self._thread.start()

    def __enter__(self) -> LocalServer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close all connections and end the threads."""
        # In the server's own thread, which ends when no connection is left. Where a request wakes it first,
        # everything is closed already, the trigger included.
        with contextlib.suppress(OSError):
            self._server.trigger.pull_trigger(lambda: wasyncore.close_all(self._sockets, ignore_all=True))
        self._thread.join(SECONDS)
        self._server.task_dispatcher.shutdown(timeout=1)


class _Channel(HTTPChannel):
    """A connection whose request must be complete within the time limit, also when it arrives slowly byte by byte."""

    _began = 0.0
    last_activity: float

    def received(self, data: bytes) -> Any:
        answer = super().received(data)
        if self.request is None:
            self._began = 0.0
        else:
            self._began = self._began or self.last_activity
            self.last_activity = self._began
        return answer


class _Server(TcpWSGIServer):
    """Waitress with a limit on the number of connections."""

    channel_class = _Channel

    def handle_accept(self) -> None:
        """Accept all waiting connections at once, because Waitress polls every connection between two calls."""
        try:
            for _ in range(BACKLOG):
                accepted = self.accept()
                if accepted is None:
                    return
                client, address = accepted
                if len(self.active_channels) < MOST_CLIENTS:
                    self.set_socket_options(client)
                    self.channel_class(self, client, self.fix_addr(address), self.adj, map=self._map)
                else:
                    _refuse(client)
        except OSError:
            pass  # the client has left, or no file is free

    def maintenance(self, now: float) -> None:
        """Close connections that were idle for too long, and those whose answer the client does not read."""
        for channel in self.active_channels.values():
            if channel.last_activity < now - SECONDS:
                channel.will_close = True


def _refuse(client: socket.socket) -> None:
    """Tell a client that there are too many connections."""
    with client, contextlib.suppress(OSError):
        client.setblocking(False)
        client.send(BUSY)
        client.shutdown(socket.SHUT_WR)


class _Gate:
    """The WSGI application around an ``Application``: checks the origin of requests and adds the headers of answers."""

    def __init__(self, application: Application, server: LocalServer) -> None:
        self._application, self._server = application, server

    def __call__(self, environ: Mapping[str, Any], start: Callable[..., Any]) -> Iterable[bytes]:
        answer = self._answer(environ)
        headers = [*HEADERS, *answer.headers]
        if not any(name == "Content-Security-Policy" for name, _ in headers):
            headers.append(("Content-Security-Policy", "default-src 'none'; frame-ancestors 'none'; sandbox"))
        body, length = answer.body, answer.length
        if _is_text(answer.kind) and answer.status == 200 and LEAST_GZIP <= length <= MOST_GZIP:
            headers.append(("Vary", "Accept-Encoding"))
            if _takes_gzip(environ.get("HTTP_ACCEPT_ENCODING", "")):
                packed = gzip.compress(body.read(length), GZIP_LEVEL, mtime=0)
                body.close()
                body, length = io.BytesIO(packed), len(packed)
                headers.append(("Content-Encoding", "gzip"))
        headers += [("Content-Type", answer.kind), ("Content-Length", str(length))]
        start(f"{answer.status} {HTTPStatus(answer.status).phrase}", headers)
        if environ["REQUEST_METHOD"] == "HEAD" or not length:
            body.close()
            return []
        return environ["wsgi.file_wrapper"](body)

    def _answer(self, environ: Mapping[str, Any]) -> Answer:
        if not self._may_ask(environ):
            return Answer.of(403, b"this page is for this machine only")
        try:
            path = environ["PATH_INFO"].encode("latin-1").decode()
        except UnicodeError:
            return Answer.of(404, b"there is nothing here")
        body = environ["wsgi.input"].read(MOST_BODY)
        # A range of a file that may have changed since is not what was asked for.
        asked = "" if "HTTP_IF_RANGE" in environ else environ.get("HTTP_RANGE", "")
        try:
            return self._application(Request(environ["REQUEST_METHOD"], path, body, asked))
        except Exception as error:
            return Answer.of(500, f"the request failed ({type(error).__name__})".encode())

    def _may_ask(self, environ: Mapping[str, Any]) -> bool:
        """Whether the request comes from the served page, not from another site that names or links to this machine."""
        names = {f"{host}:{self._server.port}" for host in (LOOPBACK, "localhost")}
        origins = {f"http://{name}" for name in names}
        if self._server.port == 80:
            names |= {LOOPBACK, "localhost"}
            origins |= {f"http://{LOOPBACK}", "http://localhost"}
        return environ.get("HTTP_HOST") in names and environ.get("HTTP_ORIGIN") in {None, *origins}


def _is_text(kind: str) -> bool:
    return kind.startswith("text/") or kind.split(";")[0] in ("application/json", "image/svg+xml")


def _takes_gzip(accepted: str) -> bool:
    """Whether a header Accept-Encoding allows gzip."""
    for part in accepted.lower().split(","):
        name, _, weight = part.partition(";")
        if name.strip() in ("gzip", "*"):
            return weight.replace(" ", "") not in ("q=0", "q=0.0", "q=0.00", "q=0.000")
    return False


def wait_for_interrupt() -> None:
    """Wait until Ctrl-C, which raises ``KeyboardInterrupt``."""
    while True:
        # Short: a signal that arrives just before the system call does not end that sleep.
        time.sleep(0.5)
