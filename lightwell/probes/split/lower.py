"""Converts a feature volume to a shading graph with ops that every runtime has.

Per pixel: the cell by ``nearest``; the side of its plane by ``select``; eight nodes of that side and their features by
``rows``; the decoder by ``linear``; the dot product with the normal's harmonics.
"""

from __future__ import annotations

from functools import reduce

import numpy as np

from lightwell.graph import Builder, Graph, pack
from lightwell.graph.quantise import pack_indices
from lightwell.probes.code import Mixing
from lightwell.probes.lattice import CORNERS
from lightwell.probes.lower import shaded
from lightwell.probes.split.volume import FeatureVolume


def lower(volume: FeatureVolume, unit: float = 1.0, code: Mixing | None = None) -> Graph:
    """Build the shading graph of a feature volume.

    Args:
        volume: The volume.
        unit: Irradiance of 1 in the graph: what is stored is divided by it.
        code: Computes the K mixing factors; None for light that does not change.

    Returns:
        Graph with the output ``radiance``, which is E / π.
    """
    b = Builder(position=3, normal=3, **(code.inputs if code else {}))
    grid, lattice = volume.grid, volume.grid.lattice
    cells = np.array(lattice.cells)
    edges = lattice.spacing * cells
    y = b.add("position", b.scale("normal", float(volume.offset * lattice.spacing)))
    place = b.clamp(b.affine(y, (1 / edges).tolist(), (-lattice.origin / edges).tolist()), 0.0, 1.0)
    low = b.nearest(place, b.buffer(pack_indices(_corners(cells)), "cells"))
    f = b.subtract(b.affine(place, cells.tolist(), [0.0] * 3), low)
    record = b.nearest(place, b.buffer(pack_indices(_records(volume)), "records"))
    # Row 0 of each table stands for cells without air, or without a plane.
    planes = np.concatenate([np.zeros((1, 4)), grid.cuts.plane])
    plane = b.rows(b.slice(record, 1, 1), b.buffer(planes, "planes"))
    first = b.slice(record, 0, 1)
    height = b.add(b.dot(b.slice(plane, 0, 3), f), b.slice(plane, 3, 1))
    side = b.select(height, b.affine(first, [1.0], [1.0]), first)
    sides = np.concatenate([np.zeros((1, 8)), grid.nodes + 1.0])
    nodes = b.rows(side, b.buffer(pack_indices(sides), "sides"))
    features = _interpolated(b, volume.features / np.float32(unit), nodes, f)
    decoder = pack(_ordered(volume), "float16")
    e = b.linear(features, decoder, np.zeros(len(volume.decoder)))
    return b.build(radiance=shaded(b, code.mixed(b, e) if code else e, unit))


def _interpolated(b: Builder, values: np.ndarray, nodes: str, f: str) -> str:
    """[F] features [P, F] at the point."""
    black = np.zeros((1, values.shape[1]), np.float32)
    table = b.buffer(pack(np.concatenate([black, values]), "int8"), "features")
    g = b.affine(f, [-1.0] * 3, [1.0] * 3)
    axis = [[b.slice(v, k, 1) for v in (g, f)] for k in range(3)]
    parts = []
    for k, corner in enumerate(CORNERS):
        hat = b.multiply(b.multiply(axis[0][corner[0]], axis[1][corner[1]]), axis[2][corner[2]])
        parts.append(b.multiply(hat, b.rows(b.slice(nodes, k, 1), table)))
    return reduce(b.add, parts)


def _ordered(volume: FeatureVolume) -> np.ndarray:
    """[27 K, F] rows of the decoder as ``shaded`` reads them: band 0 of all colours, then colour by colour."""
    rows = volume.decoder.reshape(9, 3, volume.rank, -1)
    even, rest = rows[0], np.moveaxis(rows[1:], 0, 1)
    return np.concatenate([even.reshape(3 * volume.rank, -1), rest.reshape(24 * volume.rank, -1)])


def _corners(cells: np.ndarray) -> np.ndarray:
    """[Cz, Cy, Cx, 3] least corner of each cell."""
    z, y, x = np.meshgrid(*(np.arange(n) for n in cells[::-1]), indexing="ij")
    return np.stack([x, y, z], axis=-1)


def _records(volume: FeatureVolume) -> np.ndarray:
    """[Cz, Cy, Cx, 2] row of the cell's first side, and of its plane; 0: none."""
    nx, ny, nz = volume.grid.lattice.cells
    return np.stack([volume.grid.first + 1, volume.grid.cuts.row + 1], axis=-1).reshape(nz, ny, nx, 2)
