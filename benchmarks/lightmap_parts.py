"""Parts of the light maps' figures that need no given scene: leaks, mips, moving light, codecs, subsurface light."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from lightmap_scenes import HELD_OUT, MIPS, QUICK, Effort
from rows import Row, at_least, at_most, without_bar

from lightwell.core.color import display
from lightwell.fields.baked import Baked
from lightwell.fields.lightmap import fit as lightmap
from lightwell.fields.lightmap.curve import stored
from lightwell.fields.lightmap.fit import PRESETS
from lightwell.fields.lightmap.fitting import fitted, sample_unit
from lightwell.fields.lightmap.sides import lit_scene, seen_sides
from lightwell.fields.lightmap.trace import chart
from lightwell.fields.lightmap.views import eye_samples
from lightwell.graph.pictures import decoded, encode, seen_from_afar
from lightwell.scenes import load


def leak(quick: bool) -> list[Row]:
    """Texels of the leak scene that read another chart."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "scenes"))
    from test_atlas import fronts, leaking

    from lightwell.scenes.atlas import build

    scene = load("two-rooms")
    atlas = build(scene, 256 if quick else 1024, fronts(scene), mips=3)
    note = f"two-rooms, {atlas.charts} charts, coverage {atlas.coverage:.0%}"
    return [
        at_most(f"leak: texels that read another chart at mip {m}", 0, leaking(atlas, m), "", note) for m in range(4)
    ]


