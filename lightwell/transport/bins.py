"""Bins of surface: cells of a lattice, by the axis that the surface faces, found from places that rays have met."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from lightwell.backend import dr, mi, upload_integers
from lightwell.transport.interactions import upload

# The lattice covers the middle of the places along each axis: all but this share at each end, and a margin of the rest.
TAIL, MARGIN = 0.002, 0.01
# Cells of the whole lattice at most, and halvings of the search for the edge of a cell.
MOST_CELLS, HALVINGS = 1 << 22, 24
# A bin has this many places at least when it is found ...
FEWEST = 2
# ... and keeps this many at most.
PLACES = 8
# Edge of a coarse cell, in cells, at most.
COARSEST = 16
# Places are looked at from this far above their surface, in cells, and coarse bins are cut this often.
LIFT, COARSE_CUTS = 0.1, 2
# How much farther a place is off its plane than along it, and how far off, in cells, it belongs to no bin: a layer that
# is hidden behind those that were found, and dark.
OFF_PLANE, DEEPEST = 8.0, 0.3
# Sides of a cell: two for each axis.
SIDES = 6


@dataclass(frozen=True)
class Bins:
    """F bins with places in each, and the coarse bin that each belongs to."""

    low: np.ndarray
    """[3] corner of the lattice."""
    edge: float
    """Edge of a cell, metres."""
    shape: tuple[int, int, int]
    """Cells along x, y, z."""
    table: np.ndarray
    """[cells * SIDES] int32 number (below S) of each cell and side that has places; S for all others."""
    coarse: np.ndarray
    """[F] coarse bin."""
    place: np.ndarray
    """[F, PLACES, 3] places in each bin, repeated where there are fewer."""
    normal: np.ndarray
    """[F, PLACES, 3] unit normals there, on the side of the bin."""
    sites: np.ndarray
    """[S, PLACES, 3] places in each cell of the table: the nearest one decides the bin."""
    site_normals: np.ndarray
    """[S, PLACES, 3] normals there."""
    owner: np.ndarray
    """[S, PLACES] bin of each of these."""

    @property
    def count(self) -> int:
        """F."""
        return len(self.coarse)

    @property
    def coarse_count(self) -> int:
        """C."""
        return int(self.coarse.max()) + 1

    def arrays(self) -> dict[str, np.ndarray]:
        """Return the bins as arrays, for other machines.

        Returns:
            Arrays by name, of any shape.
        """
        return {f.name: np.asarray(getattr(self, f.name)) for f in fields(self)}

    @staticmethod
    def of(arrays: Mapping[str, np.ndarray]) -> Bins:
        """Make the bins of arrays.

        Args:
            arrays: Result of ``arrays``, of any shape [...].

        Returns:
            The bins.
        """
        exact = {"edge": float(arrays["edge"]), "shape": tuple(int(n) for n in arrays["shape"])}
        return Bins(**{**arrays, **exact})

    @cached_property
    def _device(self):
        table = upload_integers(self.table)
        places, normals, *sites = (
            upload(mi.Vector3f, a.reshape(-1, 3)) for a in (self.place, self.normal, self.sites, self.site_normals)
        )
        return table, places, normals, *sites, upload_integers(self.owner.ravel())

    def lookup(self, p: Any, n: Any) -> mi.UInt32:
        """Find the bins of places on the device.

        Args:
            p: [N] places, metres.
            n: [N] unit normals.

        Returns:
            Number of the bin of each place; F where there is none.
        """
        table, _, _, sites, site_normals, owner = self._device
        cells = [
            mi.UInt32(dr.clip((x - float(low)) / self.edge, 0, size - 1))
            for x, low, size in zip(p, self.low, self.shape)
        ]
        a = dr.abs(n)
        axis = dr.select((a.x >= a.y) & (a.x >= a.z), mi.UInt32(0), dr.select(a.y >= a.z, mi.UInt32(1), mi.UInt32(2)))
        along = dr.select(axis == 0, n.x, dr.select(axis == 1, n.y, n.z))
        side = 2 * axis + dr.select(along < 0, mi.UInt32(1), mi.UInt32(0))
        cell = (cells[0] * self.shape[1] + cells[1]) * self.shape[2] + cells[2]
        found = dr.gather(mi.UInt32, table, cell * SIDES + side)
        valid = found < len(self.owner)
        nearest, least, depth = found * PLACES, mi.Float(dr.inf), mi.Float(dr.inf)
        for k in range(PLACES):
            at = found * PLACES + k
            way = dr.gather(mi.Vector3f, sites, at, valid) - p
            # Layers of a wall lie behind each other: off its plane a place is farther than it is.
            off = dr.abs(dr.dot(dr.gather(mi.Vector3f, site_normals, at, valid), way))
            distance = dr.squared_norm(way) + dr.square(OFF_PLANE * off)
            nearer = distance < least
            nearest, depth = dr.select(nearer, at, nearest), dr.select(nearer, off, depth)
            least = dr.minimum(least, distance)
        valid &= depth < DEEPEST * self.edge
        return dr.select(valid, dr.gather(mi.UInt32, owner, nearest, valid), self.count)

    def random_place(self, index: mi.UInt32, rng: Any) -> tuple[mi.Vector3f, mi.Vector3f]:
        """Choose a random place of each bin.

        Args:
            index: [N] bins.
            rng: Random streams of the lanes.

        Returns:
            Places and unit normals.
        """
        places, normals = self._device[1:3]
        at = index * PLACES + dr.minimum(mi.UInt32(rng.next_float32() * PLACES), PLACES - 1)
        return dr.gather(mi.Vector3f, places, at), dr.gather(mi.Vector3f, normals, at)

    def places_of_coarse(self, count: int, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Choose random places of the coarse bins.

        Args:
            count: Places per coarse bin.
            random: Source of random numbers.

        Returns:
            [C * count, 3] places, bin by bin, and their normals.
        """
        order = np.argsort(self.coarse, kind="stable")
        first = np.searchsorted(self.coarse[order], np.arange(self.coarse_count + 1))
        size = np.diff(first)
        pick = first[:-1, None] + (random.random((self.coarse_count, count)) * size[:, None]).astype(int)
        bins, which = order[pick.ravel()], random.integers(PLACES, size=pick.size)
        return self.place[bins, which].astype(np.float64), self.normal[bins, which].astype(np.float64)


