"""Light maps as KTX2 pictures against WebP: GPU memory and loss, from the same samples.

Rows of ``engines.json``, by ``python benchmarks/engines.py --only ktx2``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from lightmap_scenes import Effort
from rows import Row, at_least, at_most, without_bar

from lightwell.core.color import display
from lightwell.fields.baked import Baked
from lightwell.fields.lightmap.fit import PRESETS, LightmapFit
from lightwell.fields.lightmap.fitting import fitted
from lightwell.fields.lightmap.options import stored_as
from lightwell.fields.lightmap.sides import lit_scene, lit_sides
from lightwell.fields.lightmap.square import atlas_of
from lightwell.fields.lightmap.trace import chart
from lightwell.fields.lightmap.views import eye_samples
from lightwell.graph.pictures import gpu_bytes
from lightwell.scenes import load
from lightwell.scenes.atlas import Atlas
from lightwell.scenes.scene import Scene
from lightwell.transport import draw_surface
from lightwell.transport.lightmap_query import query_of_lightmap
from lightwell.transport.radiance import static

SEED, HELD_OUT = 1, 0x5EED
MIPS = 1
# A scene with gloss, normal maps and lamps, in the smallest atlas that its 1,678 charts fit into.
EFFORT = Effort(size=512, paths=64, eyes=1 << 15, steps=700, view_paths=128)
QUICK = Effort(size=512, paths=4, eyes=1 << 10, eye_paths=4, steps=20, view_paths=8)
# Held-out points on all surfaces.
POINTS = 8192
OPTIONS = ("ktx2", "ktx2-etc1s")


def rows(quick: bool) -> list[Row]:
    """GPU memory and loss of each option."""
    effort = QUICK if quick else EFFORT
    scene = lit_scene(load("courtyard"))[0]
    sides = lit_sides(scene, SEED)
    atlas = atlas_of(scene, effort.size, MIPS, sides)
    made = chart(scene, effort.size, MIPS, effort.paths, SEED, atlas=atlas)
    samples = eye_samples(scene, made, effort.eyes, effort.eye_paths, SEED + 5, made.image)
    held = _held_out(scene, atlas, effort.view_paths)
    fits = {}
    for name in (None, *OPTIONS):
        preset = replace(stored_as(PRESETS["default"], name), size=effort.size)
        fits[name] = fitted(scene, made, samples, preset, SEED, effort.steps)
    note = f"courtyard, {effort.size}², {effort.paths} paths per texel, {effort.steps} steps"
    return [row for name in OPTIONS for row in _rows(name, fits, held, note)]


def _rows(name: str, fits: dict[str | None, LightmapFit], held: tuple, note: str) -> list[Row]:
    memory = {key: sum(map(gpu_bytes, fit.pictures.values())) for key, fit in fits.items()}
    size = {key: sum(len(picture.data) for picture in fit.pictures.values()) for key, fit in fits.items()}
    webp = decibels(fits[None], held)
    less, loss = memory[None] / memory[name], webp - decibels(fits[name], held)
    bars = name == "ktx2"
    label = "KTX2" if bars else "KTX2, the ordinary light map as ETC1S"
    first = f"{label}: GPU memory of pictures, times less", less, "times", note
    second = f"{label}: loss", loss, "dB", f"{note}; as WebP {webp:.1f} dB"
    return [
        at_least(first[0], 4, *first[1:]) if bars else without_bar(*first),
        at_most(second[0], 0.5, *second[1:]) if bars else without_bar(*second),
        without_bar(f"{label}: pictures in the file, times those of WebP", size[name] / size[None], "times", note),
    ]


def _held_out(scene: Scene, atlas: Atlas, paths: int) -> tuple:
    """Points on all surfaces, and two independent means of what leaves them."""
    draw = draw_surface(scene, POINTS, SEED + HELD_OUT, floor=8, shown=True)
    a, b = static(scene, draw.points, paths, SEED + HELD_OUT)
    good = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
    return query_of_lightmap(scene, atlas, draw.points)[good], a[good], b[good]


def decibels(fit: LightmapFit, held: tuple) -> float:
    """PSNR of displayed values, without the noise of the reference."""
    query, *halves = held
    f, a, b = (display(v / fit.unit) for v in (Baked(fit.lower())(query), *halves))
    return float(-10 * np.log10(np.mean((f - a) * (f - b))))
