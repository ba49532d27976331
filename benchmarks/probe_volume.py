"""The feature volume against probes with bricks: the same scene, samples and queries, at most as many bytes."""

from __future__ import annotations

import numpy as np
from probe_trial import BUDGET, Queries, asked_of, line_of_sight_of, mean, queries, total_bytes
from rows import Row, at_least, at_most

from lightwell.probes.assemble import plain
from lightwell.probes.bake import bake_geometry
from lightwell.probes.lattice import ProbeLattice
from lightwell.probes.light import SolvedVolume, light_volume, origins, refined, traced
from lightwell.probes.metrics import Scores, score
from lightwell.probes.samples import ProbeSampling
from lightwell.probes.solve import SolveRows
from lightwell.probes.split.fit import fit_volume
from lightwell.probes.split.grid import split_grid
from lightwell.probes.split.volume import FeatureVolume, query
from lightwell.probes.volume import query as query_probes

# Queries and paths of the reference: fewer than those of the other parts, as methods are only compared.
COUNT, PATHS = 1200, 2048
FEATURES, SEED = 12, 1
SPACING = 1.0
# Grids that are tried for a number of bytes, and the part of it that is enough.
TRIES, ENOUGH = 4, 0.85


def volume_of(scene, lit: SolvedVolume, apart: float, most: float, offset) -> FeatureVolume:
    """A volume of the samples of ``lit`` of at most ``most`` bytes, and nearly as many."""
    light = np.concatenate([lit.samples.light, lit.start])
    place = np.concatenate([lit.samples.place, origins(lit.geometry)[0]])
    rows = SolveRows(place, np.zeros_like(place), light)
    spacing, found = apart / 2, None
    for _ in range(TRIES):
        grid, _ = split_grid(scene, ProbeLattice.around(scene.core, spacing, offset))
        volume = fit_volume(grid, rows, FEATURES)
        size = sum(volume.bytes.values())
        # Of those that fit, the largest one.
        if size <= most and (found is None or size > sum(found.bytes.values())):
            found = volume
        if ENOUGH * most <= size <= most:
            break
        spacing *= 1.01 * (size / most) ** (1 / 3)
    assert found is not None
    return found


def asked_volume(volume: FeatureVolume, asked: Queries) -> np.ndarray:
    """Answers, with the offset on surfaces alone."""
    return asked_of(lambda v, x, n: query(v, x, n), volume, asked)


def trial(
    made, asked: Queries, direct: bool, apart: float, offset, seed: int, quick: bool
) -> tuple[dict[str, Scores], dict]:
    """Scores of probes with bricks, the volume, trilinear weights and line of sight; and bytes."""
    scene = made.scene
    effort = ProbeSampling(8, 16, 32, direct, 1) if quick else ProbeSampling(32, 128, 1024, direct, 8)
    lattice = ProbeLattice.around(scene.core, apart, offset)
    geometry = bake_geometry(scene, apart, "relu-field", lattice=lattice)
    support = geometry.support
    every = traced(scene, geometry, np.arange(len(lattice)), effort, seed) * support.stands[:, None, None]
    lit = refined(scene, light_volume(scene, geometry, effort, seed), BUDGET)
    volume = volume_of(scene, lit, apart, total_bytes(lit.volume), offset)
    ask = lambda v: asked_of(lambda w, x, n: query_probes(w, x, n)[0], v, asked)  # noqa: E731
    answers = {
        "ours": ask(lit.volume),
        "volume": asked_volume(volume, asked),
        "trilinear": ask(plain(support, False).lit(every)),
        "line of sight": line_of_sight_of(scene, support, every, asked),
    }
    region = np.where(asked.near < 0.5 * apart, asked.region, -1)
    size = {"ours": total_bytes(lit.volume), "volume": sum(volume.bytes.values())}
    size |= {"spacing": volume.grid.lattice.spacing}
    return {name: score(asked.truth, found, region) for name, found in answers.items()}, size


def rows_of(label: str, made, direct: bool, apart: float, quick: bool, offsets: int) -> list[Row]:
    """Rows of one scene over some lattice offsets."""
    asked = queries(made, 100 if quick else COUNT, 16 if quick else PATHS, direct=direct)
    rng = np.random.default_rng(SEED)
    trials, sizes = zip(*(trial(made, asked, direct, apart, rng.random(3), k, quick) for k in range(offsets)))
    of = lambda name, measure: mean([t[name] for t in trials], measure)  # noqa: E731
    size = {name: float(np.mean([s[name] for s in sizes])) for name in sizes[0]}
    note = (
        f"{offsets} lattice offsets, {len(asked.place)} queries, {size['volume']:.0f} B, nodes {size['spacing']:.2f} m"
    )
    note += f" apart; relu-field with bricks {size['ours']:.0f} B"
    names = ("volume", "ours", "trilinear", "line of sight")
    listed = lambda measure: ", ".join(f"{n} {of(n, measure):.4f}" for n in names)  # noqa: E731
    ratio = lambda measure, base: of("volume", measure) / max(of(base, measure), 1e-9)  # noqa: E731
    what, noise = f"{label}, feature volume", score(asked.truth, asked.again, asked.region)
    return [
        at_most(
            f"{what}: bright leak over trilinear's",
            0.1,
            ratio("bright_worst", "trilinear"),
            "ratio",
            f"{note}: {listed('bright_worst')}, noise {noise.bright_worst:.4f}",
        ),
        at_most(
            f"{what}: dark leak over line of sight's",
            0.5,
            ratio("dark_worst", "line of sight"),
            "ratio",
            f"{note}: {listed('dark_worst')}, noise {noise.dark_worst:.4f}",
        ),
        at_most(
            f"{what}: bright leak over relu-field's with bricks", 1.0, ratio("bright_worst", "ours"), "ratio", note
        ),
        at_most(
            f"{what}: sMAPE over relu-field's with bricks",
            1.0,
            ratio("smape", "ours"),
            "ratio",
            f"{note}: {listed('smape')}, noise {noise.smape:.4f}",
        ),
        at_least(
            f"{what}: log-PSNR over relu-field's with bricks, at most as many bytes",
            0,
            of("volume", "log_psnr") - of("ours", "log_psnr"),
            "dB",
            f"{note}: {listed('log_psnr')}",
        ),
    ]