def find_bins(position: np.ndarray, normal: np.ndarray, fine: int, coarse: int, random: np.random.Generator) -> Bins:
    """Group places on surfaces into bins: cells of a lattice, by the axis that the surface faces.

    Args:
        position: [H, 3] places, metres.
        normal: [H, 3] unit normals.
        fine: Bins to aim at.
        coarse: Coarse bins to aim at.
        random: Source of random numbers.

    Returns:
        The bins.
    """
    low, high = np.quantile(position, [TAIL, 1 - TAIL], axis=0)
    margin = MARGIN * float((high - low).max()) + 1e-6
    low, high = low - margin, high + margin
    side = _sides(normal)
    edge = _edge(position, side, low, high, fine)
    shape = tuple(int(v) for v in np.maximum(np.ceil((high - low) / edge), 1))
    cells = _cells(position, low, edge, shape)
    key = _key(cells, shape, side)
    kinds, inverse, count = np.unique(key, return_inverse=True, return_counts=True)
    kept = count >= FEWEST
    number = np.where(kept, np.cumsum(kept) - 1, kept.sum()).astype(np.int64)
    table = np.full(int(np.prod(shape)) * SIDES, kept.sum(), np.int32)
    table[kinds] = number
    place, normals = _places(position, normal, number[inverse], int(kept.sum()), random)
    owner = np.repeat(np.arange(len(place))[:, None], PLACES, axis=1)
    return Bins(
        low, float(edge), shape, table, _coarse(kinds[kept], shape, coarse), place, normals, place, normals, owner
    )


