"""Groups of a scene's emitters as light sources: which group a lane samples, and which one a ray has met; or one group
alone as the source of a path tracer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lightwell.backend import dr, mi
from lightwell.scenes.lamps import LampGroup
from lightwell.scenes.scene import Scene
from lightwell.transport.emitter_table import EmitterTable, pointers
from lightwell.transport.panes import Panes, panes_of
from lightwell.transport.resampling import candidates, chosen, nominal


class LampSources:
    """The emitters of K groups on the device."""

    def __init__(self, scene: Scene, groups: Sequence[LampGroup]) -> None:
        """Upload which emitter belongs to which group.

        Args:
            scene: The scene.
            groups: K groups of its emitters; an emitter is in one group at most.
        """
        self.scene, self.count = scene, len(groups)
        sizes = np.array([len(group.emitters) for group in groups])
        order = [index for group in groups for index in group.emitters]
        self._table, known = EmitterTable.of(scene.mi, order), pointers(scene.mi)
        of_pointer = np.full(known.max(initial=0) + 2, self.count, np.uint32)
        of_pointer[known[order]] = np.arange(self.count).repeat(sizes)
        self._size, self._first = mi.UInt32(sizes), mi.UInt32(np.cumsum(sizes) - sizes)
        self._of_pointer = mi.UInt32(of_pointer)
        dr.eval(self._size, self._first, self._of_pointer)

    def sample(
        self, it: mi.Interaction3f, group: mi.UInt32, number: mi.Float, u: mi.Point2f, active: mi.Bool
    ) -> tuple[mi.DirectionSample3f, mi.Spectrum, mi.Float]:
        """Sample a direction to an emitter of a group, as ``Emitters`` does; the caller traces the shadow ray.

        Args:
            it: [N] places to light.
            group: [N] groups.
            number: [N] numbers in [0, 1) that choose the emitter.
            u: [N] points in [0, 1)².
            active: [N] lanes.

        Returns:
            Direction sample, radiance over density, and the nominal density per steradian for MIS weights; 0 where
            nothing shines.
        """
        size = dr.gather(mi.UInt32, self._size, group, active)
        first = dr.gather(mi.UInt32, self._first, group, active)
        emitter, weight, _ = chosen(self._table, (first, size), it, number, active)
        ds, light = self._table.sample(emitter, it, u, active)
        good = active & (ds.pdf > 0)
        pdf = ds.pdf * nominal(candidates(size)) / mi.Float(size)
        return ds, dr.select(good, light * weight, 0), dr.select(good, pdf, 0)

    def met(
        self, prev: mi.Interaction3f, si: mi.SurfaceInteraction3f, active: mi.Bool
    ) -> tuple[mi.UInt32, mi.Spectrum, mi.Float]:
        """Evaluate the emission that rays have found.

        Args:
            prev: [N] places that the rays come from.
            si: [N] what they found.
            active: [N] lanes.

        Returns:
            Group (K where nothing of a group shines), radiance, and the density of ``sample`` for the direction.
        """
        ds = mi.DirectionSample3f(self.scene.mi, si, prev)
        emitter = dr.reinterpret_array(mi.UInt32, ds.emitter)
        group = dr.select(active, dr.gather(mi.UInt32, self._of_pointer, emitter, active), self.count)
        # A new array: an assignment with "&=" would change the lanes of the caller.
        active = active & (group < self.count)
        size = dr.gather(mi.UInt32, self._size, group, active)
        pdf = ds.emitter.pdf_direction(prev, ds, active) / mi.Float(size) * nominal(candidates(size))
        return group, dr.select(active, ds.emitter.eval(si, active), 0), dr.select(active, pdf, 0)


@dataclass
class GroupEmitters:
    """Some of the emitters in the Mitsuba scene, as a source of ``transport.sources``; the others are dark."""

    table: EmitterTable
    """The emitters that shine, M."""
    shines: mi.Float
    """1 for the pointers of emitters that shine, else 0."""
    size: mi.UInt32
    """M, opaque."""
    panes: Panes | None = None
    hits = True
    emits = False
    first_hit = False

    @staticmethod
    def of(scene: Scene, emitters: Sequence[int]) -> GroupEmitters:
        """Make the source.

        Args:
            scene: The scene.
            emitters: Indices of its emitters that shine, at least one.

        Returns:
            The source.
        """
        table, known = EmitterTable.of(scene.mi, emitters), pointers(scene.mi)
        shines = np.zeros(known.max() + 2, np.float32)
        shines[known[list(emitters)]] = 1
        made = GroupEmitters(table, mi.Float(shines), dr.opaque(mi.UInt32, len(emitters)), panes_of(scene))
        dr.eval(made.shines, made.size)
        return made

    def sample(
        self, scene: mi.Scene, si: mi.SurfaceInteraction3f, u: mi.Point2f, active: mi.Bool
    ) -> tuple[mi.Vector3f, mi.Spectrum, mi.Float, mi.Bool, mi.Ray3f]:
        """Sample a direction to an emitter of the group, as ``Emitters`` does; the caller traces the shadow ray.

        Args:
            scene: Mitsuba scene, not used.
            si: Surface interactions to light.
            u: 2D points in [0, 1)².
            active: Active lanes.

        Returns:
            Direction [world], weight, density per solid angle, whether it is a delta density, and the shadow ray.
        """
        emitter, weight, number = chosen(self.table, (mi.UInt32(0), self.size), si, u.x, active)
        ds, light = self.table.sample(emitter, si, mi.Point2f(number, u.y), active)
        good = active & (ds.pdf > 0)
        pdf = dr.select(good, ds.pdf * nominal(candidates(self.size)) / mi.Float(self.size), 0)
        return ds.d, dr.select(good, light * weight, 0), pdf, ds.delta, si.spawn_ray_to(ds.p)

    def hit(
        self,
        scene: mi.Scene,
        prev: mi.Interaction3f,
        si: mi.SurfaceInteraction3f,
        ray: mi.Ray3f,
        delta_prev: mi.Bool,
        active: mi.Bool,
    ) -> tuple[mi.Spectrum, mi.Float]:
        """Evaluate the emission of the surface (or environment) that rays found, where it is of the group.

        Args:
            scene: Mitsuba scene.
            prev: Interactions that the rays come from.
            si: Surface interactions that the rays found.
            ray: Rays, chosen by BSDF sampling; not used.
            delta_prev: Whether a delta lobe chose the ray.
            active: Active lanes.

        Returns:
            Radiance, and the density with which ``sample`` chooses the direction (0 after a delta lobe).
        """
        ds = mi.DirectionSample3f(scene, si, prev)
        pointer = dr.reinterpret_array(mi.UInt32, ds.emitter)
        lit = active & (dr.gather(mi.Float, self.shines, pointer, active) > 0)
        share = nominal(candidates(self.size)) / mi.Float(self.size)
        pdf = ds.emitter.pdf_direction(prev, ds, lit & ~delta_prev) * share
        return dr.select(lit, ds.emitter.eval(si, lit), 0), dr.select(lit & ~delta_prev, pdf, 0)
