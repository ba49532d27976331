"""The declared light inside the path tracer: point, sphere or sun, one position per lane, and the scene's emitters.

Every source offers the two halves of multiple importance sampling (Veach 1997, chapter 9):

* ``sample(si, u)``: a direction towards the light; returns (wo [world], weight = Le / pdf, pdf, delta, shadow ray).
* ``hit(prev, si, ray, delta_prev)``: the radiance that a BSDF-sampled ray finds, with the density ``sample`` gives it.

Sources are not frozen: Dr.Jit carries them through its loops and assigns their fields.

The declared light is not part of the scene's geometry: it blocks no ray, so that lights add up exactly.
"""

from __future__ import annotations

from dataclasses import dataclass

from lightwell.backend import dr, mi
from lightwell.scenes.variables import PointLight, Variable


@dataclass
class Point:
    """A point light of 1 cd."""

    position: mi.Point3f
    hits = False  # a ray cannot find it
    emits = True  # it can send a ray

    def emit(self, u) -> mi.Ray3f:
        """A ray in a direction that is uniform on the sphere."""
        return mi.Ray3f(self.position, mi.warp.square_to_uniform_sphere(u))

    def sample(self, scene, si, u, active):
        """Toward the light: irradiance at normal incidence is 1 / distance²."""
        offset = self.position - si.p
        distance2 = dr.squared_norm(offset)
        weight = mi.Spectrum(dr.select(distance2 > 0, dr.rcp(distance2), 0))
        return offset * dr.rsqrt(distance2), weight, mi.Float(1), mi.Bool(True), si.spawn_ray_to(self.position)


@dataclass
class Sun:
    """A distant light of 1 lx at normal incidence; ``direction`` points to it."""

    direction: mi.Vector3f
    hits = False
    emits = False

    def sample(self, scene, si, u, active):
        """Toward the sun: irradiance at normal incidence is 1."""
        return self.direction, mi.Spectrum(1), mi.Float(1), mi.Bool(True), si.spawn_ray(self.direction)


@dataclass
class Sphere:
    """A sphere of constant radiance 1 / (π r²), that is 1 cd from far away."""

    position: mi.Point3f
    radius: mi.Float
    hits = True
    emits = False

    def _solid_angle(self, p) -> tuple[mi.Float, mi.Bool]:
        """1 - cos of the half angle that the sphere fills at p, and whether p is outside of it."""
        sin2 = dr.square(self.radius) / dr.squared_norm(self.position - p)
        outside = sin2 < 1
        return dr.select(outside, sin2 / (1 + dr.sqrt(dr.maximum(1 - sin2, 0))), 1), outside

    def _entry(self, o, d) -> tuple[mi.Float, mi.Bool]:
        """Distance at which the ray enters the sphere, and whether it does."""
        m = self.position - o
        along = dr.dot(m, d)
        inside2 = dr.square(self.radius) - dr.squared_norm(m - along * d)
        t = along - dr.sqrt(dr.maximum(inside2, 0))
        return t, (inside2 > 0) & (t > 0)

    def sample(self, scene, si, u, active):
        """Uniform in the cone under which the sphere is seen."""
        one_minus_cos, outside = self._solid_angle(si.p)
        drop = u.x * one_minus_cos
        sin_theta = dr.safe_sqrt(drop * (2 - drop))
        sin_phi, cos_phi = dr.sincos(dr.two_pi * u.y)
        frame = mi.Frame3f(dr.normalize(self.position - si.p))
        d = frame.to_world(mi.Vector3f(sin_theta * cos_phi, sin_theta * sin_phi, 1 - drop))
        t, _ = self._entry(si.p, d)
        pdf = dr.select(outside, dr.rcp(dr.two_pi * one_minus_cos), 0)
        weight = mi.Spectrum(dr.select(outside, self._radiance() / pdf, 0))
        return d, weight, pdf, mi.Bool(False), si.spawn_ray_to(si.p + d * dr.maximum(t, 0))

    def hit(self, scene, prev, si, ray, delta_prev, active):
        """Radiance found by a BSDF-sampled ray that meets the sphere before anything else."""
        t, found = self._entry(ray.o, ray.d)
        one_minus_cos, outside = self._solid_angle(prev.p)
        found &= outside & (t < si.t)
        pdf = dr.select(delta_prev, 0, dr.rcp(dr.two_pi * one_minus_cos))
        return mi.Spectrum(dr.select(found, self._radiance(), 0)), pdf

    def _radiance(self) -> mi.Float:
        return dr.rcp(dr.pi * dr.square(self.radius))


@dataclass
class Emitters:
    """The emitters that stand in the Mitsuba scene: area lights, environment, punctual lights."""

    hits = True
    emits = False

    def sample(self, scene, si, u, active):
        """Mitsuba's own emitter sampling, the shadow test left to the caller."""
        ds, weight = scene.sample_emitter_direction(si, u, False, active)
        ray = si.spawn_ray_to(ds.p)
        return ds.d, dr.select(ds.pdf > 0, weight, 0), ds.pdf, ds.delta, ray

    def hit(self, scene, prev, si, ray, delta_prev, active):
        """Emission at the surface (or environment) that the ray found."""
        ds = mi.DirectionSample3f(scene, si, prev)
        pdf = scene.pdf_emitter_direction(prev, ds, active & ~delta_prev)
        return ds.emitter.eval(si, active), dr.select(delta_prev, 0, pdf)


def declared(variable: Variable, light: mi.Vector3f) -> Point | Sphere | Sun:
    """The source that a variable declares, at the given per-lane positions (directions for a sun)."""
    if variable.kind == "sun":
        return Sun(dr.normalize(light))
    if isinstance(variable, PointLight) and variable.radius > 0:
        return Sphere(mi.Point3f(light), dr.opaque(mi.Float, variable.radius))
    return Point(mi.Point3f(light))
