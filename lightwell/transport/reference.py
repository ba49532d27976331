"""Reference estimator for tests: indirect radiance by the shortest correct path tracer. Read this first.

One vertex at a time, plain Python recursion, no multiple importance sampling, no roulette, no loop recording:

    L(x, v) = E[ β L'(y, -w) ],   L'(y, v) = f(y, v, to l) cos(θ) V(y, l) / d² + E[ β L'(z, -w) ],   L' = 0 at max_depth

β f·cos/pdf of a BSDF sample in direction w from x; y the point that the ray meets; V visibility of the light l at
distance d.
"""

from __future__ import annotations

import numpy as np

from lightwell.backend import dr, mi
from lightwell.scenes.scene import Scene
from lightwell.transport.interactions import interaction
from lightwell.transport.samples import SurfacePoints


def indirect_reference(
    scene: Scene, points: SurfacePoints, light: np.ndarray, paths: int, seed: int, max_depth: int = 8
) -> tuple[np.ndarray, np.ndarray]:
    """Estimate the indirect radiance from point lights of 1 cd by plain path tracing.

    Args:
        scene: Scene to trace.
        points: N points.
        light: [N, 3] positions of the light, metres.
        paths: Paths per point, ≥ 2.
        seed: Seed of the paths.
        max_depth: Longest path, 2 = direct light only.

    Returns:
        Mean and standard error, [N, 3] each.
    """
    rows = np.repeat(np.arange(len(points)), paths)
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, len(rows))
    si = interaction(scene, points[rows])
    L = _scattered(scene.mi, si, mi.Point3f(np.asarray(light, np.float32)[rows].T), sampler, 1, max_depth)
    draws = np.array(L).T.reshape(len(points), paths, 3).astype(np.float64)
    return draws.mean(axis=1), draws.std(axis=1, ddof=1) / np.sqrt(paths)


def _scattered(scene, si, light, sampler, depth: int, max_depth: int):
    """Estimate the radiance that one BSDF sample adds at ``si``."""
    # Sample a direction and trace a ray along it.
    sample, β = si.bsdf().sample(mi.BSDFContext(), si, sampler.next_1d(), sampler.next_2d())
    si = scene.ray_intersect(si.spawn_ray(si.to_world(sample.wo)))
    # Add the light that the surface there reflects; a path has at most max_depth segments from the camera to the light.
    if depth + 1 >= max_depth:
        return mi.Spectrum(0)
    L = _lit(scene, si, light) + _scattered(scene, si, light, sampler, depth + 1, max_depth)
    return dr.select(si.is_valid(), β * L, 0)


def _lit(scene, si, light):
    """Compute the radiance of the point light that ``si`` reflects."""
    to_light = light - si.p
    distance2 = dr.squared_norm(to_light)
    value = si.bsdf().eval(mi.BSDFContext(), si, si.to_local(to_light * dr.rsqrt(distance2)))
    return dr.select(scene.ray_test(si.spawn_ray_to(light)), 0, value / distance2)
