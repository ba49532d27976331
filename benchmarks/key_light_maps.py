"""A baked day beside what is done without it: light maps of key times, of as many bytes, blended linearly.

`changing_light.py --keys` calls ``key_rows``. Each key is a plain light map: a picture of irradiance / π, the form and
the codecs of the plain light maps of `neural_lightmap.py`. It holds the light that the field learns (the bounce of the
sun, all of the sky), divided by the level of its time, as the field's light is; maps keep no other number of the time.
Number of keys, size and codec are those with which the blend is best on the points that both are scored on, which
favours the maps. Points and times are those of the report of the bake.

Notation: K covered texels, T times, N held-out points.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np
from lightmap_scenes import PLAIN_CODECS
from rows import Row, at_least, without_bar

from lightwell.asset.read import read_fields
from lightwell.backend import dr
from lightwell.baking.reference import PointReference, trace_points
from lightwell.baking.reference_budget import ReferenceBudget
from lightwell.core.color import display
from lightwell.fields.baked import Baked
from lightwell.fields.base import FieldSetup
from lightwell.fields.lightmap.curve import stored
from lightwell.fields.lightmap.fit import PRESETS, LightmapFit
from lightwell.fields.lightmap.sides import lit_scene, matte, seen_sides
from lightwell.fields.lightmap.square import atlas_of
from lightwell.fields.lightmap.trace import AtlasIrradiance, light_image, mask_image, reduced, stored_texels
from lightwell.graph.pictures import Picture, encode
from lightwell.report.metrics import error_without_noise, relative_error
from lightwell.scenes import load
from lightwell.scenes.normal_maps import relief
from lightwell.scenes.scene import Scene
from lightwell.scenes.suns import Sun
from lightwell.scenes.variables import from_json
from lightwell.transport.day_light import day_light
from lightwell.transport.gather_rays import beyond, cosine_directions, free_ray
from lightwell.transport.irradiance import irradiance
from lightwell.transport.lightmap_query import query_of_lightmap
from lightwell.transport.queries import make_query
from lightwell.transport.radiosity import LANES, BinLight, Radiosity
from lightwell.transport.samples import SurfacePoints
from lightwell.transport.seen_shards import GatherSize, SeenBins
from lightwell.transport.shards import ShardSettings
from lightwell.transport.surface import FLOOR
from lightwell.transport.texels import texels

WHAT = "day: above blended key light maps of as many bytes"
BAR = 6
# Numbers of keys, each with a key at both ends; all are among the last one's.
KEYS = (2, 3, 5, 9, 17)
SEED = 0xDA1


@dataclass(frozen=True)
class Effort:
    """How much is traced."""

    atlases: tuple[tuple[int, int], ...] = ((512, 0), (1024, 1))
    """Edge, texels, and levels of the mip chain beside the first: a picture may be that of any level."""
    keys: tuple[int, ...] = KEYS
    rays: int = 1 << 26
    """Of all texels of an atlas together."""
    most_rays: int = 1024
    """Of a texel."""
    shards: int = 32
    """As many bins as a bake of so many shards has."""
    paths: int = 4096
    """Of a held-out point: what a screen shows of noisy halves is darker than what it shows of their mean."""


QUICK = Effort(((512, 0),), (2, 3), 1 << 19, 16, 1, 64)


@dataclass(frozen=True)
class KeyTimes:
    """Key times of a day, and the light of the bins at them."""

    time: np.ndarray
    """[T] from 0 to 1."""
    light: BinLight

    @staticmethod
    def of(radiosity: Radiosity, day: Sun, count: int) -> KeyTimes:
        """``count`` times at equal distances, both ends among them."""
        time = np.linspace(0, 1, count)
        return KeyTimes(time, day_light(radiosity, day, day.direction(time).astype(np.float32), SEED))


def arriving(radiosity: Radiosity, light: BinLight, points: SurfacePoints, rays: int) -> np.ndarray:
    """[K, T, 3] irradiance / π at points without the direct light of the sun; one set of rays serves all times."""
    from scipy.sparse import csr_matrix

    query = make_query(radiosity.scene, points, np.zeros(3, np.float32))
    columns, random = light.irradiance.shape[1], np.random.default_rng([SEED, 1])
    times = len(light.lights)
    out = np.empty((len(points), times, 3), np.float32)
    batch = max(1, LANES // rays)
    for start in range(0, len(points), batch):
        part = slice(start, start + batch)
        normal = query.normal[part].astype(np.float64).repeat(rays, axis=0)
        count = len(normal) // rays
        # The first number is stratified: rays of a point are at all heights.
        u = random.random((2, len(normal)))
        u[0] = (np.tile(np.arange(rays), count) + u[0]) / rays
        origin = query.position[part].repeat(rays, axis=0) + 1e-4 * radiosity.scene.core_extent * normal
        weight, place, met, away = free_ray(
            radiosity.scene.mi, origin, cosine_directions(normal, u), SEED, start * rays
        )
        index = radiosity.bins.lookup(radiosity.scene.mi, place, met)
        weight, index = beyond(radiosity.bins.count, weight, index, away)
        dr.eval(weight, index)
        w, column = np.nan_to_num(np.array(weight).T, posinf=0, neginf=0) / (np.pi * rays), np.array(index)
        ends = np.arange(0, len(normal) + 1, rays)
        for c in range(3):
            rows = csr_matrix((w[:, c].astype(np.float32), column.astype(np.int32), ends), shape=(count, columns))
            out[part, :, c] = rows @ np.ascontiguousarray(light.irradiance[..., c].T)
    return out


class KeyAtlas:
    """The texels of an atlas of one size, and their light at the key times."""

    def __init__(
        self, scene: Scene, radiosity: Radiosity, times: KeyTimes, shape: tuple[int, int], effort: Effort
    ) -> None:
        atlas = atlas_of(scene, *shape, seen_sides(scene, SEED), True)
        covered = texels(scene, atlas)
        rays = int(np.clip(effort.rays // len(covered.index), 4, effort.most_rays))
        self.arriving = arriving(radiosity, times.light, covered.points, rays)
        # Which texels lie inside closed objects; the light of it is not used.
        inside = irradiance(lit_scene(scene)[0], covered.points, 16, SEED)
        mean = self.arriving.mean(axis=1)
        light = replace(inside, half_a=mean, half_b=mean, direction=np.zeros_like(mean))
        kept = stored_texels(scene, atlas, covered, light, SEED)
        self.made = AtlasIrradiance(atlas, covered, light, kept, ~matte(scene)[covered.points.shape])
        self.images = [light_image(self.made, values=self.arriving[:, t]) for t in range(len(times.time))]
        self._scene, self._mask = scene, encode(mask_image(self.made), "webp", 0)

    def pictures(self, codec: str, level: int) -> list[tuple[Picture, float]]:
        """The light map of each key time at a level of the mip chain, and its unit."""
        units = [4 * float(self.arriving[self.made.stored, t].mean()) for t in range(len(self.images))]
        images = [reduced(image, 1 << level) for image in self.images]
        return [(encode(stored(image / unit), codec, 0), unit) for image, unit in zip(images, units)]

    def shown(self, points: SurfacePoints, picture: Picture, unit: float) -> np.ndarray:
        """[N, 3] radiance of points by a light map."""
        setup, bumpy = FieldSetup.of(self._scene, unit, "static"), bool(relief(self._scene).any())
        extra = {"setup": setup, "mask": self._mask, "relief": bumpy}
        fit = LightmapFit(PRESETS["plain"], self.made.atlas.size, unit, picture, None, SEED, **extra)
        return Baked(fit.lower())(query_of_lightmap(self._scene, self.made.atlas, points))


def blended(keys: np.ndarray, time: np.ndarray, light: np.ndarray) -> np.ndarray:
    """[N, 3] light at times [N], linear between the two nearest of T keys [T]; light [T, N, 3]."""
    after = np.clip(np.searchsorted(keys, time), 1, len(keys) - 1)
    share = ((time - keys[after - 1]) / (keys[after] - keys[after - 1]))[:, None]
    row = np.arange(len(time))
    return (1 - share) * light[after - 1, row] + share * light[after, row]


@dataclass(frozen=True)
class Score:
    """How near light at the held-out points is to the reference."""

    decibels: float
    """Of display values, noise of the reference taken off."""
    error: float
    """Mean relative error, noise included."""
    bare: float | None
    """Root mean square without the noise; None where the reference has too few paths."""

    @staticmethod
    def of(found: np.ndarray, truth: PointReference) -> Score:
        """Score radiance [N, 3]."""
        a, b = (np.nan_to_num(half) for half in (truth.half_a, truth.half_b))
        unit = 4 * max(float(np.average((0.5 * (a + b)).mean(axis=1), weights=truth.weight)), 1e-30)
        f, a, b = found / unit, a / unit, b / unit
        shown = [display(x) for x in (f, a, b)]
        squared = float(np.average(((shown[0] - shown[1]) * (shown[0] - shown[2])).mean(axis=1), weights=truth.weight))
        return Score(
            float(-10 * np.log10(max(squared, 1e-10))),
            relative_error(f, 0.5 * (a + b), truth.weight).mean,
            error_without_noise(f, a, b, truth.weight),
        )


def best_maps(
    scene: Scene, day: Sun, truth: PointReference, most: int, effort: Effort
) -> tuple[Score, str, dict[int, float]]:
    """The best blend of at most so many bytes: its score, what it is, and the best decibels of each number of keys."""
    bins = GatherSize.of(effort.shards, ShardSettings())
    radiosity = SeenBins(day, bins.points, bins.bins, FLOOR, (SEED, SEED + 1)).make(scene)[1]
    times, time = KeyTimes.of(radiosity, day, effort.keys[-1]), day.time(truth.light)
    found: list[tuple[Score, str, int]] = []
    for shape in effort.atlases:
        try:
            atlas = KeyAtlas(scene, radiosity, times, shape, effort)
        except ValueError as error:  # The charts of the scene do not fit.
            print(f"  left out: {error}", flush=True)
            continue
        for level, codec in product(range(shape[1] + 1), PLAIN_CODECS):
            made, light = atlas.pictures(codec, level), {}
            edge = atlas.made.atlas.size >> level
            for count in effort.keys:
                chosen = np.rint(np.linspace(0, effort.keys[-1] - 1, count)).astype(int)
                total = sum(len(made[k][0].data) for k in chosen)
                if total > most:
                    break
                light |= {k: atlas.shown(truth.points, *made[k]) for k in chosen if k not in light}
                shown = blended(times.time[chosen], time, np.stack([light[k] for k in chosen]))
                text = f"{count} light maps of {edge} x {edge} in {codec}, {total} B"
                found.append((Score.of(shown, truth), text, count))
                print(f"  {text}: {found[-1][0].decibels:.2f} dB, error {found[-1][0].error:.1%}", flush=True)
    if not found:
        raise ValueError(f"key light maps: none fits into {most} bytes; add a smaller one to Effort.atlases")
    score, text, _ = max(found, key=lambda entry: entry[0].decibels)
    each = {count: max(s.decibels for s, _, c in found if c == count) for count in {c for *_, c in found}}
    return score, text, dict(sorted(each.items()))


def key_rows(folder: Path | None, quick: bool) -> list[Row]:
    """Compare a kept bake of a day with light maps of key times.

    Args:
        folder: What ``lightwell bake`` wrote; None: nothing is measured.
        quick: A small run.

    Returns:
        The rows.
    """
    if folder is None:
        return [
            at_least(
                WHAT, BAR, None, "dB", "not measured yet: python benchmarks/changing_light.py --keys on a quiet machine"
            )
        ]
    report, effort = json.loads((folder / "report.json").read_text()), QUICK if quick else Effort()
    fields, variables = read_fields(folder / "scene.glb")
    scene, day = load(report["scene"]), from_json(variables[0])
    if not isinstance(day, Sun) or day.sky is None:
        raise ValueError(f"key light maps: '{folder}' is no bake of a day; bake one with --vary day=…")
    truth = trace_points(scene, day, "indirect", ReferenceBudget(point_paths=effort.paths), report["seed"])
    graph = next(field.graph for field in fields if field.role == "indirect")
    ours = Score.of(Baked(graph)(make_query(scene, truth.points, truth.light)), truth)
    maps, text, each = best_maps(scene, day, truth, report["bytes"], effort)
    keys = ", ".join(f"{count} keys {value:.1f} dB" for count, value in each.items())
    note = f"field {ours.decibels:.1f} dB, {report['bytes']} B; best: {text}, {maps.decibels:.1f} dB; {keys}"
    bare = f"without noise {_percent(maps.bare)}, field {_percent(ours.bare)}"
    return [
        at_least(WHAT, BAR, ours.decibels - maps.decibels, "dB", note),
        without_bar("day: error of blended key light maps", maps.error, "", f"field {ours.error:.1%}; {bare}"),
    ]


def _percent(value: float | None) -> str:
    return "not measurable" if value is None else f"{value:.1%}"
