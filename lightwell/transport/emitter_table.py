"""Where the emitters of a scene are and how they shine, in a few numbers each: what an emitter is likely to bring to a
place costs no ray and no sample of it.

The estimate by power, distance and bounds of both cosines is that of the light trees of Conty Estevez & Kulla,
*Importance Sampling of Many Lights with Adaptive Tree Splitting*, 2018. It decides how often an emitter is chosen, not
what it brings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.backend import dr, mi, upload_floats, upload_integers
from lightwell.scenes.scene import Scene
from lightwell.scenes.scene_cache import Derived

# Shares of its light that an emitter is taken to bring at least: along the surface, to its other side, and outside of
# the cone in which it shines. Normal maps and transmission may reflect it, and the numbers are estimates.
GRAZING, BEHIND, OUTSIDE = 0.05, 0.1, 0.01
# Rays, or places on its surface, by which an emitter is known.
RAYS = 256
# Emitters whose mean direction is shorter shine to all sides; those whose cone is narrower than this have sharp edges.
ALL_AROUND, NARROW = 0.35, 0.3
# How much wider cones, by 1 - cosine, and extents are taken to be: rays do not find the rim.
CONE_SLACK, EXTENT_SLACK = 1.1, 1.05


@dataclass
class EmitterTable:
    """M emitters on the device. It is not frozen: Dr.Jit carries it through loops."""

    pointer: mi.UInt32
    """[M] pointers."""
    place: mi.Float
    """[M * 4] centre and radius of a sphere around it, metres; radius -1: infinitely far."""
    lobe: mi.Float
    """[M * 4] unit axis of its light (0: it shines to all sides), then its intensity along it, W/sr (irradiance of one
    that is infinitely far)."""
    cone: mi.Float
    """[M] least cosine between the axis and its rays."""

    @staticmethod
    def of(geometry: mi.Scene, indices: Sequence[int] | None = None) -> EmitterTable:
        """Measure emitters by places on their surfaces, or by rays that they send.

        Args:
            geometry: Mitsuba scene.
            indices: Numbers of the emitters, M; None: all.

        Returns:
            The table.
        """
        every = geometry.emitters()
        emitters = every if indices is None else [every[index] for index in indices]
        flags = [emitter.flags() for emitter in emitters]
        far, surface, aimed = (
            np.array([mi.has_flag(flag, kind) for flag in flags], bool)
            for kind in (mi.EmitterFlags.Infinite, mi.EmitterFlags.Surface, mi.EmitterFlags.DeltaDirection)
        )
        surface &= ~aimed
        others, kept = ~far & ~surface, [emitter for emitter, here in zip(emitters, surface) if here]
        place, lobe, cone = (np.zeros((len(emitters), *shape)) for shape in ((4,), (4,), ()))
        pointer = _pointers(mi.EmitterPtr, emitters)
        if far.any():
            lobe[far], place[far, 3], cone[far] = _far(pointer[far], mi.Point3f(geometry.bbox().center())), -1, -1
        if surface.any():
            shapes = _pointers(mi.ShapePtr, [emitter.get_shape() for emitter in kept])
            place[surface], lobe[surface], cone[surface] = _surfaces(pointer[surface], shapes)
        if others.any():
            place[others], lobe[others], cone[others] = _others([emitters[k] for k in np.flatnonzero(others)])
        floats = lambda values: upload_floats(np.ascontiguousarray(values, np.float32).ravel())  # noqa: E731
        return EmitterTable(upload_integers(pointer), floats(place), floats(lobe), floats(cone))

    def likely(self, emitter: mi.UInt32, p: mi.Point3f, normal: mi.Vector3f, side: mi.Float) -> mi.Float:
        """Estimate what emitters bring to places if nothing is in the way.

        Args:
            emitter: [N] numbers of emitters in the table.
            p: [N] places, metres.
            normal: [N] unit normals.
            side: [N] positive where the side to which the normal points is seen.

        Returns:
            [N] estimates, in proportion to irradiance.
        """
        place, lobe = (dr.gather(mi.Vector4f, values, emitter) for values in (self.place, self.lobe))
        axis, radius = mi.Vector3f(lobe.x, lobe.y, lobe.z), dr.maximum(place.w, 0)
        offset = mi.Point3f(place.x, place.y, place.z) - p
        distance2, far = dr.squared_norm(offset), place.w < 0
        around, everywhere = dr.squared_norm(axis) == 0, far | (distance2 <= dr.square(radius))
        d = dr.select(far, -axis, offset * dr.rsqrt(dr.maximum(distance2, 1e-30)))
        sine = dr.select(everywhere, 0, radius * dr.rsqrt(dr.maximum(distance2, 1e-30)))
        facing = _bound(dr.dot(normal, d) * dr.sign(side), sine)
        facing = dr.select((everywhere & ~far) | (far & around), 1, facing)
        leaving = dr.select(everywhere | around, 1, _bound(-dr.dot(axis, d), sine))
        received = dr.maximum(dr.abs(facing), GRAZING) * dr.select(facing > 0, 1, BEHIND)
        sent = dr.select(leaving > dr.gather(mi.Float, self.cone, emitter), dr.maximum(leaving, GRAZING), OUTSIDE)
        return lobe.w * received * sent / dr.select(far, 1, dr.maximum(distance2, dr.square(radius)))

    def sample(
        self, emitter: mi.UInt32, it: mi.Interaction3f, u: mi.Point2f, active: mi.Bool
    ) -> tuple[mi.DirectionSample3f, mi.Spectrum]:
        """Sample directions to emitters.

        Args:
            emitter: [N] numbers of emitters in the table.
            it: [N] places to light.
            u: [N] points in [0, 1)².
            active: [N] lanes.

        Returns:
            Direction sample, and radiance over its density, those of the emitter alone.
        """
        pointer = dr.gather(mi.UInt32, self.pointer, emitter, active)
        return dr.reinterpret_array(mi.EmitterPtr, pointer).sample_direction(it, u, active)


TABLE = Derived[EmitterTable]("transport.emitter_table")


def emitter_table(scene: Scene) -> EmitterTable:
    """Return the table of all emitters of a scene, made on first use and kept with it until they are dimmed.

    Args:
        scene: The scene, with at least one emitter.

    Returns:
        The table.
    """
    return scene.cache.get(TABLE, lambda: EmitterTable.of(scene.mi), scene.cache.relit)


def pointers(geometry: mi.Scene) -> np.ndarray:
    """Read the pointers of all emitters.

    Args:
        geometry: Mitsuba scene.

    Returns:
        [E] uint32.
    """
    return _pointers(mi.EmitterPtr, geometry.emitters())


def _pointers(kind: type, objects: Sequence[Any]) -> np.ndarray:
    return np.array([int(dr.reinterpret_array(mi.UInt32, kind(one))[0]) for one in objects], np.uint32)


def _bound(cosine: mi.Float, sine: mi.Float) -> mi.Float:
    """Largest cosine of directions at most so far, by the sine of the angle, from one with this cosine."""
    most = dr.safe_sqrt(1 - dr.square(sine))
    return dr.select(cosine >= most, 1, cosine * most + dr.safe_sqrt(1 - dr.square(cosine)) * sine)


def _lanes(kind: type, pointer: np.ndarray) -> tuple[Any, list[mi.Float]]:
    """``RAYS`` lanes for each object, and five random numbers for each lane."""
    lane = dr.arange(mi.UInt32, len(pointer) * RAYS)
    number = [mi.sample_tea_float32(lane, dr.opaque(mi.UInt32, k)) for k in range(5)]
    return dr.reinterpret_array(kind, dr.gather(mi.UInt32, upload_integers(pointer), lane // RAYS)), number


def _read(values: Any) -> np.ndarray:
    """[M, RAYS] or [M, RAYS, 3] finite numbers of lanes."""
    found = np.nan_to_num(np.array(values))
    return found.T.reshape(-1, RAYS, 3) if found.ndim == 2 else found.reshape(-1, RAYS)


def _far(pointer: np.ndarray, middle: mi.Point3f) -> np.ndarray:
    """[M, 4] axis and irradiance of emitters that are infinitely far."""
    emitter, (a, b, *_) = _lanes(mi.EmitterPtr, pointer)
    it = dr.zeros(mi.Interaction3f, len(pointer) * RAYS)
    it.p = mi.Point3f(middle)
    ds, weight = emitter.sample_direction(it, mi.Point2f(a, b), mi.Bool(True))
    mean = -_read(ds.d).mean(axis=1)
    # Only the light of one direction has one; that of an environment comes from all sides.
    one = np.linalg.norm(mean, axis=1, keepdims=True) > 1 - 1e-3
    # A surface that is lit evenly from one side receives a quarter of what comes from both, by the cosine.
    brought = np.where(one, 1, 0.25) * _read(dr.max(weight)).mean(axis=1, keepdims=True)
    return np.concatenate([np.where(one, mean, 0), brought], axis=1)


def _surfaces(pointer: np.ndarray, shapes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """[M, 4] sphere, [M, 4] axis and intensity, and [M] cone of surfaces that shine by Lambert's law."""
    emitter, (shape, (a, b, *_)) = _lanes(mi.EmitterPtr, pointer)[0], _lanes(mi.ShapePtr, shapes)
    ps = shape.sample_position(0.0, mi.Point2f(a, b), mi.Bool(True))
    si, sides = mi.SurfaceInteraction3f(ps, []), []
    for z in (1.0, -1.0):
        si.wi = mi.Vector3f(0, 0, z)
        sides.append(_read(dr.max(emitter.eval(si, mi.Bool(True)))))
    place, normal, area = _read(ps.p), _read(ps.n), _read(dr.select(ps.pdf > 0, dr.rcp(ps.pdf), 0)).mean(axis=1)
    power = np.pi * area * (sides[0] + sides[1]).mean(axis=1)
    # The mean direction of a flat lamp is two thirds of its normal.
    mean = 2 / 3 * ((sides[0] - sides[1])[..., None] * normal).mean(axis=1)
    mean /= np.maximum((sides[0] + sides[1]).mean(axis=1, keepdims=True), 1e-30)
    axis, aimed = _aimed(mean)
    shines = np.stack([np.where(sides[0] > 0, 1, 2), np.where(sides[1] > 0, -1, 2)])
    cosine = np.einsum("mrc,mc->mr", normal, axis)
    least = np.where(shines < 2, shines * cosine, 1).min(axis=(0, 2))
    # A surface shines a quarter turn away from its normal.
    cosine = np.where(least > 0, -np.sqrt(np.maximum(1 - least**2, 0)), -1.0)
    return _sphere(place), *_lobe(axis, aimed, cosine, power)