Sight = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""(places [K, 3], places [K, 3]) → [K] whether nothing stands between them."""


def parted(bins: Bins, sight: Sight) -> Bins:
    """Cut bins in two where a wall stands between their places, so that light of one side does not leak to the other.

    Args:
        bins: The bins; coarse ones are cut in up to four.
        sight: Tests whether places see each other.

    Returns:
        The new bins.
    """
    lifted = bins.place + LIFT * bins.edge * bins.normal
    first = np.repeat(lifted[:, :1], PLACES, axis=1)
    behind = ~sight(first.reshape(-1, 3), lifted.reshape(-1, 3)).reshape(-1, PLACES)
    behind[:, 0] = False
    cut = np.flatnonzero(behind.any(axis=1))
    owner = bins.owner.copy()
    owner[cut] = np.where(behind[cut], (bins.count + np.arange(len(cut)))[:, None], owner[cut])
    front, back = _only(~behind), _only(behind[cut])
    take = lambda a: np.concatenate(  # noqa: E731
        [np.take_along_axis(a, front[..., None], 1), np.take_along_axis(a[cut], back[..., None], 1)]
    )
    place, normal = take(bins.place), take(bins.normal)
    coarse = np.concatenate([bins.coarse, bins.coarse[cut]])
    for _ in range(COARSE_CUTS):
        coarse = _cut_coarse(coarse, place[:, 0] + LIFT * bins.edge * normal[:, 0], sight)
    return replace(bins, place=place, normal=normal, owner=owner, coarse=coarse)


def _only(mask: np.ndarray) -> np.ndarray:
    """[R, PLACES] indices of the True columns of each row, repeated."""
    order = np.argsort(~mask, axis=1, kind="stable")
    return np.take_along_axis(order, np.arange(PLACES)[None] % np.maximum(mask.sum(axis=1), 1)[:, None], axis=1)


def _cut_coarse(coarse: np.ndarray, place: np.ndarray, sight: Sight) -> np.ndarray:
    """Coarse bins of which those that the first bin of a coarse bin does not see make another one."""
    _, first = np.unique(coarse, return_index=True)
    behind = ~sight(place[first[coarse]], place)
    behind[first] = False
    number = coarse + behind * (int(coarse.max()) + 1)
    return np.unique(number, return_inverse=True)[1]


def _sides(normal: np.ndarray) -> np.ndarray:
    """[H] which way a surface faces: twice the axis, plus one when it looks down the axis."""
    axis = np.argmax(np.abs(normal), axis=1)
    return 2 * axis + (np.take_along_axis(normal, axis[:, None], axis=1)[:, 0] < 0)


def _cells(position: np.ndarray, low: np.ndarray, edge: float, shape: tuple[int, ...]) -> np.ndarray:
    return np.clip((position - low) / edge, 0, np.array(shape) - 1).astype(np.int64)


def _key(cells: np.ndarray, shape: tuple[int, ...], side: np.ndarray) -> np.ndarray:
    return ((cells[:, 0] * shape[1] + cells[:, 1]) * shape[2] + cells[:, 2]) * SIDES + side


def _edge(position: np.ndarray, side: np.ndarray, low: np.ndarray, high: np.ndarray, wanted: int) -> float:
    """Edge of a cell that makes about ``wanted`` bins."""
    size = high - low
    least = max((float(np.prod(size)) / MOST_CELLS) ** (1 / 3), float(size.max()) / 4096)
    small, large = least, float(size.max())
    for _ in range(HALVINGS):
        middle = (small * large) ** 0.5
        shape = tuple(int(v) for v in np.maximum(np.ceil(size / middle), 1))
        _, count = np.unique(_key(_cells(position, low, middle, shape), shape, side), return_counts=True)
        small, large = (middle, large) if (count >= FEWEST).sum() > wanted else (small, middle)
        if large / small < 1.02:
            break
    return large


def _coarse(keys: np.ndarray, shape: tuple[int, ...], wanted: int) -> np.ndarray:
    """[F] coarse bin of each bin: several cells of one side together, about ``wanted`` of them."""
    side, cell = keys % SIDES, keys // SIDES
    cells = np.stack([cell // (shape[1] * shape[2]), cell // shape[2] % shape[1], cell % shape[2]], axis=1)
    for width in range(2, COARSEST + 1):
        wide = tuple(-(-n // width) for n in shape)
        kinds, number = np.unique(_key(cells // width, wide, side), return_inverse=True)
        if len(kinds) <= wanted:
            break
    return number


def _places(
    position: np.ndarray, normal: np.ndarray, number: np.ndarray, count: int, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """[count, PLACES, 3] random places of each bin and their normals; ``number`` [H] is the bin of every place."""
    order = random.permutation(len(number))
    order = order[np.argsort(number[order], kind="stable")]
    first = np.searchsorted(number[order], np.arange(count + 1))
    have = np.diff(first)
    rows = order[first[:-1, None] + np.arange(PLACES) % np.maximum(have, 1)[:, None]]
    return position[rows].astype(np.float32), normal[rows].astype(np.float32)
