"""Light of the scene's own lamps, the share of each group apart, for all groups at the price of about one.

Direct light of a group is sampled at the point itself, by emitters and by the BSDF. Its indirect light is gathered over
the bins of ``radiosity``: the rays of a point serve all groups, because paths need no light; only the irradiance of the
bins is another one. Light adds up: the sum over the groups is the light of the scene.

Notation: N points, K groups, F bins, P rays per point.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from lightwell.backend import dr, mi
from lightwell.core.color import LUMINANCE
from lightwell.scenes.executor import Recipe
from lightwell.scenes.lamps import LampGroup
from lightwell.transport.gather_rays import PASSED, goes_straight
from lightwell.transport.interactions import DevicePoints, gather_interaction, own_eval_pdf, own_sample
from lightwell.transport.lamp_sources import LampSources
from lightwell.transport.panes import Panes, panes_of, unblocked
from lightwell.transport.path_numbers import LATTICE_STREAM, random_streams, stratified
from lightwell.transport.path_state import interaction_at, power_heuristic
from lightwell.transport.radiosity import LANES, Radiosity, Rows, rays_of_points
from lightwell.transport.samples import SurfacePoints
from lightwell.transport.uneven_light import UnevenLight, is_uneven, sums_by_group

# Shadow rays to each group from a bin, and from each half of a point: many points are worth more than exact ones.
BIN_SAMPLES, POINT_SAMPLES = 128, 2
# Rays from a bin that look for emitters through frosted glass and by mirrors.
BIN_RAYS = 128
# Random stream of the rays to bins that are lit unevenly.
UNEVEN_STREAM = 0x75E7
# Points whose rays are added up at a time; bounds memory.
POINTS_AT_ONCE = 1 << 14


@dataclass(frozen=True)
class LampShares:
    """Radiance that leaves N points because of each group, in two independent halves."""

    half_a: np.ndarray
    """[N, K, 3] float32."""
    half_b: np.ndarray
    """[N, K, 3] float32."""

    @property
    def radiance(self) -> np.ndarray:
        """[N, K, 3] mean of both halves."""
        return 0.5 * (self.half_a + self.half_b)


class LampLight:
    """The light of K groups of lamps in a scene."""

    def __init__(self, radiosity: Radiosity, groups: Sequence[LampGroup], seed: int) -> None:
        """Light the bins by each group.

        Args:
            radiosity: The bins of the scene.
            groups: K groups of its emitters.
            seed: Seed of the rays.
        """
        self.radiosity, self._scene = radiosity, radiosity.scene
        self.sources, self._count = LampSources(self._scene, groups), len(groups)
        self._panes = panes_of(self._scene)
        direct = np.zeros((self._count, radiosity.bins.count + 1, 3), np.float32)
        seen, square = self._bins(seed)
        direct[:, :-1] = seen + self._bins_behind(seed)
        indirect, uneven = radiosity.indirect(direct), is_uneven(seen, square)
        direct[:, :-1] -= np.where(uneven[..., None], seen, 0)
        # [3, F + 1, K]: what a ray that meets a bin is multiplied by.
        self._irradiance = np.ascontiguousarray((direct + indirect).transpose(2, 1, 0))
        level = np.where(uneven, seen @ np.asarray(LUMINANCE, np.float32), 0)
        self.uneven = UnevenLight(self._scene, radiosity.bins, self.sources, level)

    def shares(
        self,
        points: SurfacePoints,
        rays: int,
        seed: int,
        shadow_rays: int = POINT_SAMPLES,
        recipe: Callable[[int, int], Recipe] | None = None,
    ) -> LampShares:
        """Trace what points reflect of each group's light.

        Args:
            points: N surface points.
            rays: Rays per point, even.
            seed: Seed of the rays; another one than that of the bins.
            shadow_rays: Shadow rays to each group from each half of a point.
            recipe: (first, count) → how workers make that part of the points, and the bins; None: they are sent.

        Returns:
            The shares.
        """
        total = np.zeros((len(points), 2, self._count, 3), np.float32)
        for start in range(0, len(points), POINTS_AT_ONCE):
            rows = np.arange(start, min(start + POINTS_AT_ONCE, len(points)))
            told = recipe and recipe(start, len(rows))
            total[rows] = self.gathered(self.radiosity.rows(points[rows], rays, seed + start, recipe=told))
        total += self._direct(points, rays, seed, shadow_rays)
        return LampShares(np.ascontiguousarray(total[:, 0]), np.ascontiguousarray(total[:, 1]))

    @property
    def irradiance(self) -> np.ndarray:
        """[K, F + 1, 3] irradiance of the bins under each group, without uneven direct light; the last is dark."""
        return np.ascontiguousarray(self._irradiance.transpose(2, 1, 0))

    def direct(self, points: SurfacePoints, rays: int, seed: int, shadow_rays: int = POINT_SAMPLES) -> LampShares:
        """Trace what points reflect of each group's direct light, and of the bins that it lights unevenly.

        Args:
            points: N surface points.
            rays: Rays per point that the BSDF chooses, even.
            seed: Seed of the rays; another one than that of the bins.
            shadow_rays: Shadow rays to each group from each half of a point.

        Returns:
            The shares.
        """
        total = self._direct(points, rays, seed, shadow_rays)
        return LampShares(np.ascontiguousarray(total[:, 0]), np.ascontiguousarray(total[:, 1]))

    def _direct(self, points: SurfacePoints, rays: int, seed: int, shadow_rays: int) -> np.ndarray:
        """[N, 2, K, 3] direct light, and that of bins on which it is uneven."""
        device, rows = DevicePoints(points), np.arange(len(points))
        found = self._emitted(device, rows, rays, seed) + self._sampled(device, rows, shadow_rays, seed)
        return found + self._bounced(device, len(points), rays, seed) if self.uneven.any else found

    def _bounced(self, device: DevicePoints, count: int, rays: int, seed: int) -> np.ndarray:
        """[count, 2, K, 3] light of the bins on which it is uneven."""
        out = np.empty((count, 2, self._count, 3), np.float32)
        batch = max(1, LANES // rays)
        for start in range(0, count, batch):
            size = min(batch, count - start)
            w, p, n, _ = rays_of_points(self._scene, device, start, size, rays, seed ^ UNEVEN_STREAM)
            lane = dr.arange(mi.UInt32, size * rays)
            numbers = (seed & 0xFFFFFFFF, start * rays)
            at_seed, first = (dr.opaque(mi.UInt32, number) for number in numbers)
            rng = random_streams(at_seed, lane + first, mi.UInt32(UNEVEN_STREAM))
            L, group = self.uneven.light(w, p, n, self.radiosity.bins.lookup(self._scene.mi, p, n), rng)
            sums = sums_by_group(L, group, self._count, rays // 2)
            out[start : start + size] = (sums * (2 / rays)).reshape(size, 2, self._count, 3)
        return out

    # ------------------------------------------------------------------ bins

    def _bins(self, seed: int) -> tuple[np.ndarray, np.ndarray]:
        """[K, F, 3] direct irradiance of the bins, at places of each, and the mean square of its luminance [K, F]."""
        bins, size = self.radiosity.bins.count, self._count
        out, square = np.zeros((size, bins, 3), np.float32), np.zeros((size, bins), np.float32)
        batch = max(1, LANES // (BIN_SAMPLES * bins))
        for start in range(0, size, batch):
            count = min(batch, size - start)
            mean, squares = self._bin_launch(start, count, bins, seed)
            out[start : start + count] = mean.reshape(count, bins, 3)
            square[start : start + count] = squares[:, 0].reshape(count, bins)
        return out, square

    def _bin_launch(self, start: int, count: int, bins: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
        lane = dr.arange(mi.UInt32, count * bins * BIN_SAMPLES)
        path, row = lane % BIN_SAMPLES, lane // BIN_SAMPLES
        index, group = row % dr.opaque(mi.UInt32, bins), dr.opaque(mi.UInt32, start) + row // dr.opaque(mi.UInt32, bins)
        at_seed = dr.opaque(mi.UInt32, seed & 0xFFFFFFFF)
        stream = group * dr.opaque(mi.UInt32, bins) + index
        place, normal = self.radiosity.places.spread(index, path, BIN_SAMPLES)
        number, u, _ = stratified(random_streams(at_seed, stream, LATTICE_STREAM), path, mi.UInt32(BIN_SAMPLES))
        it = dr.zeros(mi.Interaction3f, dr.width(lane))
        it.p = mi.Point3f(place + dr.opaque(mi.Float, 1e-4 * self._scene.core_extent) * normal)
        it.n = mi.Normal3f(normal)
        ds, weight, _ = self.sources.sample(it, group, number, u, mi.Bool(True))
        E = weight * dr.maximum(dr.dot(normal, ds.d), 0)
        lit = (dr.max(E) > 0) & dr.all(dr.isfinite(E))
        T, _ = unblocked(self._scene.mi, self._panes, it.spawn_ray_to(ds.p), lit, mi.Bool(True))
        E = dr.select(lit, E * T, 0)
        return block_mean(E, BIN_SAMPLES), block_mean(mi.Spectrum(dr.square(mi.luminance(E))), BIN_SAMPLES)

    def _bins_behind(self, seed: int) -> np.ndarray:
        """[K, F, 3] irradiance of the bins through frosted glass and by mirrors, which shadow rays do not find."""
        bins = self.radiosity.bins.count
        out = np.empty((self._count, bins, 3), np.float32)
        for start in range(0, bins, batch := max(1, LANES // BIN_RAYS)):
            size = min(batch, bins - start)
            sums = sums_by_group(*self._behind_launch(start, size, ~seed), self._count, BIN_RAYS)
            out[:, start : start + size] = sums.swapaxes(0, 1) * (np.pi / BIN_RAYS)
        return out

    def _behind_launch(self, start: int, size: int, seed: int) -> tuple[mi.Spectrum, mi.UInt32]:
        lane = dr.arange(mi.UInt32, size * BIN_RAYS)
        path, index = lane % BIN_RAYS, dr.opaque(mi.UInt32, start) + lane // BIN_RAYS
        at_seed = dr.opaque(mi.UInt32, seed & 0xFFFFFFFF)
        rng = random_streams(at_seed, index, path)
        place, normal = self.radiosity.places.spread(index, path, BIN_RAYS)
        u = stratified(random_streams(at_seed, index, LATTICE_STREAM), path, mi.UInt32(BIN_RAYS))[1]
        it = dr.zeros(mi.Interaction3f, dr.width(lane))
        it.p = mi.Point3f(place + dr.opaque(mi.Float, 1e-4 * self._scene.core_extent) * normal)
        it.n = mi.Normal3f(normal)
        d = mi.Frame3f(normal).to_world(mi.warp.square_to_cosine_hemisphere(u))
        # A density of 0 leaves what is seen at once, or through clear glass, to the shadow rays.
        chosen = (dr.zeros(mi.Float, dr.width(lane)), mi.Bool(False))
        way = (it.spawn_ray(d), mi.Spectrum(1), it, chosen)
        L, group = emission_met(self._scene.mi, self.sources, self._panes, rng, *way)
        good = dr.all(dr.isfinite(L))
        return dr.select(good, L, 0), dr.select(good, group, self._count)

    # ------------------------------------------------------------------ points

    def gathered(self, rows: Rows) -> np.ndarray:
        """Sum up the rays of each half times the irradiance of the bins that they met.

        Args:
            rows: What n points see of the bins.

        Returns:
            [n, 2, K, 3] indirect light.
        """
        from scipy.sparse import csr_matrix

        count, rays = rows.bin.shape
        out = np.empty((count, 2, self._count, 3), np.float32)
        shape = (2 * count, self._irradiance.shape[1])
        ends, met = np.arange(0, count * rays + 1, rays // 2), rows.bin.ravel().astype(np.int32)
        for channel in range(3):
            weight = rows.weight[..., channel].astype(np.float32).ravel()
            found = csr_matrix((weight, met, ends), shape=shape) @ self._irradiance[channel]
            out[..., channel] = found.reshape(count, 2, self._count)
        return out

    def _sampled(self, device: DevicePoints, rows: np.ndarray, samples: int, seed: int) -> np.ndarray:
        """[n, 2, K, 3] direct light by shadow rays to each group."""
        out = np.empty((len(rows), 2, self._count, 3), np.float32)
        batch = max(1, LANES // (2 * samples * self._count))
        for start in range(0, len(rows), batch):
            part = rows[start : start + batch]
            out[start : start + len(part)] = self._sample_launch(device, part, samples, seed)
        return out

    def _sample_launch(self, device: DevicePoints, rows: np.ndarray, samples: int, seed: int) -> np.ndarray:
        lane = dr.arange(mi.UInt32, len(rows) * 2 * self._count * samples)
        path, block = lane % samples, lane // samples
        groups = dr.opaque(mi.UInt32, self._count)
        group, half_of_row = block % groups, block // groups
        row = dr.opaque(mi.UInt32, int(rows[0])) + half_of_row // 2
        at_seed = dr.opaque(mi.UInt32, seed & 0xFFFFFFFF)
        shift = random_streams(at_seed, row, LATTICE_STREAM + 2 + (half_of_row & 1) * groups + group)
        number, u, _ = stratified(shift, path, mi.UInt32(samples))
        si = gather_interaction(self._scene, device, row)
        bsdf = si.bsdf()
        active = mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
        ds, weight, density = self.sources.sample(si, group, number, u, active)
        value, pdf = own_eval_pdf(si, bsdf, si.to_local(ds.d), density > 0)
        L = dr.select(ds.delta, 1, power_heuristic(density, pdf)) * value * weight
        lit = (density > 0) & (dr.max(L) > 0) & dr.all(dr.isfinite(L))
        T, _ = unblocked(self._scene.mi, self._panes, si.spawn_ray_to(ds.p), lit, mi.Bool(True))
        L = dr.select(lit, L * T, 0)
        return block_mean(L, samples).reshape(len(rows), 2, self._count, 3)

    def _emitted(self, device: DevicePoints, rows: np.ndarray, rays: int, seed: int) -> np.ndarray:
        """[n, 2, K, 3] direct light by rays that the BSDF chooses; added up in the order of the rays."""
        out = np.empty((len(rows), 2, self._count, 3), np.float32)
        batch = max(1, LANES // rays)
        for start in range(0, len(rows), batch):
            part = rows[start : start + batch]
            sums = sums_by_group(*self._emitted_launch(device, part, rays, seed), self._count, rays // 2)
            out[start : start + len(part)] = (sums * (2 / rays)).reshape(len(part), 2, self._count, 3)
        return out

    def _emitted_launch(self, device: DevicePoints, rows: np.ndarray, rays: int, seed: int):
        size = dr.opaque(mi.UInt32, rays)
        lane = dr.arange(mi.UInt32, len(rows) * rays)
        path, row = lane % size, dr.opaque(mi.UInt32, int(rows[0])) + lane // size
        at_seed, half = dr.opaque(mi.UInt32, ~seed & 0xFFFFFFFF), dr.opaque(mi.UInt32, rays // 2)
        shift = random_streams(at_seed, row, LATTICE_STREAM + path // half)
        first = stratified(shift, path % half, half)
        si = gather_interaction(self._scene, device, row)
        sources = (self.sources, self._panes)
        L, group = _first_emission(self._scene.mi, si, sources, random_streams(at_seed, row, path), first)
        good = dr.all(dr.isfinite(L))
        return dr.select(good, L, 0), dr.select(good, group, self._count)


def block_mean(value: mi.Spectrum, size: int) -> np.ndarray:
    """Average blocks of lanes.

    Args:
        value: [lanes] colours.
        size: Lanes of a block.

    Returns:
        [lanes / size, 3] means.
    """
    dr.eval(value)
    total = dr.block_sum(value, size)
    dr.eval(total)
    return np.array(total).T / size


def _first_emission(scene, si, sources, rng, first):
    """Follow a ray that the BSDF chooses, through mirrors, glass and holes, to what it meets first.

    Returns the emission found times the BSDF, weighted against shadow rays, and its group.
    """
    lobe, direction, _ = first
    sample, weight = own_sample(si, si.bsdf(), lobe, direction)
    delta = mi.has_flag(sample.sampled_type, mi.BSDFFlags.Delta)
    ray, prev = si.spawn_ray(si.to_world(sample.wo)), interaction_at(si)
    return emission_met(scene, *sources, rng, ray, mi.Spectrum(weight), prev, (mi.Float(sample.pdf), delta))


@dr.syntax
def emission_met(scene, sources, panes, rng, ray, β, prev, chosen):
    """Follow rays through mirrors, glass and holes to what they meet first.

    Shadow rays pass glass and holes in a straight line, so that what rays find behind them is weighted as what they
    find at once. Refraction makes the two differ: small lamps count as if glass bent no light, large ones as they are.

    Args:
        scene: Mitsuba scene.
        sources: ``LampSources`` of K groups.
        panes: What shadow rays pass; None: nothing.
        rng: [N] random streams.
        ray: [N] rays.
        β: [N] their throughput.
        prev: [N] places where they begin.
        chosen: Density per steradian of their directions, and whether they are those of a mirror.

    Returns:
        Emission found times the throughput, weighted against shadow rays, and its group; K where there is none.
    """
    ctx = mi.BSDFContext()
    pdf, beside = mi.Float(chosen[0]), ~mi.Bool(chosen[1])
    ray, β = mi.Ray3f(ray), mi.Spectrum(β)
    L, found = mi.Spectrum(0), mi.UInt32(sources.count)
    passed = mi.UInt32(0)
    active = dr.max(β) != 0
    while dr.hint(active, label="lightwell lamps"):
        si = scene.ray_intersect(ray, mi.RayFlags.All, False, active)
        group, emitted, density = sources.met(prev, si, active)
        mis = dr.select(beside, power_heuristic(pdf, density), 1)
        shines = active & (dr.max(emitted) > 0)
        L = dr.select(shines, β * mis * emitted, L)
        found = dr.select(shines, group, found)
        active &= si.is_valid() & ~shines
        u = mi.Point2f(rng.next_float32(), rng.next_float32())
        sample, albedo = si.bsdf(ray).sample(ctx, si, rng.next_float32(), u, active)
        β = dr.select(active, β * albedo, β)
        beside &= _passes(panes, si, sample, active)
        ray = si.spawn_ray(si.to_world(sample.wo))
        passed += 1
        active &= goes_straight(sample) & (passed < PASSED) & (dr.max(β) != 0)
    return L, found


def _passes(panes: Panes | None, si: mi.SurfaceInteraction3f, sample: mi.BSDFSample3f, active: mi.Bool) -> mi.Bool:
    """[N] whether rays go on behind surfaces that shadow rays pass too."""
    if panes is None:
        return mi.Bool(False)
    has = lambda flag: mi.has_flag(sample.sampled_type, flag)  # noqa: E731
    across = has(mi.BSDFFlags.DeltaTransmission) | has(mi.BSDFFlags.GlossyTransmission) | has(mi.BSDFFlags.Null)
    return across & (panes.passes(si, active)[1] > 0)
