"""Light sources of the path tracer: point, sphere or sun, one position per lane, and the scene's own emitters.

Every source offers the two techniques of multiple importance sampling (Veach 1997, chapter 9):

* ``sample(scene, si, u, active)``: a direction towards the light; returns (wo [world], weight = Le / pdf, pdf, delta,
  shadow ray).
  Where it has ``panes``, the shadow ray of a light without extent passes them.
* ``hit(scene, prev, si, ray, delta_prev, active)``: the radiance that a BSDF-sampled ray finds, with the density with
  which ``sample`` would have chosen its direction.

Sources are not frozen: Dr.Jit carries them through its loops and assigns their fields.

The declared light is not part of the scene's geometry: it blocks no ray, so that the light of several sources adds up
exactly.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

from lightwell.backend import dr, mi
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import PointLight, Turning, Variable, has_sky
from lightwell.transport.emitter_table import EmitterTable, emitter_table
from lightwell.transport.light_vertices import OFTEN, LightVertices
from lightwell.transport.panes import Panes, first_stop, panes_of
from lightwell.transport.resampling import candidates, chosen, nominal
from lightwell.transport.sky_source import DayEmitter
from lightwell.transport.turned_source import TurnedEmitter

LightSample: TypeAlias = tuple[Any, Any, Any, Any, Any]
"""Direction [world], weight = Le / pdf, pdf, whether the pdf is a delta function, shadow ray; Dr.Jit values."""


@dataclass
class PointEmitter:
    """A point light of 1 cd."""

    position: mi.Point3f
    panes: Panes | None = None
    vertices: LightVertices | None = None
    """Ends of the light rays of several lamps, which all paths share; None: each path has a light ray of its own."""
    group: mi.UInt32 | None = None
    """Number of the lamp among them, times 2, plus that of the half of the paths."""
    hits = False  # a ray cannot find it
    emits = True  # it can send a ray
    first_hit = False  # its direct light is the rasteriser's, without exception

    def emit(self, u: mi.Point2f) -> mi.Ray3f:
        """Make a ray from the light in a direction that is uniform on the sphere.

        Args:
            u: 2D points in [0, 1)².

        Returns:
            One ray per lane.
        """
        return mi.Ray3f(self.position, mi.warp.square_to_uniform_sphere(u))

    @property
    def often(self) -> float:
        """How many light rays the one of a path counts as in weights against BSDF sampling."""
        return 1.0 if self.vertices is None else OFTEN

    def vertex(
        self, scene: mi.Scene, si: mi.SurfaceInteraction3f, u: mi.Point2f, rng: mi.PCG32
    ) -> tuple[tuple[Any, Any, Any], Any]:
        """Find the end of a light ray to which paths are connected.

        Args:
            scene: Mitsuba scene.
            si: Surface interactions where the paths start.
            u: 2D points in [0, 1)².
            rng: Random streams.

        Returns:
            Where it ends, the transmittance on the way and the chance that it does; what it is multiplied by.
        """
        if self.vertices is None or self.group is None:
            return first_stop(scene, self.panes, self.emit(u), rng)[0], 1.0
        return self.vertices.choose(si, self.position, self.group, u.x, rng)

    def sample(self, scene: mi.Scene, si: mi.SurfaceInteraction3f, u: mi.Point2f, active: mi.Bool) -> LightSample:
        """Sample the direction to the light; the irradiance at normal incidence is 1 / distance².

        Args:
            scene: Mitsuba scene, not used.
            si: Surface interactions to light.
            u: 2D points in [0, 1)², not used.
            active: Active lanes, not used.

        Returns:
            Direction [world], weight, density 1, whether it is a delta density (it is), and the shadow ray.
        """
        offset = self.position - si.p
        distance2 = dr.squared_norm(offset)
        weight = mi.Spectrum(dr.select(distance2 > 0, dr.rcp(distance2), 0))
        return offset * dr.rsqrt(distance2), weight, mi.Float(1), mi.Bool(True), si.spawn_ray_to(self.position)


@dataclass
class SunEmitter:
    """A distant light of 1 lx at normal incidence; ``direction`` points to it."""

    direction: mi.Vector3f
    panes: Panes | None = None
    hits = False
    emits = False
    first_hit = False

    def sample(self, scene: mi.Scene, si: mi.SurfaceInteraction3f, u: mi.Point2f, active: mi.Bool) -> LightSample:
        """Return the direction to the sun; the irradiance at normal incidence is 1.

        Args:
            scene: Mitsuba scene, not used.
            si: Surface interactions to light.
            u: 2D points in [0, 1)², not used.
            active: Active lanes, not used.

        Returns:
            Direction [world], weight, density 1, whether it is a delta density (it is), and the shadow ray.
        """
        return self.direction, mi.Spectrum(1), mi.Float(1), mi.Bool(True), si.spawn_ray(self.direction)


@dataclass
class Sphere:
    """A sphere of constant radiance 1 / (π r²), that is 1 cd from far away."""

    position: mi.Point3f
    radius: mi.Float
    panes = None  # rays that the BSDF chooses find it behind glass
    hits = True
    emits = False
    first_hit = False

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

    def sample(self, scene: mi.Scene, si: mi.SurfaceInteraction3f, u: mi.Point2f, active: mi.Bool) -> LightSample:
        """Sample a direction uniformly in the cone under which the sphere is seen.

        Args:
            scene: Mitsuba scene, not used.
            si: Surface interactions to light.
            u: 2D points in [0, 1)².
            active: Active lanes, not used.

        Returns:
            Direction [world], weight, density per solid angle (0 inside the sphere), whether it is a delta density (it
            is not), and the shadow ray.
        """
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

    def hit(
        self,
        scene: mi.Scene,
        prev: mi.Interaction3f,
        si: mi.SurfaceInteraction3f,
        ray: mi.Ray3f,
        delta_prev: mi.Bool,
        active: mi.Bool,
    ) -> tuple[mi.Spectrum, mi.Float]:
        """Find the radiance of rays that meet the sphere before anything else.

        Args:
            scene: Mitsuba scene, not used.
            prev: Interactions that the rays come from.
            si: Surface interactions that the rays found.
            ray: Rays, chosen by BSDF sampling.
            delta_prev: Whether a delta lobe chose the ray.
            active: Active lanes, not used.

        Returns:
            Radiance, and the density with which ``sample`` chooses the direction (0 after a delta lobe).
        """
        t, found = self._entry(ray.o, ray.d)
        one_minus_cos, outside = self._solid_angle(prev.p)
        found &= outside & (t < si.t)
        pdf = dr.select(delta_prev, 0, dr.rcp(dr.two_pi * one_minus_cos))
        return mi.Spectrum(dr.select(found, self._radiance(), 0)), pdf

    def _radiance(self) -> mi.Float:
        return dr.rcp(dr.pi * dr.square(self.radius))


@dataclass
class Emitters:
    """The emitters in the Mitsuba scene: area lights, environment, punctual lights."""

    panes: Panes | None = None
    table: EmitterTable | None = None
    """By which one is chosen; None: all have the same chance."""
    hits = True
    emits = False
    first_hit = False

    @staticmethod
    def of(scene: Scene) -> Emitters:
        """Make the source of all emitters of a scene.

        Args:
            scene: The scene.

        Returns:
            The source.
        """
        several = len(scene.mi.emitters()) > 1
        return Emitters(panes_of(scene), emitter_table(scene) if several else None)

    def sample(self, scene: mi.Scene, si: mi.SurfaceInteraction3f, u: mi.Point2f, active: mi.Bool) -> LightSample:
        """Sample a direction to an emitter; the caller traces the shadow ray.

        Of several emitters the one that would bring most is chosen most often (``resampling``): of many lamps the one
        close by, so that a bright spot that few paths meet is lit whenever one does.

        Args:
            scene: Mitsuba scene.
            si: Surface interactions to light.
            u: 2D points in [0, 1)².
            active: Active lanes.

        Returns:
            Direction [world], weight, density per solid angle, whether it is a delta density, and the shadow ray. With
            several candidates the density is a nominal one, the same that ``hit`` returns: MIS weights need no more.
        """
        if self.table is None:
            ds, weight = scene.sample_emitter_direction(si, u, False, active)
            return ds.d, dr.select(ds.pdf > 0, weight, 0), ds.pdf, ds.delta, si.spawn_ray_to(ds.p)
        count = dr.opaque(mi.UInt32, len(scene.emitters()))
        emitter, weight, number = chosen(self.table, (mi.UInt32(0), count), si, u.x, active)
        ds, light = self.table.sample(emitter, si, mi.Point2f(number, u.y), active)
        pdf = ds.pdf * nominal(candidates(count)) / mi.Float(count)
        return ds.d, dr.select(ds.pdf > 0, light * weight, 0), pdf, ds.delta, si.spawn_ray_to(ds.p)

    def hit(
        self,
        scene: mi.Scene,
        prev: mi.Interaction3f,
        si: mi.SurfaceInteraction3f,
        ray: mi.Ray3f,
        delta_prev: mi.Bool,
        active: mi.Bool,
    ) -> tuple[mi.Spectrum, mi.Float]:
        """Evaluate the emission of the surface (or environment) that rays found.

        Args:
            scene: Mitsuba scene.
            prev: Interactions that the rays come from.
            si: Surface interactions that the rays found.
            ray: Rays, chosen by BSDF sampling; not used.
            delta_prev: Whether a delta lobe chose the ray.
            active: Active lanes.

        Returns:
            Radiance, and the density of ``sample`` for the direction (0 after a delta lobe).
        """
        ds = mi.DirectionSample3f(scene, si, prev)
        pdf = scene.pdf_emitter_direction(prev, ds, active & ~delta_prev)
        if self.table is not None:
            pdf *= nominal(candidates(len(scene.emitters())))
        return ds.emitter.eval(si, active), dr.select(delta_prev, 0, pdf)


Source: TypeAlias = PointEmitter | SunEmitter | DayEmitter | TurnedEmitter | Sphere | Emitters
"""Anything that the path tracer can sample."""


Declared: TypeAlias = PointEmitter | Sphere | SunEmitter | DayEmitter | TurnedEmitter


def declared(variable: Variable, light: mi.Vector3f, scene: Scene) -> Declared:
    """Make the source that a variable declares.

    Args:
        variable: The declared light.
        light: Its position in every lane, metres (direction to a sun).
        scene: The scene that it lights.

    Returns:
        A sun, alone or with its sky, an environment map, a sphere for a radius above 0, else a point.
    """
    if has_sky(variable):
        return DayEmitter.of(variable, dr.normalize(light), panes_of(scene))
    if isinstance(variable, Turning):
        return TurnedEmitter.of(scene.surrounding, dr.normalize(light))
    if variable.kind == "sun":
        return SunEmitter(dr.normalize(light), panes_of(scene))
    if isinstance(variable, PointLight) and variable.radius > 0:
        return Sphere(mi.Point3f(light), dr.opaque(mi.Float, variable.radius))
    return PointEmitter(mi.Point3f(light), panes_of(scene))
