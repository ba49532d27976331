"""From the slots of training paths to shuffled batches on the device."""

from __future__ import annotations

import functools
from typing import Any

from lightwell.backend import dr, mi
from lightwell.cache.draws import mixed
from lightwell.cache.features import stored
from lightwell.cache.model import Model
from lightwell.cache.recorded import Recorded


@dr.syntax
def permuted(i: mi.UInt32, count: mi.UInt32, bits: int, seed: mi.UInt32) -> mi.UInt32:
    """A permutation of 0 ... count - 1 for any count <= 2^bits: a bijection of bits-bit numbers, walked along
    its cycles until it lands below ``count`` (Black & Rogaway 2002)."""
    mask = mi.UInt32((1 << bits) - 1)
    half = max(bits // 2, 1)
    i = mi.UInt32(i)
    out = dr.full(mi.UInt32, 0, dr.width(i))
    walking = i < count
    while dr.hint(walking, label="lightwell nrc permutation"):
        # Each line is a bijection: adding, multiplying by an odd number, and xor with a shift of itself.
        for k in range(3):
            i = (i + mixed(seed + k)) & mask
            i = (i * (mixed(seed ^ (k + 11)) | 1)) & mask
            i = i ^ (i >> half)
        out = dr.select(i < count, i, out)
        walking &= i >= count
    return out


def compacted(valid: mi.Bool) -> tuple[mi.UInt32, mi.UInt32]:
    """Rows where ``valid``, in their order, in an array of the same length; and how many there are, on the device."""
    n = dr.width(valid)
    ones = dr.select(valid, mi.UInt32(1), mi.UInt32(0))
    before = dr.cumsum(ones) - ones
    rows = dr.zeros(mi.UInt32, n)
    dr.scatter(rows, dr.arange(mi.UInt32, n), before, valid)
    return rows, dr.sum(ones)


@functools.lru_cache(maxsize=64)
def frozen_batches(model: Model, size: int, bits: int) -> Any:
    """``packed_batches`` of one size, recorded once."""
    return Recorded(lambda *arrays: packed_batches(model, *arrays, size, bits))


def packed_batches(model: Model, features, targets, rows, count, seed, scale, size: int, bits: int):
    """``size`` shuffled records, weight 0 beyond the ``count`` there are.

    targets  [R * 4] radiance per slot. scale: radiance scale.
    returns  The fields of a ``Batch``.
    """
    lane = dr.arange(mi.UInt32, size)
    there = lane < count
    row = dr.gather(mi.UInt32, rows, permuted(lane, count, bits, seed), there)
    v = stored(features, row, there)
    t = dr.gather(mi.Vector4f, targets, row, there)
    y, learned = model.target(dr.maximum(mi.Color3f(t.x, t.y, t.z), 0), v, scale)
    learned = dr.select(there, learned, 0)
    K = model.direct_inputs
    direct = dr.empty(mi.Float, size * K)
    inputs = model.inputs(v)
    for k in range(0, K, 4):
        packet = dr.select(there, mi.Vector4f(*inputs[k : k + 4]), 0)
        dr.scatter(direct, packet, lane * (K // 4) + k // 4)
    out = []
    for value in (v.p, y, learned):
        flat = dr.empty(mi.Float, size * 3)
        for k in range(3):
            dr.scatter(flat, dr.select(there, value[k], 0), lane * 3 + k)
        out.append(mi.TensorXf(flat, (size, 3)))
    return mi.TensorXf(direct, (size, K)), *out


def usable(targets: mi.Float) -> tuple[mi.Bool, mi.Bool]:
    """Per slot: there is a finite record; there is one that is not finite."""
    t = dr.gather(mi.Vector4f, targets, dr.arange(mi.UInt32, dr.width(targets) // 4))
    finite = dr.isfinite(t.x) & dr.isfinite(t.y) & dr.isfinite(t.z)
    there: Any = t.w > 0
    return there & finite, there & ~finite
