"""State of paths, and the steps that all path loops share: emission that a ray meets, light sampling, roulette.

Notation: N lanes, one path each.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from lightwell.backend import dr, mi
from lightwell.transport.panes import Panes, unblocked
from lightwell.transport.sources import Source

# Largest survival probability of the roulette; Mitsuba's path integrator.
RR_MAX = 0.95


def power_heuristic(pdf_a: mi.Float, pdf_b: mi.Float) -> mi.Float:
    """Compute the power heuristic: weight of a sample drawn with one density that another could have drawn too.

    Args:
        pdf_a: [N] density with which the sample was drawn.
        pdf_b: [N] the other density, of the same measure.

    Returns:
        [N] weight in [0, 1]; 0 where it is not finite.

    Reference: Veach, *Robust Monte Carlo Methods for Light Transport Simulation*, 1997, § 9.2.4.
    """
    a2 = dr.square(pdf_a)
    weight = a2 / dr.fma(pdf_b, pdf_b, a2)
    return dr.select(dr.isfinite(weight), weight, 0)


def interaction_at(si: mi.SurfaceInteraction3f) -> mi.Interaction3f:
    """Reduce surface interactions to what emitter densities need.

    Args:
        si: [N] surface interactions.

    Returns:
        [N] interactions with the same position, normal, time and wavelengths.
    """
    return mi.Interaction3f(si.t, si.time, si.wavelengths, si.p, si.n)


def is_delta(sample: mi.BSDFSample3f) -> mi.Bool:
    """Test whether directions were sampled from delta components.

    Args:
        sample: [N] BSDF samples.

    Returns:
        [N] mask.
    """
    return mi.has_flag(sample.sampled_type, mi.BSDFFlags.Delta)


@dataclass
class LightSample:
    """Direction to a light at each vertex. It is not a loop variable."""

    direction: mi.Vector3f
    """[N] towards the light, unit, world space."""
    weight: mi.Spectrum
    """[N] radiance over density; irradiance for lights without extent. Less what panes hold back."""
    pdf: mi.Float
    """[N] density per steradian."""
    delta: mi.Bool
    """[N] whether the light has no extent, so that BSDF sampling cannot find it."""
    seen: mi.Bool
    """[N] active lanes whose light is visible."""
    chance: mi.Float
    """[N] chance with which a random ray from the light comes as far as the vertex; 1 where nothing is on the way."""

    def mis(self, bsdf_pdf: mi.Float) -> mi.Float:
        """Compute the weight against BSDF sampling.

        Args:
            bsdf_pdf: [N] density with which the BSDF samples the direction.

        Returns:
            [N] weight in [0, 1].
        """
        return dr.select(self.delta, 1, power_heuristic(self.pdf, bsdf_pdf))


@dataclass
class AimedRay:
    """Direction to a light at each vertex, not known to be visible. It is not a loop variable."""

    direction: mi.Vector3f
    """[N] towards the light, unit, world space."""
    weight: mi.Spectrum
    """[N] radiance over density; irradiance for lights without extent."""
    pdf: mi.Float
    """[N] density per steradian."""
    delta: mi.Bool
    """[N] whether the light has no extent."""
    ray: mi.Ray3f
    """[N] shadow rays."""
    panes: Panes | None
    """What they may pass; None: nothing."""

    def traced(self, scene: mi.Scene, active: mi.Bool) -> LightSample:
        """Trace the shadow rays.

        Args:
            scene: Mitsuba scene.
            active: [N] lanes whose surface reflects light from the direction.

        Returns:
            The samples; not seen where ``active`` is false.
        """
        T, chance = unblocked(scene, self.panes, self.ray, active & (dr.max(self.weight) > 0), self.delta)
        return LightSample(self.direction, self.weight * T, self.pdf, self.delta, chance > 0, chance)


def aim_at_light(
    scene: mi.Scene, si: mi.SurfaceInteraction3f, source: Source, u: mi.Point2f, active: mi.Bool
) -> AimedRay:  # fmt: skip
    """Sample a light at vertices; ``traced`` then asks whether it is visible where the surface reflects its light.

    Of the directions many lie below the surface: their shadow rays would be traced for nothing (a path costs 7 %
    less without them in zdm2, 14 % in hello-webxr-hall).

    Args:
        scene: Mitsuba scene.
        si: [N] surface interactions.
        source: What shines.
        u: [N] random points in [0, 1)².
        active: [N] lanes whose BSDF reflects light from such a direction.

    Returns:
        The directions, and rays to the lights.
    """
    direction, weight, pdf, delta, ray = source.sample(scene, si, u, active)
    return AimedRay(direction, weight, pdf, delta, ray, source.panes)


class PathState:
    """Loop variables of paths."""

    DRJIT_STRUCT: dict[str, Any] = {  # noqa: RUF012
        "ray": mi.Ray3f, "β": mi.Spectrum, "η": mi.Float, "depth": mi.UInt32, "prev": mi.Interaction3f,
        "prev_pdf": mi.Float, "prev_delta": mi.Bool, "active": mi.Bool,
    }  # fmt: skip

    def __init__(self, ray: mi.Ray3f | None = None) -> None:
        """Start paths, as if a delta component had sampled their rays.

        Args:
            ray: [N] rays; None: to be set later.
        """
        self.ray = mi.Ray3f() if ray is None else mi.Ray3f(dr.detach(ray))
        self.β, self.η = mi.Spectrum(1), mi.Float(1)
        """Throughput, and product of the indices of refraction."""
        self.depth = mi.UInt32(0)
        """Vertices left behind."""
        self.prev = dr.zeros(mi.Interaction3f)
        """Vertex that the ray comes from."""
        self.prev_pdf, self.prev_delta = mi.Float(1), mi.Bool(True)
        """Density of the ray's direction there, and whether it was sampled from a delta component."""
        self.active = mi.Bool(True)
        """Whether the path continues."""

    def meet(self, scene: mi.Scene, si: mi.SurfaceInteraction3f, source: Source) -> tuple[mi.Spectrum, mi.Float]:
        """Evaluate the light that the rays found, with its weight against light sampling.

        Args:
            scene: Mitsuba scene.
            si: [N] surface interactions at the end of the rays.
            source: What shines.

        Returns:
            Radiance and weight, [N] each.
        """
        Le, pdf = source.hit(scene, self.prev, si, self.ray, self.prev_delta, self.active)
        return Le, power_heuristic(self.prev_pdf, pdf)

    def leave(
        self, si: mi.SurfaceInteraction3f, wo: mi.Vector3f, pdf: mi.Float, weight: mi.Spectrum, eta: mi.Float,
        delta: mi.Bool,
    ) -> None:  # fmt: skip
        """Continue from vertices in sampled directions.

        Args:
            si: [N] surface interactions at the vertices.
            wo: [N] directions in the local frame, unit.
            pdf: [N] their density per steradian.
            weight: [N] BSDF times cosine over density.
            eta: [N] relative index of refraction along the direction.
            delta: [N] whether it was sampled from a delta component.
        """
        self.ray = si.spawn_ray(si.to_world(wo))
        self.β *= weight
        self.η *= eta
        self.prev = interaction_at(si)
        self.prev_pdf, self.prev_delta = pdf, delta

    def roulette(self, rr_depth: mi.UInt32, number: mi.Float) -> tuple[mi.Float, mi.Bool]:
        """Play Russian roulette by the throughput; the throughput itself is not changed.

        Args:
            rr_depth: Depth from which a path may end.
            number: [N] random numbers in [0, 1).

        Returns:
            Factor of the throughput of paths that continue, and which do, [N] each.
        """
        brightest = dr.max(self.β)
        survival = dr.minimum(brightest * dr.square(self.η), RR_MAX)
        plays = self.depth >= rr_depth
        return dr.select(plays, dr.rcp(survival), 1), (brightest != 0) & (~plays | (number < survival))
