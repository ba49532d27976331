"""Encodings of the network's inputs, one value per lane: triangle wave, one-blob and hash grid.

Müller et al. 2021 (triangle wave), Müller et al. 2019 (one-blob), Müller et al. 2022 (hash grid).
"""

from __future__ import annotations

from typing import Any

from lightwell.backend import dr, mi
from lightwell.graph.ops.hashgrid import HashGridLevel, drjit_vertices

OCTAVES = 12
BLOBS = 4


def triangle_wave(x: mi.Float, octaves: int = OCTAVES) -> list[mi.Float]:
    """Encode a coordinate with triangle waves.

    Args:
        x: [N] coordinates in [0, 1].
        octaves: Number of waves; octave l has period 2^(1-l).

    Returns:
        One [N] array in [-1, 1] per octave.

    Reference: Müller et al. 2021, *Real-time Neural Radiance Caching for Path Tracing*.
    """
    out = []
    for octave in range(octaves):
        v = x * 2.0 ** (octave - 1) + octave / 4
        out.append(4 * dr.abs(v - dr.floor(v) - 0.5) - 1)
    return out


def _step(d: mi.Float, k: int) -> mi.Float:
    """Integrate the quartic kernel of radius 1/k up to d."""
    u = d * k
    square = u * u
    value = 0.5 + 15 / 16 * u * (1 - square * (2 / 3) + square * square / 5)
    return dr.select(u <= -1, 0, dr.select(u >= 1, 1, dr.clip(value, 0, 1)))


def one_blob(x: mi.Float, k: int = BLOBS, periodic: bool = False) -> list[mi.Float]:
    """Encode a number as the integrals of a kernel around it over equal bins.

    Args:
        x: [N] numbers in [0, 1].
        k: Number of bins; the kernel has radius 1/k.
        periodic: Whether 0 and 1 are the same place.

    Returns:
        One [N] array in [0, 1] per bin; they add up to one.

    Reference: Müller et al. 2019, *Neural Importance Sampling*.
    """
    shifts = (-1, 0, 1) if periodic else (0,)
    bins = []
    for b in range(k):
        bins.append(sum(_step((b + 1) / k - x - s, k) - _step(b / k - x - s, k) for s in shifts))
    if periodic:
        return bins
    total = sum(bins)
    return [b / total for b in bins]


def spherical(d: mi.Vector3f) -> tuple[mi.Float, mi.Float]:
    """Convert unit vectors to normalised spherical coordinates.

    Args:
        d: [N] unit vectors.

    Returns:
        Polar angle / π and (azimuth + π) / 2π, [N] each, in [0, 1].
    """
    return dr.safe_acos(d.z) * dr.inv_pi, (dr.atan2(d.y, d.x) + dr.pi) * dr.inv_two_pi


def direction_blob(d: mi.Vector3f) -> list[mi.Float]:
    """Encode a direction with four one-blob bins each of the polar angle and the azimuth, which is periodic.

    Args:
        d: [N] unit vectors.

    Returns:
        Eight [N] arrays in [0, 1].
    """
    theta, phi = spherical(d)
    return one_blob(theta) + one_blob(phi, periodic=True)


def hash_lookup(layout: list[HashGridLevel], table: mi.Float, packets: int, at: mi.Point3f) -> list[Any]:
    """Interpolate the features of a hash grid, with the same result as ``networks.hashgrid.HashGrid``.

    Args:
        layout: Levels of the grid.
        table: Entries of all levels, each of 4 * ``packets`` numbers.
        packets: Features per level / 4.
        at: [N] points; clamped to [0, 1]^3.

    Returns:
        One [N] array per feature, ordered by level.

    Reference: Müller et al. 2022, *Instant Neural Graphics Primitives*.
    """
    clamped = [dr.clip(coordinate, 0, 1) for coordinate in at]
    out: list[Any] = []
    for level in layout:
        total = [mi.Vector4f(0)] * packets
        for entry, weight in drjit_vertices(level, clamped):
            rows = [dr.gather(mi.Vector4f, table, entry * packets + k) for k in range(packets)]
            total = [dr.fma(weight, row, t) for row, t in zip(rows, total)]
        for packet in total:
            out += list(packet)
    return out
