"""Direct light of lamps on bins where it is uneven: taken at the places that rays meet, by a shadow ray from each.

A lamp close to a wall lights a small part of a bin. The mean over the bin would reach points that see other parts of it
alone: a dark room behind the wall, or the wall beside the lamp. Where light is even, the mean has less noise.
"""

from __future__ import annotations

import numpy as np

from lightwell.backend import dr, mi, upload_floats
from lightwell.core.color import LUMINANCE
from lightwell.scenes.scene import Scene
from lightwell.transport.bins import Bins
from lightwell.transport.lamp_sources import LampSources
from lightwell.transport.panes import panes_of, unblocked

# Variance of the irradiance within a bin, over its square, above which it is uneven.
UNEVEN = 1.0
# Groups whose sums are made one by one on the device, which takes a tenth of the time of a sum of all in NumPy.
FEW_GROUPS = 4
# How far above a surface shadow rays begin, as a share of the scene's size.
LIFT = 1e-4


def is_uneven(mean: np.ndarray, square: np.ndarray) -> np.ndarray:
    """Find the bins whose irradiance varies much.

    Args:
        mean: [K, F, 3] mean irradiance over places of each bin under each group of lamps.
        square: [K, F] mean square of its luminance.

    Returns:
        [K, F] bool.
    """
    level = mean @ np.asarray(LUMINANCE)
    return np.asarray((square - level**2 > UNEVEN * level**2) & (level > 0))


class UnevenLight:
    """Direct light of K groups on the bins where it is uneven; one group is chosen for each ray."""

    def __init__(self, scene: Scene, bins: Bins, sources: LampSources, level: np.ndarray) -> None:
        """Prepare to choose groups.

        Args:
            scene: The scene.
            bins: Its F bins.
            sources: The groups.
            level: [K, F] mean luminance of a group's irradiance on a bin where it is uneven; 0 where it is even.
        """
        self._scene, self._bins, self._sources, self.count = scene, bins, sources, len(level)
        self.any = bool((level > 0).any())
        self._sums = np.zeros((bins.count + 1, self.count), np.float32)
        self._sums[:-1] = np.cumsum(level.T, axis=1)
        self._device = upload_floats(self._sums.ravel())

    def light(self, w: mi.Spectrum, p: mi.Point3f, n: mi.Normal3f, index: mi.UInt32, rng: mi.PCG32):
        """Trace one shadow ray from the end of each ray.

        Args:
            w: [R] weight of the irradiance there.
            p: [R] ends.
            n: [R] unit normals, on the side that the rays meet.
            index: [R] bins there; F where there is none.
            rng: [R] random streams.

        Returns:
            [R] light, and the group that it is of; K where there is none.
        """
        K = dr.opaque(mi.UInt32, self.count)
        row = index * K
        total = dr.gather(mi.Float, self._device, row + K - 1)
        active = (total > 0) & (dr.max(w) > 0)
        wanted = rng.next_float32() * total
        group = dr.binary_search(
            0, self.count - 1, lambda k: dr.gather(mi.Float, self._device, row + k, active) <= wanted
        )
        before = dr.select(group > 0, dr.gather(mi.Float, self._device, row + dr.maximum(group, 1) - 1, active), 0)
        chance = (dr.gather(mi.Float, self._device, row + group, active) - before) / total
        it = dr.zeros(mi.Interaction3f, dr.width(index))
        it.p = mi.Point3f(p + dr.opaque(mi.Float, LIFT * self._scene.core_extent) * n)
        it.n = mi.Normal3f(n)
        number, u = rng.next_float32(), mi.Point2f(rng.next_float32(), rng.next_float32())
        ds, weight, _ = self._sources.sample(it, group, number, u, active)
        L = w * weight * dr.maximum(dr.dot(n, ds.d), 0) / chance
        lit = active & (chance > 0) & (dr.max(L) > 0) & dr.all(dr.isfinite(L))
        T, _ = unblocked(self._scene.mi, panes_of(self._scene), it.spawn_ray_to(ds.p), lit, mi.Bool(True))
        lit &= dr.max(T) > 0
        return dr.select(lit, L * T, 0), dr.select(lit, group, K)


def sums_by_group(L: mi.Spectrum, group: mi.UInt32, groups: int, lanes: int) -> np.ndarray:
    """Add up lanes by block and group, in the order of the lanes.

    Args:
        L: [R] light.
        group: [R] groups; K where there is none.
        groups: K.
        lanes: Lanes of a block.

    Returns:
        [R / lanes, K, 3] sums.
    """
    if groups <= FEW_GROUPS:
        of_each = [dr.select(group == k, L, 0) for k in range(groups)]
        dr.eval(of_each)
        sums = [dr.block_sum(one, lanes) for one in of_each]
        dr.eval(sums)
        return np.stack([np.array(one).T for one in sums], axis=1)
    dr.eval(L, group)
    of_lane, light = np.array(group).astype(np.int64), np.array(L).T
    out = np.zeros((len(of_lane) // lanes * groups, 3))
    lit = np.flatnonzero(of_lane < groups)
    at = lit // lanes * groups + of_lane[lit]
    for channel in range(3):
        out[:, channel] = np.bincount(at, light[lit, channel], len(out))
    return out.reshape(-1, groups, 3)
