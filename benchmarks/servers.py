"""The server of `view` under load: an honest request beside 500 half-open connections.

python benchmarks/servers.py            rows of results/reliability.json
python benchmarks/servers.py --quick    prints them only
"""

from __future__ import annotations

import argparse
import http.client
import socket
import tempfile
import threading
import time
from pathlib import Path

from rows import Row, at_most, publish

from lightwell.serving.folder import open_server
from lightwell.serving.server import THREADS

CLIENTS, REQUESTS = 500, 200
PAGE_BYTES = 1 << 20
# One thread for connections, those that answer.
MOST_THREADS = 1 + THREADS


def half_open_rows(clients: int, requests: int) -> list[Row]:
    """Measure the slowest of ``requests`` honest requests for a page of 1 MB, and the threads of the server.

    A third of the ``clients`` sends nothing, a third half a request line, a third half the headers.
    """
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "index.html").write_text("<p>" + "page " * (PAGE_BYTES // 5))
        before = threading.active_count()
        with open_server(Path(folder)) as server:
            opened = []
            for number in range(clients):
                client = socket.create_connection(("127.0.0.1", server.port))
                client.sendall((b"", b"GET / HT", b"GET / HTTP/1.1\r\nHost: ")[number % 3])
                opened.append(client)
            times, threads = [], 0
            for _ in range(requests):
                times.append(_request(server.port))
                threads = max(threads, threading.active_count() - before)
            for client in opened:
                client.close()
    times.sort()
    note = f"{clients} half-open connections, {requests} requests, median {1e3 * times[len(times) // 2]:.1f} ms"
    return [
        at_most("slowest honest request beside half-open connections", 0.1, times[-1], "s", note),
        at_most("threads of the server meanwhile", MOST_THREADS, threads, "threads", f"{clients} connections"),
    ]


def _request(port: int) -> float:
    """Seconds of one request on a new connection."""
    start = time.perf_counter()
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30)
    connection.request("GET", "/")
    answer = connection.getresponse()
    body = answer.read()
    seconds = time.perf_counter() - start
    connection.close()
    if answer.status != 200 or len(body) < PAGE_BYTES // 2:
        raise RuntimeError(f"servers: the request was answered with {answer.status} and {len(body)} bytes")
    return seconds


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="few connections and requests; print, write nothing")
    quick = parser.parse_args().quick
    publish("reliability", half_open_rows(20, 5) if quick else half_open_rows(CLIENTS, REQUESTS), quick)


if __name__ == "__main__":
    main()
