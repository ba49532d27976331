"""Many places on each bin, for light that varies within it: a lamp beside a wall is a bright spot on a part of a bin.

They are where rays from seen points meet the bins: what a point receives from a bin is a mean over such places.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lightwell.backend import dr, mi, upload_integers
from lightwell.transport.bins import Bins
from lightwell.transport.interactions import upload

# Places that are looked up at a time; bounds memory.
AT_ONCE = 1 << 18


@dataclass(frozen=True)
class BinPlaces:
    """H places of F bins, bin by bin."""

    first: np.ndarray
    """[F + 1] number of the first place of each bin; every bin has one at least."""
    place: np.ndarray
    """[H, 3] float32, metres."""
    normal: np.ndarray
    """[H, 3] float32 unit normals."""

    @staticmethod
    def of(scene: mi.Scene, bins: Bins, position: np.ndarray, normal: np.ndarray) -> BinPlaces:
        """Sort places by bin.

        Args:
            scene: Mitsuba scene.
            bins: The bins; those that no place belongs to keep their own places.
            position: [N, 3] places on surfaces, metres, in random order.
            normal: [N, 3] unit normals there.

        Returns:
            The places.
        """
        of_place = np.empty(len(position), np.int64)
        for start in range(0, len(position), AT_ONCE):
            part = slice(start, start + AT_ONCE)
            p, n = (upload(mi.Vector3f, np.asarray(a[part], np.float32)) for a in (position, normal))
            of_place[part] = np.array(bins.lookup(scene, p, n))
        empty = np.flatnonzero(np.bincount(of_place, minlength=bins.count + 1)[: bins.count] == 0)
        bin_of = np.concatenate([of_place, empty.repeat(bins.place.shape[1])])
        order = np.argsort(bin_of, kind="stable")[: np.count_nonzero(bin_of < bins.count)]
        place = np.concatenate([position, bins.place[empty].reshape(-1, 3)])[order]
        normals = np.concatenate([normal, bins.normal[empty].reshape(-1, 3)])[order]
        first = np.searchsorted(bin_of[order], np.arange(bins.count + 1))
        return BinPlaces(first, place.astype(np.float32), normals.astype(np.float32))

    @cached_property
    def _device(self) -> tuple[mi.UInt32, mi.Vector3f, mi.Vector3f]:
        first = upload_integers(self.first.astype(np.uint32))
        return first, upload(mi.Vector3f, self.place), upload(mi.Vector3f, self.normal)

    def spread(self, index: mi.UInt32, k: mi.UInt32, count: int) -> tuple[mi.Vector3f, mi.Vector3f]:
        """Choose one of several places of each bin that are as different as possible.

        Args:
            index: [N] bins.
            k: [N] numbers below ``count``.
            count: Places that are chosen in each bin.

        Returns:
            Places and unit normals.
        """
        first, place, normal = self._device
        start = dr.gather(mi.UInt32, first, index)
        # Lanes behind the last one, which fill up a vector, have no places: a division by 0 would end the process.
        have = dr.maximum(dr.gather(mi.UInt32, first, index + 1) - start, 1)
        at = start + dr.select(have < count, k % have, mi.UInt32(mi.Float(k) * mi.Float(have) / count))
        return dr.gather(mi.Vector3f, place, at), dr.gather(mi.Vector3f, normal, at)
