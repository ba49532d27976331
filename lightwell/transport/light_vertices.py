"""Where rays from lamps meet surfaces: what a place is connected to, chosen by what it would bring there.

A light ray of its own for each path rarely meets what the path sees: in the open air few of them meet anything, and in
a house most end in other rooms. The rays of a lamp therefore serve all paths under it, and each path takes one of
several, in proportion to what they bring if nothing is in the way (Talbot et al. 2005, resampled importance sampling;
Keller 1997, instant radiosity).

Notation: L lamps, V vertices of each half of a lamp.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.scenes.scene import Scene
from lightwell.scenes.scene_cache import Derived
from lightwell.transport.interactions import upload
from lightwell.transport.panes import first_stop, panes_of
from lightwell.transport.path_numbers import LATTICE_STREAM, next_2d, random_streams
from lightwell.transport.tables import tables

# V, and how many of them a path chooses from.
VERTICES, CANDIDATES = 512, 32
# How many light rays a chosen one counts as where it is weighed against sampling by the BSDF. Squared noise with 1, 8
# and 32, over that with light rays of their own: modern-house 0.65, 0.33, 0.24; littlest-tokyo 0.79, 0.37, 0.37;
# courtyard 0.83, 0.75, 0.67; without the largest 0.2 %, drake-living-room 0.64, 0.81, 1.06, bevy-dof 0.80, 0.64, 0.71.
OFTEN = 8.0
# Cosines count as so much at least where candidates are weighed, and reflectances: normal maps and gloss reflect light
# that plain surfaces do not.
LEAST_COSINE, LEAST_REFLECTANCE = 0.02, 0.1
# Step of the angle around the axis, in turns: the golden ratio.
GOLDEN = 0.6180339887498949
# Light rays of one launch.
LANES = 1 << 20


@dataclass(frozen=True)
class SharedLamps:
    """Places of a point light that many points share."""

    places: np.ndarray
    """[L, 3] metres."""
    index: np.ndarray
    """[N] number of the place of each point."""
    seed: int
    """Seed of their light rays."""


@dataclass
class LightVertices:
    """Ends of the light rays of L point lights of 1 cd. It is not frozen: Dr.Jit carries it through loops."""

    place: mi.Float
    """[L * 2 * V * 4] position, metres, and what the surface reflects of the light that arrives."""
    side: mi.Float
    """[L * 2 * V * 4] unit normal towards the lamp, and density by area; 0 where the ray meets nothing."""
    at: mi.Float
    """[L * 2 * V * 2] barycentric weights of the second and third vertex of the triangle."""
    shape: mi.UInt32
    """[L * 2 * V] index of the shape ..."""
    triangle: mi.UInt32
    """... and of the triangle."""
    through: mi.Float | None
    """[L * 2 * V * 4] transmittance on the way, and chance that a ray comes so far and ends; None without panes."""
    shapes: Any
    """[M] shapes of the scene."""

    @staticmethod
    def of(scene: Scene, lamps: np.ndarray, seed: int) -> LightVertices:
        """Trace light rays, evenly distributed over the directions of each half of a lamp.

        Args:
            scene: Scene to trace.
            lamps: [L, 3] positions, metres.
            seed: Seed of the rays.

        Returns:
            Their ends.
        """
        tables(scene)
        panes, position = panes_of(scene), upload(mi.Point3f, np.asarray(lamps, np.float32))
        batch, parts = max(1, LANES // (2 * VERTICES)), []
        at_seed = dr.opaque(mi.UInt32, seed & 0xFFFFFFFF)
        for start in range(0, len(lamps), batch):
            count = min(batch, len(lamps) - start)
            lane = dr.arange(mi.UInt32, count * 2 * VERTICES)
            group, k = dr.opaque(mi.UInt32, 2 * start) + lane // VERTICES, lane % VERTICES
            lamp = dr.gather(mi.Point3f, position, group // 2)
            ray = mi.Ray3f(lamp, _direction(random_streams(at_seed, group, LATTICE_STREAM), k))
            found = _vertices(scene.mi, panes, ray, random_streams(at_seed, group, k))
            dr.eval(found)
            parts.append([None if v is None else np.array(v) for v in found])
        held = [None if p[0] is None else np.concatenate(p, axis=-1) for p in zip(*parts)]
        flat = lambda kind, v: None if v is None else kind(np.ascontiguousarray(v.T).ravel())  # noqa: E731
        place, side, at, shape, triangle, through = held
        return LightVertices(
            flat(mi.Float, place), flat(mi.Float, side), flat(mi.Float, at), mi.UInt32(shape), mi.UInt32(triangle),
            flat(mi.Float, through), scene.mi.shapes_dr(),
        )  # fmt: skip

    def choose(
        self, si: mi.SurfaceInteraction3f, lamp: mi.Point3f, group: mi.UInt32, u: mi.Float, rng: mi.PCG32
    ) -> tuple[tuple[Any, Any, Any], mi.Float]:
        """Choose a vertex for each place.

        Args:
            si: [N] places.
            lamp: [N] positions of the lamps, metres.
            group: [N] number of the lamp, times 2, plus that of the half.
            u: [N] numbers in [0, 1) that choose the candidates.
            rng: [N] random streams.

        Returns:
            The end of a light ray, as ``panes.first_stop`` returns it, and what it must be multiplied by, [N].
        """
        facing = dr.sign(mi.Frame3f.cos_theta(si.wi))
        n = si.sh_frame.n * facing
        start = dr.minimum(mi.UInt32(u * VERTICES), VERTICES - 1)
        index, factor = _chosen(self, si.p, n, group * VERTICES, start, rng)
        pi = dr.zeros(mi.PreliminaryIntersection3f, dr.width(index))
        place = dr.gather(mi.Vector4f, self.place, index)
        pi.valid, pi.t = factor > 0, mi.Float(0)
        pi.shape_index = dr.gather(mi.UInt32, self.shape, index)
        pi.shape = dr.gather(mi.ShapePtr, self.shapes, pi.shape_index)
        pi.prim_index = dr.gather(mi.UInt32, self.triangle, index)
        pi.prim_uv = dr.gather(mi.Point2f, self.at, index)
        ray = mi.Ray3f(lamp, dr.normalize(mi.Point3f(place.x, place.y, place.z) - lamp))
        z = pi.compute_surface_interaction(ray, mi.RayFlags.All, pi.valid)
        z.t = dr.select(pi.valid, 1, dr.inf)
        if self.through is None:
            return (z, mi.Spectrum(1), mi.Float(1)), factor
        through = dr.gather(mi.Vector4f, self.through, index)
        return (z, mi.Spectrum(through.x, through.y, through.z), through.w), factor


def _direction(shift: mi.PCG32, k: mi.UInt32) -> mi.Vector3f:
    """The k-th of V directions that are even on the sphere, shifted by random numbers."""
    u = next_2d(shift)
    height = u.x + (mi.Float(k) + 0.5) / VERTICES
    turn = u.y + mi.Float(k) * GOLDEN
    return mi.warp.square_to_uniform_sphere(mi.Point2f(turn - dr.floor(turn), height - dr.floor(height)))


def _vertices(scene: mi.Scene, panes, ray: mi.Ray3f, rng: mi.PCG32):
    """Columns of ``LightVertices``, component by component."""
    lamp = ray.o
    (si, T, chance), last = first_stop(scene, panes, ray, rng)
    pi = scene.ray_intersect_preliminary(last)
    valid = si.is_valid() & pi.is_valid()
    cosine = dr.dot(si.n, -ray.d)
    density = chance * dr.inv_four_pi * dr.abs(cosine) / dr.squared_norm(si.p - lamp)
    valid &= (density > 0) & dr.isfinite(density)
    reflectance = mi.luminance(T * si.bsdf().eval_diffuse_reflectance(si, valid))
    reflected = dr.maximum(reflectance, LEAST_REFLECTANCE * mi.luminance(T)) / chance
    normal = si.n * dr.sign(cosine)
    keep = lambda v: dr.select(valid, v, 0)  # noqa: E731
    return (
        mi.Vector4f(*si.p, keep(reflected)),
        mi.Vector4f(*normal, keep(density)),
        mi.Point2f(keep(pi.prim_uv)),
        dr.select(valid, pi.shape_index, 0),
        dr.select(valid, pi.prim_index, 0),
        None if panes is None else mi.Vector4f(*T, chance),
    )


@dr.syntax
def _chosen(vertices, p, n, first, start, rng):
    """(index of the chosen vertex, factor) of each place; the factor is 0 where none brings anything."""
    total, weight, chosen, j = mi.Float(0), mi.Float(0), mi.UInt32(0), mi.UInt32(0)
    stride = VERTICES // CANDIDATES
    while dr.hint(j < CANDIDATES, label="lightwell light vertex"):
        index = first + (start + j * stride) % VERTICES
        place, side = dr.gather(mi.Vector4f, vertices.place, index), dr.gather(mi.Vector4f, vertices.side, index)
        way = mi.Point3f(place.x, place.y, place.z) - p
        distance2 = dr.squared_norm(way)
        d = way * dr.rsqrt(distance2)
        here, there = dr.dot(n, d), -dr.dot(mi.Vector3f(side.x, side.y, side.z), d)
        by_bsdf = dr.inv_pi * dr.maximum(here, 0) * dr.maximum(there, 0) / distance2
        often2 = dr.square(OFTEN * side.w)
        mis = often2 / dr.fma(by_bsdf, by_bsdf, often2)
        here, there = dr.maximum(here, LEAST_COSINE), dr.maximum(there, LEAST_COSINE)
        one = place.w * here * there * mis / distance2
        one = dr.select((side.w > 0) & dr.isfinite(one), one, 0)
        total += one
        taken = rng.next_float32() * total < one
        weight, chosen = dr.select(taken, one, weight), dr.select(taken, index, chosen)
        j += 1
    return chosen, dr.select(weight > 0, total / (weight * CANDIDATES), 0)


VERTICES_OF = Derived[LightVertices]("transport.light_vertices")


def light_vertices(scene: Scene, places: np.ndarray, seed: int) -> LightVertices:
    """Return the ends of the light rays of lamps, traced on first use; the scene keeps the last ones.

    Args:
        scene: Scene to trace.
        places: [L, 3] positions of the lamps, metres.
        seed: Seed of the rays.

    Returns:
        The ends.
    """
    places = np.ascontiguousarray(places, np.float32)
    return scene.cache.get(VERTICES_OF, lambda: LightVertices.of(scene, places, seed), (places.tobytes(), seed))
