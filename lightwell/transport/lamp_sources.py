"""Groups of a scene's emitters as light sources: which group a lane samples, and which one a ray has met."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lightwell.backend import dr, mi
from lightwell.scenes.lamps import LampGroup
from lightwell.scenes.scene import Scene


class LampSources:
    """The emitters of K groups on the device."""

    def __init__(self, scene: Scene, groups: Sequence[LampGroup]) -> None:
        """Upload which emitter belongs to which group.

        Args:
            scene: The scene.
            groups: K groups of its emitters; an emitter is in one group at most.
        """
        self.scene, self.count = scene, len(groups)
        emitters = scene.mi.emitters()
        pointers = [int(dr.reinterpret_array(mi.UInt32, mi.EmitterPtr(emitter))[0]) for emitter in emitters]
        order = [index for group in groups for index in group.emitters]
        sizes = np.array([len(group.emitters) for group in groups])
        of_pointer = np.full(max(pointers, default=0) + 2, self.count, np.uint32)
        of_pointer[[pointers[index] for index in order]] = np.arange(self.count).repeat(sizes)
        self._size, self._first = mi.UInt32(sizes), mi.UInt32(np.cumsum(sizes) - sizes)
        self._emitter = mi.UInt32([pointers[index] for index in order])
        self._of_pointer = mi.UInt32(of_pointer)
        dr.eval(self._size, self._first, self._emitter, self._of_pointer)

    def sample(
        self, it: mi.Interaction3f, group: mi.UInt32, number: mi.Float, u: mi.Point2f, active: mi.Bool
    ) -> tuple[mi.DirectionSample3f, mi.Spectrum, mi.Float]:
        """Sample a direction to a random emitter of a group; the caller traces the shadow ray.

        Args:
            it: [N] places to light.
            group: [N] groups.
            number: [N] numbers in [0, 1) that choose the emitter.
            u: [N] points in [0, 1)².
            active: [N] lanes.

        Returns:
            Direction sample, radiance over density, and the density per steradian; 0 where nothing shines.
        """
        size = dr.gather(mi.UInt32, self._size, group, active)
        index = dr.gather(mi.UInt32, self._first, group, active) + dr.minimum(mi.UInt32(number * size), size - 1)
        emitter = dr.reinterpret_array(mi.EmitterPtr, dr.gather(mi.UInt32, self._emitter, index, active))
        ds, weight = emitter.sample_direction(it, u, active)
        good = active & (ds.pdf > 0)
        return ds, dr.select(good, weight * mi.Float(size), 0), dr.select(good, ds.pdf / mi.Float(size), 0)

    def met(
        self, prev: mi.Interaction3f, si: mi.SurfaceInteraction3f, active: mi.Bool
    ) -> tuple[mi.UInt32, mi.Spectrum, mi.Float]:
        """Evaluate the emission that rays have found.

        Args:
            prev: [N] places that the rays come from.
            si: [N] what they found.
            active: [N] lanes.

        Returns:
            Group (K where nothing of a group shines), radiance, and the density per steradian with which ``sample``
            chooses the direction.
        """
        ds = mi.DirectionSample3f(self.scene.mi, si, prev)
        emitter = dr.reinterpret_array(mi.UInt32, ds.emitter)
        group = dr.select(active, dr.gather(mi.UInt32, self._of_pointer, emitter, active), self.count)
        active &= group < self.count
        pdf = ds.emitter.pdf_direction(prev, ds, active) / mi.Float(dr.gather(mi.UInt32, self._size, group, active))
        return group, dr.select(active, ds.emitter.eval(si, active), 0), dr.select(active, pdf, 0)
