"""What is asked of a GPU, stage by stage: the rows of results/gpu.json, measured or not."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rows import Row, at_least, at_most, without_bar

FINISHED = "finished"


@dataclass(frozen=True)
class Figure:
    """One figure that a stage measures."""

    key: str
    what: str
    unit: str
    most: float | None = None
    """Largest value that holds."""
    least: float | None = None
    """Smallest value that holds."""

    def row(self, measured: float | None, note: str) -> Row:
        """The row of the figure; ``measured`` None with the reason as the note."""
        if self.most is not None:
            return at_most(self.what, self.most, measured, self.unit, note)
        if self.least is not None:
            return at_least(self.what, self.least, measured, self.unit, note)
        return without_bar(self.what, measured, self.unit, note)


@dataclass(frozen=True)
class Stage:
    """A part of the benchmark, run in a process of its own that ends after ``seconds`` at the latest."""

    name: str
    seconds: float
    figures: tuple[Figure, ...]

    def rows(self, found: Mapping[str, Mapping[str, Any]], why: str) -> list[Row]:
        """Rows of all figures: those ``found`` by key, the others unmeasured because of ``why``."""
        missing = {"measured": None, "note": why}
        return [f.row(**found.get(f.key, missing)) for f in self.figures]


class Record:
    """Figures of a running stage, appended to a file at once, so that a stage that is stopped keeps what it has."""

    def __init__(self, path: Path) -> None:
        self._path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("")

    def __call__(self, key: str, measured: float | None, note: str = "") -> None:
        """Append a figure."""
        line = {"measured": None if measured is None else float(measured), "note": " ".join(note.split())}
        with self._path.open("a") as file:
            file.write(json.dumps({"key": key, **line}) + "\n")

    def finish(self) -> None:
        """Say that nothing more comes."""
        self(FINISHED, 1)


def recorded(path: Path) -> dict[str, dict[str, Any]]:
    """Figures of a stage by key; a line that was cut off is left out. ``FINISHED`` is a key of a stage that ended."""
    found: dict[str, dict[str, Any]] = {}
    for line in path.read_text().splitlines() if path.exists() else ():
        try:
            entry = json.loads(line)
            found[entry.pop("key")] = entry
        except ValueError:
            continue
    return found


# Milliseconds are those asked on a GPU of the class of an H100 (issue: published 2.6 ms of overhead on an RTX 3090).
# Limits of the stages: at most 8 minutes each and 22 minutes together, the first compilation of OptiX included.
STAGES = (
    Stage(
        "device",
        60,
        (
            Figure("cuda", "GPU: the CUDA variant loads and runs a kernel", "of 1", least=1),
            Figure("optix", "GPU: OptiX traces rays (a path-traced picture is finite and lit)", "of 1", least=1),
            Figure("first", "GPU: first picture of a process, 64x64, kernels compiled", "s"),
        ),
    ),
    Stage(
        "tests",
        200,
        (
            Figure("failed", "GPU: failed tests of pytest -m gpu", "tests", most=0),
            Figure("passed", "GPU: passed tests of pytest -m gpu", "tests", least=1),
        ),
    ),
    Stage(
        "transport",
        120,
        (
            Figure("paths", "GPU: paths per second of ours, Cornell box", "M paths/s"),
            Figure("mitsuba", "GPU: paths per second of ours over Mitsuba's path, Cornell box", "ratio", least=0.8),
            Figure("processor", "GPU: paths per second over those of the same machine's processor", "ratio"),
        ),
    ),
    Stage(
        "training",
        60,
        (
            Figure("step", "GPU: training step of 4,096 samples, 85-64-64-3", "ms"),
            Figure("numpy", "GPU: training steps per second over NumPy's on the same machine's processor", "ratio"),
        ),
    ),
    Stage(
        "bake",
        340,
        (
            Figure("demo", "GPU: lightwell demo to the written page, report included", "s", most=180),
            Figure("demo-error", "GPU: relative error of the demo", "of 1"),
            Figure("best", "GPU: bake of the Cornell box with --quality best", "s"),
            Figure("best-error", "GPU: relative error of that bake", "of 1", most=0.05),
        ),
    ),
    Stage(
        "cache",
        120,
        (
            Figure("overhead", "GPU: cache overhead per 1080p frame, training and queries", "ms", most=5),
            Figure("frame", "GPU: 1080p frame with the radiance cache, training included", "ms"),
            Figure("path", "GPU: 1080p frame of Mitsuba's path, one sample", "ms"),
        ),
    ),
    Stage(
        "live",
        90,
        (
            Figure("rest", "GPU: pictures per second of the live page at 512x512, camera at rest", "1/s", least=10),
            Figure("orbit", "GPU: pictures per second of the live page at 512x512, camera turning", "1/s", least=10),
        ),
    ),
    Stage("probes", 60, (Figure("mlp", "GPU: query time of probes (mlp) over DDGI's", "ratio", most=0.75),)),
    Stage(
        "shading",
        180,
        tuple(
            figure
            for name, bar in (("mlp:report-20", 0.2), ("default field", 0.5), ("light map", 0.3))
            for figure in (
                Figure(name, f"GPU: shading pass of {name} at 1920x1080", "ms", most=bar),
                Figure(f"{name}, ratio", f"GPU: shading pass of {name} over a textured pass", "ratio"),
                Figure(f"{name}, parity", f"GPU: shading pass of {name} against NumPy", "of max(1, value)", most=1e-4),
            )
        ),
    ),
    Stage(
        "lens",
        90,
        (
            Figure("frame", "GPU: the browser's lens at 1024x1024, two layers, radius up to 32 px", "ms", most=5),
            Figure("parity", "GPU: the browser's lens, PSNR against Python", "dB", least=45),
        ),
    ),
)
