"""Light maps of the given scenes: traced once, fitted, and scored on held-out views from the graphs that ship.

The truth of the views is kept under out/references, because it takes longer than all else.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

import numpy as np
from rows import Row, at_least, at_most, without_bar

from lightwell.baking.evaluate import view_name
from lightwell.baking.reference_budget import EVALUATION_SEED
from lightwell.core.color import display
from lightwell.fields.baked import Baked
from lightwell.fields.lightmap.fit import PRESETS, LightmapFit, LightmapPreset
from lightwell.fields.lightmap.fitting import STARTS, base_picture, fitted, sample_unit
from lightwell.fields.lightmap.seams import SHARE, seam_pairs, seam_samples
from lightwell.fields.lightmap.sides import TriangleSides, lit_scene, lit_sides
from lightwell.fields.lightmap.size_limit import CODECS
from lightwell.fields.lightmap.square import atlas_of, roomy_atlas
from lightwell.fields.lightmap.trace import AtlasIrradiance, chart
from lightwell.fields.lightmap.views import ViewSamples, eye_samples
from lightwell.report.picture_metrics import flip
from lightwell.report.records import ViewComparison
from lightwell.scenes import load
from lightwell.scenes.atlas import Atlas
from lightwell.scenes.placing import sample_cameras
from lightwell.scenes.scene import Camera, Scene
from lightwell.scenes.variables import declare
from lightwell.transport.camera import gbuffer
from lightwell.transport.lightmap_query import query_of_lightmap
from lightwell.transport.radiance import static
from lightwell.transport.tables import tables

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
PICTURES = Path(__file__).resolve().parents[1] / "docs" / "images"
REFERENCES = Path(__file__).resolve().parents[1] / "out" / "references"


@dataclass(frozen=True)
class Effort:
    """How much is traced."""

    size: int = 1024
    paths: int = 128
    eyes: int = 400_000
    eye_paths: int = 8
    views: int = 3
    view_paths: int = 4096
    """What a screen shows of noisy halves is darker than what it shows of their mean: with 384 paths staircase2's light
    map seems 0.3 dB worse."""
    view_size: tuple[int, int] = (192, 120)
    steps: int = 6000
    """Of three starts together."""


QUICK = Effort(128, 4, 1 << 12, 4, 1, 8, (48, 30), 20)
# Mip level up to which the atlases of the scenes keep charts apart.
MIPS = 0


@dataclass(frozen=True)
class Traced:
    """A scene, traced once."""

    made: AtlasIrradiance
    eyes: ViewSamples
    without_seams: ViewSamples
    truth: list
    scene: object
    effort: Effort
    seconds: float
    sides: TriangleSides


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


def compare_camera(
    scene: Scene,
    atlas: Atlas,
    baked: dict[str, Baked],
    camera: Camera,
    size: tuple[int, int],
    paths: int,
    number: int = 0,
) -> ViewComparison:
    """One held-out picture of the scene's own light, emission left out: what is baked beside the reference."""
    points, mask, _ = gbuffer(scene, camera, *size)
    seen = np.flatnonzero(mask)
    a, b = static(scene, points[seen], paths, EVALUATION_SEED + number)
    images = np.zeros((3, size[0] * size[1], 3), np.float32)
    images[0, seen] = sum(field(query_of_lightmap(scene, atlas, points[seen])) for field in baked.values())
    images[1:, seen] = np.nan_to_num(a), np.nan_to_num(b)
    prediction, half_a, half_b = images.reshape(3, size[1], size[0], 3)
    return ViewComparison(view_name(camera, number), prediction, half_a, half_b, caption="the scene's own light")


