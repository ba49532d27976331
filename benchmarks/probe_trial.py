"""One trial of the light-probe benchmark: a scene, a lattice, all methods on the same probes and queries.

Query sets: air (free places, random normals, no offset) and surfaces (1 cm off, with the query's offset). Leak is
counted on the places within half a spacing of a surface. The reference is path traced once for a scene.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.probes import ddgi, line_of_sight, rays, sh
from lightwell.probes.assemble import plain
from lightwell.probes.bake import bake_geometry
from lightwell.probes.lattice import CORNERS, ProbeLattice
from lightwell.probes.light import light_volume, refined, traced
from lightwell.probes.metrics import Scores, score
from lightwell.probes.pattern import pattern
from lightwell.probes.samples import ProbeSampling
from lightwell.probes.solve import relative_error
from lightwell.probes.support import bake_support
from lightwell.probes.trace import air_light
from lightwell.probes.volume import OFFSET, query
from lightwell.scenes.free_air import free_air

# Half floats of 27 harmonics.
TRILINEAR_BYTES = 54.0
# Fine probes per probe that stands at its node, at most.
BUDGET = 8.0
# Biases that the baseline of distance moments may choose from, in its favour.
BIASES = (0.0, 0.1, 0.2, 0.3)
OFF_SURFACE = 0.01
# Noise of the reference (relative error, in [0, 1]) above which it gets more paths, and how many times more at most.
QUIET, MOST = 0.01, 8


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
    """[N, 3] by half of the paths: as far from the truth as that is from what more paths would give."""
    exact: np.ndarray
    """[N, 3] irradiance without harmonics."""


def queries(leak_scene, count: int, paths: int, seed: int = 0, direct: bool = True) -> Queries:
    """Half of them in the air, half off surfaces, spread by area over both sides of all triangles."""
    scene, rng = leak_scene.scene, np.random.default_rng(seed)
    low, high = leak_scene.bounds
    air = (low + (high - low) * rng.random((4 * count, 3))).astype(np.float32)
    normal = rng.standard_normal((4 * count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    parts = [(air, normal, 0), (*_off_surfaces(scene, 4 * count, rng), 1)]
    found = []
    for place, normal, surface in parts:
        inside = np.all((place > low) & (place < high), axis=1)
        keep = np.flatnonzero(inside & rays.valid(scene, place) & (leak_scene.region(place) >= 0))[: count // 2]
        found.append((place[keep], normal[keep], np.full(len(keep), surface, bool)))
    place, normal, surface = (np.concatenate(part) for part in zip(*found))
    normal, region = normal.astype(np.float32), leak_scene.region(place)
    halves, irradiance = _reference(scene, place, normal, region, paths, direct)
    answers = [np.maximum(sh.evaluate(e, normal), 0) for e in (halves[0], halves.mean(axis=0))]
    near = free_air(scene).distance(place)
    return Queries(place, normal, surface, near, region, answers[1], answers[0], np.maximum(irradiance, 0))


def _reference(scene, place, normal, region, paths: int, direct: bool) -> tuple[np.ndarray, np.ndarray]:
    """[2, N, 9, 3] harmonics by each half of the paths, and [N, 3] irradiance; more paths where it is noisy.

    How many is decided by an eighth of the paths, whose light is thrown away, and by the mean over the queries of one
    region within a metre: nothing is chosen by the light that counts.
    """
    pilot = air_light(scene, place, max(2, paths // 8), 4241, direct=direct)
    noise = 0.5 * relative_error(pilot.half_a, pilot.half_b) / np.sqrt(8)
    group = np.concatenate([region[:, None], np.floor(place)], axis=1)
    _, index = np.unique(group, axis=0, return_inverse=True)
    mean = (np.bincount(index, noise) / np.bincount(index))[index]
    times = 2 ** np.clip(np.ceil(2 * np.log2(np.maximum(mean / QUIET, 1e-9))), 0, np.log2(MOST)).astype(np.int64)
    halves, irradiance = np.empty((2, len(place), 9, 3)), np.empty((len(place), 3))
    for k in np.unique(times):
        asked = np.flatnonzero(times == k)
        more = dict(normals=normal[asked], direct=direct, numbers=asked)
        found = air_light(scene, place[asked], paths * int(k), 4242, **more)
        halves[:, asked], irradiance[asked] = (found.half_a, found.half_b), found.irradiance
    return halves, irradiance


def _off_surfaces(scene, count: int, rng) -> tuple[np.ndarray, np.ndarray]:
    """Places [count, 3] a centimetre off triangles, on a side drawn at random, and the normals of that side."""
    corners = []
    for shape in scene.mi.shapes():
        vertices = np.array(shape.vertex_positions_buffer()).reshape(-1, 3)
        corners.append(vertices[np.array(shape.faces_buffer()).reshape(-1, 3).astype(np.int64)])
    triangle = np.concatenate(corners)
    normal = np.cross(triangle[:, 1] - triangle[:, 0], triangle[:, 2] - triangle[:, 0])
    area = np.linalg.norm(normal, axis=1)
    chosen = rng.choice(len(triangle), count, p=area / area.sum())
    s, t = np.sqrt(rng.random(count))[:, None], rng.random(count)[:, None]
    a, b, c = np.swapaxes(triangle[chosen], 0, 1)
    side = (normal / np.maximum(area, 1e-30)[:, None])[chosen] * rng.choice([-1, 1], count)[:, None]
    return ((1 - s) * a + s * (1 - t) * b + s * t * c + OFF_SURFACE * side).astype(np.float32), side


def trial(
    leak_scene,
    asked: Queries,
    spacing: float,
    offset,
    functions,
    effort: ProbeSampling,
    seed: int,
    budget=BUDGET,
    net: int = 0,
) -> dict:
    """Scores by method, and what it cost; with ``budget`` > 0 the first function also with bricks; with ``net`` steps
    also a network of as many bytes."""
    scene = leak_scene.scene
    lattice = ProbeLattice.around(scene.bounds, spacing, offset)
    made = bake_geometry(scene, spacing, functions[0], lattice=lattice)
    support = made.support
    every = traced(scene, made, np.arange(len(lattice)), effort, seed) * support.stands[:, None, None]
    answers, bytes_ = {}, {}
    ask = lambda volume: asked_of(lambda v, x, n: query(v, x, n)[0], volume, asked)  # noqa: E731
    for function in functions:
        geometry = made if function == functions[0] else bake_geometry(scene, spacing, function, lattice=lattice)
        lit = light_volume(scene, geometry, effort, seed)
        answers[function], bytes_[function] = ask(lit.volume), total_bytes(lit.volume)
        if function == functions[0]:
            lit = refined(scene, lit, budget)
            answers["ours"], bytes_["ours"] = ask(lit.volume), total_bytes(lit.volume)
            bricks = 0 if lit.volume.bricks is None else len(lit.volume.bricks.table)
    if net:
        from probe_net import answers as ask_net

        answers["network"] = ask_net(lit, bytes_["ours"], asked.place, asked.normal, net)
    answers["trilinear"] = ask(plain(support, False).lit(every))
    answers["validity"] = ask(plain(support, True).lit(every))
    answers |= others(support, every, asked)
    answers["line of sight"] = line_of_sight_of(scene, support, every, asked)
    answers["ddgi"] = _best_bias(ddgi.bake_moments(scene, support, every), asked)
    # Denser trilinear lattices of as many bytes (B8).
    finer = spacing * min(1.0, (TRILINEAR_BYTES * support.stands.sum() / bytes_["ours"]) ** (1 / 3))
    for _ in range(3):
        dense = bake_support(scene, ProbeLattice.around(scene.bounds, finer, offset), pattern(64))
        missing = bytes_["ours"] / (TRILINEAR_BYTES * dense.stands.sum())
        if missing <= 1:
            break
        # Borders spoil the estimate: a little finer, until it has no fewer bytes.
        finer /= 1.02 * missing ** (1 / 3)
    light = np.zeros((len(dense.lattice), 9, 3), np.float32)
    live = np.flatnonzero(dense.stands)
    light[live] = air_light(scene, dense.origin[live], effort.probe_paths, seed, direct=effort.direct).sh
    answers["dense trilinear"] = ask(plain(dense, False).lit(light))
    answers["dense validity"] = ask(plain(dense, True).lit(light))
    cost = {"nodes": len(lattice), "live": int(made.volume.alive.sum()), "bricks": bricks, "bytes": bytes_}
    cost |= {"dense bytes": TRILINEAR_BYTES * len(live), "orphans": float(lit.solution.orphans.mean()), "finer": finer}
    near = asked.near < 0.5 * spacing
    # Errors over all queries, leak over those near surfaces.
    leak_region = np.where(near, asked.region, -1)
    return {name: score(asked.truth, found, leak_region) for name, found in answers.items()} | {"cost": cost}


def total_bytes(volume) -> float:
    """Bytes of a volume, nine harmonics a probe as they are asked here, tables counted."""
    parts = volume.bytes_per_probe("l2")
    return sum(value for name, value in parts.items() if name != "record") * float(volume.alive.sum())


def others(support, light: np.ndarray, asked: Queries) -> dict[str, np.ndarray]:
    """Validity with a facing weight (B3), and one fetch at a place warped by the valid weights (B4)."""
    found = {}
    offset = np.where(asked.on_surface, OFFSET, 0.0)[:, None] * support.lattice.spacing
    y = asked.place + offset * asked.normal
    node, hat, _ = support.lattice.corners(y)
    weight = hat * support.stands[node]
    way = support.origin[node] - asked.place[:, None]
    cosine = (way * asked.normal[:, None]).sum(axis=2) / np.maximum(np.linalg.norm(way, axis=2), 1e-9)
    facing = weight * (((cosine + 1) / 2) ** 2 + 0.2)
    total = np.maximum(weight.sum(axis=1, keepdims=True), 1e-30)
    side = np.stack([(weight * CORNERS[:, k]).sum(axis=1) / total[:, 0] for k in range(3)], axis=1)[:, None]
    warped = np.where(CORNERS, side, 1 - side).prod(axis=2)
    for name, w in (("facing", facing), ("warped", warped)):
        share = w / np.maximum(w.sum(axis=1, keepdims=True), 1e-30)
        e = np.einsum("nk,nkbc->nbc", share, light[node])
        found[name] = np.maximum(sh.evaluate(e, asked.normal), 0)
    return found


def asked_of(answer, volume, asked: Queries) -> np.ndarray:
    """Answers of a volume, with the offset on surfaces alone."""
    found = answer(volume, asked.place, asked.normal)
    found[~asked.on_surface] = answer(volume.in_air(), asked.place[~asked.on_surface], asked.normal[~asked.on_surface])
    return found


def line_of_sight_of(scene, support, light, asked: Queries) -> np.ndarray:
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
