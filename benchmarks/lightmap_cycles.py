"""Cycles' own light map bake beside ours: a room exported by Blender, one run on the same cores."""

from __future__ import annotations

import os
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np
from rows import Row, at_least

from lightwell.asset.records import FieldEntry
from lightwell.asset.write import write_glb
from lightwell.fields.lightmap.curve import stored
from lightwell.fields.lightmap.fit import PRESETS, LightmapFit
from lightwell.fields.lightmap.trace import chart
from lightwell.graph.pictures import encode
from lightwell.scenes import load
from lightwell.scenes.atlas import charted

# Growth of our path count until it is as good, and how often that is timed.
STEP, TIMINGS = 1.2, 3


def cycles(quick: bool) -> list[Row]:
    """Time to equal noise: Cycles' light map bake and ours, a room exported by Blender, one run on the same cores."""
    what = "bake: Cycles' time over ours at equal error, same cores"
    python = os.environ.get("LIGHTWELL_BPY")
    if not python:
        return [at_least(what, 2, None, "ratio", "needs LIGHTWELL_BPY, a Python that has bpy")]
    size, count, reference = (64, 4, 32) if quick else (256, 32, 128)
    with tempfile.TemporaryDirectory() as folder:
        found = side_by_side(python, Path(folder), size, count, reference)
    note = (
        f"{size} x {size}, Cycles {count} samples {found.cycles_seconds:.1f} s, error {found.cycles_error:.3f}; ours "
        f"{found.paths} paths {found.seconds:.2f} s, error {found.error:.3f}; each against {reference} samples of "
        f"its own; their E' agree within {found.apart:.1%} (median)"
    )
    return [at_least(what, 2, found.cycles_seconds / found.seconds, "ratio", note)]


@dataclass(frozen=True)
class SideBySide:
    """Cycles and ours."""

    cycles_seconds: float
    cycles_error: float
    seconds: float
    error: float
    paths: int
    apart: float


def side_by_side(python: str, folder: Path, size: int, count: int, reference: int) -> SideBySide:
    """The least of our path counts, in steps of a fifth, that is as good as Cycles with ``count`` samples."""
    from lightwell.transport.irradiance import irradiance

    script = Path(__file__).with_name("lightmap_blender.py")
    run = lambda *a: subprocess.run([python, script, *a], check=True, capture_output=True, text=True).stdout  # noqa: E731
    run("export", folder / "room.glb")
    scene = load(str(folder / "room.glb"))
    made = chart(scene, size, 0, 4, 0)
    fit = LightmapFit(PRESETS["plain"], size, 1.0, encode(stored(made.image), "png"))
    write_glb(
        folder / "uv.glb",
        charted(scene, made.atlas),
        [FieldEntry("light", "static", fit.lower(), None, fit.pictures)],
        [],
    )
    text = run("bake", folder / "uv.glb", folder / "light.npy", str(size), f"1,{count},{reference}")
    seconds = {int(line.split()[1]): float(line.split()[2]) for line in text.splitlines() if line.startswith("SECONDS")}
    theirs = [c.reshape(-1, 3)[made.texels.index].mean(axis=1) for c in np.load(folder / "light.npy")[1:]]
    points = made.texels.points
    truth = irradiance(scene, points, 2 * reference, 9).mean.mean(axis=1)
    ratio = theirs[1] / np.maximum(truth, 1e-9)
    # Where two sides of a wall lie in one place the two may hold different ones.
    scale = np.median(ratio[made.stored & (ratio > 0)])
    both = made.stored & (ratio > 0.7 * scale) & (ratio < 1.4 * scale)
    error = lambda a, b: float(np.sqrt(np.mean(((a - b)[both] / (b[both] + 0.05 * b[both].mean())) ** 2)))  # noqa: E731
    wanted, paths = error(*theirs), 2
    bake = lambda seed: irradiance(scene, points, paths, seed).mean.mean(axis=1)  # noqa: E731
    while error(light := bake(3), truth) > wanted and paths < 1024:
        paths = max(paths + 2, int(STEP * paths) // 2 * 2)
    took = []
    for seed in range(4, 4 + TIMINGS):
        start = perf_counter()
        bake(seed)
        took.append(perf_counter() - start)
    apart = float(np.median(np.abs(ratio[both] / np.median(ratio[both]) - 1)))
    return SideBySide(seconds[count], wanted, float(np.median(took)), error(light, truth), paths, apart)