def _others(emitters: Sequence[mi.Emitter]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same of points, spots and other emitters that have a place, by rays that they send."""
    found = []
    # One by one: calls by pointers would trace those of all emitters, and surfaces of our own send no rays.
    for emitter in emitters:
        a, b, c, d, e = (mi.sample_tea_float32(dr.arange(mi.UInt32, RAYS), dr.opaque(mi.UInt32, k)) for k in range(5))
        ray, weight = emitter.sample_ray(0.0, e, mi.Point2f(a, b), mi.Point2f(c, d), mi.Bool(True))
        found.append((_read(ray.o + mi.Point3f(0 * a))[0], _read(ray.d)[0], _read(dr.max(weight) + 0 * a)[0]))
    place, way, light = (np.stack(values) for values in zip(*found))
    power = light.mean(axis=1)
    axis, aimed = _aimed((light[..., None] * way).mean(axis=1) / np.maximum(power, 1e-30)[:, None])
    cosine = np.where(light > 0, np.einsum("mrc,mc->mr", way, axis), 1).min(axis=1)
    return _sphere(place), *_lobe(axis, aimed, cosine, power)


def _aimed(mean: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """[M, 3] axis of lights with these mean directions, and [M] whether they have one."""
    length = np.linalg.norm(mean, axis=1)
    aimed = length > ALL_AROUND
    return np.where(aimed[:, None], mean / np.maximum(length, 1e-30)[:, None], 0), aimed


def _sphere(place: np.ndarray) -> np.ndarray:
    """[M, 4] centre and radius around places [M, RAYS, 3]."""
    centre = place.mean(axis=1)
    radius = EXTENT_SLACK * np.linalg.norm(place - centre[:, None], axis=2).max(axis=1)
    return np.concatenate([centre, radius[:, None]], axis=1)


def _lobe(axis: np.ndarray, aimed: np.ndarray, cosine: np.ndarray, power: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """[M, 4] axis and intensity, and [M] cone, from the least cosine of the light and its power, W."""
    cone = np.where(aimed, np.maximum(1 - CONE_SLACK * (1 - cosine), -1), -1)
    # The solid angle that it shines into: all, that of a narrow cone, or π of a flat lamp (by the cosine).
    angle = np.where(cosine > NARROW, 2 * np.pi * np.maximum(1 - cosine, 1e-6), np.pi)
    return np.concatenate([axis, (power / np.where(aimed, angle, 4 * np.pi))[:, None]], axis=1), cone
