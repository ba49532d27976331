"""The first surfaces that camera rays meet, as a rasteriser draws them: without the backs of one-sided materials.

Walls of such materials are seen from one side: from outside, a camera looks through them into the room. They block
light from both sides.
"""

from __future__ import annotations

from collections.abc import Callable

from lightwell.backend import dr, mi
from lightwell.scenes.scene import Scene
from lightwell.transport.tables import shape_index, shape_lookup, tables

# Surfaces with a larger null transmission than this are cut away, as a rasteriser does (glTF MASK).
CUTOUT = 0.5
# Surfaces that a camera ray passes at most.
PASSED = 16


def first_drawn(scene: Scene, ray: mi.Ray3f) -> tuple[mi.SurfaceInteraction3f, mi.Ray3f]:
    """Find the first surface of which the front is met, or the back that is drawn too.

    Args:
        scene: The scene.
        ray: [N] rays.

    Returns:
        What the rays meet, and the rays that meet it: they begin behind what they have passed, [N] each.
    """
    lookup, culled = shape_lookup(scene), mi.Bool(tables(scene).culled)
    return past_backs(
        scene.mi, ray, lambda si, active: dr.gather(mi.Bool, culled, shape_index(lookup, si.shape), active)
    )


def first_surface(scene: Scene, ray: mi.Ray3f) -> tuple[mi.PreliminaryIntersection3f, mi.Ray3f]:
    """Find the first surface that is drawn and neither cut away nor glass, which rays pass without refraction.

    Args:
        scene: The scene.
        ray: [N] rays.

    Returns:
        What the rays meet, and the rays that meet it: they begin behind what they have passed, [N] each.
    """
    known = tables(scene)
    return _first_surface(scene.mi, shape_lookup(scene), mi.Bool(known.looked_through), mi.Bool(known.culled), ray)


@dr.syntax
def past_backs(
    geometry: mi.Scene, ray: mi.Ray3f, culled: Callable[[mi.SurfaceInteraction3f, mi.Bool], mi.Bool]
) -> tuple[mi.SurfaceInteraction3f, mi.Ray3f]:
    """Find the first surface that is not met from a back that is culled.

    Args:
        geometry: Mitsuba scene.
        ray: [N] rays.
        culled: Function of surfaces [N] and a mask: whether their backs are not drawn.

    Returns:
        What the rays meet, and the rays that meet it: they begin behind what they have passed, [N] each.
    """
    ray = mi.Ray3f(ray)
    si = geometry.ray_intersect(ray)
    passed = mi.UInt32(0)
    active = si.is_valid()
    while active:
        back = dr.dot(si.n, ray.d) > 0
        active &= back & culled(si, active) & (passed < PASSED)
        if active:
            ray = si.spawn_ray(ray.d)
            si = geometry.ray_intersect(ray, active)
        active &= si.is_valid()
        passed += 1
    return si, ray


@dr.syntax
def _first_surface(geometry, lookup, glass, culled, ray):
    ray = mi.Ray3f(ray)
    pi = geometry.ray_intersect_preliminary(ray, coherent=True)
    passed = mi.UInt32(0)
    active = pi.is_valid()
    while active:
        si = pi.compute_surface_interaction(ray, mi.RayFlags.All, active)
        mesh = shape_index(lookup, pi.shape)
        unseen = dr.gather(mi.Bool, glass, mesh, active)
        unseen |= dr.gather(mi.Bool, culled, mesh, active) & (dr.dot(si.n, ray.d) > 0)
        active &= unseen | (dr.mean(si.bsdf().eval_null_transmission(si, active)) > CUTOUT)
        active &= passed < PASSED
        if active:
            ray = si.spawn_ray(ray.d)
            pi = geometry.ray_intersect_preliminary(ray, active=active)
        active &= pi.is_valid()
        passed += 1
    return pi, ray
