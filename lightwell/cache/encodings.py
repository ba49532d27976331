"""Encodings of the network's inputs, one value per lane: the paper's triangle wave and one-blob, and the hash grid.

Müller et al. 2021 (triangle wave), Müller et al. 2019 (one-blob), Müller et al. 2022 (hash grid).
"""

from __future__ import annotations

from typing import Any

from lightwell.backend import dr, mi
from lightwell.graph.ops.hashgrid import PRIMES, Level

OCTAVES = 12
BLOBS = 4


def triangle_wave(x: mi.Float, octaves: int = OCTAVES) -> list[mi.Float]:
    """x in [0, 1] to one value in [-1, 1] per octave; octave l has period 2^(1-l)."""
    out = []
    for octave in range(octaves):
        v = x * 2.0 ** (octave - 1) + octave / 4
        out.append(4 * dr.abs(v - dr.floor(v) - 0.5) - 1)
    return out


def _step(d: mi.Float, k: int) -> mi.Float:
    """Integral of the quartic kernel of radius 1/k up to d."""
    u = d * k
    square = u * u
    value = 0.5 + 15 / 16 * u * (1 - square * (2 / 3) + square * square / 5)
    return dr.select(u <= -1, 0, dr.select(u >= 1, 1, dr.clip(value, 0, 1)))


def one_blob(x: mi.Float, k: int = BLOBS, periodic: bool = False) -> list[mi.Float]:
    """x in [0, 1] to the integrals over k bins of a kernel round x; they add up to one."""
    shifts = (-1, 0, 1) if periodic else (0,)
    bins = []
    for b in range(k):
        bins.append(sum(_step((b + 1) / k - x - s, k) - _step(b / k - x - s, k) for s in shifts))
    if periodic:
        return bins
    total = sum(bins)
    return [b / total for b in bins]


def spherical(d: mi.Vector3f) -> tuple[mi.Float, mi.Float]:
    """A unit vector to polar angle / pi and (azimuth + pi) / 2 pi, both in [0, 1]."""
    return dr.safe_acos(d.z) * dr.inv_pi, (dr.atan2(d.y, d.x) + dr.pi) * dr.inv_two_pi


def direction_blob(d: mi.Vector3f) -> list[mi.Float]:
    """A unit vector to eight numbers: the azimuth wraps round, the polar angle does not."""
    theta, phi = spherical(d)
    return one_blob(theta) + one_blob(phi, periodic=True)


def hash_lookup(layout: list[Level], table: mi.Float, packets: int, at: mi.Point3f) -> list[Any]:
    """Interpolated features of a point in [0, 1]^3, level-major: the same numbers as ``networks.hashgrid.HashGrid``."""
    clamped = [dr.clip(coordinate, 0, 1) for coordinate in at]
    out: list[Any] = []
    for level in layout:
        scaled = [coordinate * level.cells for coordinate in clamped]
        low = [dr.minimum(mi.UInt32(a), level.cells - 1) for a in scaled]
        fraction = [a - mi.Float(i) for a, i in zip(scaled, low)]
        total = [mi.Vector4f(0)] * packets
        side = level.cells + 1
        for corner in range(8):
            upper = [corner >> axis & 1 for axis in range(3)]
            x, y, z = (i + u for i, u in zip(low, upper))
            if level.dense:
                entry = x + side * (y + side * z)
            else:
                entry = (x ^ y * mi.UInt32(PRIMES[1]) ^ z * mi.UInt32(PRIMES[2])) & (level.entries - 1)
            weight = mi.Float(1)
            for f, u in zip(fraction, upper):
                weight = weight * (f if u else 1 - f)
            entry = (entry + level.offset) * packets
            rows = [dr.gather(mi.Vector4f, table, entry + k) for k in range(packets)]
            total = [dr.fma(weight, row, t) for row, t in zip(rows, total)]
        for packet in total:
            out += list(packet)
    return out
