"""Times, pictures and sources that the parts of the lens benchmark share."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from lightwell.lens.splat import Sources

PICTURES = Path(__file__).resolve().parents[1] / "docs" / "images"


def median_seconds(run, rounds: int) -> float:
    """Median wall time after one warm-up."""
    run()
    times = []
    for _ in range(rounds):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return float(np.median(times))


def turn_about(ours, theirs, rounds: int, each: int = 3) -> tuple[float, float]:
    """Median wall times of two runs that take turns, after one warm-up: ours ``each`` times, then theirs once."""
    ours(), theirs()
    times = ([], [])
    for _ in range(rounds):
        for kept, run, count in ((times[0], ours, each), (times[1], theirs, 1)):
            for _ in range(count):
                start = time.perf_counter()
                run()
                kept.append(time.perf_counter() - start)
    return float(np.median(times[0])), float(np.median(times[1]))


def processor_seconds(run, rounds: int) -> float:
    """Least processor time of all threads: what the work costs when others use the machine too."""
    times = []
    for _ in range(rounds):
        start = time.process_time()
        run()
        times.append(time.process_time() - start)
    return min(times)


def clipped_psnr(a: np.ndarray, b: np.ndarray) -> float:
    """Decibels of two pictures clipped to [0, 1], RGB."""
    error = np.mean((np.clip(a[..., :3], 0, 1).astype(float) - np.clip(b[..., :3], 0, 1)) ** 2)
    return float(-10 * np.log10(max(error, 1e-20)))


def all_pixels(rgba: np.ndarray, record: np.ndarray) -> Sources:
    """Every pixel as a source."""
    y, x = (v.ravel().astype(np.int32) for v in np.mgrid[: rgba.shape[0], : rgba.shape[1]])
    ones = np.ones(x.size, np.float32)
    return Sources(x, y, rgba.reshape(-1, 4), record.ravel().astype(np.uint32), ones, None)


def save(image: np.ndarray, name: str) -> None:
    from PIL import Image

    PICTURES.mkdir(exist_ok=True)
    shown = (np.clip(image, 0, 1) ** (1 / 2.2) * 255).astype(np.uint8)
    Image.fromarray(shown).save(PICTURES / name, optimize=True)


# ---------------------------------------------------------------------- Blender
