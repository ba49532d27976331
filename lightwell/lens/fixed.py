"""Deterministic scatter in 32-bit integers: the same bytes on every run, thread count and machine.

WebGPU uses the same arithmetic, because its atomics are integers. format/LENS.md defines it bit by bit; in short:

* One step of the image is 2⁻¹⁶ of white. A pixel's light times its record's scale is u steps per unit of q.
* The pixel's four channels share a shift b, so that m = round(u · 2ᵇ) fits 16 bits: products m · q fit 31.
* The remainder is carried along the points of a spreadlet: t = m·q + e, n = t >> b, e = t − (n << b), beginning with
  e = 2ᵇ⁻¹. Σ q = 0 makes Σ m·q = 0, so that the written values sum to exactly zero in every channel.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.lens.splat import Frame, Planes, Points, Sources, plane_starts, reduce_mode, separate

# Steps per white, bits of a mantissa, largest shift, and bits of turns and of bilinear weights.
STEP_BITS, MANTISSA_BITS, MOST_SHIFT, TURN_BITS, WEIGHT_BITS = 16, 15, 29, 14, 8
# Largest light in multiples of white; brighter light is clamped, and counted by ``mantissas``.
BRIGHTEST = 16384.0


def mantissas(rgba: np.ndarray, scale: np.ndarray, white: float = 1.0) -> tuple[np.ndarray, np.ndarray, int]:
    """Convert light to shared-exponent integers.

    Args:
        rgba: Light [n, 4].
        scale: Scale of each source's record [n].
        white: Scene-referred value that is displayed as white, > 0.

    Returns:
        m [n, 4] int32, shifts b [n] int32, and the number of sources that were cut at ``BRIGHTEST``.
    """
    light = np.asarray(rgba, np.float64) / white
    cut = np.abs(light).max(1, initial=0) > BRIGHTEST
    u = np.clip(light, -BRIGHTEST, BRIGHTEST) * np.asarray(scale, np.float64)[:, None] * 2.0**STEP_BITS
    largest = np.abs(u).max(1, initial=0)
    _, exponent = np.frexp(largest)
    shift = np.clip(MANTISSA_BITS - exponent, 0, MOST_SHIFT).astype(np.int32)
    m = np.rint(u * np.exp2(shift)[:, None])
    limit = 2**MANTISSA_BITS - 1
    return np.clip(m, -limit, limit).astype(np.int32), shift, int(cut.sum())


@dr.syntax
def _whole(
    target: Any, base: Any, m: Any, shift: Any, k: Any, end: Any, sign: Any, delta: Any, q: Any, mode: Any
) -> None:
    """Scatter points at integer offsets."""
    e = mi.Vector4i((mi.Int32(1) << shift) >> 1)
    while k < end:
        step, weight = dr.gather(mi.Int32, delta, k), dr.gather(mi.Int32, q, k)
        t = m * weight + e
        n = t >> shift
        e = t - (n << shift)
        dr.scatter_add(target, n, mi.UInt32(base + sign * step), mode=mode)
        k += 1


@dr.syntax
def _turned(
    target: Any, x: Any, y: Any, base: Any, width: Any, m: Any, shift: Any, k: Any, end: Any,
    c: Any, s: Any, px: Any, py: Any, q: Any, mode: Any,
) -> None:  # fmt: skip
    """Scatter rotated points: positions in 2⁻¹⁴ pixels, four writes each with 8-bit bilinear weights."""
    e = mi.Vector4i((mi.Int32(1) << shift) >> 1)
    while k < end:
        dx, dy = dr.gather(mi.Int32, px, k), dr.gather(mi.Int32, py, k)
        weight = dr.gather(mi.Int32, q, k)
        t = m * weight + e
        n = t >> shift
        e = t - (n << shift)
        at_x, at_y = x + c * dx - s * dy, y + s * dx + c * dy
        index = mi.UInt32(base + (at_y >> 14) * width + (at_x >> 14))
        fx, fy = (at_x >> 6) & 255, (at_y >> 6) & 255
        lower = _share(n, fy)
        upper = n - lower
        right = _share(upper, fx)
        dr.scatter_add(target, upper - right, index, mode=mode)
        dr.scatter_add(target, right, index + 1, mode=mode)
        right = _share(lower, fx)
        dr.scatter_add(target, lower - right, index + width, mode=mode)
        dr.scatter_add(target, right, index + width + 1, mode=mode)
        k += 1


def _share(n: Any, weight: Any) -> Any:
    """Compute ⌊n·weight/256⌉ within 32 bits; the other share is the rest of n, so that no light is lost."""
    return (n >> 8) * weight + (((n & 255) * weight + 128) >> 8)


def scatter(frame: Frame, points: Points, sources: Sources, white: float = 1.0) -> Planes:
    """Scatter all sources in integers.

    Args:
        frame: Size of the picture and its guard band.
        points: Points of all records.
        sources: What is scattered.
        white: Scene-referred value that is displayed as white, > 0.

    Returns:
        Picture and charges [H, W, 4] int32, in steps of 2⁻¹⁶ of white.
    """
    height, width = frame.padded
    starts, planes = plane_starts(points, height * width)
    target = dr.zeros(mi.Int32, planes * height * width * 4)
    if len(sources.x):
        mode = reduce_mode(len(target))
        record = sources.record
        k, end = mi.UInt32(points.first[record]), mi.UInt32(points.first[record] + points.count[record])
        plane = starts[record]
        m, shift, _ = mantissas(sources.rgba, points.scale[record], white)
        m = dr.unravel(mi.Vector4i, mi.Int32(m.ravel()))
        b, q = mi.Int32(shift), mi.Int32(points.q.astype(np.int32))
        if sources.sine is None:
            base = plane + (sources.y + frame.guard) * width + sources.x + frame.guard
            delta = np.rint(points.y * width + points.x).astype(np.int32)
            sign = mi.Int32(np.rint(sources.cosine).astype(np.int32))
            _whole(target, mi.Int32(base.astype(np.int32)), m, b, k, end, sign, mi.Int32(delta), q, mode)
        else:
            half = 1 << (TURN_BITS - WEIGHT_BITS - 1)
            x, y = (
                mi.Int32(np.rint((v + frame.guard) * 2.0**TURN_BITS).astype(np.int32) + half)
                for v in (sources.x.astype(np.float64), sources.y.astype(np.float64))
            )
            turn = (mi.Int32(np.rint(v * 2.0**TURN_BITS).astype(np.int32)) for v in (sources.cosine, sources.sine))
            shape = (mi.Int32(np.rint(v).astype(np.int32)) for v in (points.x, points.y))
            _turned(target, x, y, mi.Int32(plane), mi.Int32(width), m, b, k, end, *turn, *shape, q, mode)
        dr.eval(target)
    return separate(points, np.array(target).reshape(planes, height, width, 4))


def splat(frame: Frame, points: Points, sources: Sources, white: float = 1.0) -> Planes:
    """Scatter all sources in integers and convert to float32; otherwise like ``lightwell.lens.splat.splat``.

    Args:
        frame: Size of the picture and its guard band.
        points: Points of all records.
        sources: What is scattered.
        white: Scene-referred value that is displayed as white, > 0.

    Returns:
        Picture and charges [H, W, 4] float32.
    """
    step = np.float32(white * 2.0**-STEP_BITS)
    both = scatter(frame, points, sources, white)
    return Planes(*(None if p is None else p.astype(np.float32) * step for p in (both.picture, both.charges)))


def scatter_reference(frame: Frame, points: Points, sources: Sources, white: float = 1.0) -> Planes:
    """Scatter one source after the other in NumPy: the reference implementation, equal to ``scatter`` bit for bit.

    Args:
        frame: Size of the picture and its guard band.
        points: Points of all records.
        sources: What is scattered.
        white: Scene-referred value that is displayed as white, > 0.

    Returns:
        Picture and charges [H, W, 4] int32, in steps of 2⁻¹⁶ of white.
    """
    image = np.zeros((2, *frame.padded, 4), np.int64)
    m, shift, _ = mantissas(sources.rgba, points.scale[sources.record], white)
    for i, record in enumerate(sources.record):
        mine = slice(points.first[record], points.first[record] + points.count[record])
        total = np.cumsum(m[i].astype(np.int64) * points.q[mine, None].astype(np.int64), 0)
        steps = np.diff((total + ((1 << int(shift[i])) >> 1)) >> int(shift[i]), axis=0, prepend=0)
        dx, dy = (np.rint(v[mine]).astype(np.int64) for v in (points.x, points.y))
        plane = image[points.plane[record]]
        if sources.sine is None:
            sign = round(float(sources.cosine[i]))
            np.add.at(plane, (sources.y[i] + frame.guard + sign * dy, sources.x[i] + frame.guard + sign * dx), steps)
            continue
        c, s = (int(np.rint(np.float64(v[i]) * 2.0**TURN_BITS)) for v in (sources.cosine, sources.sine))
        x, y = (int(np.rint((np.float64(v[i]) + frame.guard) * 2.0**TURN_BITS)) + 32 for v in (sources.x, sources.y))
        at_x, at_y = x + c * dx - s * dy, y + s * dx + c * dy
        lower = _share(steps, ((at_y >> 6) & 255)[:, None])
        for row, part in ((0, steps - lower), (1, lower)):
            right = _share(part, ((at_x >> 6) & 255)[:, None])
            np.add.at(plane, ((at_y >> 14) + row, at_x >> 14), part - right)
            np.add.at(plane, ((at_y >> 14) + row, (at_x >> 14) + 1), right)
    return Planes(image[0].astype(np.int32), image[1].astype(np.int32))
