"""One trial of the light-probe benchmark: a scene, a lattice, all methods on the same probes and queries.

Query sets: air (free places, random normals, no offset) and surfaces (1 cm off, with the query's offset). Leak is
counted on the places within half a spacing of a surface. The reference is path traced once for a scene.
"""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter, process_time

import numpy as np

from lightwell.probes import ddgi, line_of_sight, rays, sh
from lightwell.probes.assemble import assemble, plain
from lightwell.probes.bake import bake_geometry
from lightwell.probes.lattice import Lattice
from lightwell.probes.light import Effort, light_volume, traced
from lightwell.probes.metrics import Scores, score
from lightwell.probes.trace import air_light
from lightwell.probes.volume import query
from lightwell.scenes.free_air import free_air
from lightwell.transport import draw_surface
from lightwell.transport.queries import frames

# Biases that the baseline of distance moments may choose from, in its favour.
BIASES = (0.0, 0.1, 0.2, 0.3)
OFF_SURFACE = 0.01


@dataclass(frozen=True)
class Queries:
    """Where light is asked for, and the truth there."""

    place: np.ndarray
    normal: np.ndarray
    on_surface: np.ndarray
    """[N] bool."""
    near: np.ndarray
    """[N] metres to the nearest surface."""
    region: np.ndarray
    truth: np.ndarray
    """[N, 3] irradiance from nine harmonics traced at the place itself: errors of interpolation alone."""
    again: np.ndarray
    """[N, 3] the second, independent reference."""
    exact: np.ndarray
    """[N, 3] irradiance without harmonics."""


def queries(leak_scene, count: int, paths: int, seed: int = 0) -> Queries:
    """Half of them in the air, half off surfaces."""
    scene, rng = leak_scene.scene, np.random.default_rng(seed)
    low, high = leak_scene.bounds
    air = (low + (high - low) * rng.random((count, 3))).astype(np.float32)
    normal = rng.standard_normal((count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    drawn = draw_surface(scene, count, seed).points
    position, _, flat = frames(scene, drawn)
    flat = np.where((flat * drawn.view).sum(axis=1, keepdims=True) < 0, -flat, flat)
    place = np.concatenate([air[: count // 2], (position + OFF_SURFACE * flat)[: count // 2]]).astype(np.float32)
    normal = np.concatenate([normal[: count // 2], flat[: count // 2]]).astype(np.float32)
    surface = np.arange(len(place)) >= count // 2
    inside = np.all((place > low) & (place < high), axis=1)
    keep = inside & rays.valid(scene, place) & (leak_scene.region(place) >= 0)
    place, normal, surface = place[keep], normal[keep], surface[keep]
    light = air_light(scene, place, paths, 4242, normals=normal)
    found = [np.maximum(sh.evaluate(e, normal), 0) for e in (light.half_a, light.half_b, light.sh)]
    near = free_air(scene).distance(place)
    region = leak_scene.region(place)
    return Queries(place, normal, surface, near, region, found[2], found[0], np.maximum(light.irradiance, 0))


def trial(leak_scene, asked: Queries, spacing: float, offset, functions, effort: Effort, seed: int) -> dict:
    """Scores by method, and what it cost."""
    scene = leak_scene.scene
    lattice = Lattice.around(scene.bounds, spacing, offset)
    wall, busy = perf_counter(), process_time()
    made = bake_geometry(scene, spacing, functions[0], lattice=lattice)
    cost = {"wall": perf_counter() - wall, "busy": process_time() - busy, "nodes": len(lattice)}
    support, target = made.support, made.target.astype(np.float32)
    every = traced(scene, support, np.arange(len(lattice)), effort, seed)
    answers, bytes_, live = {}, {}, int(made.volume.alive.sum())
    for function in functions:
        volume = made.volume if function == functions[0] else assemble(support, target, function)
        lit, solution, start = light_volume(scene, volume, support, effort, seed)
        answers[function] = _asked(lambda v, x, n: query(v, x, n)[0], lit, asked)
        answers[f"{function}, traced"] = _asked(lambda v, x, n: query(v, x, n)[0], volume.lit(start), asked)
        bytes_[function] = volume.bytes_per_probe()
    cost |= {"live": live, "orphans": float(solution.orphans.mean()), "bytes": bytes_}
    answers["trilinear"] = _asked(lambda v, x, n: query(v, x, n)[0], plain(support, False).lit(every), asked)
    answers["validity"] = _asked(lambda v, x, n: query(v, x, n)[0], plain(support, True).lit(every), asked)
    answers["line of sight"] = _line_of_sight(scene, support, every, asked)
    moments = ddgi.bake_moments(scene, support, every)
    answers["ddgi"] = _best_bias(moments, asked)
    near = asked.near < 0.5 * spacing
    # Errors over all queries, leak over those near surfaces.
    leak_region = np.where(near, asked.region, -1)
    return {name: score(asked.truth, found, leak_region) for name, found in answers.items()} | {"cost": cost}


def _asked(answer, volume, asked: Queries) -> np.ndarray:
    """Answers of a volume, with the offset on surfaces alone."""
    found = answer(volume, asked.place, asked.normal)
    found[~asked.on_surface] = answer(volume.in_air(), asked.place[~asked.on_surface], asked.normal[~asked.on_surface])
    return found


def _line_of_sight(scene, support, light, asked: Queries) -> np.ndarray:
    found = line_of_sight.query(scene, support, light, asked.place, asked.normal)
    air = ~asked.on_surface
    found[air] = line_of_sight.query(scene, support, light, asked.place[air], asked.normal[air], 0.0)
    return found


def _best_bias(moments: ddgi.Moments, asked: Queries) -> np.ndarray:
    """The baseline with the biases, of surfaces and of air, that suit it best."""
    from dataclasses import replace

    found = np.empty_like(asked.truth)
    for rows in (asked.on_surface, ~asked.on_surface):
        tried = [ddgi.query(replace(moments, bias=b), asked.place[rows], asked.normal[rows]) for b in BIASES]
        errors = [score(asked.truth[rows], t, asked.region[rows]).smape for t in tried]
        found[rows] = tried[int(np.argmin(errors))]
    return found


def mean(scores: list[Scores], name: str) -> float:
    """Mean over trials of one measure."""
    return float(np.mean([getattr(s, name) for s in scores]))
