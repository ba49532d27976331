"""Scatter: every active pixel adds colour × its spreadlet's points to the charge image (Dr.Jit: LLVM or CUDA).

Primal points and charges go to two images [H, W, 4] with a guard band on all sides; a pixel's four channels are written
as one packet.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.backend import ACTIVE, dr, mi
from lightwell.lens.solve import smooth_size
from lightwell.lens.spreadlet import Spreadlet

# Most memory for copies of the target per thread on the CPU, bytes.
MOST_COPIES = 3 << 30


@dataclass(frozen=True)
class Points:
    """The points of all records of a frame, concatenated."""

    x: np.ndarray
    """[n] float32"""
    y: np.ndarray
    """[n] float32"""
    value: np.ndarray
    """[n] float32"""
    first: np.ndarray
    """[records] uint32: index of the record's first point."""
    count: np.ndarray
    """[records] uint32"""
    plane: np.ndarray
    """[records] uint32: 0 primal, 1 charge."""
    q: np.ndarray
    """[n] int16: value = q · scale of the record."""
    scale: np.ndarray
    """[records] float32"""

    @classmethod
    def of(cls, spreadlets: Sequence[Spreadlet]) -> Points:
        """Concatenate the points of spreadlets.

        Args:
            spreadlets: Spreadlets; record i is the i-th.

        Returns:
            The points.
        """
        count = np.array([len(s) for s in spreadlets], np.int64)

        def together(name: str, kind: type[np.generic]) -> np.ndarray:
            return np.concatenate([np.zeros(0, kind), *(getattr(s, name).astype(kind) for s in spreadlets)])

        return cls(
            together("x", np.float32),
            together("y", np.float32),
            together("values", np.float32),
            (np.cumsum(count) - count).astype(np.uint32),
            count.astype(np.uint32),
            np.array([s.kind for s in spreadlets], np.uint32),
            together("q", np.int16),
            np.array([s.scale for s in spreadlets], np.float32),
        )

    @property
    def reach(self) -> int:
        """Largest distance of a point from its source, rounded up, pixels."""
        return int(np.ceil(np.hypot(self.x, self.y).max())) if len(self.x) else 0


@dataclass(frozen=True)
class Planes:
    """Result of a scatter; a plane that no record writes to is None, because clearing and adding one costs time."""

    picture: np.ndarray | None
    """[H, W, 4]: primal points."""
    charges: np.ndarray | None
    """[H, W, 4]: −Δ of the rest of the picture."""

    def __add__(self, other: Planes) -> Planes:
        both = ((getattr(self, n), getattr(other, n)) for n in ("picture", "charges"))
        return Planes(*(a if b is None else b if a is None else a + b for a, b in both))


@dataclass(frozen=True)
class Sources:
    """What is scattered: one row per active pixel or sample."""

    x: np.ndarray
    """[n] int32, or float32 where centres lie between pixels (only with turning)."""
    y: np.ndarray
    """[n]"""
    rgba: np.ndarray
    """[n, 4] float32"""
    record: np.ndarray
    """[n] uint32"""
    cosine: np.ndarray
    """[n] float32: of the turn; −1 mirrors."""
    sine: np.ndarray | None
    """[n] float32, or None where nothing is turned by other than 0 or half a turn."""


@dataclass(frozen=True)
class Frame:
    """Size of the picture and of the guard band around it."""

    height: int
    width: int
    guard: int

    @property
    def padded(self) -> tuple[int, int]:
        """Height and width with the guard band on all sides, rounded up to fast transform sizes."""
        return smooth_size(self.height + 2 * self.guard), smooth_size(self.width + 2 * self.guard)

    def crop(self, image: np.ndarray) -> np.ndarray:
        """Remove the guard band.

        Args:
            image: Padded image [..., H, W].

        Returns:
            View [..., height, width].
        """
        g = self.guard
        return image[..., g : g + self.height, g : g + self.width]


def guard_for(points: Points, turned: bool) -> int:
    """Compute the width of the guard band: the largest offset plus one, plus one more for bilinear writes.

    Args:
        points: Points of all records.
        turned: Whether points are rotated, which makes their writes bilinear.

    Returns:
        Width, pixels.
    """
    return points.reach + 1 + int(turned)


def reduce_mode(size: int) -> Any:
    """Choose how scatters are added: copies per thread on the CPU while they fit into memory, atomics elsewhere.

    Args:
        size: Number of float32 values of the target.

    Returns:
        A ``drjit.ReduceMode``.
    """
    if ACTIVE.variant.startswith("cuda"):
        return dr.ReduceMode.Direct
    return dr.ReduceMode.Expand if size * 4 * ACTIVE.threads <= MOST_COPIES else dr.ReduceMode.Auto


@dr.syntax
def _scatter_whole(target: Any, base: Any, rgba: Any, k: Any, end: Any, sign: Any, pairs: Any, mode: Any) -> None:
    """Scatter at integer offsets: one write per point, two points per iteration."""
    while k < end:
        pair = dr.gather(mi.Vector4f, pairs, k)
        one, other = (base + sign * dr.reinterpret_array(mi.Int32, step) for step in (pair.x, pair.z))
        dr.scatter_add(target, rgba * pair.y, mi.UInt32(one), mode=mode)
        dr.scatter_add(target, rgba * pair.w, mi.UInt32(other), mode=mode)
        k += 1


