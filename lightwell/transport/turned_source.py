"""A turned environment map as a light source of the path tracer, one angle per lane.

A rasteriser draws nothing of it: all of its light is learned, also what reaches a surface in a straight line
(``first_hit``).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from lightwell.backend import dr, mi


@dataclass
class TurnedEmitter:
    """An environment map whose north (-Z) points to ``north``; directions are drawn by the map's own radiance."""

    north: mi.Vector3f
    """Horizontal unit vector of every lane."""
    pointer: mi.UInt32
    """The emitter, which is not part of the scene that is traced."""
    panes = None  # it has no delta lobe
    hits = True
    emits = False
    first_hit = True
    level = 1.0

    @staticmethod
    def of(surrounding: Any, north: mi.Vector3f) -> TurnedEmitter:
        """Make the source.

        Args:
            surrounding: Mitsuba's emitter, ``Scene.surrounding``.
            north: [N] where its north has turned to.

        Returns:
            The source.
        """
        pointer = int(dr.reinterpret_array(mi.UInt32, mi.EmitterPtr(surrounding))[0])
        return TurnedEmitter(north, dr.opaque(mi.UInt32, pointer))

    def sky(self, direction: mi.Vector3f, active: mi.Bool) -> mi.Color3f:
        """Evaluate the map.

        Args:
            direction: [N] unit directions.
            active: [N] lanes.

        Returns:
            [N] radiance from there.
        """
        si = dr.zeros(mi.SurfaceInteraction3f, dr.width(direction))
        # Towards the eye, from where the light comes.
        si.wi = -self._unturned(direction)
        return dr.select(active, self._emitter.eval(si, active), 0)

    def sample(self, scene: mi.Scene, si: mi.SurfaceInteraction3f, u: mi.Point2f, active: mi.Bool):
        """Sample a direction by the radiance of the map.

        Args:
            scene: Mitsuba scene, not used.
            si: Surface interactions to light.
            u: 2D points in [0, 1)².
            active: Active lanes.

        Returns:
            Direction [world], weight, density per solid angle, whether it is a delta density (it is not), shadow ray.
        """
        ds, weight = self._emitter.sample_direction(si, u, active)
        d, good = self._turned(ds.d), active & (ds.pdf > 0)
        return d, dr.select(good, weight, 0), dr.select(good, ds.pdf, 0), mi.Bool(False), si.spawn_ray(d)

    def hit(
        self,
        scene: mi.Scene,
        prev: mi.Interaction3f,
        si: mi.SurfaceInteraction3f,
        ray: mi.Ray3f,
        delta_prev: mi.Bool,
        active: mi.Bool,
    ) -> tuple[mi.Spectrum, mi.Float]:
        """Find the map in rays that leave the scene.

        Args:
            scene: Mitsuba scene, not used.
            prev: Interactions that the rays come from.
            si: Surface interactions that the rays found.
            ray: Rays, chosen by BSDF sampling.
            delta_prev: Whether a delta lobe chose the ray.
            active: Active lanes.

        Returns:
            Radiance, and the density with which ``sample`` chooses the direction (0 after a delta lobe).
        """
        free = active & ~si.is_valid()
        ds = dr.zeros(mi.DirectionSample3f, dr.width(ray.d))
        ds.d = self._unturned(ray.d)
        pdf = self._emitter.pdf_direction(prev, ds, free & ~delta_prev)
        return self.sky(ray.d, free), dr.select(free & ~delta_prev, pdf, 0)

    @property
    def _emitter(self) -> mi.EmitterPtr:
        return dr.reinterpret_array(mi.EmitterPtr, self.pointer)

    def _turned(self, d: mi.Vector3f) -> mi.Vector3f:
        """Directions of the map in the world: cosine is -z of its north, sine is x."""
        cosine, sine = -self.north.z, self.north.x
        return mi.Vector3f(d.x * cosine - d.z * sine, d.y, d.x * sine + d.z * cosine)

    def _unturned(self, d: mi.Vector3f) -> mi.Vector3f:
        """Directions of the world in the map."""
        cosine, sine = -self.north.z, self.north.x
        return mi.Vector3f(d.x * cosine + d.z * sine, d.y, d.z * cosine - d.x * sine)
