"""Warm start: a cache that is trained with a baked field of the same scene before its first frame.

A baked field holds the radiance that surfaces scatter, of the scene's own emitters or of a point light; direct light of
the latter is added in closed form. Both together are the targets of the cache, without noise.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lightwell.asset.read import read_fields, refuse_moving
from lightwell.backend import dr, mi, upload_floats
from lightwell.cache.batches import frozen_batches
from lightwell.cache.features import WIDTH
from lightwell.cache.learner import LUMINANCE, Batch
from lightwell.cache.live_scene import LiveScene
from lightwell.cache.radiance_cache import RadianceCache
from lightwell.cache.schedule import skip_cold_start
from lightwell.fields.baked import Baked
from lightwell.graph import Graph
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import declare
from lightwell.transport import make_query, sample_surface
from lightwell.transport.interactions import interaction
from lightwell.transport.radiance import direct
from lightwell.transport.samples import SurfacePoints

# Gradient steps, and how often each record is used.
STEPS, PASSES = 128, 2
# The learning rate falls to this share of the first, as that of a still does.
FINAL_RATE = 0.1
# What a bake may lack, by the role of the field, and the cure.
LACKS = {
    "static": "the scene's own lights; bake it again without --no-static",
    "indirect": "a point light; bake one, or leave out --cache-from",
}


@dataclass(frozen=True)
class BakedLight:
    """The fields of a bake."""

    name: str
    """Of the file, for messages."""
    graphs: Mapping[str, Graph]
    """Role, 'indirect' or 'static', to shading graph."""

    @staticmethod
    def read(path: str | Path) -> BakedLight:
        """Read the fields of a baked file.

        Args:
            path: ``scene.glb`` of a bake.

        Returns:
            The fields.
        """
        fields = read_fields(path)[0]
        refuse_moving(fields, "render")
        return BakedLight(str(path), {entry.role: entry.graph for entry in fields})


@dataclass(frozen=True)
class WarmStart:
    """What a warm start did."""

    records: int
    """Records of the baked field."""
    steps: int
    """Gradient steps."""
    loss: float
    """Mean loss of the last quarter of them."""


def warm_start(
    cache: RadianceCache, live: LiveScene, loaded: Scene, baked: BakedLight, seed: int, steps: int = STEPS
) -> WarmStart:
    """Train a cache with a baked field.

    Args:
        cache: Untrained cache; it is prepared for the scene.
        live: Mitsuba scene that will be rendered.
        loaded: The scene that it was made of.
        baked: Fields of a bake of that scene.
        seed: Seed of the places.
        steps: Gradient steps, ≥ ``PASSES``.

    Returns:
        Counts and loss.
    """
    cache.prepare(live.scene)
    size = cache.settings.training.batch
    count = -(-steps // PASSES) * size
    points = sample_surface(loaded, count, seed)
    radiance = scattered(live, loaded, points, baked)
    with dr.suspend_grad():
        features, targets, rows = _records(cache, loaded, points, radiance)
    predictor = cache.predictor
    factor = predictor.scale.update(np.maximum(radiance, 0) @ np.array(LUMINANCE))
    if factor != 1.0:
        predictor.learner.rescale(factor)
    losses: list[float] = []
    per_pass = count // size
    pack = frozen_batches(predictor.model, per_pass * size, max(1, (count - 1).bit_length()))
    for number in range(PASSES):
        order, unit = dr.opaque(mi.UInt32, seed * 7919 + number), dr.opaque(mi.Float, predictor.scale.value)
        with dr.suspend_grad():
            batch = Batch(*pack(features, targets, rows, dr.opaque(mi.UInt32, count), order, unit))
            dr.eval(batch.direct, batch.points, batch.target, batch.weight)
        for k in range(per_pass):
            rate = cache.settings.training.learning_rate * FINAL_RATE ** (len(losses) / (PASSES * per_pass))
            losses.append(float(np.array(predictor.learner.train(batch, k * size, rate)).ravel()[0]))
    predictor.touched()
    skip_cold_start(cache.schedule)
    return WarmStart(count, len(losses), float(np.mean(losses[-max(len(losses) // 4, 1) :])))


def scattered(live: LiveScene, loaded: Scene, points: SurfacePoints, baked: BakedLight) -> np.ndarray:
    """Evaluate the radiance that surface points scatter towards their views, according to a baked field.

    Args:
        live: Mitsuba scene that will be rendered, with its lamp.
        loaded: The scene that it was made of.
        points: N surface points.
        baked: Fields of a bake of that scene.

    Returns:
        [N, 3] radiance; 0 where it is not finite.

    Raises:
        ValueError: The bake lacks light that the scene has.
    """
    check_light(live, baked)
    total = np.zeros((len(points), 3))
    if live.loaded.has_static_light:
        total += _evaluated(baked, "static", loaded, points, np.zeros(3))
    if live.lamp is not None:
        place = np.asarray(live.lamp.place, np.float32)
        indirect = _evaluated(baked, "indirect", loaded, points, place)
        total += live.lamp.intensity * (indirect + direct(loaded, points, place, declare((), loaded)))
    return np.where(np.isfinite(total), np.maximum(total, 0), 0)


def check_light(live: LiveScene, baked: BakedLight) -> None:
    """Refuse a bake whose light cannot stand for that of the scene.

    Args:
        live: Mitsuba scene that will be rendered, with its lamp.
        baked: Fields of a bake of that scene.

    Raises:
        ValueError: The bake lacks light that the scene has, or a field reads what is not known here.
    """
    roles = ["static"] if live.loaded.has_static_light else []
    for role in [*roles, "indirect"] if live.lamp is not None else roles:
        if role not in baked.graphs:
            raise ValueError(f"nrc: '{baked.name}' has no field of {LACKS[role]}")
        if missing := sorted(set(baked.graphs[role].inputs) & {"uv", "uv1"}):
            raise ValueError(
                f"nrc: the field of '{baked.name}' reads {', '.join(missing)}, which a cache does not know; "
                "bake the scene with --field factored"
            )


def _evaluated(
    baked: BakedLight, role: str, loaded: Scene, points: SurfacePoints, light: np.ndarray
) -> np.ndarray:  # fmt: skip
    """[N, 3] radiance of one field."""
    graph = baked.graphs[role]
    # Groups of lamps as they were baked: factors of 1.
    frame = {"lamps": np.ones(graph.inputs["lamps"], np.float32)} if "lamps" in graph.inputs else {}
    return Baked(graph, frame)(make_query(loaded, points, light))


def _records(
    cache: RadianceCache, loaded: Scene, points: SurfacePoints, radiance: np.ndarray
) -> tuple[Any, Any, Any]:  # fmt: skip
    """Features, targets and rows of records, in the layout of training frames."""
    count = len(points)
    si = interaction(loaded, points)
    vertex = cache.region.context.vertex(si, si.bsdf(), mi.Bool(True))
    features, lane = dr.zeros(mi.Float, count * WIDTH), dr.arange(mi.UInt32, count)
    vertex.store(features, lane, mi.Bool(True))
    targets = upload_floats(np.concatenate([radiance, np.ones((count, 1))], axis=1).ravel())
    dr.eval(features, targets, lane)
    return features, targets, lane
