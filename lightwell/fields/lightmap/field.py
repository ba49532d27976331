"""The field ``lightmap``: atlas, irradiance at texels, radiance towards views, and the network."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np

from lightwell.basisu import codec as basisu
from lightwell.core.denoise import missing
from lightwell.core.formats import JSON, RecordFormat
from lightwell.core.work import WorkPart
from lightwell.fields.budget import Budget, learning_seconds
from lightwell.fields.lightmap.edits import (
    EditedLightmap,
    edited_chart,
    edited_fit,
    edited_lightmap,
    keep_lightmap,
)
from lightwell.fields.lightmap.fit import PRESETS, LightmapFit, LightmapPreset
from lightwell.fields.lightmap.fitting import fitted, sample_unit
from lightwell.fields.lightmap.lamps import PATHS as LAMP_PATHS
from lightwell.fields.lightmap.lamps import fewer, find_lamps, lamp_errors, map_of, seam_count, with_lamps
from lightwell.fields.lightmap.media import media_meshes
from lightwell.fields.lightmap.moving import moving_fit, moving_samples
from lightwell.fields.lightmap.options import LightmapOptions, stored_as
from lightwell.fields.lightmap.seams import seam_samples
from lightwell.fields.lightmap.sides import TriangleSides, lit_scene, lit_sides, matte, seen_sides
from lightwell.fields.lightmap.size_limit import choose
from lightwell.fields.lightmap.square import AtlasChoice, AtlasChoiceFormat, AtlasLimits, atlas_of, roomy_atlas
from lightwell.fields.lightmap.state import EYE_PATHS, FittedLightmap, LightmapState, StillSamples
from lightwell.fields.lightmap.trace import FIRST_SHARE, AtlasIrradiance, chart, narrow_cost
from lightwell.fields.lightmap.validation import LightmapValidation
from lightwell.fields.lightmap.views import ViewSamples, eye_samples
from lightwell.fields.protocol import Job, Role
from lightwell.fields.surface.tracing import path_rate
from lightwell.scenes.atlas import Atlas
from lightwell.scenes.executor import Recipe
from lightwell.scenes.placing import sample_lights
from lightwell.scenes.scene import Scene
from lightwell.scenes.triangle_groups import triangle_groups
from lightwell.scenes.variables import declare
from lightwell.transport.gather import gathered_irradiance, known_arrays
from lightwell.transport.irradiance import Irradiance, irradiance
from lightwell.transport.samples import SurfacePoints
from lightwell.transport.texels import Texels, texel_points, texels

# Shares of the budget: irradiance at texels (in maps whose texels hold no light of their own), radiance towards views;
# the rest trains. A light that moves has no texels.
TEXEL_SHARE, BARE_TEXEL_SHARE, EYE_SHARE = 0.45, 0.02, 0.3
# ... and, of what is left before both: the search for light on dark sides, and packing of the atlas.
SIDES_SHARE, ATLAS_SHARE = 0.05, 0.15
# Texels and paths that time the tracer; bounds of the paths per texel.
TIMED_TEXELS, WARM_TEXELS, TIMED_PATHS, FEWEST_PATHS, MOST_PATHS = 1 << 17, 1 << 10, 4, 4, 4096
# Paths that end at known light are taken where they are so many times as fast: they pay where most light is indirect.
WORTH_GATHERING = 2.0
# Bounds of the number of samples of radiance towards views.
FEWEST_EYES, MOST_EYES = 1 << 12, 1 << 19
# Surface points that share a light in a shard of other fields: what ``--shards`` means is the same everywhere.
POINTS_PER_LIGHT = 128
# Seconds of a training step of 2^14 rows on two cores, and the fewest steps.
STEP_SECONDS, LEAST_STEPS = 0.04, 200
# Edge of the light that the fallback is made from where there is no ordinary light map.
COARSE = 1024
# Mip level up to which charts do not mix, where none is asked for.
MIPS = 1
# Formats of stored samples.
LIGHT, VIEWS, ATLASES = RecordFormat(Irradiance), RecordFormat(ViewSamples), AtlasChoiceFormat()


class LightmapField:
    """See ``lightwell.fields.protocol.Field``."""

    name = "lightmap"
    Options = LightmapOptions
    shares = "lightmap"

    def __init__(self, presets: Mapping[str, LightmapPreset] = PRESETS, limits: AtlasLimits | None = None) -> None:
        """Set up the field.

        Args:
            presets: Settings by name, the default first.
            limits: When an atlas becomes larger for its small charts; None: the defaults.
        """
        self.presets, self.limits = presets, limits or AtlasLimits()

    # ------------------------------------------------------------------ prepare

    def prepare(self, job: Job) -> LightmapState:
        """Add a light to a scene that has none, find the variable light, make the atlas, and plan the samples of the
        budget.

        Args:
            job: Scene and settings.

        Returns:
            The prepared scene.
        """
        if job.options.rebake:
            return edited_lightmap(job)
        request, preset = job.request, stored_as(self.presets[job.request.preset], job.options.compress)
        scene, note = (job.scene, "") if request.vary else lit_scene(job.scene)
        variable = declare(request.vary, scene) if request.vary else None
        roles: tuple[Role, ...] = ("static",) if request.static and scene.has_static_light and not job.shared else ()
        roles += () if variable is None else ("indirect",)
        _check(job, roles)
        if variable is not None:
            sample_lights(scene, variable, 1, request.seed)
        if note:
            job.progress.say(f"[yellow]warning[/] {note}")
        warnings = [*filter(None, [missing(), note])]
        state = LightmapState(job, scene, variable, roles, warnings, preset, keep=keep_lightmap)
        find_lamps(state)
        with job.work.timed("trace"), job.progress.stage("atlas", 2, "") as stage:
            _lay_out(state, self.limits)
            stage.advance(2, f"{_texel_paths(state)}, {state.eyes} eye samples")
        atlas, size = state.atlas, state.size
        job.progress.say(f"atlas: {atlas.charts} charts, {atlas.coverage:.0%} of {size} x {size}, {atlas.origin}")
        return state

    # ------------------------------------------------------------------ sample

    def sample(self, state: LightmapState, role: Role) -> StillSamples | ViewSamples | AtlasIrradiance:
        """Trace irradiance at texels and radiance towards views; for a variable light, only the latter.

        Args:
            state: The prepared scene.
            role: The part of the light to sample.

        Returns:
            Samples for ``fit``.
        """
        job, seed = state.job, state.job.request.seed
        with job.work.timed("trace"), job.progress.stage(f"trace {role}", 2, "") as stage:
            if isinstance(state, EditedLightmap):
                made, state.touched = edited_chart(state.scene, state.before, state.changes, state.paths)
                return made
            if role == "indirect":
                make = lambda: moving_samples(  # noqa: E731
                    state.scene, state.atlas, state.variable, state.eyes, EYE_PATHS, seed + 6
                )
                return state.part.get("lightmap.moving", make, VIEWS)
            keep = lambda make: state.part.get("lightmap.light", make, LIGHT)  # noqa: E731
            size, mips = state.atlas.size, state.atlas.mips
            made = chart(
                state.scene, size, mips, state.paths, seed, keep=keep, atlas=state.atlas, gathers=state.gathers
            )
            stage.advance(note=_texel_paths(state))
            eyes = state.part.get("lightmap.views", lambda: _still_samples(state, made), VIEWS)
            stage.advance(note=f"{state.eyes} eye samples")
        return with_lamps(state, made, eyes) if state.lamps else StillSamples(made, eyes)

    # ------------------------------------------------------------------ fit

    def fit(
        self,
        state: LightmapState,
        role: Role,
        samples: StillSamples | ViewSamples | AtlasIrradiance,
        part: WorkPart | None = None,
    ) -> FittedLightmap:
        """Fit the light map; with a target error, again with twice the samples until the error is reached.

        Args:
            state: The prepared scene.
            role: The part of the light that the samples hold.
            samples: Samples from ``sample``.
            part: Not used: checkpoints are stored in the part of the state.

        Returns:
            The finished fit.
        """
        if isinstance(state, EditedLightmap):
            begin, made = perf_counter(), edited_fit(state.scene, state.before, samples)
            paths = int(state.touched.sum()) * state.paths
            return FittedLightmap(state, role, made, paths, perf_counter() - begin, samples)
        budget: Budget = state.job.request.budget
        fit = self._fit_once(state, role, samples)
        if budget.error is None:
            return fit
        held = LightmapValidation.of(state.scene, state.variable, state.job.request.seed, role)
        for _ in range(budget.rounds):
            error = held.error(fit)
            if error <= budget.error or (state.paths >= MOST_PATHS and state.eyes >= MOST_EYES):
                break
            state.round, state.paths = state.round + 1, min(2 * state.paths, MOST_PATHS)
            state.gathers, state.eyes = min(2 * state.gathers, MOST_PATHS), min(2 * state.eyes, MOST_EYES)
            fit = self._fit_once(state, role, self.sample(state, role))
        if (error := held.error(fit)) > budget.error:
            state.job.progress.say(
                f"[yellow]{role}: {error:.1%} after {state.round + 1} rounds, asked for {budget.error:.1%}"
            )
        return fit

    def _fit_once(self, state: LightmapState, role: Role, samples: Any) -> FittedLightmap:
        seed, start = state.job.request.seed, perf_counter()
        with state.job.work.timed("train"), state.job.progress.stage(f"train {role}", 1, "") as stage:
            if role == "indirect":
                count = max(_steps(state), 1 if state.job.request.steps else LEAST_STEPS)
                unit = sample_unit(samples, state.variable)
                # Checkpoints of its own: those of the other role have the same names.
                made = moving_fit(
                    state.scene, state.atlas, state.variable, samples, unit, seed, count, state.part.part(role=role),
                    state.preset.codec, _watched(state),
                )  # fmt: skip
                stage.advance()
                return FittedLightmap(state, role, made, state.eyes * EYE_PATHS, perf_counter() - start)
            fit = _fit_still(state, samples)
            stage.advance()
        paths = len(samples.chart.texels.index) * (state.paths + state.gathers) + state.eyes * EYE_PATHS
        made = FittedLightmap(state, role, fit, paths, perf_counter() - start, samples.chart)
        return replace(made, lamp_facts=lamp_errors(made))


FIELD = LightmapField()


def _check(job: Job, roles: tuple[Role, ...]) -> None:
    """Refuse settings that leave nothing to learn, and options without effect."""
    if not roles and job.shared:
        raise ValueError(
            "a light map stores no light that moves unless --vary declares it; "
            "add --vary light.position=box(x0,y0,z0,x1,y1,z1)"
        )
    if not roles:
        raise ValueError(
            "bake: --no-static leaves nothing to learn: without --vary a light map stores the light of the scene's own "
            "emitters alone; declare a light that moves with --vary, or leave --no-static out"
        )
    if job.options.compress and (lacking := basisu.missing()):
        raise ValueError(f"bake: --compress {job.options.compress}: {lacking}")
    if job.options.max_bytes and job.options.compress:
        raise ValueError("bake: --max-bytes chooses among WebP pictures; leave it or --compress out")
    if job.options.max_bytes and "static" not in roles:
        raise ValueError(
            "bake: --max-bytes chooses among forms of light that stands still, and this bake has none; leave it out"
        )


# ---------------------------------------------------------------------- prepare


def _lay_out(state: LightmapState, limits: AtlasLimits) -> None:
    """Find the sides that are stored, the atlas, and the counts of paths and samples."""
    job, scene, preset = state.job, state.scene, state.preset
    request, options = job.request, job.options
    # A variable light can reach every visible side.
    seconds = None if request.shards else SIDES_SHARE * learning_seconds(request.budget, job.work.elapsed)
    look = partial(lit_sides, seconds=seconds) if state.variable is None else seen_sides
    part = job.work.part(field="lightmap")
    sides = part.get("lightmap.sides", lambda: look(scene, request.seed), RecordFormat(TriangleSides))
    deadline = np.inf if seconds is None else perf_counter() + ATLAS_SHARE / SIDES_SHARE * seconds
    make = partial(_atlas, scene, options, preset, sides, limits, deadline)
    # A packing that was ended by the time is kept for a resumed bake; one of groups takes no time and much space.
    choice = make() if triangle_groups(scene).count else part.get("lightmap.atlas", make, ATLASES)
    found = part.get("lightmap.path-counts", lambda: list(_counts(choice, limits, state)), JSON)
    state.paths, state.gathers, state.eyes, smaller = found
    state.atlas = choice.smaller if smaller and choice.smaller else choice.first
    fewer(state)


def _atlas(
    scene: Scene,
    options: LightmapOptions,
    preset: LightmapPreset,
    sides: TriangleSides,
    limits: AtlasLimits,
    deadline: float,
) -> AtlasChoice:
    """Make the atlas. Without an ordinary light map, irradiance serves the fallback alone and is traced coarsely."""
    size, mips = options.size or preset.size, MIPS if options.mips is None else options.mips
    if preset.base and not options.size:
        return roomy_atlas(scene, size, mips, sides, limits, options.mips is not None, deadline)
    atlas = atlas_of(scene, size, mips, sides, deadline=deadline)
    return AtlasChoice(atlas if preset.base else replace(atlas, size=min(size, COARSE)))


def _counts(choice: AtlasChoice, limits: AtlasLimits, state: LightmapState) -> tuple[int, int, int, bool]:
    """Full and gathered paths per texel (see ``chart``), number of radiance samples, and whether the smaller atlas
    serves; with ``--shards`` they are fixed.
    """
    request, preset, scene = state.job.request, state.preset, state.scene
    if request.shards:
        return request.paths, 0, request.shards * request.lights_per_shard * POINTS_PER_LIGHT, False
    own_light, first = "static" in state.roles, texels(scene, choice.first)
    state.rate = path_rate(scene, state.variable, request.seed, own_light).short
    rate = _texel_rate(partial(irradiance, scene), choice.first, first, request.seed)
    seconds = learning_seconds(request.budget, state.job.work.elapsed)
    share = TEXEL_SHARE if preset.base else BARE_TEXEL_SHARE
    # Each role takes its shares of a part of the time.
    seconds *= role_part(state.roles, preset)
    count = len(first.index) + narrow_cost(first)
    paths, smaller = share * seconds * rate / count, False
    if paths * (LAMP_PATHS if state.lamps else 1) < limits.fewest_paths and choice.smaller:
        # A larger atlas is of no use where its texels are too noisy to be denoised.
        area = [atlas.coverage * atlas.size**2 for atlas in (choice.first, choice.smaller)]
        paths, smaller = paths * area[0] / area[1], True
    eye_share = EYE_SHARE + TEXEL_SHARE - share if preset.hidden else 0.0
    eyes = int(np.clip(eye_share * seconds * rate / EYE_PATHS, FEWEST_EYES, MOST_EYES))
    paths = int(np.clip(paths, FEWEST_PATHS, MOST_PATHS)) // 2 * 2
    if not preset.base or not own_light or state.lamps or media_meshes(scene).any():
        return paths, 0, eyes, smaller
    nothing = np.zeros((choice.first.size, choice.first.size, 3), np.float32)
    known = known_arrays(scene, choice.first, nothing, matte(scene), scattered=True)
    gather = lambda points, paths, seed, _: gathered_irradiance(scene, points, known, paths, seed)  # noqa: E731
    faster = _texel_rate(gather, choice.first, first, request.seed) / rate
    gathers = int(min((1 - FIRST_SHARE) * faster * paths, MOST_PATHS)) // 2 * 2
    return paths, gathers if faster >= WORTH_GATHERING else 0, eyes, smaller


def role_part(roles: Sequence[Role], preset: LightmapPreset) -> float:
    """Compute the part of the learning time that each role has, so that all of them together take the time once.

    Args:
        roles: Parts of the light that are learned.
        preset: Settings of the light map.

    Returns:
        The part; 1 with one role.
    """
    if len(roles) < 2:
        return 1.0
    # A light that moves leaves the share of the texels.
    moving = 1 - (TEXEL_SHARE if preset.base else BARE_TEXEL_SHARE)
    return 1 / sum(1.0 if role == "static" else moving for role in roles)


def _texel_rate(
    trace: Callable[[SurfacePoints, int, int, Recipe], Any], atlas: Atlas, covered: Texels, seed: int
) -> float:
    """Measure the paths per second at texels."""
    rows = np.arange(0, len(covered.index), max(8, len(covered.index) // TIMED_TEXELS))
    seconds = np.inf
    for timed in (rows[:WARM_TEXELS], rows):
        # The first call compiles.
        start = perf_counter()
        trace(covered.points[timed], TIMED_PATHS, seed + 9, texel_points(atlas, len(covered.index), timed))
        seconds = perf_counter() - start
    return len(rows) * TIMED_PATHS / max(seconds, 1e-6)


def _texel_paths(state: LightmapState) -> str:
    """Say how the light at texels is traced."""
    if not state.gathers:
        return f"{state.paths} paths per texel"
    return f"{int(FIRST_SHARE * state.paths)} full and {state.gathers} gathered paths per texel"


def _still_samples(state: LightmapState, made: AtlasIrradiance) -> ViewSamples:
    """Sample radiance towards views, a tenth of it on seams."""
    scene, preset, seed = state.scene, state.preset, state.job.request.seed
    samples = eye_samples(scene, made, state.eyes, EYE_PATHS, seed + 5, made.image if preset.base else None)
    across = None
    if preset.base and preset.hidden:
        across = seam_samples(scene, made, made.image, seam_count(state), EYE_PATHS, seed + 7)
    return samples if across is None else samples + across


# ---------------------------------------------------------------------- fit


def _steps(state: LightmapState) -> int:
    request = state.job.request
    if request.steps:
        return request.steps << state.round
    # The number depends on the budget alone, so that it is the same on every machine.
    seconds = learning_seconds(request.budget, 0.0) * 2**state.round * role_part(state.roles, state.preset)
    return max(int((1 - TEXEL_SHARE - EYE_SHARE) * seconds / STEP_SECONDS), LEAST_STEPS)


def _watched(state: LightmapState) -> Callable[[int], None] | None:
    """What a training calls now and then where somebody looks, who may pause or end it."""
    job = state.job

    def wait(_: int) -> None:
        job.wait()

    return None if job.observer is None else wait


def _fit_still(state: LightmapState, samples: StillSamples) -> LightmapFit:
    """Fit the light map of the scene's own light; the network is left out where it does not lower the error."""
    scene, made, preset = state.scene, samples.chart, state.preset
    seed, say = state.job.request.seed, state.job.progress.say
    if preset.hidden and not made.glossy.any():
        say("every surface looks the same from everywhere: no network is needed, the light map is plain")
        preset = replace(preset, hidden=(), channels=0, direction=False)
    if limit := state.job.options.max_bytes:
        trial = lambda p, s, n: fitted(scene, made, s, p, seed, n)  # noqa: E731
        preset = choose(limit, preset, made, samples.eyes, trial, say)
    steps = _steps(state) if preset.hidden else 0
    lamps = partial(map_of, state, samples) if samples.lamps is not None else None
    more = {"part": state.part, "size": state.size, "lamps": lamps}
    fit = fitted(scene, made, samples.eyes, preset, seed, steps, _watched(state), **more)
    if preset.hidden and not fit.preset.hidden:
        say("the network was no better than none on held-out samples: the light map is plain")
    return fit
