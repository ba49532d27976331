"""Irradiance / π of groups of lamps at surface points, the share of each apart: what a light map with switches stores.

    E'_k = (1 / π) ∫ L_k(ω) max(n · ω, 0) dω

As ``lamp_light`` does for what surfaces reflect: the rays of a point serve all groups. Direct light is sampled at the
point, by shadow rays to each group and by cosine-distributed rays; indirect light is gathered over bins of surface.

Notation: N points, K groups, P rays per point.
"""

from __future__ import annotations

import numpy as np

from lightwell.backend import dr, mi
from lightwell.transport.gather_rays import ray_ends
from lightwell.transport.interactions import DevicePoints, gather_interaction
from lightwell.transport.lamp_light import LampLight, block_mean, emission_met
from lightwell.transport.panes import panes_of, unblocked
from lightwell.transport.path_numbers import LATTICE_STREAM, check_halves, random_streams, stratified
from lightwell.transport.path_state import interaction_at, power_heuristic
from lightwell.transport.radiosity import LANES, Rows, bin_type, stored_ends
from lightwell.transport.samples import SurfacePoints
from lightwell.transport.uneven_light import sums_by_group

# Points whose shares are added up at a time; bounds memory.
POINTS_AT_ONCE = 1 << 15


def irradiance_shares(
    light: LampLight, points: SurfacePoints, rays: int, seed: int, shadow_rays: int = 2
) -> np.ndarray:
    """Trace irradiance / π of every group, on the side of the points' views.

    Args:
        light: Groups of lamps, and the bins of their scene.
        points: N surface points.
        rays: Rays per point, even, ≥ 2.
        seed: Seed of the rays; another one than that of the bins.
        shadow_rays: Shadow rays from each point to each group.

    Returns:
        [N, K, 3] float32.

    Raises:
        ValueError: ``rays`` is odd or below 2.
    """
    check_halves(rays, "rays")
    device, groups = DevicePoints(points), light.sources.count
    out = np.empty((len(points), groups, 3), np.float32)
    for start in range(0, len(points), POINTS_AT_ONCE):
        count = min(POINTS_AT_ONCE, len(points) - start)
        tracer = _Tracer(light, device, start, count, seed)
        seen, uneven = tracer.rows(rays)
        part = light.gathered(seen).mean(axis=1) + uneven
        out[start : start + count] = part + tracer.met(rays) + tracer.sampled(shadow_rays)
    return np.nan_to_num(out, copy=False, posinf=0, neginf=0)


