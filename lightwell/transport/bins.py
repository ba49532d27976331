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
# Places are looked at from this far above their surface, in cells; what is looked up is that far, so that it sees its
# own surface only where that bends.
LIFT, LIFT_OF_MET = 0.1, 1e-3
# What sees none of them so, because a curved surface hides them, is looked up once more from this far above, at places
# that are as far above theirs. In white rooms a few per cent that are lost at each bounce are half of the light; from
# 0.3 of a cell dark rooms of a house leak.
LIFT_OVER = 0.12
# Bins that the places of a cell make at most, and places that are tried for what is looked up.
MOST_PARTS, TRIES = 4, 3
# How much farther a place is off its plane than along it, and how far off, in cells, it belongs to no bin: a layer that
# is hidden behind those that were found, and dark.
OFF_PLANE, DEEPEST = 8.0, 0.3
# Sides of a cell: two for each axis.
SIDES = 6


@dataclass(frozen=True)
class Bins:
    """F bins with places in each."""

    low: np.ndarray
    """[3] corner of the lattice."""
    edge: float
    """Edge of a cell, metres."""
    shape: tuple[int, int, int]
    """Cells along x, y, z."""
    table: np.ndarray
    """[cells * SIDES] int32 number (below S) of each cell and side that has places; S for all others."""
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
        return len(self.place)

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

    def lookup(self, scene: mi.Scene, p: Any, n: Any) -> mi.UInt32:
        """Find the bins of places on the device: those of the nearest place of the same cell that is in sight.

        A cell may reach through a wall. Light of its other side would be most of what a dark room has.

        Args:
            scene: The scene, whose surfaces hide places from each other.
            p: [N] places, metres.
            n: [N] unit normals.

        Returns:
            Number of the bin of each place; F where there is none.
        """
        p, n, found = mi.Vector3f(p), mi.Vector3f(n), self._cell(p, n)
        valid = found < len(self.owner)
        bin_of, wanted, last = mi.UInt32(self.count), mi.Bool(valid), mi.Float(-1)
        first = None
        for _ in range(TRIES):
            nearest, last, depth = self._next_site(p, found, valid, last)
            wanted &= dr.isfinite(last)
            near = depth < DEEPEST * self.edge
            first = first or (nearest, wanted & near)
            bin_of, wanted = self._taken(scene, (p, n), nearest, wanted & near, (LIFT_OF_MET, LIFT), bin_of, wanted)
        assert first is not None
        nearest, near = first
        # Nothing may stand on the way up either.
        free = ~self._blocked(scene, p + n * (LIFT_OF_MET * self.edge), n * (LIFT_OVER * self.edge), wanted & near)
        over = (LIFT_OVER, LIFT_OVER)
        return self._taken(scene, (p, n), nearest, wanted & near & free, over, bin_of, wanted)[0]

    def _taken(
        self, scene: mi.Scene, met: tuple[Any, Any], site: Any, active: Any, lifts: tuple[float, float], *state: Any
    ) -> tuple[Any, Any]:
        """(bins, what still wants one) after a look from places to sites, each so many cells above its surface."""
        _, _, _, sites, site_normals, owner = self._device
        (p, n), (bin_of, wanted) = met, state
        place = dr.gather(mi.Vector3f, sites, site, active)
        place += dr.gather(mi.Vector3f, site_normals, site, active) * (lifts[1] * self.edge)
        origin = p + n * (lifts[0] * self.edge)
        seen = active & ~self._blocked(scene, origin, place - origin, active)
        return dr.select(seen, dr.gather(mi.UInt32, owner, site, seen), bin_of), wanted & ~seen

    def _blocked(self, scene: mi.Scene, origin: Any, way: Any, active: Any) -> Any:
        """[N] whether something stands between places and places that are ``way`` farther."""
        ray = mi.Ray3f(mi.Point3f(origin), way)
        ray.maxt = 1
        return scene.ray_test(ray, active)

    def _cell(self, p: mi.Vector3f, n: mi.Vector3f) -> mi.UInt32:
        """Number of the cell and side of places."""
        table = self._device[0]
        cells = [
            mi.UInt32(dr.clip((x - float(low)) / self.edge, 0, size - 1))
            for x, low, size in zip(p, self.low, self.shape)
        ]
        a = dr.abs(n)
        axis = dr.select((a.x >= a.y) & (a.x >= a.z), mi.UInt32(0), dr.select(a.y >= a.z, mi.UInt32(1), mi.UInt32(2)))
        along = dr.select(axis == 0, n.x, dr.select(axis == 1, n.y, n.z))
        side = 2 * axis + dr.select(along < 0, mi.UInt32(1), mi.UInt32(0))
        cell = (cells[0] * self.shape[1] + cells[1]) * self.shape[2] + cells[2]
        return dr.gather(mi.UInt32, table, cell * SIDES + side)

    def _next_site(self, p: mi.Vector3f, found: mi.UInt32, valid: mi.Bool, last: mi.Float) -> tuple[Any, Any, Any]:
        """(index, distance², distance off its plane) of the nearest place of a cell that is farther than ``last``."""
        _, _, _, sites, site_normals, _ = self._device
        nearest, least, depth = found * PLACES, mi.Float(dr.inf), mi.Float(dr.inf)
        for k in range(PLACES):
            at = found * PLACES + k
            way = dr.gather(mi.Vector3f, sites, at, valid) - p
            # Layers of a wall lie behind each other: off its plane a place is farther than it is.
            off = dr.abs(dr.dot(dr.gather(mi.Vector3f, site_normals, at, valid), way))
            distance = dr.squared_norm(way) + dr.square(OFF_PLANE * off)
            nearer = (distance < least) & (distance > last)
            nearest, depth = dr.select(nearer, at, nearest), dr.select(nearer, off, depth)
            least = dr.select(nearer, distance, least)
        return nearest, least, depth

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

    def places_of_all(self, count: int, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Choose random places of every bin.

        Args:
            count: Places per bin.
            random: Source of random numbers.

        Returns:
            [F * count, 3] places, bin by bin, and their normals.
        """
        bins, which = np.arange(self.count).repeat(count), random.integers(PLACES, size=self.count * count)
        return self.place[bins, which].astype(np.float64), self.normal[bins, which].astype(np.float64)


def find_bins(position: np.ndarray, normal: np.ndarray, wanted: int, random: np.random.Generator) -> Bins:
    """Group places on surfaces into bins: cells of a lattice, by the axis that the surface faces.

    Args:
        position: [H, 3] places, metres.
        normal: [H, 3] unit normals.
        wanted: Bins to aim at.
        random: Source of random numbers.

    Returns:
        The bins.
    """
    low, high = np.quantile(position, [TAIL, 1 - TAIL], axis=0)
    margin = MARGIN * float((high - low).max()) + 1e-6
    low, high = low - margin, high + margin
    side = _sides(normal)
    edge = _edge(position, side, low, high, wanted)
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
    return Bins(low, float(edge), shape, table, place, normals, place, normals, owner)


Sight = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""(places [K, 3], places [K, 3]) → [K] whether nothing stands between them."""


def parted(bins: Bins, sight: Sight) -> Bins:
    """Cut bins where a wall stands between their places, so that light of one side does not leak to the other.

    Args:
        bins: The bins, one in each cell.
        sight: Tests whether places see each other.

    Returns:
        The new bins: up to ``MOST_PARTS`` in a cell, the last of which takes all places that are left.
    """
    part = _parts(bins.sites + LIFT * bins.edge * bins.site_normals, sight)
    cell, of_cell = np.nonzero(np.stack([(part == k).any(axis=1) for k in range(MOST_PARTS)], axis=1))
    number = np.zeros((len(part), MOST_PARTS), np.int64)
    number[cell, of_cell] = np.arange(len(cell))
    chosen = _only(part[cell] == of_cell[:, None])[..., None]
    place, normal = (np.take_along_axis(a[cell], chosen, 1) for a in (bins.sites, bins.site_normals))
    return replace(bins, place=place, normal=normal, owner=np.take_along_axis(number, part, 1))


def _parts(lifted: np.ndarray, sight: Sight) -> np.ndarray:
    """[S, PLACES] part of its cell that each place belongs to: those that the first place of a part sees."""
    part = np.full(lifted.shape[:2], -1)
    for k in range(MOST_PARTS):
        rest = part < 0
        cells = np.flatnonzero(rest.any(axis=1))
        if not len(cells):
            break
        leader = rest[cells].argmax(axis=1)
        first = np.repeat(lifted[cells, leader][:, None], PLACES, axis=1)
        seen = sight(first.reshape(-1, 3), lifted[cells].reshape(-1, 3)).reshape(-1, PLACES)
        seen[np.arange(len(cells)), leader] = True
        part[cells] = np.where(rest[cells] & (seen | (k == MOST_PARTS - 1)), k, part[cells])
    return part


def _only(mask: np.ndarray) -> np.ndarray:
    """[R, PLACES] indices of the True columns of each row, repeated."""
    order = np.argsort(~mask, axis=1, kind="stable")
    return np.take_along_axis(order, np.arange(PLACES)[None] % np.maximum(mask.sum(axis=1), 1)[:, None], axis=1)


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