@dr.syntax
def _scatter_turned(
    target: Any, x: Any, y: Any, base: Any, width: Any, rgba: Any, k: Any, end: Any,
    c: Any, s: Any, px: Any, py: Any, value: Any, mode: Any,
) -> None:  # fmt: skip
    """Scatter at rotated offsets: a bilinear write to four pixels per point."""
    while k < end:
        dx, dy = dr.gather(mi.Float, px, k), dr.gather(mi.Float, py, k)
        v = dr.gather(mi.Float, value, k)
        at_x, at_y = x + c * dx - s * dy, y + s * dx + c * dy
        ix, iy = mi.Int32(dr.floor(at_x)), mi.Int32(dr.floor(at_y))
        fx, fy = at_x - mi.Float(ix), at_y - mi.Float(iy)
        index = mi.UInt32(base + iy * width + ix)
        upper, lower = rgba * (v * (1 - fy)), rgba * (v * fy)
        dr.scatter_add(target, upper * (1 - fx), index, mode=mode)
        dr.scatter_add(target, upper * fx, index + 1, mode=mode)
        dr.scatter_add(target, lower * (1 - fx), index + width, mode=mode)
        dr.scatter_add(target, lower * fx, index + width + 1, mode=mode)
        k += 1


def paired(points: Points, width: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Group points in pairs, because one vector gather per pair is a tenth faster than two per point.

    A pair is [4] float32: step in the buffer (the bits of an int32) and value of either point; a record of an odd
    number of points ends with a value of zero.

    Args:
        points: Points of all records.
        width: Width of the padded frame, pixels.

    Returns:
        Pairs as [2·pairs, 2] float32, and per record the first pair [records] uint32 and the one past its last.
    """
    halves = (points.count.astype(np.int64) + 1) // 2
    end = np.cumsum(halves)
    pairs = np.zeros((2 * int(end[-1]) if len(end) else 0, 2), np.float32)
    record = np.repeat(np.arange(len(halves)), points.count)
    place = np.arange(len(points.x)) - points.first[record] + 2 * (end - halves)[record]
    pairs[place, 0] = np.rint(points.y * width + points.x).astype(np.int32).view(np.float32)
    pairs[place, 1] = points.value
    return pairs, (end - halves).astype(np.uint32), end.astype(np.uint32)


def plane_starts(points: Points, size: int) -> tuple[np.ndarray, int]:
    """Place the planes in use in one buffer of pixels.

    Args:
        points: Points of all records.
        size: Pixels of one plane.

    Returns:
        First pixel of each record's plane [records] int32, and the number of planes.
    """
    used = np.unique(points.plane)
    return (np.searchsorted(used, points.plane) * size).astype(np.int32), len(used)


def separate(points: Points, buffer: np.ndarray) -> Planes:
    """Split a buffer into its planes.

    Args:
        points: Points of all records.
        buffer: Scattered values [planes, H, W, 4].

    Returns:
        The planes.
    """
    used = np.unique(points.plane).tolist()
    return Planes(*(buffer[used.index(kind)] if kind in used else None for kind in (0, 1)))


def splat(frame: Frame, points: Points, sources: Sources) -> Planes:
    """Scatter all sources in float32.

    Args:
        frame: Size of the picture and its guard band.
        points: Points of all records.
        sources: What is scattered.

    Returns:
        Picture and charges [H, W, 4] float32.
    """
    height, width = frame.padded
    starts, planes = plane_starts(points, height * width)
    target = dr.zeros(mi.Float, planes * height * width * 4)
    if len(sources.x):
        mode = reduce_mode(len(target))
        record = mi.UInt32(sources.record)
        plane = dr.gather(mi.Int32, mi.Int32(starts), record)
        rgba = dr.unravel(mi.Vector4f, mi.Float(np.ascontiguousarray(sources.rgba, np.float32).ravel()))
        if sources.sine is None:
            pairs, first, past = paired(points, width)
            k, end = (dr.gather(mi.UInt32, mi.UInt32(v), record) for v in (first, past))
            x, y = (mi.Int32(v.astype(np.int32, copy=False)) + frame.guard for v in (sources.x, sources.y))
            sign = mi.Int32(dr.round(mi.Float(sources.cosine)))
            _scatter_whole(target, plane + y * width + x, rgba, k, end, sign, mi.Float(pairs.ravel()), mode)
        else:
            k = dr.gather(mi.UInt32, mi.UInt32(points.first), record)
            end = k + dr.gather(mi.UInt32, mi.UInt32(points.count), record)
            x, y = (mi.Float((v + frame.guard).astype(np.float32)) for v in (sources.x, sources.y))
            turn = mi.Float(sources.cosine), mi.Float(sources.sine)
            shape = mi.Float(points.x), mi.Float(points.y), mi.Float(points.value)
            _scatter_turned(target, x, y, plane, mi.Int32(width), rgba, k, end, *turn, *shape, mode)
        dr.eval(target)
    return separate(points, target.numpy().reshape(planes, height, width, 4))
