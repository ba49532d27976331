"""Frames per second of the live page, end to end over HTTP: a client asks as the page does, rests, then orbits."""

from __future__ import annotations

import http.client
import json
import subprocess
import sys
import time
from typing import Any

# Seconds of each measurement; frames after which kernels are compiled and the cache is no longer cold.
SECONDS, WARM_FRAMES, PATIENCE = 6.0, 16, 240.0


def ask(port: int, order: dict[str, Any] | None = None) -> dict[str, Any]:
    """The newest frame, or the answer to a command."""
    link = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    try:
        if order is None:
            link.request("GET", "/frame")
        else:
            link.request("POST", "/command", json.dumps(order))
        answer = link.getresponse()
        body = answer.read()
        if answer.status != 200:
            raise RuntimeError(f"live: {answer.status} {body[:200]!r}")
        return json.loads(body)
    finally:
        link.close()


def rate(port: int, seconds: float, orbits: bool) -> dict[str, float]:
    """Different frames that reached the client, per second, and what the session says of its stages."""
    first = ask(port)
    seen, start = {first["frame"]}, time.perf_counter()
    state = first
    while time.perf_counter() - start < seconds:
        if orbits:
            ask(port, {"do": "orbit", "x": 0.02, "y": 0.0, "z": 0.0})
        state = ask(port)
        if state["failure"]:
            raise RuntimeError(f"live: {state['failure']}")
        seen.add(state["frame"])
        time.sleep(0.01)
    return {"fps": (len(seen) - 1) / (time.perf_counter() - start), **state["milliseconds"]}


def measure(source: str, size: int, seconds: float = SECONDS, warm: int = WARM_FRAMES) -> dict[str, Any]:
    """Start ``lightwell live`` and measure it at rest and while the camera turns."""
    words = [sys.executable, "-m", "lightwell.cli", "live", source, "--no-open", "--size", str(size)]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    try:
        line = process.stdout.readline() if process.stdout else ""
        port = int(line.split("127.0.0.1:")[1].split("/")[0])
        start = time.perf_counter()
        while (state := ask(port))["frame"] < warm:
            if state["failure"] or time.perf_counter() - start > PATIENCE:
                raise RuntimeError(f"live: {state['failure'] or 'no frames'}")
            time.sleep(0.1)
        rate(port, seconds, True)  # the first turn is recorded once
        return {"rest": rate(port, seconds, False), "orbit": rate(port, seconds, True),
                "pictures": sorted(state["pictures"])}  # fmt: skip
    finally:
        # Not SIGINT: whoever starts this in the background has it ignored.
        process.terminate()
        process.wait(timeout=60)
