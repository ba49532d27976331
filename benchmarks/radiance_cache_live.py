"""The live page: pictures per second, end to end over HTTP, and quality against the time since the camera stopped.

A client asks for pictures as the page does, rests, then turns the camera. Quality is measured in a session of its own:
the camera turns for a while and stops; every picture that the page would show from then on is compared with a
path-traced reference of that camera, as displayed values, at the exposure of the page. The reference is denoised: its
own noise would be most of what is measured.
"""

from __future__ import annotations

import http.client
import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from radiance_cache_truth import path_tracer

from lightwell.backend import mi
from lightwell.cache import settings_of
from lightwell.cache.live import LiveSession
from lightwell.cache.views import guides
from lightwell.core.color import display
from lightwell.core.denoise import denoise

# Seconds of each measurement; frames after which kernels are compiled and the cache is no longer cold.
SECONDS, WARM_FRAMES, PATIENCE = 6.0, 24, 240.0
# Seconds between two questions of the page.
POLL = 0.025
# A turn of the camera per frame, radians; frames that it turns; seconds after it has stopped that are measured.
TURN, TURNS, WATCHED = 0.01, 40, 6.0
# Samples per pixel of the reference, and of one launch of it.
REFERENCE, CHUNK = 512, 64
# The bar is at so many seconds of standing still.
AT = 2.0


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
    """Different pictures (at rest: frames) that reached the client, per second, and the times of their stages."""
    key = "picture" if orbits else "frame"
    state = ask(port)
    first, seen, start = state[key], {state[key]}, time.perf_counter()
    while time.perf_counter() - start < seconds:
        if orbits:
            ask(port, {"do": "orbit", "x": TURN, "y": 0.0, "z": 0.0})
        state = ask(port)
        if state["failure"]:
            raise RuntimeError(f"live: {state['failure']}")
        seen.add(state[key])
        time.sleep(POLL)
    passed = time.perf_counter() - start
    # At rest frames are traced that are not shown: all count.
    count = len(seen) - 1 if orbits else state[key] - first
    return {"fps": count / passed, **state["milliseconds"]}


def rates(source: str, size: int, seconds: float = SECONDS, warm: int = WARM_FRAMES) -> dict[str, Any]:
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
        return {"rest": rate(port, seconds, False), "orbit": rate(port, seconds, True)}
    finally:
        # Not SIGINT: whoever starts this in the background has it ignored.
        process.terminate()
        process.wait(timeout=60)


def quality(source: str, size: int, spp: int = REFERENCE, turns: int = TURNS, watched: float = WATCHED) -> list[Any]:
    """[seconds since the camera stopped, dB] of each new picture."""
    session = LiveSession(source, settings_of({}), size)
    for _ in range(WARM_FRAMES):
        session.frame()
    for _ in range(turns):
        session.command({"do": "orbit", "x": TURN})
        session.obey()
        session.frame()
    start, shown, number = time.perf_counter(), [], session.panel.number
    while time.perf_counter() - start < watched:
        session.frame()
        if session.panel.number > number:
            number = session.panel.number
            # Kept as they are on the device: a copy would take time from the session.
            shown.append((time.perf_counter() - start, session.pictures["cache"].image))
    truth, scene, sensor = np.zeros((size, size, 3)), session.live.scene, session.live.sensor
    for k in range(max(spp // CHUNK, 1)):
        part = mi.render(scene, sensor=sensor, integrator=path_tracer(), spp=min(CHUNK, spp), seed=1000 + k)
        truth += np.array(part)[..., :3]
    guided = denoise(truth / max(spp // CHUNK, 1), *guides(scene, sensor, session.cache, 0))
    wanted = display(guided * session.panel.exposure)
    curve = []
    for seconds, image in shown:
        found = display(np.array(image).reshape(size, size, 3) * session.panel.exposure)
        curve.append([round(seconds, 3), round(float(-10 * np.log10(np.mean((found - wanted) ** 2))), 2)])
    return curve


def at(curve: list[Any], seconds: float = AT) -> float:
    """dB of the picture that the page shows at a time."""
    return float(
        max((entry for entry in curve if entry[0] <= seconds), key=lambda entry: entry[0], default=[0, 0.0])[1]
    )


def measure(source: str, size: int, quick: bool = False) -> dict[str, Any]:
    """Rates and quality of a scene."""
    if quick:
        return {**rates(source, 32, 0.5, 2), "curve": quality(source, 32, CHUNK, 2, 0.5)}
    return {**rates(source, size), "curve": quality(source, size)}


COLOURS = ("#2f6690", "#e08a3c", "#5a9e6f", "#8b5fbf")


def plot(found: dict[str, dict[str, Any]], path: Path) -> None:
    """Quality against time as lines, drawn at twice the size and reduced."""
    from PIL import Image, ImageDraw, ImageFont

    curves = {name: f["curve"] for name, f in found.items()}
    values = [db for curve in curves.values() for _, db in curve]
    low, high = np.floor(min(values) / 5) * 5, np.ceil(max(values) / 5) * 5
    width, height, left, right, top, bottom = 1600, 900, 130, 60, 90, 110
    image = Image.new("RGB", (width, height), "white")
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(28)
    x = lambda t: left + t / WATCHED * (width - left - right)  # noqa: E731
    y = lambda db: height - bottom - (db - low) / (high - low) * (height - top - bottom)  # noqa: E731
    for db in np.arange(low, high + 1, 5):
        draw.line((left, y(db), width - right, y(db)), "#dddddd", 2)
        draw.text((left - 16, y(db)), f"{db:g}", "#444444", font, anchor="rm")
    for second in range(int(WATCHED) + 1):
        draw.line((x(second), top, x(second), height - bottom), "#eeeeee", 2)
        draw.text((x(second), height - bottom + 26), f"{second}", "#444444", font, anchor="mm")
    draw.text((left, 40), "dB to the path-traced picture", "black", font, anchor="lm")
    draw.text((width - right, height - 30), "seconds since the camera stopped", "black", font, anchor="rm")
    begin = left + 470
    for k, (name, curve) in enumerate(curves.items()):
        color = COLOURS[k % len(COLOURS)]
        points = [(x(t), y(db)) for t, db in curve]
        draw.line(points, color, 5, joint="curve")
        draw.rectangle((begin, 26, begin + 26, 52), color)
        draw.text((begin + 38, 40), name, "black", font, anchor="lm")
        begin += 70 + int(draw.textlength(name, font))
    path.parent.mkdir(parents=True, exist_ok=True)
    image.resize((width // 2, height // 2), Image.Resampling.LANCZOS).save(path, optimize=True)
