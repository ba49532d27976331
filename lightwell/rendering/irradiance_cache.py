"""An irradiance cache: sparse records of irradiance with gradients, interpolated in the picture (a baseline).

A record at x_i with normal n_i is used at x where the error of the split-sphere model is small:

    1 / w_i(x) = ‖x − x_i‖ / R_i + √(1 − n · n_i) < a
    E(x) = Σ w_i (E_i + (n_i × n) · ∇_r E_i + (x − x_i) · ∇_t E_i) / Σ w_i

R_i is the harmonic mean of the distances to what the record saw, at most E_i / ‖∇_t E_i‖.

Papers: Ward, Rubinstein, Clear, *A Ray Tracing Solution for Diffuse Interreflection*, SIGGRAPH 1988; Ward and Heckbert,
*Irradiance Gradients*, Eurographics Workshop on Rendering 1992. Notation: P points, rays in M rings by N sectors.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from lightwell.backend import dr, mi
from lightwell.cache.frames import sampled_rays
from lightwell.cache.scene_region import bounds_of
from lightwell.rendering.indirect_baseline import IndirectBaseline

# Pixels between the places where records are looked for, from pass to pass.
STRIDES = (16, 8, 4, 2, 1)
# Records that are tried at a point, the nearest first.
NEAREST = 24
# Smallest and largest radius of a record as a share of the scene's extent (Radiance: maximum over minimum of 64).
SMALLEST, LARGEST = 1 / 512, 1 / 8
# A record in front of a point by more than this share of its radius is not used (Ward 1988, eq. 5).
AHEAD = 0.05
# Rays of one launch.
LAUNCH = 1 << 20


@dataclass(frozen=True)
class Records:
    """P records of irradiance."""

    position: np.ndarray
    """[P, 3] metres."""
    normal: np.ndarray
    """[P, 3] unit."""
    irradiance: np.ndarray
    """[P, 3]."""
    turning: np.ndarray
    """[P, 3, 3] rotation gradient: of each colour a vector."""
    moving: np.ndarray
    """[P, 3, 3] translation gradient, 1 / m."""
    radius: np.ndarray
    """[P] metres."""

    def __len__(self) -> int:
        return len(self.position)

    def joined(self, other: Records) -> Records:
        """Append other records.

        Args:
            other: The records to append.

        Returns:
            Both.
        """
        names = self.__dataclass_fields__
        return Records(*(np.concatenate([getattr(self, name), getattr(other, name)]) for name in names))


def frames_of(normal: np.ndarray) -> np.ndarray:
    """Make tangent frames.

    Args:
        normal: [P, 3] unit normals.

    Returns:
        [P, 3, 3] rows: two tangents and the normal.
    """
    helper = np.where(np.abs(normal[:, :1]) > 0.9, [[0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0]])
    tangent = np.cross(helper, normal)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    return np.stack([tangent, np.cross(normal, tangent), normal], axis=1)


def directions(frames: np.ndarray, rings: int, sectors: int, rng: np.random.Generator) -> np.ndarray:
    """Draw stratified, cosine-distributed directions.

    Args:
        frames: [P, 3, 3] tangent frames.
        rings: M.
        sectors: N.
        rng: Random numbers.

    Returns:
        [P, M, N, 3] unit directions.
    """
    u, v = rng.random((2, len(frames), rings, sectors))
    sine = np.sqrt((np.arange(rings)[:, None] + u) / rings)
    angle = 2 * np.pi * (np.arange(sectors) + v) / sectors
    local = np.stack([sine * np.cos(angle), sine * np.sin(angle), np.sqrt(np.maximum(1 - sine**2, 0))], axis=-1)
    return np.einsum("pmnc,pcd->pmnd", local, frames)


def integrate(
    position: np.ndarray, frames: np.ndarray, radiance: np.ndarray, distance: np.ndarray, extent: float
) -> Records:
    """Make records of what rays in stratified, cosine-distributed directions saw.

    Args:
        position: [P, 3] metres.
        frames: [P, 3, 3] tangent frames.
        radiance: [P, M, N, 3] along the rays.
        distance: [P, M, N] metres, inf where nothing was hit.
        extent: Extent of the scene, metres; limits the radii.

    Returns:
        The records.
    """
    _, rings, sectors = distance.shape
    irradiance = np.pi * radiance.mean(axis=(1, 2))
    centre = 2 * np.pi * (np.arange(sectors) + 0.5) / sectors
    edge = 2 * np.pi * np.arange(sectors) / sectors
    # Directions in the tangent plane: along the middle of a sector, across it, and across its first edge.
    along, across, at_edge = (
        frames[:, 0, None] * np.cos(a)[None, :, None] + frames[:, 1, None] * np.sin(a)[None, :, None]
        for a in (centre, centre + 0.5 * np.pi, edge + 0.5 * np.pi)
    )
    middle = np.sqrt((np.arange(rings) + 0.5) / rings)
    tangent = middle / np.sqrt(1 - middle**2)
    turning = np.pi / (rings * sectors) * np.einsum("m,pmnc,pnd->pcd", tangent, radiance, across)
    bounds = np.sqrt(np.arange(rings + 1) / rings)
    near = np.minimum(distance[:, 1:], distance[:, :-1])
    inner = (bounds[1:-1] * (1 - bounds[1:-1] ** 2))[None, :, None] / near
    outward = np.einsum("pmn,pmnc->pnc", inner, np.diff(radiance, axis=1)) * 2 * np.pi / sectors
    near = np.minimum(distance, np.roll(distance, 1, axis=2))
    steps = radiance - np.roll(radiance, 1, axis=2)
    sideways = np.einsum("pmn,pmnc->pnc", np.diff(bounds)[None, :, None] / near, steps)
    moving = np.einsum("pnc,pnd->pcd", outward, along) + np.einsum("pnc,pnd->pcd", sideways, at_edge)
    with np.errstate(divide="ignore"):
        harmonic = 1 / np.mean(1 / np.maximum(distance, 1e-9), axis=(1, 2))
        steepness = np.linalg.norm(moving.mean(axis=1), axis=1)
        limit = irradiance.mean(axis=1) / np.maximum(steepness, 1e-20)
    radius = np.clip(np.minimum(harmonic, limit), SMALLEST * extent, LARGEST * extent)
    return Records(position, frames[:, 2], irradiance, turning, moving, radius)


def interpolate(
    records: Records, position: np.ndarray, normal: np.ndarray, accuracy: float
) -> tuple[np.ndarray, np.ndarray]:
    """Interpolate irradiance.

    Args:
        records: Records, at least one.
        position: [Q, 3] metres.
        normal: [Q, 3] unit.
        accuracy: The a of the split-sphere model.

    Returns:
        Irradiance [Q, 3] ≥ 0, and whether a record was near enough [Q].
    """
    count = min(NEAREST, len(records))
    _, index = cKDTree(records.position).query(position, k=count)
    index = index.reshape(len(position), count)
    offset = position[:, None] - records.position[index]
    towards = records.normal[index]
    facing = np.clip(np.einsum("qd,qkd->qk", normal, towards), -1, 1)
    radius = records.radius[index]
    error = np.linalg.norm(offset, axis=2) / radius + np.sqrt(1 - facing)
    ahead = np.einsum("qkd,qkd->qk", offset, normal[:, None] + towards) / 2 < -AHEAD * radius
    weight = np.where((error < accuracy) & ~ahead, 1 / np.maximum(error, 1e-6), 0)
    turned = np.cross(towards, normal[:, None])
    values = records.irradiance[index]
    values = values + np.einsum("qkd,qkcd->qkc", turned, records.turning[index])
    values = values + np.einsum("qkd,qkcd->qkc", offset, records.moving[index])
    total = weight.sum(axis=1)
    mean = np.einsum("qk,qkc->qc", weight, values) / np.maximum(total, 1e-20)[:, None]
    return np.maximum(mean, 0), total > 0


class IrradianceCacheIntegrator(IndirectBaseline):
    """Direct light by path tracing, indirect light of diffuse reflection from an irradiance cache.

    Records are placed where the picture has none that is near enough, in passes over ever finer grids of pixels. Every
    ray of a record is a path of Mitsuba's ``path``.

    Not supported: indirect light that is reflected other than diffusely at the first surface, participating media,
    derivatives. Reconstruction filters other than the box are taken as the box.

    Parameters: ``rings`` and ``sectors`` of the rays of a record (8, 24), ``accuracy`` (0.3: smaller is denser),
    ``max_depth`` (-1).
    """

    plugin = "lightwell_irradiance_cache"

    def __init__(self, props: Any = None) -> None:
        """Read the parameters.

        Args:
            props: Mitsuba properties of the plugin; None: the defaults.
        """
        props = mi.Properties(self.plugin) if props is None else props
        super().__init__(props)
        self.rings, self.sectors = int(props.get("rings", 8)), int(props.get("sectors", 24))
        self.accuracy = float(props.get("accuracy", 0.3))
        """Largest error of the split-sphere model at which a record is used."""
        self.records: Records | None = None
        """Records of the last image."""

    def _indirect(self, scene: Any, sensor: Any, first: int, spp: int, size: tuple[int, int]) -> np.ndarray:
        """See ``IndirectBaseline``."""
        height, width = size
        self.records = None
        y, x = (v.ravel() for v in np.mgrid[:height, :width])
        total = np.zeros((height * width, 3))
        for number in range(spp):
            hit, position, normal, reflectance = _seen(scene, sensor, first * spp + number)
            wanted = hit & (reflectance.max(axis=1) > 0)
            # The first sample places most records, from a coarse grid to a fine one; the others fill what is left.
            for stride in STRIDES if number == 0 else STRIDES[-1:]:
                rows = np.flatnonzero(wanted & (x % stride == 0) & (y % stride == 0))
                self._place(scene, position[rows], normal[rows], (first * spp + number) * len(STRIDES) + stride)
            if self.records is not None:
                found, _ = interpolate(self.records, position[wanted], normal[wanted], self.accuracy)
                total[wanted] += reflectance[wanted] / np.pi * found
        return total

    def _place(self, scene: Any, position: np.ndarray, normal: np.ndarray, seed: int) -> None:
        """Put records at those of [P, 3] places that have none near enough."""
        if self.records is not None and len(position):
            rows = ~interpolate(self.records, position, normal, self.accuracy)[1]
            position, normal = position[rows], normal[rows]
        if len(position):
            made = self.measure(scene, position, normal, seed)
            self.records = made if self.records is None else self.records.joined(made)

    def measure(self, scene: Any, position: np.ndarray, normal: np.ndarray, seed: int) -> Records:
        """Trace the rays of records.

        Args:
            scene: Mitsuba scene.
            position: [P, 3] points on surfaces, metres.
            normal: [P, 3] unit normals.
            seed: Seed.

        Returns:
            P records of indirect irradiance.
        """
        low, high = bounds_of(scene)
        extent, rng = float((high - low).max()), np.random.default_rng(seed)
        frames = frames_of(normal)
        way = directions(frames, self.rings, self.sectors, rng)
        rays = self.rings * self.sectors
        origin = np.repeat(position + 1e-4 * extent * normal, rays, axis=0)
        parts = []
        for start in range(0, len(origin), LAUNCH):
            rows = slice(start, start + LAUNCH)
            parts.append(self._along(scene, origin[rows], way.reshape(-1, 3)[rows], seed + start))
        radiance, distance = (np.concatenate(part) for part in zip(*parts))
        shape = (len(position), self.rings, self.sectors)
        return integrate(position, frames, radiance.reshape(*shape, 3), distance.reshape(shape), extent)

    def _along(self, scene: Any, origin: np.ndarray, way: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
        """([N, 3] radiance without the emission that a ray meets, [N] distance) along rays."""
        places = (kind(np.ascontiguousarray(v.T, np.float32)) for kind, v in ((mi.Point3f, origin), (mi.Vector3f, way)))
        ray = mi.RayDifferential3f(mi.Ray3f(*places))
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(seed & 0x7FFFFFFF, len(origin))
        path = mi.load_dict({"type": "path", "max_depth": -1 if self.longest < 0 else max(self.longest - 1, 0)})
        si = scene.ray_intersect(ray)
        L, _, _ = path.sample(scene, sampler, ray)
        L -= si.emitter(scene).eval(si)
        distance = dr.select(si.is_valid(), si.t, dr.inf)
        return np.maximum(np.array(L).T, 0), np.array(distance)


def _seen(scene: Any, sensor: Any, seed: int) -> tuple[np.ndarray, ...]:
    """(mask [N], position [N, 3], normal towards the eye [N, 3], diffuse reflectance [N, 3]) behind every pixel."""
    size = sensor.film().crop_size()
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, int(size.x) * int(size.y))
    ray, _, _, _ = sampled_rays(sensor, sampler, 1)
    si = scene.ray_intersect(ray)
    hit = si.is_valid()
    normal = si.to_world(mi.Vector3f(0, 0, dr.select(si.wi.z >= 0, mi.Float(1), mi.Float(-1))))
    reflectance = dr.select(hit, si.bsdf().eval_diffuse_reflectance(si, hit), 0)
    return np.array(hit), *(np.array(v).T.astype(np.float64) for v in (si.p, normal, reflectance))


def register() -> None:
    """Register ``lightwell_irradiance_cache`` with the active Mitsuba variant."""
    mi.register_integrator(IrradianceCacheIntegrator.plugin, lambda props: IrradianceCacheIntegrator(props))
