"""The oracle: indirect radiance by the shortest path tracer that is correct, for tests and for reading first.

One vertex at a time, plain Python recursion, no multiple importance sampling, no roulette, no loop recording:

    L(x, v) = E[ β L'(y, -w) ],   L'(y, v) = f(y, v, to l) cos(θ) V(y, l) / d² + E[ β L'(z, -w) ],   L' = 0 at max_depth

β f·cos/pdf of a BSDF sample in direction w from x; y what the ray meets; V visibility of the light l at distance d.
"""

from __future__ import annotations

import numpy as np

from lightwell.backend import dr, mi
from lightwell.scenes.scene import Scene
from lightwell.transport.interactions import interaction
from lightwell.transport.samples import SurfacePoints


def indirect_twin(
    scene: Scene, points: SurfacePoints, light: np.ndarray, paths: int, seed: int, max_depth: int = 8
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard error [N, 3] of the indirect radiance from point lights of 1 cd at [N, 3] positions."""
    rows = np.repeat(np.arange(len(points)), paths)
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, len(rows))
    si = interaction(scene, points[rows])
    L = _scattered(scene.mi, si, mi.Point3f(np.asarray(light, np.float32)[rows].T), sampler, 1, max_depth)
    draws = np.array(L).T.reshape(len(points), paths, 3).astype(np.float64)
    return draws.mean(axis=1), draws.std(axis=1, ddof=1) / np.sqrt(paths)


def _scattered(scene, si, light, sampler, depth: int, max_depth: int):
    """Radiance that one BSDF sample brings to ``si``."""
    # Choose a direction, look along it.
    sample, β = si.bsdf().sample(mi.BSDFContext(), si, sampler.next_1d(), sampler.next_2d())
    si = scene.ray_intersect(si.spawn_ray(si.to_world(sample.wo)))
    # Count what the surface there reflects, at most max_depth segments from the eye to the light.
    if depth + 1 >= max_depth:
        return mi.Spectrum(0)
    L = _lit(scene, si, light) + _scattered(scene, si, light, sampler, depth + 1, max_depth)
    return dr.select(si.is_valid(), β * L, 0)


def _lit(scene, si, light):
    """Radiance that ``si`` reflects of the point light."""
    to_light = light - si.p
    distance2 = dr.squared_norm(to_light)
    value = si.bsdf().eval(mi.BSDFContext(), si, si.to_local(to_light * dr.rsqrt(distance2)))
    return dr.select(scene.ray_test(si.spawn_ray_to(light)), 0, value / distance2)
