"""A small bake to report on: noisy halves, a slightly wrong prediction, names that need escaping."""

import subprocess
from pathlib import Path

import numpy as np
import pytest

from lightwell.report import PointComparison, ReportData, ViewComparison

OBJECTS = ("floor", "wall <b>&</b>", "never seen")


def halves(truth: np.ndarray, rng, noise: float = 0.02) -> tuple[np.ndarray, np.ndarray]:
    return tuple(truth * (1 + noise * rng.standard_normal(truth.shape)) for _ in range(2))


@pytest.fixture
def data() -> ReportData:
    rng = np.random.default_rng(8)
    truth = rng.uniform(1, 3, (400, 3))
    points = PointComparison(1.05 * truth, *halves(truth, rng), rng.integers(0, 2, 400), OBJECTS, rng.random(400) + 0.5)
    picture = np.outer(np.linspace(0.5, 3, 40), np.linspace(1, 2, 32))[..., None] * [1, 0.8, 0.6]
    regions = np.indices((40, 32))[1] // 8
    view = ViewComparison("corner <script>", 1.05 * picture, *halves(picture, rng), regions, regions == 2, "lamp at 0")
    return ReportData(
        scene="room </title><script>alert(1)</script>",
        field="experts",
        preset="small",
        seed=3,
        points=points,
        views=[view, ViewComparison("plain", picture, picture, picture)],
        bytes=123_456,
        macs_per_pixel=7_890,
        seconds={"trace": 10.0, "train": 20.0},
        paths=1_000_000,
        paths_per_second=1e5,
        versions={"lightwell": "0.1.0", "numpy": np.__version__},
        settings={"samples": 4096, "light": {"kind": "point"}},
        training=[(1.0, 0.5), (2.0, 0.2), (4.0, 0.1)],
        sweep=[(0.0, 0.05, 0.01), (0.5, 0.06, 0.01), (1.0, 0.05, 0.01)],
        warnings=["material 'glass' <i>"],
        licences=["room: CC0"],
    )


def violations(page: Path) -> list[str]:
    """What tools/check-site.mjs finds on a page, at 1280 and at 390 pixels: violations of axe, sideways scrolling."""
    root = Path(__file__).parents[2]
    command = ["node", "tools/check-site.mjs", str(page.parent), page.name]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, timeout=600)
    lines = done.stdout.splitlines()
    assert len(lines) == 2, done.stderr[-1000:]
    return [line for line in lines if '"violations":[],"sideways":0' not in line]


@pytest.fixture
def accessible():
    return lambda page: violations(page) == []
