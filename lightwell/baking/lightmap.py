"""The bake of a light map: atlas, light that arrives, light that leaves towards eyes, network, files, report."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from lightwell.asset.page import write_page
from lightwell.asset.records import Fallback, FieldEntry
from lightwell.asset.write import write_glb
from lightwell.baking.evaluate import Baked
from lightwell.baking.lightmap_bytes import choose
from lightwell.baking.lightmap_moving import moving_fit, moving_samples
from lightwell.baking.lightmap_resume import kept_counts, kept_eyes, kept_light, kept_sides
from lightwell.baking.lightmap_score import LightmapStage, score_lightmap, stage_of
from lightwell.baking.lightmap_seams import SHARE as SEAM_SHARE
from lightwell.baking.lightmap_seams import seam_samples
from lightwell.baking.lightmap_size import roomy_atlas
from lightwell.baking.lightmap_trace import (
    Chart,
    EyeSamples,
    Sides,
    chart,
    direction_image,
    eye_samples,
    lit_scene,
    lit_sides,
    mask_image,
    reduced,
    seen_sides,
)
from lightwell.baking.progress import Progress
from lightwell.baking.settings import BakeSettings
from lightwell.baking.work import Work, check_output
from lightwell.core.denoise import missing
from lightwell.fields.base import FieldSetup, radiance_unit
from lightwell.fields.lightmap import PRESETS, LightmapFit, LightmapPreset
from lightwell.fields.lightmap_graph import stored
from lightwell.graph.pictures import Picture, encode
from lightwell.report.html import write_report
from lightwell.report.metrics import display
from lightwell.scenes import load
from lightwell.scenes.atlas import Atlas, build, charted_meshes
from lightwell.scenes.normal_maps import relief
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable, declare
from lightwell.transport.samples import Samples

# Shares of the budget: light at texels, samples of eyes; the rest trains.
TEXEL_SHARE, EYE_SHARE = 0.45, 0.3
# Texels and paths that time the tracer; bounds of the paths per texel.
TIMED_PATHS, FEWEST_PATHS, MOST_PATHS = 4, 8, 4096
# Edge of the features of a larger atlas, relative to those of one of the usual size.
FINER = 1.5
# An atlas is not made larger for its small charts where its texels would get fewer paths than this.
ROOMY_PATHS = 32
# Paths per eye sample, and bounds of their number.
EYE_PATHS, FEWEST_EYES, MOST_EYES = 8, 1 << 12, 1 << 20
# Eye samples that judge whether the network is better than none.
HELD = 1 << 13
# Trainings from different starts, of which the best on held-out samples is taken; each has at least so many steps.
STARTS, ENOUGH_STEPS, START_SEED = 3, 800, 0x10001
# Eye samples of one of ``--shards``.
SHARD = 1 << 16
# What a training step of 2^14 rows takes on two cores, and the fewest steps.
STEP_SECONDS, LEAST_STEPS = 0.04, 200
# Edge of the fallback, and of the light that it is made from where there is no ordinary light map.
FALLBACK_SIZE, COARSE = 512, 1024
FALLBACK_CODEC = "jpeg90"
# The brightest irradiance of the fallback, as a quantile of all texels: bytes are not spent on a few highlights.
FALLBACK_QUANTILE = 0.999


@dataclass(frozen=True)
class LightmapPlan:
    """Counts that a budget buys."""

    size: int
    texel_paths: int
    eye_samples: int
    eye_paths: int
    steps: int


def bake_lightmap(settings: BakeSettings, progress: Progress | None = None) -> dict[str, Any]:
    """Bake SCENE with ``--field lightmap``; returns the content of ``report.json``."""
    progress = progress or Progress(quiet=True)
    preset = preset_of(settings.preset)
    scene, note = _scene(settings, progress)
    variable = declare(settings.vary, scene) if settings.vary else None
    work = Work(settings)
    work.open(scene)
    with work.timed("trace"):
        made, samples, moving = _trace(scene, variable, settings, preset, work.part("lightmap"), progress)
    size = settings.size or max(preset.size, made.atlas.size)
    progress.say(
        f"atlas: {made.atlas.charts} charts, {made.atlas.coverage:.0%} of {size} x {size}, {made.atlas.origin}"
    )
    if preset.hidden and not made.glossy.any() and scene.has_static_light:
        progress.say("every surface looks the same from everywhere: no network is needed, the light map is plain")
        preset = replace(preset, hidden=(), channels=0, direction=False)
    if settings.max_bytes and samples is not None:
        trial = lambda p, s, n: fitted(scene, made, s, p, settings.seed, n)  # noqa: E731
        preset = choose(settings.max_bytes, preset, made, samples, trial, progress.say)
    steps, fits = _steps(settings, preset), {}
    with work.timed("train"), progress.stage("train light map", 2, "") as stage:
        if scene.has_static_light:
            folder = work.part("lightmap")
            fits["static"] = fitted(scene, made, samples, preset, settings.seed, steps, folder=folder, size=size)
            if preset.hidden and not fits["static"].preset.hidden:
                progress.say("the network was no better than none on held-out samples: the light map is plain")
        stage.advance()
        if moving is not None:
            unit, count = sample_unit(moving), settings.steps or max(steps, LEAST_STEPS)
            fits["indirect"] = moving_fit(scene, made.atlas, variable, moving, unit, settings.seed, count)
        stage.advance()
    with work.timed("write"):
        stage_ = stage_of(scene, variable, settings, fits)
        _write_asset(scene, made, fits, stage_, settings)
    with work.timed("evaluate"):
        score = score_lightmap(scene, made.atlas, fits, stage_, settings, progress)
    facts = {
        "atlas": atlas_facts(made),
        "textures": {r: {k: len(p.data) for k, p in f.pictures.items()} for r, f in fits.items()},
    }
    seconds = {name: round(value, 3) for name, value in work.seconds.items()}
    data = replace(
        score.data, seconds=seconds, warnings=[*scene.warnings, *filter(None, [missing(), note])], facts=facts
    )
    report = _write_pages(scene, settings, data, score)
    work.close()
    progress.say(_verdict(report, settings))
    return report


def _scene(settings: BakeSettings, progress: Progress) -> tuple[Scene, str]:
    """The scene, with a light where it has none and none was declared, and what was done."""
    scene = load(settings.scene, limits=settings.limits, unit=settings.unit, allow_paths=settings.allow_paths)
    if not scene.meshes or not sum(len(mesh.indices) for mesh in scene.meshes):
        raise ValueError(f"bake: scene '{scene.source}' has no triangles; nothing can be lit")
    check_output(settings.out)
    scene, note = (scene, "") if settings.vary else lit_scene(scene)
    if note:
        progress.say(f"[yellow]warning[/] {note}")
    return scene, note


def preset_of(name: str) -> LightmapPreset:
    """ValueError for an unknown name."""
    if name not in PRESETS:
        raise ValueError(
            f"bake: field 'lightmap' has no preset '{name}'; choose one of {', '.join(PRESETS)} with --preset"
        )
    return PRESETS[name]


def _steps(settings: BakeSettings, preset: LightmapPreset) -> int:
    if not preset.hidden:
        return 0
    if settings.steps:
        return settings.steps
    # The number depends on the budget alone, so that it is the same on every machine.
    return max(int((1 - TEXEL_SHARE - EYE_SHARE) * settings.budget.round_seconds / STEP_SECONDS), LEAST_STEPS)


# ---------------------------------------------------------------------- trace


def _trace(
    scene: Scene,
    variable: Variable | None,
    settings: BakeSettings,
    preset: LightmapPreset,
    folder: Path,
    progress: Progress,
) -> tuple[Chart, EyeSamples | None, EyeSamples | None]:
    """The atlas with its light, samples of the still light, samples of the moving one."""
    still = moving = None
    with progress.stage("trace light map", 4, "") as stage:
        # A light that moves may come to every side that is seen.
        look = lit_sides if variable is None else seen_sides
        sides = kept_sides(folder / "sides.npz", lambda: look(scene, settings.seed))
        atlas = _atlas(scene, settings, preset, sides)
        size, seed = atlas.size, settings.seed
        first = None if settings.shards else chart(scene, size, settings.mips, TIMED_PATHS, seed, atlas=atlas)
        stage.advance(note="atlas")
        paths, eyes = kept_counts(folder / "counts.npz", lambda: _counts(first, scene, settings, preset))
        if first is not None and paths < ROOMY_PATHS and atlas.size > (settings.size or preset.size):
            # Texels that are too noisy to be denoised are no room.
            atlas = build(scene, atlas.size // 2, sides.lit, settings.mips, dark=sides.dark, faint=sides.faint)
            size, paths = atlas.size, 4 * paths
        per_texel = paths if scene.has_static_light else TIMED_PATHS
        keep = lambda make: kept_light(folder / "light.npz", make)  # noqa: E731
        made = chart(scene, size, settings.mips, per_texel, seed, keep=keep, atlas=atlas)
        stage.advance(note=f"{paths} paths per texel")
        if scene.has_static_light:
            still = kept_eyes(folder / "eyes.npz", lambda: _still_samples(scene, made, eyes, preset, settings.seed))
        stage.advance(note=f"{eyes} eye samples")
        if variable is not None:
            make = lambda: moving_samples(scene, made.atlas, variable, eyes, EYE_PATHS, settings.seed + 6)  # noqa: E731
            moving = kept_eyes(folder / "moving.npz", make)
        stage.advance()
    return made, still, moving


def _atlas(scene: Scene, settings: BakeSettings, preset: LightmapPreset, sides: Sides) -> Atlas:
    """The atlas. Without an ordinary light map, the light that arrives is for the fallback alone: traced coarsely."""
    size = settings.size or preset.size
    if preset.base and not settings.size:
        return roomy_atlas(scene, size, settings.mips, sides)
    atlas = build(scene, size, sides.lit, settings.mips, dark=sides.dark, faint=sides.faint)
    return atlas if preset.base else replace(atlas, size=min(size, COARSE))


def _still_samples(scene: Scene, made: Chart, count: int, preset: LightmapPreset, seed: int) -> EyeSamples:
    """Eye samples, a tenth of them on seams."""
    samples = eye_samples(scene, made, count, EYE_PATHS, seed + 5, made.image if preset.base else None)
    across = None
    if preset.base and preset.hidden:
        across = seam_samples(scene, made, made.image, int(SEAM_SHARE * count), EYE_PATHS, seed + 7)
    return samples if across is None else samples + across


def _counts(first: Chart | None, scene: Scene, settings: BakeSettings, preset: LightmapPreset) -> tuple[int, int]:
    """Paths per texel and eye samples; fixed where the settings give ``--shards``."""
    if first is None:
        return settings.paths, settings.shards * SHARD
    from lightwell.transport.irradiance import irradiance

    start = perf_counter()
    probe = first.texels.points[np.arange(0, len(first.texels.index), 8)]
    irradiance(scene, probe, TIMED_PATHS, settings.seed + 9)
    rate = len(probe) * TIMED_PATHS / max(perf_counter() - start, 1e-6)
    seconds = settings.budget.round_seconds
    share = TEXEL_SHARE if preset.base else 0.02
    paths = int(np.clip(share * seconds * rate / len(first.texels.index), FEWEST_PATHS, MOST_PATHS)) // 2 * 2
    eye_share = EYE_SHARE + TEXEL_SHARE - share if preset.hidden else 0.0
    return paths, int(np.clip(eye_share * seconds * rate / EYE_PATHS, FEWEST_EYES, MOST_EYES))


# ---------------------------------------------------------------------- fit


def fitted(
    scene: Scene,
    made: Chart,
    samples: EyeSamples,
    preset: LightmapPreset,
    seed: int,
    steps: int,
    progress=None,
    folder: Path | None = None,
    size: int | None = None,
) -> LightmapFit:
    """Pictures of the light that arrives, and the trained network; ``size`` of the features' atlas where it differs."""
    size = size or made.atlas.size
    if preset.base and size > preset.size:
        # A larger atlas is for small charts, which share fewer texels of features then; directions stay as they are.
        factor = size // preset.size
        coarser = preset.direction_reduction * factor
        preset = replace(preset, share=FINER * preset.share / factor, direction_reduction=coarser)
    bumpy = bool(relief(scene).any())
    if bumpy and preset.inputs == "mirror" and preset.direction:
        # Where normals are bent, the network reads where the light comes from: leaning towards it is what bumps do.
        preset = replace(preset, inputs="reflected")
    unit = sample_unit(samples)
    base = base_picture(made, unit, preset) if preset.base else None
    direction = direction_picture(made, preset.direction_reduction) if preset.direction else None
    mask = encode(mask_image(made), "webp", made.atlas.mips) if preset.base else None
    setup = FieldSetup.of(scene, unit, "static")
    extra: dict[str, Any] = {"mips": made.atlas.mips, "setup": setup, "mask": mask, "relief": bumpy}
    start = lambda k: LightmapFit(preset, size, unit, base, direction, seed + k * START_SEED, **extra)  # noqa: E731
    if not (preset.base and preset.hidden):
        fit = start(0)
        fit.train(samples.query, samples.radiance, samples.weight, steps, progress, folder)
        return fit
    held = np.random.default_rng([seed, 0x6A7E]).random(len(samples.weight)) < min(HELD / len(samples.weight), 0.1)
    seen, judged = samples[np.flatnonzero(~held)], samples[np.flatnonzero(held & (samples.weight > 0))]
    starts = int(np.clip(steps // ENOUGH_STEPS, 1, STARTS)) if len(judged.weight) else 1
    fits = []
    for k in range(starts):
        fits.append(start(k))
        own = None if folder is None else folder / f"start{k}"
        fits[k].train(seen.query, seen.radiance, seen.weight, steps // starts, progress, own)
    if not len(judged.weight):
        return fits[0]
    plain = replace(fits[0], preset=replace(PRESETS["plain"], base=preset.base), direction=None)
    return min([*fits, plain], key=lambda fit: shown_error(fit, judged))


def shown_error(fit: LightmapFit, samples: EyeSamples) -> float:
    """Mean squared error of what a screen shows, without the noise of the samples."""
    f, a, b = (display(v / fit.unit) for v in (Baked(fit.lower())(samples.query), samples.half_a, samples.half_b))
    return float(np.average(((f - a) * (f - b)).mean(axis=1), weights=samples.weight))


def base_picture(made: Chart, unit: float, preset: LightmapPreset) -> Picture:
    """E' in the curve of a screen."""
    image = reduced(made.image, preset.base_reduction) if preset.base_reduction > 1 else made.image
    mips = max(made.atlas.mips - int(np.log2(preset.base_reduction)), 0)
    return encode(stored(image / unit), preset.base, mips)


def sample_unit(samples: EyeSamples) -> float:
    """S = 4 x the mean radiance."""
    shape = np.zeros(len(samples.weight), np.uint32)
    return radiance_unit(Samples(samples.query, samples.half_a, samples.half_b, samples.weight, shape))


def direction_picture(made: Chart, reduction: int) -> Picture:
    """The dominant direction as bytes, at a lower resolution."""
    small = reduced(direction_image(made), min(reduction, made.atlas.size))
    mips = max(made.atlas.mips - int(np.log2(reduction)), 0)
    return encode(np.floor(127.5 * (np.clip(small, -1, 1) + 1) + 0.5).astype(np.uint8), "webp", mips)


# ---------------------------------------------------------------------- write


def _write_asset(
    scene: Scene, made: Chart, fits: dict[str, LightmapFit], stage: LightmapStage, settings: BakeSettings
) -> int:
    entries = [
        FieldEntry(f"lightmap {role}", role, fit.lower(), 0 if role == "indirect" else None, fit.pictures)
        for role, fit in fits.items()
    ]
    charted = replace(scene, meshes=charted_meshes(scene, made.atlas), lights=[])
    ordinary = fallback(made) if "static" in fits else None
    return write_glb(settings.out / "scene.glb", charted, entries, stage.variables, fallback=ordinary)


def fallback(made: Chart) -> Fallback:
    """Linear irradiance for viewers that know MOZ_lightmap only."""
    image = made.image
    factor = max(made.atlas.size // FALLBACK_SIZE, 1)
    irradiance = np.pi * reduced(image, factor)
    top = max(float(np.quantile(irradiance, FALLBACK_QUANTILE)), 1e-6)
    texels = np.floor(255 * np.clip(irradiance / top, 0, 1) + 0.5).astype(np.uint8)
    return Fallback(encode(texels, FALLBACK_CODEC), top)


def atlas_facts(made: Chart) -> dict[str, Any]:
    """What the report says of the atlas."""
    atlas = made.atlas
    return {
        "origin": atlas.origin,
        "size": atlas.size,
        "charts": atlas.charts,
        "coverage": round(atlas.coverage, 4),
        "mips": atlas.mips,
        "texels": len(made.texels.index),
        "texels_without_light": int((~made.stored).sum()),
        "paths_per_texel_noise": float(np.abs(made.light.half_a - made.light.half_b).mean() / 2),
    }


def _write_pages(scene: Scene, settings: BakeSettings, data, score) -> dict[str, Any]:
    glb = settings.out / "scene.glb"
    report = write_report(settings.out, replace(data, asset_bytes=glb.stat().st_size)).numbers
    write_page(
        settings.out / "index.html",
        title=(scene.name or "scene").replace("_", " "),
        glb=glb.read_bytes(),
        home=score.home,
        views=score.pictures,
        exposure=score.exposure,
        report=report,
    )
    return report


def _verdict(report: dict[str, Any], settings: BakeSettings) -> str:
    return (
        f"[bold]{report['psnr_db']:.1f} dB[/] (noise of the truth {report['psnr_ceiling_db']:.1f} dB), "
        f"FLIP {report['flip']:.3f}, {report['bytes'] / 1024:.0f} KiB of learned light, "
        f"{report['macs_per_pixel']:,} MAC per pixel\n{settings.out / 'scene.glb'}  {settings.out / 'report.html'}"
    )
