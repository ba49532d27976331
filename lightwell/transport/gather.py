"""Final gather: radiance that leaves surfaces towards cameras, from a light map of the irradiance everywhere else.

A path ends where it meets a surface whose light is known, L = ρ E' (Ward et al. 1988; Jensen's final gather, 2001), so
that the noise is little more than that of the directions of its first bounce. Notation: N points, n texels along an
edge, E' = irradiance / π.

A surface where a path ends counts as if E' arrived from everywhere: its reflectance from the direction of the path is
estimated by one sample of its BSDF, so that no energy is lost where it is no Lambertian one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.backend import dr, mi, upload_floats, upload_integers
from lightwell.scenes.atlas import Atlas
from lightwell.scenes.executor import Arrays
from lightwell.scenes.scene import Material, Scene
from lightwell.transport.interactions import DevicePoints, gather_interaction, own_eval_pdf, own_sample
from lightwell.transport.irradiance import first_directions, half_means
from lightwell.transport.path_numbers import LATTICE_STREAM, check_halves, next_2d, random_streams, stratified
from lightwell.transport.path_state import PathState, aim_at_light, interaction_at, is_delta
from lightwell.transport.paths import MAX_DEPTH, RR_DEPTH
from lightwell.transport.radiance import LAUNCH
from lightwell.transport.row_tasks import rows_of
from lightwell.transport.samples import SurfacePoints, columns_of
from lightwell.transport.sources import Emitters
from lightwell.transport.tables import shape_index, shape_lookup, tables

# Surfaces as rough as this, unless they are metals, have nearly view-independent radiance: the irradiance is enough for
# the second hit of a path, which the camera does not see.
ROUGH, METAL = 0.4, 0.5
# The same where only light is gathered that a surface scatters in all directions: reflections are seen by nobody.
SMOOTH = 0.2
# Texels of a texture of roughness of which one is read for its mean, along each edge.
SKIPPED = 4


def settled(material: Material, matte: bool, scattered: bool = False) -> bool:
    """Decide whether ρ E' replaces the radiance of a surface for paths that meet it.

    Args:
        material: Material of the surface.
        matte: Whether its radiance is view-independent.
        scattered: Whether the paths come from surfaces that scatter what they gather.

    Returns:
        True where a path may end there.
    """
    roughness, metallic = material.roughness, material.metallic
    if (texture := material.metallic_roughness_texture) is not None:
        mean = texture.image.pixels[::SKIPPED, ::SKIPPED, 1:3].mean(axis=(0, 1)) / 255
        roughness, metallic = roughness * mean[0], metallic * mean[1]
    rough = roughness >= SMOOTH if scattered else roughness >= ROUGH and metallic <= METAL
    layers = material.clearcoat or material.transmission or material.delta
    return material.alpha_mode == "OPAQUE" and not layers and (matte or rough)


@dataclass
class KnownIrradiance:
    """A light map of E' = irradiance / π on an atlas, on the device."""

    size: mi.UInt32
    """n."""
    image: mi.Float
    """[n * n * 4] E', and whether paths must not end there, row-major."""
    uv: mi.Float
    """[2 * T * 6] corners of every triangle, by side."""
    stored: mi.Bool
    """[2 * T] sides whose light is known."""
    first: mi.UInt32
    """[M] first triangle of each mesh."""
    triangles: int
    """T."""
    meshes: mi.UInt32
    """See ``shape_lookup``."""

    @staticmethod
    def of(scene: Scene, atlas: Atlas, image: np.ndarray, matte: np.ndarray) -> KnownIrradiance:
        """Upload a light map.

        Args:
            scene: Scene with M meshes.
            atlas: Atlas of n x n texels.
            image: [n, n, 3] E'.
            matte: [M] bool: meshes with view-independent radiance.

        Returns:
            The light map, with the sides at which paths may end.
        """
        return KnownIrradiance.uploaded(scene, known_arrays(scene, atlas, image, matte))

    @staticmethod
    def uploaded(scene: Scene, arrays: Arrays) -> KnownIrradiance:
        """Upload the arrays of ``known_arrays``.

        Args:
            scene: Scene with M meshes.
            arrays: The arrays.

        Returns:
            The light map.
        """
        t = tables(scene)
        return KnownIrradiance(
            dr.opaque(mi.UInt32, len(arrays["image"])),
            upload_floats(arrays["image"].ravel()),
            upload_floats(arrays["uv"].ravel()),
            mi.Bool(arrays["stored"].astype(bool).ravel()),
            upload_integers(t.first[:-1]),
            len(t.area),
            shape_lookup(scene),
        )

    def find(
        self, si: mi.SurfaceInteraction3f, place: mi.Point2f, ray: mi.Ray3f, u: tuple[mi.Float, mi.Point2f],
        active: mi.Bool,
    ) -> tuple[mi.Bool, mi.Spectrum]:  # fmt: skip
        """Look up the light that leaves the hits of rays.

        Args:
            si: Surface interactions.
            place: Barycentric weights of the second and third vertex.
            ray: Rays that found them.
            u: Random numbers in [0, 1) for one sample of the BSDF.
            active: Lanes to look up.

        Returns:
            Whether the light is known, and an estimate of the radiance.
        """
        mesh = shape_index(self.meshes, si.shape)
        back = dr.dot(si.n, ray.d) > 0
        row = dr.gather(mi.UInt32, self.first, mesh, active) + si.prim_index + dr.select(back, self.triangles, 0)
        found = active & dr.gather(mi.Bool, self.stored, row, active)
        light, unsure = self._read(place, row, found)
        found &= unsure <= 0
        _, reflectance = si.bsdf().sample(mi.BSDFContext(), si, *u, found)
        return found, reflectance * light

    def _read(self, place, row, active) -> tuple[mi.Spectrum, mi.Float]:
        """Read E' at a hit, bilinearly filtered, and more than 0 where it is not sure."""
        a, b, c = (
            mi.Point2f(*(dr.gather(mi.Float, self.uv, row * 6 + (2 * k + axis), active) for axis in (0, 1)))
            for k in range(3)
        )
        at = (a + (b - a) * place.x + (c - a) * place.y) * mi.Float(self.size) - 0.5
        at = dr.clip(at, 0, mi.Float(self.size) - 1)
        low = mi.Point2u(at)
        high = mi.Point2u(dr.minimum(low.x + 1, self.size - 1), dr.minimum(low.y + 1, self.size - 1))
        t = at - mi.Point2f(low)
        texel = lambda x, y: dr.gather(mi.Vector4f, self.image, y * self.size + x, active)  # noqa: E731
        upper = texel(low.x, low.y) * (1 - t.x) + texel(high.x, low.y) * t.x
        lower = texel(low.x, high.y) * (1 - t.x) + texel(high.x, high.y) * t.x
        mixed = upper * (1 - t.y) + lower * t.y
        return mi.Color3f(mixed.x, mixed.y, mixed.z), mixed.w


