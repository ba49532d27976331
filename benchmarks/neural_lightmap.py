"""The figures of neural light maps, measured side by side on this machine.

    python benchmarks/neural_lightmap.py                        every figure; writes results/neural_lightmap.json
    python benchmarks/neural_lightmap.py --quick                a smoke run of a minute; writes nothing
    python benchmarks/neural_lightmap.py --only staircase2,leak
    python benchmarks/neural_lightmap.py --only staircase2 --ablate     prints a table of variants beside it
    python benchmarks/neural_lightmap.py --only curve --plot            draws docs/images/lightmap-curve.png

Parts: the scenes, leak, cycles (needs LIGHTWELL_BPY, a Python that has bpy), codecs (KTX2 needs alktx2), subsurface,
web, curve. Rows are written after every part, so that a killed run goes on with ``--only``. Every scene is traced
once; all light maps see the same atlas, the same light at texels and the same eye samples, and are scored on the same
held-out views from the graphs and pictures that they ship. PSNR is that of x / (1 + x), then sRGB, of the pixels that
the light map lights: clear glass is drawn by the rasteriser, its share is printed, and a row counts it as black
too; *corrected* takes the noise of the truth off the squared error.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from rows import Row, at_least, at_most, publish, without_bar

from lightwell.asset.records import FieldEntry
from lightwell.asset.write import write_glb
from lightwell.bake.evaluate import Baked
from lightwell.bake.lightmap import fitted
from lightwell.bake.lightmap_score import compare_camera
from lightwell.bake.lightmap_seams import SHARE, seam_gap, seam_samples
from lightwell.bake.lightmap_trace import (
    Chart,
    EyeSamples,
    Sides,
    chart,
    clear_glass,
    eye_samples,
    lit_scene,
    lit_sides,
)
from lightwell.fields.lightmap import PRESETS, LightmapFit, LightmapPreset
from lightwell.fields.lightmap_graph import stored
from lightwell.graph.pictures import decoded, encode
from lightwell.report import metrics
from lightwell.report.records import ViewComparison
from lightwell.scenes import load
from lightwell.scenes.atlas import charted_meshes
from lightwell.scenes.placing import sample_cameras
from lightwell.scenes.variables import declare

GIVEN = Path(__file__).resolve().parents[2] / "shared" / "scenes"
SCENES = {
    "room-soft-shadows": GIVEN / "gltf/room-soft-shadows/room-decoded.glb",
    "godot-living-room": GIVEN / "gltf/godot-living-room/living_room.glb",
    "staircase2": GIVEN / "mitsuba/staircase2/scene_mi3.xml",
    "courtyard": "courtyard",
}
MEGABYTE = 1_000_000
# Stream of the held-out views, which training never draws from.
HELD_OUT = 0x5EED
# A pixel counts as lit above this share of the picture's mean.
LEAST_LIT = 0.05
PLAIN_CODECS = ("webp50", "webp75", "webp90", "webp")


@dataclass(frozen=True)
class Effort:
    """How much is traced."""

    size: int = 1024
    paths: int = 32
    eyes: int = 400_000
    eye_paths: int = 8
    views: int = 3
    view_paths: int = 384
    view_size: tuple[int, int] = (192, 120)
    steps: int = 1000


QUICK = Effort(128, 4, 1 << 12, 4, 1, 8, (48, 30), 20)
# Mip level up to which the atlases of the scenes keep charts apart.
MIPS = 0


@dataclass(frozen=True)
class Traced:
    """A scene, traced once."""

    made: Chart
    eyes: EyeSamples
    without_seams: EyeSamples
    truth: list
    scene: object
    effort: Effort
    seconds: float
    sides: Sides


@dataclass(frozen=True)
class Figures:
    """One light map on the held-out views."""

    psnr: float
    corrected: float
    ceiling: float
    worst: float
    flip: float
    bytes: int
    macs: int
    seconds: float
    with_glass: float
    """Corrected PSNR of all pixels, those of clear glass as the light map leaves them: black."""


def trace(source, effort: Effort) -> Traced:
    """Light at texels, samples of eyes, held-out cameras."""
    start = perf_counter()
    scene, _ = lit_scene(load(str(source)))
    sides = lit_sides(scene, 0)
    made = chart(scene, effort.size, MIPS, effort.paths, 0, sides=sides)
    plain_eyes = eye_samples(scene, made, effort.eyes, effort.eye_paths, 5, made.image)
    across = seam_samples(scene, made, made.image, int(SHARE * effort.eyes), effort.eye_paths, 7)
    eyes = plain_eyes if across is None else plain_eyes + across
    seconds = perf_counter() - start
    cameras = sample_cameras(scene, declare((), scene), 4 * effort.views, HELD_OUT, authored=True)
    lit = [camera for camera in cameras if shows_light(scene, camera)]
    return Traced(made, eyes, plain_eyes, (lit or cameras)[: effort.views], scene, effort, seconds, sides)


def shows_light(scene, camera) -> bool:
    """Whether a camera sees more than darkness: one in a sealed cupboard would be matched without an error."""
    from lightwell.transport.camera import static_image

    picture = sum(static_image(scene, camera, 16, 10, 16)).mean(axis=2)
    return float((picture > LEAST_LIT * picture.mean()).mean()) > 0.3 and picture.mean() > 0.05 * brightness(scene)


def brightness(scene) -> float:
    """Mean radiance of points all over the scene."""
    from lightwell.transport.radiance import static
    from lightwell.transport.surface import draw_surface

    a, b = static(scene, draw_surface(scene, 512, 1, floor=0).points, 16, 1)
    return float(np.nan_to_num(a + b).mean())


class Views:
    """The truth of the held-out views, traced once; predictions are put beside it."""

    def __init__(self, traced: Traced) -> None:
        from lightwell.transport.camera import gbuffer
        from lightwell.transport.mapped import mapped_query

        width, height = traced.effort.view_size
        dark = {"static": Baked(constant_graph())}
        self.queries, self.seen, self.views, self.shapes, self.glass = [], [], [], [], []
        glass = clear_glass(traced.scene)
        for k, camera in enumerate(traced.truth):
            options = (traced.effort.view_size, traced.effort.view_paths, k)
            view, _ = compare_camera(traced.scene, traced.made.atlas, dark, camera, *options)
            points, mask, _ = gbuffer(traced.scene, camera, width, height)
            seen = np.flatnonzero(mask)
            self.glass.append(glass[points.shape[seen]])
            self.views.append(view)
            self.seen.append(seen)
            self.shapes.append(points.shape[seen])
            self.queries.append(mapped_query(traced.scene, traced.made.atlas, points[seen]))

    @property
    def glass_share(self) -> float:
        """Share of the pixels that show clear glass."""
        return float(np.concatenate(self.glass).mean())

    def score(self, fit: LightmapFit, seconds: float) -> Figures:
        """The shipped graph against the truth."""
        graph = fit.lower()
        baked, found, everything = Baked(graph), [], []
        for view, seen, query, glass in zip(self.views, self.seen, self.queries, self.glass):
            picture = np.zeros((view.half_a.size // 3, 3), np.float32)
            picture[seen] = baked(query)
            everything.append(_view_figures(view, picture, seen, fit.unit)[1])
            # What the rasteriser draws is the truth here, for FLIP.
            truth = 0.5 * (view.half_a + view.half_b).reshape(-1, 3)
            picture[seen[glass]] = truth[seen[glass]]
            found.append(_view_figures(view, picture, seen[~glass], fit.unit))
        psnr, corrected, ceiling, flip = np.mean(found, axis=0)
        size = sum(len(p.data) for name, p in fit.pictures.items() if name != "m" or fit.preset.hidden)
        size += sum(b.nbytes for name, b in graph.buffers.items() if name not in fit.pictures)
        worst = min(f[1] for f in found)
        return Figures(psnr, corrected, ceiling, worst, flip, size, graph.macs, seconds, np.mean(everything))


def constant_graph():
    """No light at all, to trace the truth beside."""
    from lightwell.graph import Builder

    b = Builder(reflectance=3)
    return b.build(radiance=b.scale("reflectance", 0.0))


def _view_figures(view: ViewComparison, picture: np.ndarray, seen: np.ndarray, unit: float) -> tuple[float, ...]:
    shape = view.half_a.shape
    a, b, f = (np.asarray(x, np.float64).reshape(-1, 3) / unit for x in (view.half_a, view.half_b, picture))
    shown = {name: metrics.display(x[seen]) for name, x in (("a", a), ("b", b), ("y", (a + b) / 2), ("f", f))}
    decibels = lambda mse: float(-10 * np.log10(max(mse, 1e-10)))  # noqa: E731
    return (
        decibels(np.mean((shown["f"] - shown["y"]) ** 2)),
        decibels(np.mean((shown["f"] - shown["a"]) * (shown["f"] - shown["b"]))),
        decibels(np.mean((shown["a"] - shown["b"]) ** 2) / 4),
        metrics.flip(f.reshape(shape), ((a + b) / 2).reshape(shape)),
    )


def learned(traced: Traced, preset: LightmapPreset, eyes: EyeSamples | None = None) -> LightmapFit:
    """Trained on the eye samples, those on seams among them unless others are given."""
    steps = traced.effort.steps if preset.hidden else 0
    return fitted(traced.scene, traced.made, traced.eyes if eyes is None else eyes, preset, 0, steps)


def measured(
    traced: Traced, views: Views, preset: LightmapPreset, name: str, fit: LightmapFit | None = None
) -> Figures:
    """Fit and score one preset; its line is printed at once."""
    start = perf_counter()
    fit = learned(traced, preset) if fit is None else fit
    figures = views.score(fit, perf_counter() - start)
    print(
        f"  {name:<36} {figures.psnr:6.2f} dB (corrected {figures.corrected:6.2f}, truth {figures.ceiling:5.1f})"
        f"  worst {figures.worst:5.1f}  FLIP {figures.flip:.3f}  {figures.bytes:>8} B  {figures.macs:>5} MAC"
        f"  {figures.seconds:4.0f} s",
        flush=True,
    )
    return figures


def variants() -> dict[str, LightmapPreset]:
    """What the default was chosen from."""
    d = PRESETS["default"]
    return {
        "no features": replace(d, channels=0),
        "no directions": replace(d, direction=False),
        "no directions, no features": replace(d, direction=False, channels=0),
        "features at 1/32": replace(d, share=1 / 32),
        "features at 1/8": replace(d, share=1 / 8),
        "features at 1/4": replace(d, share=1 / 4),
        "nine channels": replace(d, channels=9),
        "environment of 16 and 64 texels": replace(d, mirrors=(16, 64)),
        "32 x 3": replace(d, hidden=(32, 32, 32)),
        "16 x 2": replace(d, hidden=(16, 16)),
        "SH of the view in place of r": replace(d, inputs="view"),
        "sine": replace(d, activation="sine"),
        "base webp75": replace(d, base="webp75"),
        "base lossless": replace(d, base="webp"),
        "report at this size": replace(PRESETS["report"], share=1 / 4),
        "report-relu at this size": replace(PRESETS["report-relu"], share=1 / 4),
        "siren": PRESETS["siren"],
        "siren-two-stage": replace(PRESETS["siren-two-stage"], share=1 / 8),
    }


def scene_rows(name: str, quick: bool, ablate: bool) -> list[Row]:
    """All figures of one scene."""
    source, effort = SCENES[name], QUICK if quick else Effort()
    what = f"{name}, default at no more than 1 MB: "
    if isinstance(source, Path) and not source.exists():
        return [at_least(what + "PSNR", 40, None, "dB", "the scene is not on this machine")]
    traced = trace(source, effort)
    views = Views(traced)
    print(
        f"{name}: {traced.made.atlas.charts} charts, traced in {traced.seconds:.0f} s, clear glass "
        f"{views.glass_share:.1%} of the pixels, {traced.made.glossy.mean():.0%} of the texels need the eye",
        flush=True,
    )
    default = PRESETS["default"] if traced.made.glossy.any() else PRESETS["plain"]
    fit = learned(traced, default)
    ours = measured(traced, views, default, "default", fit)
    plain = {c: measured(traced, views, replace(PRESETS["plain"], base=c), f"plain {c}") for c in PLAIN_CODECS}
    directional = measured(traced, views, PRESETS["directional"], "directional")
    if ablate:
        for label, preset in variants().items():
            measured(traced, views, preset, label)
    fitting = [f for f in plain.values() if f.bytes <= ours.bytes] or [min(plain.values(), key=lambda f: f.bytes)]
    best = max([*fitting, *([directional] if directional.bytes <= ours.bytes else [])], key=lambda f: f.corrected)
    note = (
        f"{effort.size} x {effort.size}, {effort.views} held-out views, truth itself {ours.ceiling:.1f} dB, "
        f"noise-corrected {ours.corrected:.1f} dB, worst view {ours.worst:.1f} dB, traced in {traced.seconds:.0f} s, "
        f"clear glass, {views.glass_share:.1%} of the pixels, left out"
    )
    if not quick:
        remember(name, {"default": ours, **{f"plain {k}": v for k, v in plain.items()}, "directional": directional})
    against = (
        f"default {ours.corrected:.2f} dB at {ours.bytes} B, best ordinary {best.corrected:.2f} dB at {best.bytes} B"
    )
    return [
        at_least(what + "PSNR", 40, ours.psnr, "dB", note),
        at_least(what + "PSNR, noise of the truth taken off", 40, ours.corrected, "dB"),
        without_bar(what + "the same, clear glass counted as black", ours.with_glass, "dB"),
        at_most(what + "FLIP", 0.05, ours.flip, "of 1"),
        at_most(what + "bytes", MEGABYTE, ours.bytes, "B"),
        at_least(
            f"{name}: gain over the best ordinary or directional light map of no more bytes",
            GAIN[name],
            ours.corrected - best.corrected,
            "dB",
            against,
        ),
        at_least(
            f"{name}: atlas coverage, padding not counted", 0.7, traced.made.atlas.coverage, "of 1", _charts(traced)
        ),
        *mip_rows(name, traced),
        *seam_rows(name, traced, fit),
    ]


def mip_rows(name: str, traced: Traced) -> list[Row]:
    """Coverage with the padding that a mip level takes."""
    from lightwell.scenes.atlas import build

    sides = traced.sides
    try:
        atlas = build(traced.scene, traced.effort.size, sides.lit, 1, dark=sides.dark)
    except ValueError:
        return []
    return [without_bar(f"{name}: atlas coverage with padding for mip 1", atlas.coverage, "of 1")]


def seam_rows(name: str, traced: Traced, fit: LightmapFit) -> list[Row]:
    """What samples on seams do to the step across them."""
    if traced.eyes is traced.without_seams or not fit.preset.hidden:
        return []
    other = learned(traced, fit.preset, traced.without_seams)
    gaps = [seam_gap(traced.scene, traced.made, Baked(f.lower()), f.unit, 11) for f in (fit, other)]
    note = f"mean step over mean light {gaps[0]:.4f}, without samples on seams {gaps[1]:.4f}"
    return [
        at_most(
            f"{name}: step across smooth seams, trained with samples on them over without",
            1,
            gaps[0] / max(gaps[1], 1e-9),
            "ratio",
            note,
        )
    ]


STYLE = """
body { margin: 0; background: #fff; font: 12px system-ui, sans-serif; } svg { width: 840px; }
text { fill: #444; font-size: 10px; }
.title { font-size: 11px; fill: #000; } .grid { stroke: #e4e4e4; } .axis { stroke: #999; }
.front { fill: none; stroke: #999; } .tone-0 { fill: #c8501e; } .tone-1 { fill: #3a6ea5; }
"""
CURVE = Path(__file__).parent / "results" / "neural_lightmap_curve.json"


def remember(name: str, figures: dict[str, Figures]) -> None:
    """Keep the points of the plot."""
    found = json.loads(CURVE.read_text()) if CURVE.exists() else {}
    found[name] = {label: {"bytes": f.bytes, "dB": round(float(f.corrected), 3)} for label, f in figures.items()}
    CURVE.write_text(json.dumps(found, indent=1) + "\n")


# Scenes with glossy surfaces must gain 6 dB, the others must not lose.
GAIN = {"room-soft-shadows": 0, "godot-living-room": 0, "staircase2": 6, "courtyard": 0}


def _charts(traced: Traced) -> str:
    atlas = traced.made.atlas
    return f"{atlas.charts} charts, {atlas.size} x {atlas.size}, mips 0 to {atlas.mips} do not mix them"


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


def pending(quick: bool) -> list[Row]:
    """What the issue asks and nobody has measured yet: rows without a figure, so that they are not forgotten."""
    note = "not measured yet"
    return [
        at_most("page: frame time over that of the ordinary light map, headless Chromium", 2.5, None, "ratio", note),
        at_most("shading at 1080p on a GPU", 0.3, None, "ms", note),
        at_least("specular moves: correlation of image gradients with respect to the camera", 0.9, None, "", note),
    ]


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
    """The least of our path counts, doubled from 2, that is as good as Cycles with ``count`` samples."""
    from lightwell.transport.irradiance import irradiance

    script = Path(__file__).with_name("lightmap_blender.py")
    run = lambda *a: subprocess.run([python, script, *a], check=True, capture_output=True, text=True).stdout  # noqa: E731
    run("export", folder / "room.glb")
    scene = load(str(folder / "room.glb"))
    made = chart(scene, size, 0, 4, 0)
    fit = LightmapFit(PRESETS["plain"], size, 1.0, encode(stored(made.image), "png"))
    charted = replace(scene, meshes=charted_meshes(scene, made.atlas))
    write_glb(folder / "uv.glb", charted, [FieldEntry("light", "static", fit.lower(), None, fit.pictures)], [])
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
    while True:
        irradiance(scene, points, paths, 2)
        start = perf_counter()
        light = irradiance(scene, points, paths, 3).mean.mean(axis=1)
        took = perf_counter() - start
        if error(light, truth) <= wanted or paths >= 1024:
            break
        paths *= 2
    apart = float(np.median(np.abs(ratio[both] / np.median(ratio[both]) - 1)))
    return SideBySide(seconds[count], wanted, took, error(light, truth), paths, apart)


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
    from lightwell.bake.lightmap_media import media_meshes, volumetric
    from lightwell.transport.camera import gbuffer
    from lightwell.transport.mapped import mapped_query

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
    halves = [
        metrics.display(half / fits["ours"].unit) for half in volumetric(scene, seen, effort.view_paths, HELD_OUT)
    ]
    decibels = lambda mse: float(-10 * np.log10(max(mse, 1e-10)))  # noqa: E731
    found = {}
    for name, fit in fits.items():
        shown = metrics.display(Baked(fit.lower())(mapped_query(scene, made.atlas, seen)) / fit.unit)
        found[name] = decibels(np.mean((shown - halves[0]) * (shown - halves[1])))
    ceiling = decibels(np.mean((halves[0] - halves[1]) ** 2) / 4)
    size = sum(len(picture.data) for picture in fits["ours"].pictures.values())
    note = (
        f"noise taken off; ordinary light map {found['plain']:.1f} dB, truth itself {ceiling:.1f} dB, textures {size} B"
    )
    return [at_least("subsurface surfaces: PSNR", 38, found["ours"], "dB", note)]


def web(quick: bool) -> list[Row]:
    """What the page weighs."""
    import lightmap_web

    return [] if quick else lightmap_web.bundle_rows()


def curve(plot: bool) -> list[Row]:
    """PSNR over bytes of what the scenes' parts have remembered."""
    if not plot or not CURVE.exists():
        return []
    from lightwell.report.charts import Axis
    from lightwell.report.scatter import Point, scatter_chart

    error = Axis("error of the screen, RMS (1 % is 40 dB)", lambda v: f"{v:.1%}", log=True)
    size = Axis("bytes", lambda v: f"{v / 1e3:g} k", log=True)
    marked = [
        Point(f"{name} {label}", p["bytes"], 10 ** (-p["dB"] / 20), "tone-0" if label == "default" else "tone-1")
        for name, labels in json.loads(CURVE.read_text()).items()
        for label, p in labels.items()
    ]
    chart_ = scatter_chart(marked, size, error, "Error of held-out views over bytes")
    folder = Path(tempfile.mkdtemp())
    (folder / "curve.html").write_text(
        f"<!doctype html><meta charset=utf-8><style>{STYLE}</style><main>{chart_}</main>"
    )
    path = Path(__file__).resolve().parents[1] / "docs" / "images" / "lightmap-curve.png"
    tool = Path(__file__).resolve().parents[1] / "tools" / "find-chromium.sh"
    browser = subprocess.run(["sh", tool], capture_output=True, text=True).stdout.strip() or "chromium"
    options = ["--headless", "--no-sandbox", "--hide-scrollbars", "--window-size=860,520", f"--screenshot={path}"]
    subprocess.run([browser, *options, str(folder / "curve.html")], check=True, capture_output=True, timeout=120)
    print(f"wrote {path}")
    return []


def missing(quick: bool) -> list[Row]:
    """Rows that nobody has measured yet."""
    return [*(row for name in SCENES for row in unmeasured(name)), *pending(quick)]


PARTS = {
    "leak": leak,
    "pending": missing,
    "cycles": cycles,
    "codecs": codecs,
    "subsurface": subsurface,
    "web": web,
    "curve": curve,
}


def unmeasured(name: str) -> list[Row]:
    """The rows of a scene, empty."""
    what, note = f"{name}, default at no more than 1 MB: ", "not measured yet"
    return [
        at_least(what + "PSNR", 40, None, "dB", note),
        at_most(what + "FLIP", 0.05, None, "of 1", note),
        at_most(what + "bytes", MEGABYTE, None, "B", note),
        at_least(f"{name}: atlas coverage, padding not counted", 0.7, None, "of 1", note),
    ]


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--ablate", action="store_true")
    parser.add_argument("--plot", action="store_true", help="of curve: draw it")
    parser.add_argument("--only", default="", help=f"parts, comma-separated: {','.join([*SCENES, *PARTS])}")
    arguments = parser.parse_args()
    parts = arguments.only.split(",") if arguments.only else [*PARTS, *SCENES]
    if arguments.quick and not arguments.only:
        SCENES["courtyard"] = "two-rooms"
        parts = ["leak", "courtyard", "subsurface"]
    for part in parts:
        if part in SCENES:
            rows = scene_rows(part, arguments.quick, arguments.ablate)
        elif part == "curve":
            rows = curve(arguments.plot)
        elif part in PARTS:
            rows = PARTS[part](arguments.quick)
        else:
            parser.error(f"no part '{part}'; choose some of {', '.join([*SCENES, *PARTS])}")
        publish("neural_lightmap", rows, arguments.quick)


if __name__ == "__main__":
    main()
