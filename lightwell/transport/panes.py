"""Surfaces that light passes in a straight line: holes of alpha masks, blended surfaces, and clear glass.

Rays that a BSDF chooses pass them by themselves. A shadow ray to a light without extent (a point, the sun), which no
BSDF finds, goes on behind them, weakened by what they let through. In a path tracer shadow rays to lights of some
extent stop: what they would find behind a pane, rays that the BSDF chooses have found already. Where samples of many
lamps are made (``lamp_light``), they go on, and rays that the BSDF chooses count the less.

Refraction is left out: glass bends no shadow ray and focuses no light. A pane of glass lets 1 - F of the light through,
times its colour and its transmission, with F by Fresnel's equations for the index of refraction 1.5. A solid body does
so at each of its two surfaces, with the square root of both.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.backend import dr, mi
from lightwell.scenes.scene import Scene
from lightwell.scenes.scene_cache import Derived
from lightwell.transport.interactions import upload
from lightwell.transport.tables import shape_index, shape_lookup, tables

# Surfaces that a ray passes at most.
PASSED = 16
IOR = 1.5


@dataclass
class Panes:
    """The surfaces of a scene that let light through. It is not frozen: Dr.Jit carries it through loops."""

    lookup: mi.UInt32
    """Result of ``shape_lookup``."""
    tint: mi.Color3f
    """[M] share of light that each mesh of clear glass lets through once; 0 for all others."""

    def passes(self, si: mi.SurfaceInteraction3f, active: mi.Bool) -> tuple[mi.Spectrum, mi.Float]:
        """Compute what surfaces let through in a straight line.

        Args:
            si: [N] surface interactions.
            active: [N] lanes.

        Returns:
            [N] transmittance, and the chance with which a random ray goes on: its largest channel.
        """
        hole = si.bsdf().eval_null_transmission(si, active)
        tint = dr.gather(mi.Color3f, self.tint, shape_index(self.lookup, si.shape), active)
        glass = tint * (1 - mi.fresnel(dr.abs(dr.dot(si.n, si.to_world(si.wi))), IOR)[0])
        T = dr.select(active, dr.clip(mi.Spectrum(hole + (1 - hole) * glass), 0, 1), 0)
        return T, dr.max(T)


PANES = Derived[tuple[Panes | None]]("transport.panes")


def panes_of(scene: Scene) -> Panes | None:
    """Return the surfaces of a scene that let light through, found on first use and kept with it.

    Args:
        scene: Scene with M meshes.

    Returns:
        The surfaces; None where there are none.
    """
    return scene.cache.get(PANES, lambda: (_find(scene),))[0]


def _find(scene: Scene) -> Panes | None:
    clear = tables(scene).clear
    bsdfs = [shape.bsdf() for shape in scene.mi.shapes()]
    null = np.array([bsdf is not None and mi.has_flag(bsdf.flags(), mi.BSDFFlags.Null) for bsdf in bsdfs])
    if not (clear.any() or null.any()):
        return None
    materials = [scene.materials[mesh.material] for mesh in scene.meshes]
    color = np.array([m.transmission * np.clip(m.base_color[:3], 0, 1) for m in materials], np.float32)
    thin = np.array([m.thickness == 0 for m in materials])[:, None]
    # The BSDF of a thin pane of Mitsuba says itself what goes straight through.
    glass = clear & ~(null & np.array([m.alpha_mode == "OPAQUE" for m in materials]))
    tint = np.where(glass[:, None], np.where(thin, color, np.sqrt(color)), 0).astype(np.float32)
    return Panes(shape_lookup(scene), upload(mi.Color3f, tint))


def unblocked(
    scene: mi.Scene, panes: Panes | None, ray: mi.Ray3f, active: mi.Bool, through: mi.Bool
) -> tuple[mi.Spectrum, mi.Float]:
    """Trace shadow rays.

    Args:
        scene: Mitsuba scene.
        panes: What they may pass; None: nothing.
        ray: [N] rays, which end at the light.
        active: [N] lanes.
        through: [N] whether rays pass panes: those to a light without extent, or all; others stop.

    Returns:
        [N] transmittance, 0 where something stands in the way; and the chance with which a random ray from the light
        comes as far.
    """
    if panes is None:
        seen = mi.Float(dr.select(active & ~scene.ray_test(ray, active), 1, 0))
        return mi.Spectrum(seen), seen
    T, q = _unblocked(scene, panes, ray, active, through)
    return dr.select(active, T, 0), dr.select(active, q, 0)


@dr.syntax
def _unblocked(scene, panes, ray, active, through):
    T, q, passed = mi.Spectrum(1), mi.Float(1), mi.UInt32(0)
    ray, active = mi.Ray3f(ray), mi.Bool(active)
    while dr.hint(active, label="lightwell shadow ray"):
        si = scene.ray_intersect(ray, mi.RayFlags.All, False, active)
        met = active & si.is_valid()
        here, chance = panes.passes(si, met & through & (passed < PASSED))
        T, q = dr.select(met, T * here, T), dr.select(met, q * chance, q)
        left = ray.maxt - si.t
        ray = si.spawn_ray(ray.d)
        ray.maxt = left
        active = met & (q > 0)
        passed += 1
    return T, q


def first_stop(
    scene: mi.Scene, panes: Panes | None, ray: mi.Ray3f, rng: mi.PCG32
) -> tuple[tuple[mi.SurfaceInteraction3f, mi.Spectrum, mi.Float], mi.Ray3f]:
    """Follow rays from a light to the surface where they end; at each pane they go on by chance.

    Args:
        scene: Mitsuba scene.
        panes: What they may pass; None: nothing.
        ray: [N] rays.
        rng: [N] random streams; not used without panes.

    Returns:
        [N] where they end, the transmittance on the way there, and the chance that they go through it and end there;
        and the rays from the last pane on.
    """
    if panes is None:
        return (scene.ray_intersect(ray), mi.Spectrum(1), mi.Float(1)), ray
    return _first_stop(scene, panes, ray, rng)


@dr.syntax
def _first_stop(scene, panes, ray, rng):
    T, q, passed = mi.Spectrum(1), mi.Float(1), mi.UInt32(0)
    ray = mi.Ray3f(ray)
    si = scene.ray_intersect(ray)
    active = si.is_valid()
    while dr.hint(active, label="lightwell light ray"):
        here, chance = panes.passes(si, active & (passed < PASSED))
        goes = active & (rng.next_float32() < chance)
        T = dr.select(goes, T * here, T)
        q = dr.select(active, q * dr.select(goes, chance, 1 - chance), q)
        ray = dr.select(goes, si.spawn_ray(ray.d), ray)
        behind = scene.ray_intersect(ray, mi.RayFlags.All, False, goes)
        si = dr.select(goes, behind, si)
        active = goes & si.is_valid()
        passed += 1
    return (si, T, q), ray