def known_arrays(
    scene: Scene,
    atlas: Atlas,
    image: np.ndarray,
    matte: np.ndarray,
    unsure: np.ndarray | None = None,
    scattered: bool = False,
) -> Arrays:
    """Collect what ``KnownIrradiance`` uploads: arrays that are sent to workers.

    Args:
        scene: Scene with T triangles in M meshes.
        atlas: Atlas of n x n texels.
        image: [n, n, 3] E'.
        matte: [M] bool: meshes with view-independent radiance.
        unsure: [n, n] bool: texels at which no path may end; None: none.
        scattered: See ``settled``.

    Returns:
        ``image`` [n, n, 4], ``uv`` [2, T, 3, 2], ``stored`` [2, T].
    """
    known = [settled(scene.materials[m.material], bool(b), scattered) for m, b in zip(scene.meshes, matte)]
    mask = np.zeros(image.shape[:2]) if unsure is None else unsure
    four = np.concatenate([image, mask[..., None]], axis=2).astype(np.float32)
    stored = (atlas.chart >= 0) & np.array(known, bool)[tables(scene).mesh_of]
    return {"image": four, "uv": atlas.uv.astype(np.float32), "stored": stored.astype(np.uint8)}


def gathered(
    scene: Scene, points: SurfacePoints, light: KnownIrradiance, paths: int, seed: int, max_depth: int = MAX_DEPTH
) -> tuple[np.ndarray, np.ndarray]:
    """Gather radiance leaving points towards their views, as ``static`` does, ending paths at known light.

    The same paths also estimate E', a control variate: L + a (E' − the paths' estimate of it) has the mean of L and,
    where a is the diffuse albedo, little more noise than the reflections. The result is biased by the error of the
    light map, and by ignoring the view direction at rough surfaces that are seen in reflections.

    Args:
        scene: Scene to trace.
        points: N points.
        light: Known light.
        paths: Paths per point, even, ≥ 2.
        seed: Seed of the paths.
        max_depth: Longest path, 2 = direct light only.

    Returns:
        Radiance and E', each as two independent half means [2, N, 3] float32.

    Raises:
        ValueError: ``paths`` is odd or below 2.
    """
    check_halves(paths)
    tables(scene)
    device, half = DevicePoints(points), paths // 2
    batch = max(1, LAUNCH // paths)
    settings = [dr.opaque(mi.UInt32, v) for v in (seed & 0xFFFFFFFF, max_depth, RR_DEPTH, half)]
    rows = np.zeros((len(points), 2, 6), np.float32)
    for start in range(0, len(points), batch):
        count = min(batch, len(points) - start)
        rows[start : start + count] = _launch(scene, device, light, settings, start, count, half)
    return rows[..., :3].swapaxes(0, 1), rows[..., 3:].swapaxes(0, 1)


def _launch(scene: Scene, device, light: KnownIrradiance, settings, start: int, count: int, half: int) -> np.ndarray:
    """Trace one launch; returns means of both halves [count, 2, 6]: radiance and E'."""
    seed, max_depth, rr_depth, size = settings
    lane = dr.arange(mi.UInt32, count * 2 * half)
    group, path = lane // size, lane % size
    row = dr.opaque(mi.UInt32, start) + group // 2
    rng = random_streams(seed, row, (group & 1) * size + path)
    shift = random_streams(seed, row, LATTICE_STREAM + (group & 1))
    si = gather_interaction(scene, device, row)
    source, first = Emitters.of(scene), stratified(shift, path, size)
    L, E, first_weight, diffuse_weight, path = _first_vertex(scene.mi, si, source, rng, *first[:2])
    arriving = _walk(scene.mi, path, light, source, rng, max_depth, rr_depth)
    L, E = L + first_weight * arriving, E + diffuse_weight * arriving
    ok = dr.all(dr.isfinite(L)) & dr.all(dr.isfinite(E))
    L, E, ok = dr.select(ok, L, 0), dr.select(ok, E, 0), dr.select(ok, mi.UInt32(1), mi.UInt32(0))
    dr.eval(L, E, ok)
    total = np.concatenate([np.array(dr.block_sum(v, half)).T for v in (L, E)], axis=1)
    good = np.array(dr.block_sum(ok, half))[:, None]
    return np.where(good > 0, total / np.maximum(good, 1), np.nan).reshape(count, 2, 6)


def gathered_irradiance(
    scene: Scene, points: SurfacePoints, light: Arrays, paths: int, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Gather E' at points, as ``irradiance`` does, ending paths at known light.

    Args:
        scene: Scene to trace.
        points: N points.
        light: Known light, see ``known_arrays``.
        paths: Paths per point, even, ≥ 2.
        seed: Seed of the paths.

    Returns:
        [2, N, 3] E', two independent half means, and [N, 3] the mean direction of the light, see ``Irradiance``.

    Raises:
        ValueError: ``paths`` is odd or below 2.
    """
    check_halves(paths)
    settings = {"paths": paths, "seed": seed}
    rows = rows_of(scene, "gathered-irradiance", settings, columns_of(points), paths, light)["rows"]
    return rows[..., :3].swapaxes(0, 1), rows[..., 3:].mean(axis=1)


def gathered_irradiance_rows(
    scene: Scene, settings: Mapping[str, Any], columns: Arrays, first: int, shared: Arrays
) -> Arrays:
    """Trace rows of ``gathered_irradiance``; see ``row_tasks.RowFunction``.

    Args:
        scene: Scene to trace.
        settings: ``paths`` and ``seed``.
        columns: Columns of ``SurfacePoints``, [N, ...] each.
        first: Number of the first row.
        shared: Arrays of ``known_arrays``.

    Returns:
        ``rows`` [N, 2, 6]: by half E', and luminance times direction.
    """
    known = KnownIrradiance.uploaded(scene, shared)
    estimate = lambda *at: _arriving(scene, known, *at)  # noqa: E731
    return {"rows": half_means(scene, settings, columns, first, estimate, 6)}


def _arriving(scene: Scene, known, si, view, rng, u, max_depth, rr_depth):
    """Estimate E' once at ``si`` on the side of ``view``, see ``half_means``."""
    source = Emitters.of(scene)
    direct, wo, d, density, above = first_directions(scene.mi, si, view, source, rng, u)
    path = PathState(si.spawn_ray(d))
    path.prev, path.prev_pdf, path.prev_delta = interaction_at(si), mi.Float(density), mi.Bool(False)
    path.depth, path.active = mi.UInt32(1), mi.Bool(above)
    arriving = _walk(scene.mi, path, known, source, rng, max_depth, rr_depth)
    return direct + arriving, wo * mi.luminance(direct) + d * mi.luminance(arriving)


@dr.syntax
def _walk(scene, path, known, source, rng, max_depth, rr_depth):
    """Follow a path from its first ray: emitter and BSDF sampling as ``radiance.trace``, to where the light is known.

    A loop of its own, because an end at known light needs the place on the triangle, and because what arrives at the
    first vertex is weighted twice; it takes its steps from ``path_state``, and a test holds its mean to full paths.

    Returns the radiance from the first direction.
    """
    arriving = mi.Spectrum(0)

    while dr.hint(path.active, label="lightwell gather"):
        pi = scene.ray_intersect_preliminary(path.ray, active=path.active)
        si = pi.compute_surface_interaction(path.ray, mi.RayFlags.All, path.active)
        bsdf = si.bsdf(path.ray)

        # ------------------ Emission, met by BSDF sampling ------------------

        Le, mis = path.meet(scene, si, source)
        arriving += dr.select(path.active, path.β * mis * Le, 0)

        # --------------------- End of the path at known light ---------------------

        goes = path.active & si.is_valid() & (path.depth + 1 < max_depth)
        found, light = known.find(si, pi.prim_uv, path.ray, (rng.next_float32(), next_2d(rng)), goes)
        arriving += dr.select(found, path.β * light, 0)
        goes &= ~found

        # -------------- Emitter sampling, and the next direction --------------

        smooth = goes & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
        aimed = aim_at_light(scene, si, source, next_2d(rng), smooth)
        v = next_2d(rng)
        value, pdf, sample, weight = bsdf.eval_pdf_sample(
            mi.BSDFContext(), si, si.to_local(aimed.direction), rng.next_float32(), v, goes
        )
        lamp = aimed.traced(scene, smooth & (dr.max(value) > 0))
        arriving += dr.select(lamp.seen, path.β * lamp.mis(pdf) * value * lamp.weight, 0)

        # ------------------- Loop variables and stopping criterion -------------------

        path.leave(si, sample.wo, sample.pdf, weight, sample.eta, is_delta(sample))
        factor, alive = path.roulette(rr_depth, rng.next_float32())
        path.β *= factor
        path.active = goes & alive
        path.depth += 1

    return arriving


def _first_vertex(scene, si, source, rng, lobe, direction):
    """Sample the emitters at the query point, and the direction in which the path leaves.

    Returns direct light (radiance and E'), the weights of the light from the sampled direction (for radiance, and
    cos / (π p) for E'), and the path, whose throughput begins after the query point.
    """
    bsdf = si.bsdf()
    facing = dr.sign(mi.Frame3f.cos_theta(si.wi))
    smooth = mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
    aimed = aim_at_light(scene, si, source, next_2d(rng), smooth)
    wo = si.to_local(aimed.direction)
    value, pdf = own_eval_pdf(si, bsdf, wo, smooth)
    towards = facing * mi.Frame3f.cos_theta(wo)
    lamp = aimed.traced(scene, smooth & ((towards > 0) | (dr.max(value) > 0)))
    lit = dr.select(lamp.seen, lamp.mis(pdf) * lamp.weight, 0)
    E = lit * dr.maximum(towards, 0) * dr.inv_pi
    sample, weight = own_sample(si, bsdf, lobe, direction)
    cosine = dr.maximum(facing * mi.Frame3f.cos_theta(sample.wo), 0)
    diffuse_weight = dr.select(sample.pdf > 0, cosine * dr.inv_pi / sample.pdf, 0)
    path = PathState()
    path.leave(si, sample.wo, mi.Float(sample.pdf), mi.Spectrum(1), mi.Float(sample.eta), is_delta(sample))
    path.depth, path.active = mi.UInt32(1), dr.max(weight) != 0
    return lit * value, E, weight, dr.select(path.prev_delta, 0, diffuse_weight), path