def trace(source, effort: Effort) -> Traced:
    """Light at texels, samples of eyes, held-out cameras."""
    start = perf_counter()
    scene, _ = lit_scene(load(str(source)))
    sides = lit_sides(scene, 0)
    atlas = roomy_atlas(scene, effort.size, MIPS, sides).first
    # The same paths altogether, whatever the size of the square.
    paths = max(effort.paths * effort.size**2 // atlas.size**2 // 2 * 2, 4)
    made = chart(scene, atlas.size, MIPS, paths, 0, sides=sides, atlas=atlas)
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
        from lightwell.transport.lightmap_query import query_of_lightmap

        width, height = traced.effort.view_size
        dark = {"static": Baked(constant_graph())}
        self.queries, self.seen, self.views, self.shapes, self.glass = [], [], [], [], []
        glass = tables(traced.scene).clear
        for k, camera in enumerate(traced.truth):
            options = (traced.effort.view_size, traced.effort.view_paths, k)
            view = kept_view(traced, dark, camera, options)
            points, mask, _ = gbuffer(traced.scene, camera, width, height)
            seen = np.flatnonzero(mask)
            self.glass.append(glass[points.shape[seen]])
            self.views.append(view)
            self.seen.append(seen)
            self.shapes.append(points.shape[seen])
            self.queries.append(query_of_lightmap(traced.scene, traced.made.atlas, points[seen]))

    @property
    def glass_share(self) -> float:
        """Share of the pixels that show clear glass."""
        return float(np.concatenate(self.glass).mean())

    def draw(self, fits: tuple[LightmapFit, ...], path: Path) -> None:
        """What the fits show, then the truth, side by side; a row for every view."""
        from PIL import Image

        rows = []
        for view, seen, query in zip(self.views, self.seen, self.queries):
            shape, shown = view.half_a.shape, []
            for fit in fits:
                picture = np.zeros((view.half_a.size // 3, 3), np.float32)
                picture[seen] = Baked(fit.lower())(query)
                shown.append(picture.reshape(shape))
            shown.append(0.5 * (view.half_a + view.half_b))
            rows.append(np.concatenate([display(p / fits[0].unit) for p in shown], axis=1))
        image = Image.fromarray((255 * np.clip(np.concatenate(rows), 0, 1) + 0.5).astype(np.uint8))
        image.resize((2 * image.width, 2 * image.height), Image.Resampling.NEAREST).save(path)

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


def kept_view(traced: Traced, dark: dict[str, Baked], camera, options) -> ViewComparison:
    """The truth of a view, traced or from out/references; a changed scene, camera or effort is another file."""
    source = str(traced.scene.source)
    content = Path(source).read_bytes() if Path(source).is_file() else source.encode()
    key = hashlib.sha256(content + repr((camera, options)).encode()).hexdigest()[:20]
    path = REFERENCES / f"lightmap-{key}.npz"
    if path.exists():
        with np.load(path, allow_pickle=False) as kept:
            a, b = kept["half_a"], kept["half_b"]
        return ViewComparison(f"view {options[2]}", np.zeros_like(a), a, b)
    view = compare_camera(traced.scene, traced.made.atlas, dark, camera, *options)
    if traced.effort is not QUICK:
        REFERENCES.mkdir(parents=True, exist_ok=True)
        with open(path.with_suffix(".part"), "wb") as stream:
            np.savez(stream, half_a=view.half_a, half_b=view.half_b)
        path.with_suffix(".part").replace(path)
    return view


def constant_graph():
    """No light at all, to trace the truth beside."""
    from lightwell.graph import Builder

    b = Builder(reflectance=3)
    return b.build(radiance=b.scale("reflectance", 0.0))


def _view_figures(view: ViewComparison, picture: np.ndarray, seen: np.ndarray, unit: float) -> tuple[float, ...]:
    shape = view.half_a.shape
    a, b, f = (np.asarray(x, np.float64).reshape(-1, 3) / unit for x in (view.half_a, view.half_b, picture))
    shown = {name: display(x[seen]) for name, x in (("a", a), ("b", b), ("y", (a + b) / 2), ("f", f))}
    decibels = lambda mse: float(-10 * np.log10(max(mse, 1e-10)))  # noqa: E731
    return (
        decibels(np.mean((shown["f"] - shown["y"]) ** 2)),
        decibels(np.mean((shown["f"] - shown["a"]) * (shown["f"] - shown["b"]))),
        decibels(np.mean((shown["a"] - shown["b"]) ** 2) / 4),
        flip(f.reshape(shape), ((a + b) / 2).reshape(shape)),
    )


def learned(traced: Traced, preset: LightmapPreset, eyes: ViewSamples | None = None) -> LightmapFit:
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
    texels = replace(d, surface=(), share=1 / 16, channels=6)
    return {
        "texels learned one by one": texels,
        "the same, knows E' and directions": replace(texels, inputs="reflected", hidden=(24, 24)),
        "no features": replace(d, channels=0),
        "no directions": replace(d, direction=False),
        "no directions, no features": replace(d, direction=False, channels=0),
        "features at 1/8": replace(d, share=1 / 8),
        "six channels": replace(d, channels=6),
        "twelve channels": replace(d, channels=12),
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


def scene_rows(name: str, quick: bool, ablate: bool, pictures: bool = False) -> list[Row]:
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
    default = chosen_bytes(traced) if traced.made.glossy.any() else PRESETS["plain"]
    fit = learned(traced, default)
    ours = measured(traced, views, default, "default", fit)
    plain = {c: measured(traced, views, replace(PRESETS["plain"], base=c), f"plain {c}") for c in PLAIN_CODECS}
    directional = measured(traced, views, PRESETS["directional"], "directional")
    if pictures:
        ordinary = learned(traced, replace(PRESETS["plain"], base="webp90"))
        views.draw((ordinary, fit), PICTURES / f"lightmap-{name}.png")
    if ablate:
        for label, preset in variants().items():
            measured(traced, views, preset, label)
    fitting = [f for f in plain.values() if f.bytes <= ours.bytes] or [min(plain.values(), key=lambda f: f.bytes)]
    best = max([*fitting, *([directional] if directional.bytes <= ours.bytes else [])], key=lambda f: f.corrected)
    note = (
        f"{traced.made.atlas.size} squared, {effort.views} held-out views, truth itself {ours.ceiling:.1f} dB, "
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
        *seam_rows(name, traced, fit, default),
        *moving_rows(name, traced, views, fit),
    ]


def chosen_bytes(traced: Traced) -> LightmapPreset:
    """The default preset, its ordinary light map by the finest codec that leaves half of a megabyte to the features."""
    unit, default = sample_unit(traced.eyes), PRESETS["default"]
    for codec in CODECS:
        preset = replace(default, base=codec)
        if len(base_picture(traced.made, unit, preset).data) <= MEGABYTE / 2:
            return preset
    return default


def mip_rows(name: str, traced: Traced) -> list[Row]:
    """Coverage with the padding that a mip level takes."""
    sides = traced.sides
    try:
        atlas = atlas_of(traced.scene, traced.made.atlas.size, 1, sides)
    except ValueError:
        return []
    return [without_bar(f"{name}: atlas coverage with padding for mip 1", atlas.coverage, "of 1")]


# The eye steps aside by this share of its distance; surfaces as glossy as this count; paths and points of the truth.
ASIDE, GLOSSY, MOVED_PATHS, MOVED_POINTS = 0.05, 0.35, 512, 3000


def moving_rows(name: str, traced: Traced, views: Views, fit: LightmapFit) -> list[Row]:
    """Whether gloss moves as it should when the eye steps aside: points of held-out views stay, their views turn."""
    from lightwell.transport.camera import gbuffer
    from lightwell.transport.lightmap_query import query_of_lightmap
    from lightwell.transport.queries import frames
    from lightwell.transport.radiance import static
    from lightwell.transport.samples import SurfacePoints

    steps, baked, effort = [], Baked(fit.lower()), traced.effort
    for k, camera in enumerate(traced.truth):
        points, mask, _ = gbuffer(traced.scene, camera, *effort.view_size)
        points = points[np.flatnonzero(mask)]
        query = query_of_lightmap(traced.scene, traced.made.atlas, points)
        shiny = (query.roughness[:, 0] < GLOSSY) & ~tables(traced.scene).clear[points.shape]
        rows = np.flatnonzero(shiny)
        if not len(rows):
            continue
        rows = np.random.default_rng(k).permutation(rows)[: MOVED_POINTS if effort is not QUICK else 50]
        points = points[rows]
        position, eye = frames(traced.scene, points)[0], np.float32(camera.position)
        aside = np.cross(np.float32(camera.target) - eye, np.float32(camera.up))
        distance = np.linalg.norm(eye - position, axis=1, keepdims=True)
        view = eye + ASIDE * distance * aside / np.linalg.norm(aside) - position
        view = (view / np.linalg.norm(view, axis=1, keepdims=True)).astype(np.float32)
        turned = SurfacePoints(points.shape, points.triangle, points.barycentric, view)
        shown = []
        for at in (points, turned):
            # One seed for both places of the eye: what their noise has in common cancels.
            halves = static(traced.scene, at, MOVED_PATHS if effort is not QUICK else 8, 31 + k)
            learned_ = baked(query_of_lightmap(traced.scene, traced.made.atlas, at))
            shown.append([display(np.nan_to_num(v) / fit.unit) for v in (learned_, *halves)])
        steps.append(np.stack(shown[1]) - np.stack(shown[0]))
    what = f"{name}: specular moves: correlation of image gradients with respect to the camera"
    if not steps:
        return []
    f, a, b = np.concatenate(steps, axis=1)
    truth, spread = float((a * b).mean()), float((a * b).std() / np.sqrt(a.size))
    if truth < 3 * spread:
        return [at_least(what, 0.9, None, "", "the step of the truth is lost in its noise")]
    found = float((f * (a + b)).mean() / 2 / np.sqrt(max((f * f).mean() * truth, 1e-20)))
    note = f"{f.shape[0]} points of roughness under {GLOSSY}; the step learned over that of the truth "
    note += f"{float(np.sqrt((f * f).mean() / max(truth, 1e-12))):.2f}, noise taken off"
    return [at_least(what, 0.9, found, "", note)]


def _seam_gap(traced: Traced, field: Baked, unit: float) -> float:
    """Mean difference |L₁ − L₂| across seams where light is continuous, relative to the mean of both."""
    pairs = seam_pairs(traced.scene, traced.made, 1 << 13, 11)
    if pairs is None:
        return 0.0
    sides = (query_of_lightmap(traced.scene, traced.made.atlas, points) for points in (pairs.one, pairs.two))
    one, two = (field(query) / unit for query in sides)
    return float(np.abs(one - two).mean() / max(0.5 * (one + two).mean(), 1e-9))


def seam_rows(name: str, traced: Traced, fit: LightmapFit, preset: LightmapPreset) -> list[Row]:
    """What samples on seams do to the step across them."""
    if traced.eyes is traced.without_seams or not fit.preset.hidden:
        return []
    # One start each is enough to see what the samples do.
    steps = traced.effort.steps // STARTS
    other = fitted(traced.scene, traced.made, traced.without_seams, preset, 0, steps)
    gaps = [_seam_gap(traced, Baked(f.lower()), f.unit) for f in (fit, other)]
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