class _Tracer:
    """Rays of ``count`` neighbouring points."""

    def __init__(self, light: LampLight, device: DevicePoints, start: int, count: int, seed: int) -> None:
        self._light, self._scene, self._device = light, light.radiosity.scene, device
        self._start, self._count, self._seed = start, count, seed

    def rows(self, rays: int) -> tuple[Rows, np.ndarray]:
        """What cosine-distributed rays meet; a weight is E' for an irradiance of 1 on the bin.

        And the light of the bins on which it is uneven, [count, K, 3].
        """
        bins, uneven = self._light.radiosity.bins, np.zeros((self._count, self._light.sources.count, 3))
        found = np.empty((self._count, rays), bin_type(bins.count))
        weight = np.empty((self._count, rays, 3), np.float16)
        for first, size in _parts(self._count, rays):
            _, ray, β, rng = self._cosine_rays(first, size, rays, self._seed)
            w, p, n, _ = ray_ends(self._scene.mi, ray, β, rng)
            index = bins.lookup(self._scene.mi, p, n)
            if self._light.uneven.any:
                L, group = self._light.uneven.light(w, p, n, index, rng)
                uneven[first : first + size] = sums_by_group(L, group, uneven.shape[1], rays) / rays
            w, index = stored_ends(w, index, dr.opaque(mi.Float, 2 / rays), dr.opaque(mi.UInt32, bins.count))
            dr.eval(w, index)
            found[first : first + size] = np.array(index).reshape(size, rays)
            for c, values in enumerate(w):
                weight[first : first + size, :, c] = np.array(values).reshape(size, rays)
        return Rows(found, weight), uneven

    def met(self, rays: int) -> np.ndarray:
        """[count, K, 3] direct light that cosine-distributed rays meet; added up in the order of the rays."""
        sources = self._light.sources
        out = np.empty((self._count, sources.count, 3))
        for first, size in _parts(self._count, rays):
            (si, density), ray, β, rng = self._cosine_rays(first, size, rays, ~self._seed)
            start = (density, mi.Bool(False))
            way = (ray, β, interaction_at(si), start)
            L, group = emission_met(self._scene.mi, sources, panes_of(self._scene), rng, *way)
            good = dr.all(dr.isfinite(L))
            L, group = dr.select(good, L, 0), dr.select(good, group, sources.count)
            out[first : first + size] = sums_by_group(L, group, sources.count, rays)
        return out / rays

    def sampled(self, samples: int) -> np.ndarray:
        """[count, K, 3] direct light by shadow rays to each group."""
        groups = self._light.sources.count
        out = np.empty((self._count, groups, 3))
        for first, size in _parts(self._count, samples * groups):
            out[first : first + size] = self._shadow_rays(first, size, samples)
        return out

    def _shadow_rays(self, first: int, size: int, samples: int) -> np.ndarray:
        sources = self._light.sources
        lane = dr.arange(mi.UInt32, size * sources.count * samples)
        path, block = lane % samples, lane // samples
        count = dr.opaque(mi.UInt32, sources.count)
        group, row = block % count, dr.opaque(mi.UInt32, self._start + first) + block // count
        seed = dr.opaque(mi.UInt32, self._seed & 0xFFFFFFFF)
        number, u, _ = stratified(random_streams(seed, row, LATTICE_STREAM + 2 + group), path, mi.UInt32(samples))
        si, flat, normal = self._facing(row)
        ds, weight, density = sources.sample(si, group, number, u, mi.Bool(True))
        cosine = dr.dot(normal, ds.d)
        mis = dr.select(ds.delta, 1, power_heuristic(density, cosine * dr.inv_pi))
        E = mis * weight * cosine * dr.inv_pi
        lit = (density > 0) & (cosine > 0) & (dr.dot(flat, ds.d) > 0) & (dr.max(E) > 0) & dr.all(dr.isfinite(E))
        T, _ = unblocked(self._scene.mi, panes_of(self._scene), si.spawn_ray_to(ds.p), lit, mi.Bool(True))
        E = dr.select(lit, E * T, 0)
        return block_mean(E, samples).reshape(size, sources.count, 3)

    def _cosine_rays(self, first: int, size: int, rays: int, seed: int):
        """(interactions, density), rays, throughput and random streams of cosine-distributed rays."""
        width = dr.opaque(mi.UInt32, rays)
        lane = dr.arange(mi.UInt32, size * rays)
        path, row = lane % width, dr.opaque(mi.UInt32, self._start + first) + lane // width
        at_seed, half = dr.opaque(mi.UInt32, seed & 0xFFFFFFFF), dr.opaque(mi.UInt32, rays // 2)
        # Two halves, each with a lattice of its own.
        shift = random_streams(at_seed, row, LATTICE_STREAM + path // half)
        u = stratified(shift, path % half, half)[1]
        si, flat, normal = self._facing(row)
        d = mi.Frame3f(normal).to_world(mi.warp.square_to_cosine_hemisphere(u))
        β = mi.Spectrum(dr.select(dr.dot(flat, d) > 0, mi.Float(1), 0))
        return (si, dr.dot(normal, d) * dr.inv_pi), si.spawn_ray(d), β, random_streams(at_seed, row, path)

    def _facing(self, row: mi.UInt32):
        """Interactions at points, with the geometric and the shading normal on the side of the view."""
        si = gather_interaction(self._scene, self._device, row)
        view = dr.gather(mi.Vector3f, self._device.view, row)
        flat = mi.Vector3f(si.n) * dr.sign(dr.dot(si.n, view))
        normal = mi.Vector3f(si.sh_frame.n)
        return si, flat, normal * dr.select(dr.dot(normal, flat) < 0, -1.0, 1.0)


def _parts(count: int, lanes: int):
    """(first, size) of launches over ``count`` points of so many lanes each."""
    batch = max(1, LANES // lanes)
    return [(start, min(batch, count - start)) for start in range(0, count, batch)]
