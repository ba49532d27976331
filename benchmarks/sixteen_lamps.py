"""What sixteen lamps cost beside one: time of tracing at equal noise, and time of a frame in headless Chromium.

`changing_light.py --tracing` and `--frames` call ``tracing_row`` and ``frame_row``. Both use a hall of sixteen panels
under its ceiling. Times of one and of sixteen are measured in turns in one run, and the median of their ratios counts.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter

import numpy as np
from rows import Row, at_most

from lightwell.asset.page import write_page
from lightwell.asset.records import FieldEntry, LampEntry
from lightwell.asset.write import write_glb
from lightwell.core.lamps import LampRules
from lightwell.fields.base import FieldSetup
from lightwell.fields.surface.lamp_samples import BATCH, RAYS_SHARE, LampSamples
from lightwell.fields.surface.lamps import PRESETS, LampsFit
from lightwell.fields.surface.plan import RAYS
from lightwell.graph import Graph
from lightwell.scenes.builtin.kit import Kit
from lightwell.scenes.builtin.masonry import Finish, Masonry
from lightwell.scenes.builtin.shapes import box
from lightwell.scenes.lamps import LampGroup, group_lamps
from lightwell.scenes.scene import Camera, Material, Scene
from lightwell.transport.lamp_light import LampLight, LampShares
from lightwell.transport.radiosity import Radiosity
from lightwell.transport.samples import Query, SurfacePoints
from lightwell.transport.seen_shards import GatherSize, SeenBins
from lightwell.transport.shards import ShardSettings

ROOT = Path(__file__).parents[1]
LAMPS, SEED, QUALITY = 16, 0x16A, "good"
FRAMES = "frame time, 16 lamps over one (Chromium)"
TRACING = "tracing time, 16 groups over one at equal noise"
FRAME_BAR, TRACING_BAR = 1.05, 1.3
# Metres: the hall, and walls that part it into bays; a bay has two panels.
LENGTH, HEIGHT, DEPTH, BAYS, PANEL = 16.0, 3.0, 6.0, 8, 0.5
# Points of a pass, as many as a bake of a few minutes has, and passes of each kind.
POINTS, ROUNDS = 1 << 17, 9
TIMEOUT = 3000
LATER = "not measured yet: on a quiet machine, python benchmarks/changing_light.py"


def hall() -> Scene:
    """A hall of eight bays, two panels of light in each."""
    kit = Kit("hall of lamps", 1)
    for name, color in {"wall": (0.7, 0.66, 0.6), "floor": (0.4, 0.38, 0.36), "crate": (0.6, 0.25, 0.1)}.items():
        kit.material(Material(name, base_color=(*color, 1.0), metallic=0.0, roughness=0.9))
    half, side = LENGTH / 2, DEPTH / 2
    rooms = Masonry((-half - 0.1, -0.1, -side - 0.1), (half + 0.1, HEIGHT + 0.1, side + 0.1))
    rooms.carve((-half, 0, -side), (half, HEIGHT, side), Finish("wall", "floor", "wall"))
    for material, part in rooms.build().items():
        kit.add(material, material, part)
    for k in range(LAMPS):
        bay, row = divmod(k, 2)
        x, z = -half + (bay + 0.5) * LENGTH / BAYS, (row - 0.5) * side
        # Each its own colour and strength, as lamps of a scene have.
        glow = tuple(float(v) for v in 4 + 6 * np.random.default_rng([SEED, k]).random(3))
        kit.material(Material(f"glow {k + 1}", (0.9, 0.9, 0.9, 1.0), metallic=0.0, roughness=0.8, emissive=glow))
        low = (x - PANEL / 2, HEIGHT - 0.06, z - PANEL / 2)
        kit.add(f"lamp {k + 1}", f"glow {k + 1}", box(low, (low[0] + PANEL, HEIGHT - 0.02, low[2] + PANEL)))
        if row and bay:
            edge = -half + bay * LENGTH / BAYS
            kit.add("partitions", "wall", box((edge - 0.05, 0, -side), (edge + 0.05, HEIGHT, 0.4)))
            kit.add("crates", "crate", box((x - 0.3, 0, 1.6), (x + 0.3, 0.7, 2.2), skip=("-y",)))
    return kit.scene([Camera((-half + 0.6, 1.6, 2.0), (half, 1.2, 1.0), fov_y=65.0, name="home")])


def tracing_row(measure: bool, quick: bool) -> Row:
    """Time of one pass that keeps sixteen groups apart over that of a pass for one group alone.

    Args:
        measure: Whether to measure it.
        quick: A small run.

    Returns:
        The row.
    """
    if not measure:
        return at_most(
            TRACING,
            TRACING_BAR,
            None,
            "x",
            f"{LATER} --tracing",
        )
    scene, count = hall(), 1 << 12 if quick else POINTS
    groups = group_lamps(scene, LampRules("each", asked=True))
    size = GatherSize.of(max(count >> 14, 1), ShardSettings())
    points, radiosity = SeenBins(None, count, size.bins, 8, (SEED, SEED + 1)).make(scene)
    rays = RAYS[QUALITY] // RAYS_SHARE
    for warm in (groups, groups[:1]):
        traced(radiosity, warm, points, rays, 0)
    ratios, noise, whole = [], [], []
    for k in range(3 if quick else ROUNDS):
        lamp = k % LAMPS
        ours, shares = traced(radiosity, groups, points, rays, 3 * k + 1)
        alone, share = traced(radiosity, groups[lamp : lamp + 1], points, rays, 3 * k + 2)
        ratios.append(ours / alone)
        noise.append(difference(shares, lamp) ** 2 / difference(share, 0) ** 2)
        whole.append((ours, alone))
    time, variance = float(np.median(ratios)), float(np.median(noise))
    ours, alone = np.median(whole, axis=0)
    note = (
        f"hall of sixteen panels, {count} points, {rays} rays: time {time:.2f} x ({ours:.2f} s over {alone:.2f} s) at "
        f"equal rays, variance of a group's share {variance:.2f} x; bins are found before and serve both"
    )
    return at_most(TRACING, TRACING_BAR, time * variance, "x", note)


def traced(
    radiosity: Radiosity, groups: tuple[LampGroup, ...], points: SurfacePoints, rays: int, seed: int
) -> tuple[float, LampShares]:
    """Seconds in which bins are lit by groups and points gather it, in batches as in a bake, and the shares."""
    start = perf_counter()
    light = LampLight(radiosity, groups, SEED + 1000 * seed)
    parts = [
        light.shares(points[np.arange(first, min(first + BATCH, len(points)))], rays, SEED + 1000 * seed + 1 + first)
        for first in range(0, len(points), BATCH)
    ]
    seconds = perf_counter() - start
    return seconds, LampShares(*(np.concatenate([getattr(p, half) for p in parts]) for half in ("half_a", "half_b")))


def difference(shares: LampShares, group: int) -> float:
    """Mean difference of both halves over the mean of a group: the noise; bright single paths count less than in a
    variance."""
    a, b = (np.nan_to_num(half[:, group]) for half in (shares.half_a, shares.half_b))
    return float(np.abs(a - b).mean() / max(float((a + b).mean()), 1e-30))


def untrained(lamps: int, setup: FieldSetup | None = None) -> Graph:
    """A field of lamps before its training: its bytes and its cost are those of a trained one.

    Args:
        lamps: How many.
        setup: Bounds of the scene; None: those of a cube.

    Returns:
        Its graph.
    """
    zero = np.zeros((64, 3), np.float32)
    query = Query(zero, zero + 0.57, zero + 0.57, zero, zero + 0.5, zero[:, :1], zero[:, :1])
    ones = np.ones((64, lamps, 3), np.float32)
    setup = setup or FieldSetup((0, 0, 0), 1.0, 1.0, "static", (2, 2, 2))
    fit = LampsFit(setup, PRESETS[QUALITY], tuple(map(str, range(lamps))), 0)
    fit.learn_from(LampSamples(query, ones, ones, np.zeros(64, np.uint32)))
    return fit.lower()


def frame_row(measure: bool, quick: bool) -> Row:
    """Time of a frame with sixteen lamps over that with one of the same scene and trunk, while dimmers change.

    Args:
        measure: Whether to measure it.
        quick: A small run.

    Returns:
        The row: the slower of SwiftShader and llvmpipe.
    """
    if not measure:
        return at_most(
            FRAMES,
            FRAME_BAR,
            None,
            "x",
            f"{LATER} --frames",
        )
    if not shutil.which("node"):
        return at_most(FRAMES, FRAME_BAR, None, "x", "needs Node, npm ci in web/ and a Chromium")
    with tempfile.TemporaryDirectory() as folder:
        pages = [write_lamps(Path(folder), mode) for mode in ("all", "each")]
        command = ["node", str(ROOT / "tools/lamp-frames.mjs"), *map(str, pages), "2" if quick else str(ROUNDS)]
        done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=TIMEOUT)
    if done.returncode:
        print(done.stderr[-2000:], file=sys.stderr)
        return at_most(FRAMES, FRAME_BAR, None, "x", "the pages could not be timed; see the error above")
    found = json.loads(done.stdout)
    parts = [
        f"{name} {f['ratio']:.3f} x ({f['many_ms']:.1f} ms over {f['one_ms']:.1f} ms, {f['lamps'][1]} lamps over "
        f"{f['lamps'][0]}, {f['macs'][1]:.0f} multiply-adds)"
        for name, f in found.items()
    ]
    note = f"640x400, all dimmers change before every frame; the slower of {'; '.join(parts)}"
    return at_most(FRAMES, FRAME_BAR, max(f["ratio"] for f in found.values()), "x", note)


def write_lamps(folder: Path, mode: str) -> Path:
    """Write asset and page of the hall with its lamps in groups.

    Args:
        folder: Where.
        mode: Which lamps belong together, see ``lightwell.core.lamps.MODES``.

    Returns:
        The page.
    """
    scene = hall()
    groups = group_lamps(scene, LampRules(mode, asked=True))
    graph = untrained(len(groups), FieldSetup.of(scene, 1.0, "static"))
    field = FieldEntry("lamps", "static", graph)
    asset, page = folder / f"{mode}.glb", folder / f"{mode}.html"
    write_glb(asset, scene, [field], [], lamps=[LampEntry(group.name, group.nodes) for group in groups])
    write_page(page, title=scene.name, glb=asset.read_bytes(), home=scene.cameras[0])
    return page
