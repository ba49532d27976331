"""Indirect light of many lights at once: a final gather over the irradiance of bins of surface.

Paths need no light. From every surface point a few rays are traced once; each keeps the *bin* of surface that it met
and what that bin's irradiance is worth to the point. For any light the irradiance of the bins is known: direct light by
a shadow ray to a place in each bin, indirect light by paths from the bins over other bins, which are a matrix. The
light that leaves a point is then a sum over its rays, for as many lights as are wanted, at the price of reading a table
(Hašan et al. 2006, direct-to-indirect transfer; Ward et al. 1988, the final gather).

A linear system over 4,096 larger bins in place of the paths leaks from bin to bin: in dark rooms it is wrong by up to
12 times their light.

What it blurs: the bright spot beside a light over a bin, and reflections of reflections.

Notation: N points, P rays per point, F bins, K lights.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np

from lightwell.backend import dr, mi, upload_floats, upload_integers
from lightwell.scenes.executor import Arrays, Recipe
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import PointLight, Variable
from lightwell.transport.bin_places import BinPlaces
from lightwell.transport.bins import FEWEST, Bins, find_bins, parted
from lightwell.transport.gather_rays import beyond, cosine_ray, gather_ray
from lightwell.transport.interactions import DevicePoints, gather_interaction, upload
from lightwell.transport.panes import panes_of, unblocked
from lightwell.transport.path_numbers import LATTICE_STREAM, random_streams, stratified
from lightwell.transport.paths import MAX_DEPTH
from lightwell.transport.queries import dot, frames
from lightwell.transport.samples import SurfacePoints, columns_of
from lightwell.transport.sky_source import CELLS
from lightwell.transport.tables import tables

# Rays per point by which the bins are found, and points that send them.
PROBES, PROBE_POINTS = 16, 1 << 16
# Hits that a bin needs on average, and how often so many rays are traced for them at most: under the open sky most
# meet nothing, and places of which no bin is known are dark (0.35 of what points gather in kenney-fps-level and 0.20
# in godot-truck-town with one round; 0.03 and 0.05 with as many as needed).
HITS_PER_BIN, MOST_ROUNDS = 24, 8
# Rays that look for places on the bins which lamps light.
LIT_PLACES = 1 << 20
# Paths of a bin, and their length: with the way from the lamp and to the point, that of the longest traced paths.
BIN_PATHS, MOST_BOUNCES = 64, MAX_DEPTH - 3
# Bins nearer to a lamp than so many edges of a cell have the mean light of so many of their places: all of the light of
# a lamp in hello-webxr-hall was wrong by up to 80 %, because one place of a bin of 2.2 m decided it. Standard deviation
# over the lamps nearest to surfaces: 0.14 with one place, 0.09 with 8, 0.065 with 32 and with 128.
NEAR, NEAR_PLACES = 3.0, 32
# Where fewer than this share of the paths is left, a launch costs more than they are worth: then fewer go on, which
# count so many times as much. They must not count more at each bounce: that would be spots of light.
FEW, FEW_COUNT = 0.1, 4
# Lanes of one launch.
LANES = 1 << 20
# Largest weight that is kept, below the largest half float.
LARGEST = 6e4
# Lights whose indirect irradiance a thread computes at once: what all bins receive of them stays in its cache. Seconds
# for 512 lights on two cores, four scenes: 1.7 to 9.1 with 256 of them on one thread, 0.7 to 2.2 with 64 on two.
LIGHTS_AT_ONCE = 64


@dataclass(frozen=True)
class Rows:
    """What N points see of the bins: ray by ray."""

    bin: np.ndarray
    """[N, P] uint16 or uint32 bin that the ray met; F where there is none. With a sky: F + its cell where the ray
    leaves the scene, F + cells where there is nothing."""
    weight: np.ndarray
    """[N, P, 3] float16 radiance that leaves the point for an irradiance of 1 on that bin (a radiance of 1 of that cell
    of the sky): a mean over a half."""


@dataclass(frozen=True)
class BinLight:
    """Irradiance of the bins under K lights of 1 cd (1 lx)."""

    irradiance: np.ndarray
    """[K, F + 1, 3] float32; the last bin is dark. With a sky: [K, F + cells + 1, 3], its radiance behind the bins."""
    lights: np.ndarray
    """[K, 3]."""


class Radiosity:
    """The bins of a scene and how they light each other; built from points that see the scene."""

    def __init__(self, scene: Scene, points: SurfacePoints, seed: int, bins: int) -> None:
        """Find the bins of a scene and how they light each other.

        Args:
            scene: The scene.
            points: Points that see the scene.
            seed: Seed of the rays.
            bins: Bins to aim at.
        """
        self.scene, self.seed = scene, seed
        tables(scene)
        self._probes = points[: min(len(points), PROBE_POINTS)]
        position, normal = self._enough_hits(bins, seed)
        found = find_bins(position, normal, bins, np.random.default_rng([seed, 5])) if len(position) else None
        if found is None or not found.count:
            # No surface sees another one: a floor, a sphere. Bins of what the points lie on keep all the rest as it is.
            found = find_bins(*self._own_places(), bins, np.random.default_rng([seed, 5]))
        self.bins: Bins = parted(found, self._sight)

    def _enough_hits(self, bins: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
        """Places and normals where rays of the probes end: of as many rays as so many bins need."""
        seeds = [seed, *(int(s) for s in np.random.SeedSequence([seed, 8]).generate_state(MOST_ROUNDS - 1))]
        parts: list[tuple[np.ndarray, np.ndarray]] = []
        for one in seeds:
            parts.append(self._hits(DevicePoints(self._probes), len(self._probes), PROBES, one)[:2])
            if sum(len(place) for place, _ in parts) >= HITS_PER_BIN * bins:
                break
        position, normal = (np.concatenate(x) for x in zip(*parts))
        return position, normal

    def _own_places(self) -> tuple[np.ndarray, np.ndarray]:
        """Places and normals [N, 3] of the points themselves, on the sides of their views; as often as bins need."""
        position, _, flat = frames(self.scene, self._probes)
        flat = flat * np.where(dot(flat, self._probes.view) < 0, -1.0, 1.0)
        return position.repeat(FEWEST, axis=0), flat.repeat(FEWEST, axis=0)

    def _sight(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """[K] whether nothing stands between places [K, 3]."""
        way = np.asarray(b - a, np.float32)
        length = np.linalg.norm(way, axis=1)
        ray = mi.Ray3f(upload(mi.Point3f, a), upload(mi.Vector3f, way / np.maximum(length, 1e-20)[:, None]))
        ray.maxt = upload_floats(length)
        return ~np.array(self.scene.mi.ray_test(ray)) | (length < 1e-6 * self.scene.extent)

    @cached_property
    def places(self) -> BinPlaces:
        """Many places on each bin."""
        rays = max(LIT_PLACES // len(self._probes), PROBES)
        seed = int(np.random.SeedSequence([self.seed, 7]).generate_state(1)[0])
        position, normal, _ = self._hits(DevicePoints(self._probes), len(self._probes), rays, seed)
        return BinPlaces.of(self.scene.mi, self.bins, position, normal)

    # ------------------------------------------------------------------ rays

    def _hits(self, device, count: int, rays: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Places, normals on the side that is met, and weights [hits, 3] of ``rays`` rays from each of some points."""
        parts = []
        batch = max(1, LANES // rays)
        for start in range(0, count, batch):
            found = rays_of_points(self.scene, device, start, min(batch, count - start), rays, seed)[:3]
            dr.eval(found)
            weight, p, n = (np.array(v).T for v in found)
            seen = weight.max(axis=1) > 0
            parts.append((p[seen], n[seen], weight[seen]))
        return tuple(np.concatenate(x) for x in zip(*parts))

    def rows(
        self, points: SurfacePoints, rays: int, seed: int, sky: bool = False, recipe: Recipe | None = None
    ) -> Rows:
        """Trace what points see of the bins.

        Args:
            points: N surface points.
            rays: Rays per point, even; the two halves are independent.
            seed: Seed of the rays.
            sky: Note the cell of the sky of rays that leave the scene.
            recipe: How workers make points and bins again; None: they are sent.

        Returns:
            Bins and weights, ray by ray.
        """
        if self.scene.executor is None:
            return _seen_rows(self.scene, self.bins, points, rays, seed, sky=sky)
        settings = {"rays": rays, "seed": seed, "sky": sky}
        run = self.scene.executor.rows
        found = run("radiosity", settings, columns_of(points), rays, self.bins.arrays(), recipe)
        return Rows(found["bin"], found["weight"])

    @cached_property
    def _transfer(self):
        """[F, F + 1] as three sparse matrices: indirect irradiance of bins for a direct irradiance of 1 on bins."""
        from scipy.sparse import csr_matrix

        count = self.bins.count
        row, column, weight = self._bin_paths()
        shape = (count, count + 1)
        return [csr_matrix((weight[:, c], (row, column)), shape=shape, dtype=np.float32) for c in range(3)]

    def _bin_paths(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Bins that paths begin on, bins that they meet, and indirect irradiance [.., 3] for an irradiance of 1."""
        bins, random = self.bins, np.random.default_rng([self.seed, 6])
        place, normal = bins.places_of_all(BIN_PATHS, random)
        seed = int(random.integers(1 << 32))
        parts = []
        for start in range(0, len(place), LANES):
            p, n = place[start : start + LANES], normal[start : start + LANES]
            row, part = np.arange(start, start + len(p)) // BIN_PATHS, np.full((len(p), 3), 1 / BIN_PATHS)
            begun = len(p)
            for bounce in range(MOST_BOUNCES):
                met, weight, p, n = self._next_bounce(p, n, seed, (start, bounce))
                part *= weight
                known = met < bins.count
                parts.append((row[known], met[known], part[known].astype(np.float32)))
                copies, each = copies_of_paths(BIN_PATHS * part.max(axis=1), begun, random)
                if not copies.any():
                    break
                part /= np.maximum(part.max(axis=1, keepdims=True), 1e-30) * (BIN_PATHS / each)
                row, part, p, n = (v.repeat(copies, axis=0) for v in (row, part, p, n))
        return tuple(np.concatenate(x) for x in zip(*parts))

    def _next_bounce(self, place: np.ndarray, normal: np.ndarray, seed: int, stream: tuple[int, int]):
        """Bins [R], irradiance per irradiance [R, 3], places and normals where rays by the cosine end."""
        lift = 1e-4 * self.scene.core_extent
        w, p, n, _ = cosine_ray(self.scene.mi, place, normal, lift, seed, stream)
        index = self.bins.lookup(self.scene.mi, p, n)
        dr.eval(w, p, n, index)
        weight = np.nan_to_num(np.array(w).T, posinf=0, neginf=0)
        return np.array(index), weight, np.array(p).T, np.array(n).T

    # ------------------------------------------------------------------ light

    def light(self, variable: Variable, lights: np.ndarray, seed: int) -> BinLight:
        """Compute the irradiance of the bins: direct light by a shadow ray, indirect light by paths.

        Args:
            variable: What the light is.
            lights: [K, 3] positions, metres (directions of a sun).
            seed: Seed of the places in the bins.

        Returns:
            Irradiance of the bins under each light of 1 cd (1 lx).
        """
        direct = self.direct(variable, lights, seed)
        irradiance = self.indirect(direct)
        irradiance += direct
        return BinLight(irradiance, np.asarray(lights, np.float32))

    def direct(self, variable: Variable, lights: np.ndarray, seed: int) -> np.ndarray:
        """Compute the direct irradiance of the bins under white light, by shadow rays.

        Args:
            variable: What the light is.
            lights: [K, 3] positions, metres (directions of a sun).
            seed: Seed of the places in the bins.

        Returns:
            [K, F + 1, 3] float32; the last bin is dark. Without coloured glass the three are equal.
        """
        direct = np.zeros((len(lights), self.bins.count + 1, 3), np.float32)
        batch = max(1, LANES // self.bins.count)
        for start in range(0, len(lights), batch):
            direct[start : start + batch, :-1] = self._irradiance(variable, lights[start : start + batch], seed + start)
        if isinstance(variable, PointLight):
            self._light_near(variable, lights, direct)
        return direct

    def _irradiance(self, variable: Variable, lights: np.ndarray, seed: int) -> np.ndarray:
        """[k, F, 3] direct irradiance at a random place of each bin."""
        count = self.bins.count
        lane = dr.arange(mi.UInt32, len(lights) * count)
        of_bin = lane % dr.opaque(mi.UInt32, count)
        place, n = self.bins.random_place(
            of_bin, random_streams(dr.opaque(mi.UInt32, seed & 0xFFFFFFFF), lane, mi.UInt32(0))
        )
        light = dr.gather(mi.Vector3f, upload(mi.Vector3f, lights), lane // dr.opaque(mi.UInt32, count))
        return np.array(self._at_places(variable, light, place, n)).T.reshape(len(lights), count, 3)

    def _light_near(self, variable: PointLight, lights: np.ndarray, direct: np.ndarray) -> None:
        """Replace the direct irradiance of bins near each lamp, where one place decides, by a mean over many."""
        from scipy.spatial import cKDTree

        tree = cKDTree(self.bins.place[:, 0])
        found = tree.query_ball_point(lights, NEAR * self.bins.edge)
        lamp = np.repeat(np.arange(len(lights)), [len(bins) for bins in found])
        index = np.concatenate([np.asarray(bins, np.int64) for bins in found])
        batch = LANES // NEAR_PLACES
        for start in range(0, len(index), batch):
            part = slice(start, start + batch)
            lane = dr.arange(mi.UInt32, len(index[part]) * NEAR_PLACES)
            pair = lane // NEAR_PLACES
            of_bin = dr.gather(mi.UInt32, upload_integers(index[part].astype(np.uint32)), pair)
            of_lamp = dr.gather(mi.UInt32, upload_integers(lamp[part].astype(np.uint32)), pair)
            place, n = self.places.spread(of_bin, lane % NEAR_PLACES, NEAR_PLACES)
            light = dr.gather(mi.Vector3f, upload(mi.Vector3f, lights), of_lamp)
            E = np.array(self._at_places(variable, light, place, n)).T.reshape(-1, NEAR_PLACES, 3)
            direct[lamp[part], index[part]] = E.mean(axis=1)

    def _at_places(self, variable: Variable, light: mi.Vector3f, place: mi.Vector3f, n: mi.Vector3f) -> mi.Spectrum:
        """Direct irradiance at places, by a shadow ray each."""
        origin = place + dr.opaque(mi.Float, 1e-4 * self.scene.core_extent) * n
        if isinstance(variable, PointLight):
            way = light - origin
            distance2 = dr.squared_norm(way)
            d = way * dr.rsqrt(distance2)
            E = dr.maximum(dr.dot(n, d), 0) / distance2
            ray = mi.Ray3f(origin, d)
            ray.maxt = dr.sqrt(distance2) * (1 - 1e-4)
        else:
            E = dr.maximum(dr.dot(n, light), 0)
            ray = mi.Ray3f(origin, light)
        T, _ = unblocked(self.scene.mi, panes_of(self.scene), ray, E > 0, mi.Bool(True))
        return dr.select(E > 0, E * T, 0)

    def indirect(self, direct: np.ndarray) -> np.ndarray:
        """Compute the indirect irradiance of the bins.

        Args:
            direct: [K, F + 1] direct irradiance of the bins under K white lights, or [K, F + 1, 3] under coloured ones;
                the last bin is dark.

        Returns:
            [K, F + 1, 3] float32; the last bin is dark.
        """
        out = np.zeros((*direct.shape[:2], 3), np.float32)
        transfer, starts = self._transfer, range(0, len(direct), LIGHTS_AT_ONCE)

        def add(job: tuple[int, int]) -> None:
            part, c = slice(job[0], job[0] + LIGHTS_AT_ONCE), job[1]
            of_channel = direct[part] if direct.ndim == 2 else direct[part, :, c]
            out[part, :-1, c] = (transfer[c] @ np.ascontiguousarray(of_channel.T)).T

        with ThreadPoolExecutor(dr.thread_count()) as pool:
            for _ in pool.map(add, product(starts, range(3))):
                pass
        return out


def copies_of_paths(weight: np.ndarray, begun: int, random: np.random.Generator) -> tuple[np.ndarray, float]:
    """Choose how many copies of each path go on, and what each of them counts.

    White surfaces with gloss reflect up to twice what they receive in some directions, 1.08 times on average. A path
    that meets them again and again would count a hundred times: it is split, so that all paths count the same, as much
    as at their begin. All of them count more where there would be more paths than at the begin, or where few are left.

    Args:
        weight: [R] weights, of what a path counts at its begin.
        begun: Paths at the begin.
        random: Random numbers.

    Returns:
        [R] copies, and the weight of each.
    """
    total = weight.sum()
    each = max(total / begun, 1.0) if total > FEW * begun else FEW_COUNT
    return np.floor(weight / each + random.random(len(weight))).astype(np.int64), each


def radiosity_rows(scene: Scene, settings: Mapping[str, Any], columns: Arrays, first: int, shared: Arrays) -> Arrays:
    """Trace what points see of the bins; see ``row_tasks.RowFunction``.

    Args:
        scene: The scene.
        settings: ``rays``, ``seed`` and ``sky``.
        columns: Columns of ``SurfacePoints``, [N, ...] each.
        first: Number of the first row.
        shared: ``Bins.arrays``.

    Returns:
        ``bin`` [N, P] and ``weight`` [N, P, 3], as in ``Rows``.
    """
    points = SurfacePoints(*(columns[name] for name in ("shape", "triangle", "barycentric", "view")))
    rays, seed, sky = (settings[name] for name in ("rays", "seed", "sky"))
    return vars(_seen_rows(scene, Bins.of(shared), points, rays, seed, first, sky))


def _seen_rows(
    scene: Scene, bins: Bins, points: SurfacePoints, rays: int, seed: int, first: int = 0, sky: bool = False
) -> Rows:
    """What points see of the bins, ray by ray."""
    found = np.empty((len(points), rays), bin_type(nothing(bins, sky)))
    weight = np.empty((len(points), rays, 3), np.float16)
    for rows, w, index in row_launches(scene, bins, points, rays, seed, first, sky):
        dr.eval(w, index)
        found[rows] = np.array(index).reshape(-1, rays)
        for c, values in enumerate(w):
            weight[rows, :, c] = np.array(values).reshape(-1, rays)
    return Rows(found, weight)


def row_launches(
    scene: Scene, bins: Bins, points: SurfacePoints, rays: int, seed: int, first: int = 0, sky: bool = False
) -> Iterator[tuple[slice, Any, mi.UInt32]]:
    """Record what points see of the bins, launch by launch.

    Args:
        scene: The scene.
        bins: Its bins.
        points: N surface points.
        rays: P, rays per point, even.
        seed: Seed of the rays.
        first: Number of the first point.
        sky: Note the cell of the sky of rays that leave the scene.

    Yields:
        Rows of the points; weights and bins of their rays, one lane for each, not yet evaluated.
    """
    device, batch, dark = DevicePoints(points), max(1, LANES // rays), nothing(bins, sky)
    for start in range(0, len(points), batch):
        count = min(batch, len(points) - start)
        w, p, n, away = rays_of_points(scene, device, start, count, rays, seed, first)
        index = bins.lookup(scene.mi, p, n)
        if sky:
            w, index = beyond(bins.count, w, index, away)
        w, index = stored_ends(w, index, dr.opaque(mi.Float, 2 / rays), dr.opaque(mi.UInt32, dark))
        yield slice(start, start + count), w, index


def nothing(bins: Bins, sky: bool) -> int:
    """Number of nothing, behind the bins and the cells of the sky.

    Args:
        bins: The bins.
        sky: Whether cells of the sky are noted.

    Returns:
        The number, the largest one.
    """
    return bins.count + (CELLS if sky else 0)


def bin_type(largest: int) -> type[np.uint16] | type[np.uint32]:
    """Choose the type of ``Rows.bin``.

    Args:
        largest: Largest number that is stored.

    Returns:
        The smallest type that holds it.
    """
    return np.uint16 if largest <= np.iinfo(np.uint16).max else np.uint32


def stored_ends(
    w: mi.Spectrum, index: mi.UInt32, share: mi.Float, dark: mi.UInt32
) -> tuple[list[mi.Float16], mi.UInt32]:
    """Make rays as ``Rows`` holds them.

    Args:
        w: [R] weights.
        index: [R] bins.
        share: What weights are multiplied by.
        dark: Bin of a ray without weight.

    Returns:
        Weights by channel in half precision, and bins.
    """
    w = [dr.select(dr.isfinite(v), v * share, 0) for v in w]
    met = (w[0] > 0) | (w[1] > 0) | (w[2] > 0)
    return [mi.Float16(dr.minimum(v, LARGEST)) for v in w], dr.select(met, index, dark)


def rays_of_points(scene: Scene, device: DevicePoints, start: int, count: int, rays: int, seed: int, first: int = 0):
    """Trace rays from each of some points.

    Args:
        scene: The scene.
        device: The points.
        start: Number of the first one.
        count: Points.
        rays: Rays per point, P.
        seed: Seed of the rays.
        first: Added to the numbers of points, for random streams.

    Returns:
        As ``gather_ray``, [count * P].
    """
    size = dr.opaque(mi.UInt32, rays)
    lane = dr.arange(mi.UInt32, count * rays)
    path, row = lane % size, dr.opaque(mi.UInt32, start) + lane // size
    at_seed = dr.opaque(mi.UInt32, seed & 0xFFFFFFFF)
    number = row + dr.opaque(mi.UInt32, first)
    rng = random_streams(at_seed, number, path)
    # Two halves, each with a lattice of its own.
    half = dr.opaque(mi.UInt32, max(rays // 2, 1))
    shift = random_streams(at_seed, number, LATTICE_STREAM + path // half)
    numbers = stratified(shift, path % half, half)
    return gather_ray(scene.mi, gather_interaction(scene, device, row), rng, numbers)