def mips(quick: bool) -> list[Row]:
    """A light map read at levels of its mip chain, trained at random levels and at level 0 alone."""
    size, eyes, paths, steps = (256, 1 << 11, 4, 20) if quick else (512, 1 << 17, 32, 600)
    scene, _ = lit_scene(load("cornell"))
    made = chart(scene, size, 3, paths, 0)
    samples = eye_samples(scene, made, eyes, 8, 5, made.image)
    held = eye_samples(scene, made, eyes // 8, 8, 77, made.image)
    found, share = {}, lightmap.FAR_SHARE
    for label, part in (("random levels", share), ("level 0 alone", 0.0)):
        lightmap.FAR_SHARE = part
        fit = fitted(scene, made, samples, replace(PRESETS["default"], share=1 / 4), 0, steps)
        found[label] = []
        for level in range(4):
            light = Baked(seen_from_afar(fit.lower(), fit.pictures, size, level))(held.query)
            f, a, b = (display(v / fit.unit) for v in (light, held.half_a, held.half_b))
            found[label].append(decibels(np.average(((f - a) * (f - b)).mean(axis=1), weights=held.weight)))
    lightmap.FAR_SHARE = share
    note = "cornell under a sky, features at 1/4, promised mips 3, noise taken off; trained at level 0 alone {:.1f} dB"
    return [
        without_bar(f"mip-safe: PSNR of held-out samples read at mip {m}", trained, "dB", note.format(other))
        for m, (trained, other) in enumerate(zip(*found.values()))
    ]


def vary(quick: bool) -> list[Row]:
    """Whether a light map of a light that moves is lit by where the light is, on held-out places of it."""
    from lightwell.fields.lightmap.moving import moving_fit, moving_samples
    from lightwell.scenes.variables import declare

    size, count, steps = (64, 1 << 11, 20) if quick else (512, 1 << 18, 1500)
    scene = load("cornell")
    variable = declare(("light.position=box(-0.5,1.0,-0.5,0.5,1.7,0.5)",), scene)
    made = chart(scene, size, 0, 4, 0, sides=seen_sides(scene, 0))
    samples = moving_samples(scene, made.atlas, variable, count, 16, 6)
    held = moving_samples(scene, made.atlas, variable, count // 16, 64, 99)
    fit = moving_fit(scene, made.atlas, variable, samples, sample_unit(samples), 0, steps)
    field = Baked(fit.lower())
    elsewhere = replace(held.query, light=np.roll(held.query.light, len(held.weight) // 2, axis=0))
    a, b = (display(v / fit.unit) for v in (held.half_a, held.half_b))
    errors = []
    for query in (held.query, elsewhere):
        f = display(field(query) / fit.unit)
        errors.append(float(np.average(((f - a) * (f - b)).mean(axis=1), weights=held.weight)))
    bytes_ = sum(len(p.data) for p in fit.pictures.values())
    note = f"cornell, indirect light, held-out places of a lamp and of the eye, noise taken off, textures {bytes_} B"
    return [
        at_least("--vary: PSNR at held-out places of the light", 30, decibels(errors[0]), "dB", note),
        at_most(
            "--vary: RMS error over that with the light elsewhere", 0.5, np.sqrt(max(errors[0], 0) / errors[1]), "ratio"
        ),
    ]


def decibels(squared: float) -> float:
    """Of a mean squared error of what a screen shows."""
    return float(-10 * np.log10(max(squared, 1e-10)))


def codecs(quick: bool) -> list[Row]:
    """Bytes and error of the light of a scene in each codec: E' in the curve of a screen, 1024 x 1024."""
    effort = replace(QUICK if quick else Effort(), eyes=1 << 10)
    name = "two-rooms" if quick else "courtyard"
    scene, _ = lit_scene(load(name))
    made = chart(scene, effort.size, MIPS, effort.paths, 0)
    unit = 4 * float(made.light.mean[made.stored].mean())
    texels = stored(made.image / unit)
    covered = made.texels.chart >= 0
    rows = []

    def add(label: str, size: int, back: np.ndarray) -> None:
        error = np.mean((back[covered].astype(float) - texels[covered]) ** 2) / 255**2
        note = f"{10 * np.log10(1 / max(error, 1e-12)):.1f} dB of the stored curve"
        rows.append(without_bar(f"{name}, E' of {made.atlas.size} x {made.atlas.size}: {label}", size, "B", note))

    for codec in ("png", "webp", "webp90", "webp75", "webp50"):
        picture = encode(texels, codec)
        add(codec, len(picture.data), picture.buffer().array)
    try:
        import alktx2
    except ImportError:
        return rows
    rgba = np.dstack([texels, np.full(texels.shape[:2], 255, np.uint8)]).tobytes()
    for label, options in (
        ("KTX2 ETC1S", {"codec": "etc1s", "quality": 128}),
        ("KTX2 UASTC + Zstd", {"codec": "uastc"}),
    ):
        data = alktx2.encode_raw_rgba_to_ktx2(rgba, *texels.shape[:2], srgb=False, linear=True, **options)
        png, _ = alktx2.decode_ktx2_to_bytes(data, format="png")
        add(label, len(data), decoded(png))
    return rows


def subsurface(quick: bool) -> list[Row]:
    """A ball of wax: the pixels of a held-out view that show it, truth by Mitsuba's volpath."""
    from lightwell.fields.lightmap.media import media_meshes, volumetric
    from lightwell.transport.camera import gbuffer
    from lightwell.transport.lightmap_query import query_of_lightmap

    effort = QUICK if quick else Effort(size=256, paths=64, eyes=100_000, view_paths=2048, view_size=(96, 60))
    scene = load(str(Path(__file__).resolve().parents[1] / "examples" / "subsurface.xml"))
    made = chart(scene, effort.size, MIPS, effort.paths, 0)
    eyes = eye_samples(scene, made, effort.eyes, effort.eye_paths, 5, made.image)
    preset = replace(PRESETS["default"], share=1 / 8)
    fits = {
        name: fitted(scene, made, eyes, p, 0, effort.steps)
        for name, p in (("ours", preset), ("plain", PRESETS["plain"]))
    }
    points, mask, _ = gbuffer(scene, scene.cameras[0], *effort.view_size)
    seen = points[np.flatnonzero(mask & media_meshes(scene)[points.shape])]
    halves = [display(half / fits["ours"].unit) for half in volumetric(scene, seen, effort.view_paths, HELD_OUT)]
    found = {}
    for name, fit in fits.items():
        shown = display(Baked(fit.lower())(query_of_lightmap(scene, made.atlas, seen)) / fit.unit)
        found[name] = decibels(np.mean((shown - halves[0]) * (shown - halves[1])))
    ceiling = decibels(np.mean((halves[0] - halves[1]) ** 2) / 4)
    size = sum(len(picture.data) for picture in fits["ours"].pictures.values())
    note = (
        f"noise taken off; ordinary light map {found['plain']:.1f} dB, truth itself {ceiling:.1f} dB, textures {size} B"
    )
    return [at_least("subsurface surfaces: PSNR", 38, found["ours"], "dB", note)]
