"""Instant radiosity: indirect light as that of virtual point lights (a baseline to compare with).

Light paths are traced from the emitters; each vertex on a diffuse surface becomes a point light that shines like that
surface. A pixel is lit by all of them:

    L(x) = Σ_j f(x, ω_j, ω_o) min(G_j, b) V_j Φ_j ρ_j / π,    G_j = cos θ_x cos θ_j / ‖x − x_j‖²

with the bound b on the geometry term, without which near lights make bright spots, and with which corners are too dark.

Paper: Keller, *Instant Radiosity*, SIGGRAPH 1997. The bound is the customary one, see Dachsbacher et al., *Scalable
Realistic Rendering with Many-Light Methods*, Computer Graphics Forum 33(1), 2014, § 3.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.cache.frames import sampled_rays
from lightwell.cache.scene_region import bounds_of
from lightwell.rendering.indirect_baseline import IndirectBaseline

# Vertices of a light path from which Russian roulette may end it, and its largest survival probability (as Mitsuba's).
RR_VERTEX, RR_MOST = 3, 0.95
# Vertices of a light path where its length is not limited.
MOST_VERTICES = 64


@dataclass(frozen=True)
class VirtualLights:
    """M virtual point lights."""

    position: np.ndarray
    """[M, 3] metres."""
    normal: np.ndarray
    """[M, 3] unit, on the side that is lit."""
    intensity: np.ndarray
    """[M, 3] radiant intensity along the normal."""

    def __len__(self) -> int:
        return len(self.position)


def trace_lights(scene: Any, paths: int, max_depth: int, seed: int) -> VirtualLights:
    """Trace light paths and turn their vertices into point lights.

    Args:
        scene: Mitsuba scene.
        paths: Light paths, ≥ 1.
        max_depth: Longest path from an emitter to the eye, in edges; -1: unlimited.
        seed: Seed.

    Returns:
        The lights.
    """
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, paths)
    ray, power, _ = scene.sample_emitter_ray(0.0, sampler.next_1d(), sampler.next_2d(), sampler.next_2d(), True)
    power, active = power / paths, mi.Bool(True)
    found: list[tuple[np.ndarray, ...]] = []
    # A light at vertex k joins the eye by k + 2 edges.
    for vertex in range(MOST_VERTICES if max_depth < 0 else max(max_depth - 2, 0)):
        si = scene.ray_intersect(ray, active)
        active = active & si.is_valid()
        found.append(_lights_at(si, power, active))
        bsdf, context = si.bsdf(), mi.BSDFContext(mi.TransportMode.Importance)
        sample, weight = bsdf.sample(context, si, sampler.next_1d(active), sampler.next_2d(active), active)
        power = power * weight
        if vertex + 1 >= RR_VERTEX:
            survival = dr.minimum(dr.max(weight), RR_MOST)
            active = active & (sampler.next_1d() < survival)
            power = power / dr.maximum(survival, 1e-6)
        ray = si.spawn_ray(si.to_world(sample.wo))
        active = active & (dr.max(power) > 0)
        dr.eval(ray, power, active)
        if not dr.any(active):
            break
    parts = zip(*found) if found else ([np.zeros((0, 3), np.float32)],) * 3
    return VirtualLights(*(np.concatenate(part) for part in parts))


def _lights_at(si: Any, power: Any, active: Any) -> tuple[np.ndarray, ...]:
    """(positions, normals, intensities) of the vertices that reflect light diffusely."""
    side = dr.select(si.wi.z >= 0, mi.Float(1), mi.Float(-1))
    bsdf = si.bsdf()
    # The far side of a one-sided surface reflects nothing.
    towards = mi.Vector3f(0, 0, side)
    lit = active & (dr.max(bsdf.eval(mi.BSDFContext(), si, towards, active)) > 0)
    intensity = dr.select(lit, power * bsdf.eval_diffuse_reflectance(si, lit) * dr.inv_pi, 0)
    rows = np.array(lit & (dr.max(intensity) > 0))
    return tuple(np.array(v).T[rows].astype(np.float32) for v in (si.p, si.to_world(towards), intensity))


@dr.syntax
def gather(scene: Any, si: Any, lights: VirtualLights, bound: float, active: Any = True) -> Any:
    """Add up the light of all virtual lights at surface points.

    Args:
        scene: Mitsuba scene.
        si: [N] surface interactions.
        lights: The lights.
        bound: Largest geometry term, 1 / m²; inf: no bound.
        active: [N] mask.

    Returns:
        [N] reflected radiance.
    """
    place, normal, intensity = (mi.Float(np.ravel(v)) for v in (lights.position, lights.normal, lights.intensity))
    count, most = dr.opaque(mi.UInt32, len(lights)), dr.opaque(mi.Float, bound)
    context, bsdf = mi.BSDFContext(), si.bsdf()
    L, j = mi.Color3f(0), mi.UInt32(0)
    while j < count:
        to = dr.gather(mi.Point3f, place, j)
        offset = to - si.p
        squared = dr.squared_norm(offset)
        direction = si.to_local(offset * dr.rsqrt(squared))
        at_light = -dr.dot(dr.gather(mi.Vector3f, normal, j), offset) * dr.rsqrt(squared)
        value = bsdf.eval(context, si, direction, active)
        form = dr.maximum(at_light, 0) / squared
        # The BSDF's value holds cos θ at the point already.
        limit = dr.minimum(1, most / dr.maximum(form * dr.abs(direction.z), 1e-20))
        lit = active & (at_light > 0) & (dr.max(value) > 0)
        lit = lit & ~scene.ray_test(si.spawn_ray_to(to), lit)
        L += dr.select(lit, value * dr.gather(mi.Color3f, intensity, j) * form * limit, 0)
        j += 1
    return L


class VplIntegrator(IndirectBaseline):
    """Instant radiosity: direct light by path tracing, indirect light from virtual point lights.

    Each sample of the pixels has lights of its own, so that pictures of many samples converge to the bounded solution.

    Not supported: light that mirrors, glass or glossy surfaces reflect towards other surfaces (lights stand on diffuse
    surfaces alone), participating media, derivatives. Reconstruction filters other than the box are taken as the box.

    Parameters: ``paths`` light paths per sample (64), ``clamp`` the bound on the geometry term times the squared extent
    of the scene (100; inf: none), ``max_depth`` (-1).
    """

    plugin = "lightwell_vpl"

    def __init__(self, props: Any = None) -> None:
        """Read the parameters.

        Args:
            props: Mitsuba properties of the plugin; None: the defaults.
        """
        props = mi.Properties(self.plugin) if props is None else props
        super().__init__(props)
        self.paths = int(props.get("paths", 64))
        """Light paths per sample."""
        self.clamp = float(props.get("clamp", 100.0))
        """Largest geometry term times the squared extent."""

    def _indirect(self, scene: Any, sensor: Any, first: int, spp: int, size: tuple[int, int]) -> np.ndarray:
        """See ``IndirectBaseline``."""
        height, width = size
        low, high = bounds_of(scene)
        bound = self.clamp / float((high - low).max()) ** 2
        total = np.zeros((height * width, 3))
        for number in range(spp):
            lights = trace_lights(scene, self.paths, self.longest, (first + 1) * 65_537 + number)
            if not len(lights):
                continue
            sampler = mi.load_dict({"type": "independent"})
            sampler.seed(first * spp + number, width * height)
            ray, weight, _, _ = sampled_rays(sensor, sampler, 1)
            si = scene.ray_intersect(ray)
            total += np.array(gather(scene, si, lights, bound, si.is_valid()) * mi.Color3f(weight)).T
        return total


def register() -> None:
    """Register ``lightwell_vpl`` with the active Mitsuba variant."""
    mi.register_integrator(VplIntegrator.plugin, lambda props: VplIntegrator(props))
