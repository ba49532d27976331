"""Gather the records of training paths into shuffled batches on the device.

Notation: R slots for records, N rows of a batch, K network inputs that are computed and not looked up.
"""

from __future__ import annotations

import functools
from typing import Any

from lightwell.backend import dr, mi
from lightwell.cache.features import stored
from lightwell.cache.model import Model
from lightwell.cache.recorded import Recorded
from lightwell.cache.sobol_sampler import mixed


@dr.syntax
def permuted(i: mi.UInt32, count: mi.UInt32, bits: int, seed: mi.UInt32) -> mi.UInt32:
    """Permute the numbers 0 ... ``count`` - 1, for any ``count`` ≤ 2^``bits``.

    A bijection of ``bits``-bit numbers is iterated until its value is below ``count`` (cycle walking).

    Args:
        i: [N] numbers; values ≥ ``count`` give 0.
        count: How many numbers are permuted.
        bits: Width of the bijection in bits, ≥ 1.
        seed: Seed of the permutation.

    Returns:
        [N] permuted numbers, below ``count``.

    Reference: Black and Rogaway 2002, *Ciphers with Arbitrary Finite Domains*.
    """
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
    """List the indices at which a mask is true.

    Args:
        valid: [R] mask.

    Returns:
        [R] indices of the true entries in ascending order, then zeros; and the number of true entries, on the device.
    """
    n = dr.width(valid)
    ones = dr.select(valid, mi.UInt32(1), mi.UInt32(0))
    before = dr.cumsum(ones) - ones
    rows = dr.zeros(mi.UInt32, n)
    dr.scatter(rows, dr.arange(mi.UInt32, n), before, valid)
    return rows, dr.sum(ones)


@functools.lru_cache(maxsize=64)
def frozen_batches(model: Model, size: int, bits: int) -> Recorded:
    """Return ``packed_batches`` for one batch size as a function that is recorded once.

    Args:
        model: Network whose inputs and targets are packed.
        size: Rows of the batch, ≥ 1.
        bits: Width in bits of the largest slot index, ≥ 1.

    Returns:
        Function of (features, targets, rows, count, seed, scale) with the result of ``packed_batches``.
    """

    def run(
        features: mi.Float, targets: mi.Float, rows: mi.UInt32, count: mi.UInt32, seed: mi.UInt32, scale: mi.Float
    ) -> tuple[Any, Any, Any, Any]:
        return packed_batches(model, features, targets, rows, count, seed, scale, size, bits)

    return Recorded(run)


def packed_batches(
    model: Model, features: mi.Float, targets: mi.Float, rows: mi.UInt32, count: mi.UInt32, seed: mi.UInt32,
    scale: mi.Float, size: int, bits: int,
) -> tuple[Any, Any, Any, Any]:  # fmt: skip
    """Gather ``size`` records in random order; rows beyond the ``count`` existing records have weight 0.

    Args:
        model: Network whose inputs and targets are packed.
        features: [R * ``WIDTH``] vertices.
        targets: [R * 4] scattered radiance per slot; the fourth number is not used.
        rows: [R] indices of the slots that hold records, see ``compacted``.
        count: Number of records.
        seed: Seed of the order.
        scale: Radiance scale: the network's unit per unit of radiance.
        size: Rows of the batch.
        bits: Width in bits of the largest slot index.

    Returns:
        Fields of a ``Batch``: inputs [N, K], points [N, 3], targets [N, 3] and weights [N, 3].
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
    """Classify the slots of a frame.

    Args:
        targets: [R * 4] radiance and a flag above 0 where there is a record.

    Returns:
        Two [R] masks: slots with a finite record, slots with a record that is not finite.
    """
    t = dr.gather(mi.Vector4f, targets, dr.arange(mi.UInt32, dr.width(targets) // 4))
    finite = dr.isfinite(t.x) & dr.isfinite(t.y) & dr.isfinite(t.z)
    there: Any = t.w > 0
    return there & finite, there & ~finite
