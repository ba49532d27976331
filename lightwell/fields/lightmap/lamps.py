"""Light maps whose lamps have switches: which groups there are, their samples, and their errors."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from lightwell.core.formats import RecordFormat
from lightwell.core.lamps import parse_lamps
from lightwell.fields.baked import Baked
from lightwell.fields.lightmap.fit import LightmapPreset
from lightwell.fields.lightmap.lamp_map import LampMap
from lightwell.fields.lightmap.lamp_pictures import lamp_map
from lightwell.fields.lightmap.lamp_shares import LampTexels, LampTracer, check_lamps, eye_rows, lamp_facts
from lightwell.fields.lightmap.seams import SHARE as SEAM_SHARE
from lightwell.fields.lightmap.state import FittedLightmap, LightmapState, StillSamples
from lightwell.fields.lightmap.trace import AtlasIrradiance
from lightwell.fields.lightmap.views import ViewSamples
from lightwell.scenes.atlas import NOWHERE
from lightwell.scenes.lamps import group_lamps
from lightwell.transport.seen_shards import GatherSize
from lightwell.transport.shards import ShardSettings

LAMPS = RecordFormat(LampTexels)
# Shares of lamps at samples towards views, at most: they are in memory.
MOST_SHARES = 1 << 22
# Share of the paths of a light map without switches: the rest of the time traces the groups.
PATHS = 0.6
# Shards that the bins of a bake with a budget of time are as many as for.
SHARDS = 8


def find_lamps(state: LightmapState) -> None:
    """Find the groups of lamps that are asked for.

    Args:
        state: The prepared scene; its groups are set.

    Raises:
        ValueError: ``--lamps`` names no light, or comes with what stores no share of each lamp; one line.
    """
    job = state.job
    if not job.request.lamps:
        return
    lamps = group_lamps(job.scene, parse_lamps(job.request.lamps))
    if not lamps:
        return
    if not job.request.static:
        raise ValueError("bake: --lamps needs the scene's own light, which --no-static leaves out; drop one")
    if not state.preset.base:
        raise ValueError(
            f"bake: preset '{job.request.preset}' has no ordinary light map to share among lamps; "
            "use --preset default, plain or directional, or leave --lamps out"
        )
    if job.options.max_bytes:
        raise ValueError(
            "bake: --max-bytes chooses among light maps without switches; give --size, or leave --lamps out"
        )
    check_lamps(state.scene)
    bins = GatherSize.of(job.request.shards or SHARDS, ShardSettings()).bins
    state.lamps, state.tracer = lamps, LampTracer(state.scene, lamps, job.request.seed, bins)


def fewer(state: LightmapState) -> None:
    """Leave time for tracing the groups, and memory for what they light.

    Args:
        state: The prepared scene, with the counts of a light map without switches.
    """
    if state.lamps and not state.job.request.shards:
        state.paths = max(int(PATHS * state.paths), 2) // 2 * 2
        state.eyes = min(state.eyes, MOST_SHARES // len(state.lamps))


def seam_count(state: LightmapState) -> int:
    """Return the number of samples on seams.

    Args:
        state: The prepared scene.

    Returns:
        The number.
    """
    return int(SEAM_SHARE * state.eyes)


def with_lamps(state: LightmapState, made: AtlasIrradiance, eyes: ViewSamples) -> StillSamples:
    """Trace the light of each group, or read that of an interrupted bake.

    Args:
        state: The prepared scene.
        made: Atlas and irradiance of all lamps together.
        eyes: Samples towards views.

    Returns:
        Samples with the light of each group.
    """
    tracer, seed = state.tracer, state.job.request.seed
    assert tracer is not None
    network = bool(state.preset.hidden) and bool(made.glossy.any())

    def trace() -> LampTexels:
        points = eye_rows(state.scene, made, state.eyes, seed + 5, seam_count(state)) if network else None
        return tracer.texels(made, state.paths, points)

    found = state.part.get("lightmap.lamps", trace, LAMPS)
    return StillSamples(made, replace(eyes, shares=found.eyes) if network else eyes, found)


def map_of(state: LightmapState, samples: StillSamples, unit: float, preset: LightmapPreset) -> LampMap:
    """Make the pictures of the lamps.

    Args:
        state: The prepared scene.
        samples: Its samples.
        unit: Radiance unit S.
        preset: Codec.

    Returns:
        The light of the lamps.
    """
    assert samples.lamps is not None
    names = tuple(group.name for group in state.lamps)
    return lamp_map(samples.chart, samples.lamps, names, unit, preset, state.job.progress.say)


def lamp_errors(fitted: FittedLightmap) -> dict[str, Any]:
    """Measure what is shown of each lamp at held-out points.

    Args:
        fitted: The light map of light that stands still.

    Returns:
        Values for the report; none without lamps.
    """
    state, lamps = fitted.state, fitted.map.lamps
    if state.tracer is None or lamps is None:
        return {}
    points, reference = state.tracer.held_out()
    query = fitted.query(points, np.zeros(3, np.float32))
    rows = np.flatnonzero((query.uv1 != NOWHERE).any(axis=1))
    shown, found = Baked(fitted.map.lower(), fitted.map.frame), np.empty_like(reference[rows])
    for k, alone in enumerate(np.eye(lamps.count, dtype=np.float32)):
        found[:, k] = shown.with_frame(lamps=np.tile(alone, 3))(query[rows])
    facts = lamp_facts(lamps.names, found, reference[rows], state.job.request.seed)
    return facts | {"lamp_pictures": lamps.rank, "error_of_lamp_pictures": dict(zip(lamps.names, lamps.errors))}
