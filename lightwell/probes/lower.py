"""Converts a probe volume to a shading graph with ops that every runtime has.

Per pixel: the cell by ``nearest``; for its eight corners the record by ``rows``, ρ by ``grid`` in an atlas of 4³
blocks (or three indexed ``linear`` layers), the harmonics by ``rows``; the same for the cell's brick, where there
are bricks; the fallback; a division; the dot product with the normal's harmonics. Notation: P nodes, F fine probes,
L live probes, B bricks, K mixing factors of a relightable volume.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from lightwell.graph import Builder, Graph, pack
from lightwell.graph.buffers import Buffer
from lightwell.probes.code import Mixing
from lightwell.probes.lattice import CORNERS
from lightwell.probes.volume import DROPPED, FALLBACK, FINE, OPEN, TAKES_OVER, WEIGHTED, ProbeVolume
from lightwell.probes.weights import FUNCTIONS, UnweightedTrilinear, core
from lightwell.probes.weights.bare import EDGE
from lightwell.probes.weights.common import THRESHOLD
from lightwell.probes.weights.mlp import TinyMlp
from lightwell.probes.weights.product import FULL, SMOOTH_HIGH, SMOOTH_LOW, ProductField
from lightwell.probes.weights.relu import HIGH, LOW, ReluField, encode

# Irradiance is clamped to this, in the field's unit.
BRIGHTEST = 1e6
# Margin that keeps the octant's coordinate inside its block.
BELOW = 1e-4


def lower(volume: ProbeVolume, unit: float = 1.0, basis: np.ndarray | None = None, code: Mixing | None = None) -> Graph:
    """Build the shading graph of a volume.

    Args:
        volume: The volume.
        unit: Irradiance of 1 in the volume's light.
        basis: [P + F, 9, 3, K] light per unit of each mixing factor, with ``code``; None for the volume's own light.
        code: Computes the K mixing factors from the input ``light`` or ``lamps``; None for light that does not change.

    Returns:
        Graph with the outputs ``radiance``, which is E / π (the radiance of a Lambertian surface divided by its
        reflectance), and ``trust``, the trusted weight Z.
    """
    b = Builder(position=3, normal=3, **(code.inputs if code else {}))
    light = volume.light[..., None] if basis is None else basis
    tables = _Tables.of(volume, light)
    h, cells = volume.lattice.spacing, np.array(volume.lattice.cells)
    y = b.add("position", b.scale("normal", float(volume.offset * h)))
    edges = h * cells
    unit_place = b.clamp(b.affine(y, (1 / edges).tolist(), (-volume.lattice.origin / edges).tolist()), 0.0, 1.0)
    low = b.nearest(unit_place, b.buffer(tables.cells, "cells"))
    f = b.subtract(b.affine(unit_place, cells.tolist(), [0.0] * 3), low)
    counted = None
    if len(volume.sheets.plane):
        counted = _counted(b, volume, b.nearest(unit_place, b.buffer(tables.sheets, "sheets")), f)
    nodes = b.buffer(tables.nodes, "nodes")
    total, z = _sum(b, volume, tables, low, f, volume.lattice.shape, nodes, counted=counted)
    if volume.bricks is not None:
        total, z = _with_bricks(b, volume, tables, unit_place, f, (total, z))
    fallback = _light_row(b, b.nearest(unit_place, b.buffer(tables.fallback, "fallback")), tables)
    delta = b.scale(b.clamp(b.affine(z, [-1.0], [1.0]), 0.0, 1.0), FALLBACK)
    total = b.add(total, b.multiply(delta, fallback))
    mean = b.multiply(b.reciprocal(b.add(z, delta), 1e-9), total)
    radiance = shaded(b, code.mixed(b, mean) if code else mean, unit)
    return b.build(radiance=radiance, trust=b.scale(z, 1.0))


def shaded(b: Builder, light: str, unit: float) -> str:
    """Add the radiance of a Lambertian surface, divided by its reflectance, to a graph.

    Args:
        b: Graph under construction with the input ``normal`` [3].
        light: Name of the node with the irradiance harmonics [27]: band 0 of three colours, then eight of each.
        unit: Irradiance of 1 in the light.

    Returns:
        Name of the node with E / π.
    """
    y = b.sh("normal", 3)
    even = b.multiply(b.slice(light, 0, 3), b.slice(y, 0, 1))
    e = b.add(even, b.matvec(b.slice(light, 3, 24), b.slice(y, 1, 8), 3))
    return b.scale(b.clamp(e, 0.0, BRIGHTEST), float(unit / np.pi))


def _with_bricks(
    b: Builder, volume: ProbeVolume, tables: _Tables, place: str, f: str, coarse: tuple[str, str]
) -> tuple[str, str]:
    """N and Z of the lattice and of the cell's brick, blended by m."""
    brick = b.nearest(place, b.buffer(tables.bricks, "bricks"))
    low = b.nearest(f, b.buffer(_fine_cells(), "fine.cells"))
    at, side = b.subtract(b.scale(f, float(FINE)), low), FINE + 1
    counted = None
    if len(volume.sheets.plane):
        number = b.add(b.linear(low, np.array([[1.0, FINE, FINE**2]]), np.zeros(1)), b.scale(brick, float(FINE**3)))
        counted = _counted(b, volume, b.rows(number, b.buffer(tables.fine_sheets, "fine.sheets")), at)
    nodes, base = b.buffer(tables.fine, "fine.nodes"), b.scale(brick, float(side**3))
    fine, z, inner = _sum(b, volume, tables, low, at, (side,) * 3, nodes, base, counted)
    t = b.clamp(b.scale(z, 1 / TAKES_OVER), 0.0, 1.0)
    smooth = b.multiply(b.multiply(t, t), b.affine(t, [-2.0], [3.0]))
    m = b.multiply(smooth, inner)
    rest = b.affine(m, [-1.0], [1.0])
    n, total = (b.add(b.multiply(rest, a), b.multiply(m, c)) for a, c in zip(coarse, (fine, z)))
    return n, total


def _counted(b: Builder, volume: ProbeVolume, sheet: str, f: str) -> str:
    """[8] 1 for corners that count on this side of the sheet with the number ``sheet`` (0: none), else 0."""
    planes = np.concatenate([np.zeros((1, 4)), volume.sheets.plane])
    plane = b.rows(sheet, b.buffer(planes, "planes"))
    height = b.add(b.dot(b.slice(plane, 0, 3), f), b.slice(plane, 3, 1))
    # Two rows for each sheet: where the plane is not positive, and where it is.
    lower, upper = b.scale(sheet, 2.0), b.affine(sheet, [2.0], [1.0])
    bits = volume.sheets.corners[:, None] >> np.arange(16, dtype=np.uint16) & 1
    corners = np.concatenate([np.ones((2, 8)), bits.reshape(-1, 8)])
    return b.rows(
        b.select(height, upper, lower), b.buffer(Buffer(corners, "uint8", np.ones((), np.float32)), "corners")
    )


def _sum(
    b: Builder,
    volume: ProbeVolume,
    tables: _Tables,
    low: str,
    f: str,
    shape: tuple[int, int, int],
    nodes: str,
    base: str | None = None,
    counted: str | None = None,
) -> tuple[Any, ...]:
    """N and Z over the eight corners of a lattice of ``shape``; with ``base``, the first node of a brick, also the
    interpolated flag of inner nodes. ``counted``: [8] 1 for corners that count; None: all do."""
    nx, ny, _ = shape
    strides = np.array([1.0, nx, nx * ny])
    first = b.linear(low, strides[None], np.zeros(1))
    first = first if base is None else b.add(first, base)
    g = b.affine(f, [-1.0] * 3, [1.0] * 3)
    axis = [[b.slice(v, k, 1) for v in (g, f)] for k in range(3)]
    total = z = inner = None
    for k, corner in enumerate(CORNERS):
        node = b.rows(b.affine(first, [1.0], [float(corner @ strides)]), nodes)
        u = b.affine(f, [1.0] * 3, (-corner).astype(float).tolist())
        hat = b.multiply(b.multiply(axis[0][corner[0]], axis[1][corner[1]]), axis[2][corner[2]])
        phi = b.multiply(hat, _rho(b, volume, tables, node, u, hat))
        phi = phi if counted is None else b.multiply(phi, b.slice(counted, k, 1))
        part = b.multiply(phi, _light_row(b, b.slice(node, 0, 1), tables))
        total, z = (part, phi) if z is None else (b.add(total, part), b.add(z, phi))
        if base is not None:
            mine = b.multiply(hat, b.slice(node, 8, 1))
            inner = mine if inner is None else b.add(inner, mine)
    return (total, z) if base is None else (total, z, inner)


def _light_row(b: Builder, record: str, tables: _Tables) -> str:
    """[27 K] harmonics of a record: band 0 of three colours, then bands 1 and 2."""
    return b.concat(b.rows(record, b.buffer(tables.mean, "mean")), b.rows(record, b.buffer(tables.shape, "shape")))


def _rho(b: Builder, volume: ProbeVolume, tables: _Tables, node: str, u: str, hat: str) -> str:
    """ρ of one corner."""
    f = core(FUNCTIONS[volume.function])
    if isinstance(f, TinyMlp):
        record = b.slice(node, 4, 1)
        w1, b1, w2, b2, w3, b3 = tables.layers
        x = b.activate(b.linear(u, b.buffer(w1, "mlp.w1"), b.buffer(b1, "mlp.b1"), record), "leaky_relu")
        x = b.activate(b.linear(x, b.buffer(w2, "mlp.w2"), b.buffer(b2, "mlp.b2"), record), "leaky_relu")
        raw = b.linear(x, b.buffer(w3, "mlp.w3"), b.buffer(b3, "mlp.b3"), record)
    else:
        raw = _block(b, tables.blocks, getattr(f, "sharp", getattr(f, "side", 0)), b.slice(node, 1, 3), u, "blocks")
        if isinstance(f, ProductField):
            # Blocks have the same order in both atlases; only their sides differ.
            at = b.scale(b.slice(node, 1, 3), f.smooth / f.sharp)
            smooth = b.activate(_block(b, tables.smooth, f.smooth, at, u, "smooth"), "sigmoid")
            raw = b.multiply(b.clamp(raw, 0.0, 1.0), b.scale(smooth, 1 / FULL))
    rho = b.clamp(b.affine(raw, [1 / (1 - THRESHOLD)], [-THRESHOLD / (1 - THRESHOLD)]), 0.0, 1.0)
    if isinstance(FUNCTIONS[volume.function], UnweightedTrilinear):
        # ρ = Φ / hat, except for probes that are trusted in their whole cube: their record, index 1, holds ρ.
        open_ = b.clamp(b.affine(b.slice(node, 4, 1), [-1.0], [2.0]), 0.0, 1.0)
        inverse = b.reciprocal(b.clamp(hat, EDGE, 1.0), 1e-9)
        rest = b.multiply(b.affine(open_, [-1.0], [1.0]), inverse)
        rho = b.multiply(rho, b.add(rest, open_))
    if tables.octants is None:
        return rho
    size = np.array(tables.octants.shape[2::-1])
    inside = b.clamp(b.affine(u, [2.0] * 3, [2.0] * 3), 0.0, 4 - BELOW)
    place = b.add(b.slice(node, 5, 3), inside)
    return b.multiply(
        rho, b.nearest(b.affine(place, (1 / size).tolist(), [0.0] * 3), b.buffer(tables.octants, "octants"))
    )


def _block(b: Builder, blocks: Buffer, side: int, place: str, u: str, name: str) -> str:
    """Trilinear value of the block at ``place`` (in vertices) of an atlas."""
    size, half = np.array(blocks.shape[2::-1]), (side - 1) / 2
    at = b.add(place, b.affine(u, [half] * 3, [half + 0.5] * 3))
    return b.grid(b.affine(at, (1 / size).tolist(), [0.0] * 3), b.buffer(blocks, name))


@dataclass(frozen=True)
class _Tables:
    """Buffers of a graph."""

    cells: Buffer
    """[Cz, Cy, Cx, 3] least corner of each cell."""
    nodes: np.ndarray
    """[P, 8] index of the light's record, position of the block [3], index of the weights' record, position of the
    octants [3]."""
    mean: Buffer
    """[L + 1, 3 K] float16: band 0 of each colour; row 0 is black."""
    shape: Buffer
    """[L + 1, 24 K] int8 with a step for each record: bands 1 and 2 of each colour."""
    fallback: np.ndarray
    """[2 Cz, 2 Cy, 2 Cx, 1] index of the light's record of the fallback probe."""
    blocks: Buffer | None
    octants: Buffer | None
    layers: tuple[Buffer, ...] = ()
    smooth: Buffer | None = None
    """Atlas of the second grid of a product field."""
    bricks: np.ndarray | None = None
    """[Cz, Cy, Cx, 1] index of a cell's brick + 1; 0 stands for none."""
    fine: np.ndarray | None = None
    """[64 (B + 1), 9] as ``nodes``, then 1 for inner nodes."""
    sheets: np.ndarray | None = None
    """[Cz, Cy, Cx, 1] number of a cell's sheet, from 1; 0 stands for none."""
    fine_sheets: np.ndarray | None = None
    """[27 (B + 1), 1] the same for fine cells."""

    @staticmethod
    def of(volume: ProbeVolume, light: np.ndarray) -> _Tables:
        live = np.flatnonzero(volume.state != DROPPED)
        record = np.zeros(len(volume.state))
        record[live] = 1 + np.arange(len(live))
        # Weights: record 0 is ρ = 0, record 1 is ρ = 1.
        weights = np.where(volume.state == WEIGHTED, 2 + volume.row, np.where(volume.state == OPEN, 1, 0))
        places, shape = _atlas(2 + len(volume.params))
        f = core(FUNCTIONS[volume.function])
        layers: tuple[Buffer, ...] = ()
        blocks, smooth, side = None, None, getattr(f, "side", getattr(f, "sharp", 4))
        if isinstance(f, (ReluField, ProductField)):
            sharp = volume.params[:, : side**3]
            values = np.concatenate([np.full((1, side**3), LOW), np.full((1, side**3), HIGH), sharp])
            stored = _scatter(encode(values), places, shape, side)
            blocks = Buffer(stored, "uint8", np.asarray((HIGH - LOW) / 255, np.float32), LOW)
        if isinstance(f, ProductField):
            count, span = f.smooth**3, SMOOTH_HIGH - SMOOTH_LOW
            values = np.concatenate([np.full((2, count), SMOOTH_HIGH), volume.params[:, side**3 :]])
            stored = _scatter(np.rint((values - SMOOTH_LOW) / span * 255).astype(np.uint8), places, shape, f.smooth)
            smooth = Buffer(stored, "uint8", np.asarray(span / 255, np.float32), SMOOTH_LOW)
        elif isinstance(f, TinyMlp):
            layers = _layers(f, volume.params)
        octants = _octants(volume, places, shape)
        nodes = np.concatenate(
            [record[:, None], side * places[weights], weights[:, None], (4 * places[weights])[:, :3]], axis=1
        )
        made = (*_light(light, live), _fallback(volume, record), blocks, octants, layers, smooth)
        return _Tables(_cells(volume), nodes[: len(volume.lattice)], *made, *_bricks(volume, nodes), *_sheets(volume))


def _atlas(count: int) -> tuple[np.ndarray, tuple[int, int, int]]:
    """Positions [count, 3] (x, y, z in blocks) of blocks in a box, and its size in blocks."""
    side = max(1, int(np.ceil(count ** (1 / 3))))
    k = np.arange(count)
    depth = -(-count // side**2)
    return np.stack([k % side, k // side % side, k // side**2], axis=1), (side, side, depth)


def _scatter(values: np.ndarray, places: np.ndarray, shape: tuple[int, ...], side: int) -> np.ndarray:
    """[D, H, W, 1] atlas of blocks [count, side³]."""
    nx, ny, nz = shape
    out = np.zeros((nz, side, ny, side, nx, side), values.dtype)
    x, y, z = places.T
    out[z, :, y, :, x, :] = values.reshape(-1, side, side, side)
    return out.reshape(nz * side, ny * side, nx * side, 1)


def _octants(volume: ProbeVolume, places: np.ndarray, shape: tuple[int, ...]) -> Buffer | None:
    """The masks as an atlas of 4³ bytes; None where all are full."""
    bits = volume.octant[:, None] >> np.arange(64, dtype=np.uint64) & np.uint64(1)
    if bits.all():
        return None
    values = np.concatenate([np.ones((2, 64)), bits]).astype(np.uint8)
    return Buffer(_scatter(values, places, shape, 4), "uint8", np.ones((), np.float32))


def _layers(f: TinyMlp, params: np.ndarray) -> tuple[Buffer, ...]:
    """Weights and biases of all records; the first two are constants."""
    constant = np.zeros((2, params.shape[1]), np.float32)
    constant[:, -1] = (-1, 2)
    parts, steps = f.parts(np.concatenate([constant, params])), f.steps(np.concatenate([constant, params]))
    out = []
    for k in range(3):
        w, bias, step = parts[2 * k], parts[2 * k + 1], steps[:, k]
        for values in (w, bias):
            shaped = step.reshape(-1, *(1,) * (values.ndim - 1))
            out.append(Buffer(np.rint(values / shaped), "int8", step))
    return tuple(out)


def _cells(volume: ProbeVolume) -> Buffer:
    nx, ny, nz = volume.lattice.cells
    z, y, x = np.meshgrid(np.arange(nz), np.arange(ny), np.arange(nx), indexing="ij")
    values = np.stack([x, y, z], axis=-1)
    return Buffer(values, "uint8", np.ones((), np.float32)) if max(nx, ny, nz) <= 256 else Buffer(values)


def _bricks(volume: ProbeVolume, nodes: np.ndarray) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Tables ``bricks`` and ``fine``."""
    if volume.bricks is None:
        return None, None
    table, count = volume.bricks.table, len(volume.lattice)
    rows = np.concatenate([nodes[table], volume.bricks.inner[table - count, None]], axis=2)
    none = np.zeros((1, table.shape[1], rows.shape[2]))
    nx, ny, nz = volume.lattice.cells
    number = (volume.bricks.cell + 1.0).reshape(nz, ny, nx, 1)
    return number, np.concatenate([none, rows]).reshape(-1, rows.shape[2])


def _sheets(volume: ProbeVolume) -> tuple[np.ndarray, np.ndarray | None]:
    """Tables ``sheets`` and ``fine_sheets``."""
    nx, ny, nz = volume.lattice.cells
    number = (volume.sheets.row + 1.0).reshape(nz, ny, nx, 1)
    if volume.bricks is None:
        return number, None
    fine = volume.bricks.sheet + 1.0
    return number, np.concatenate([np.zeros((1, fine.shape[1])), fine]).reshape(-1, 1)


def _fine_cells() -> np.ndarray:
    """[3, 3, 3, 3] least corner of each fine cell of a brick."""
    k = np.arange(FINE)
    z, y, x = np.meshgrid(k, k, k, indexing="ij")
    return np.stack([x, y, z], axis=-1).astype(np.float64)


def _light(light: np.ndarray, live: np.ndarray) -> tuple[Buffer, Buffer]:
    """Tables of band 0 and of the other bands; the order is (colour, harmonic, mixing factor), the last one fastest."""
    rows = np.concatenate([np.zeros((1, *light.shape[1:])), light[live]])
    rows = np.moveaxis(rows, 2, 1)
    mean, shape = rows[:, :, 0].reshape(len(rows), -1), rows[:, :, 1:].reshape(len(rows), -1)
    return pack(mean, "float16"), pack(shape, "int8")


def _fallback(volume: ProbeVolume, record: np.ndarray) -> np.ndarray:
    nx, ny, nz = volume.lattice.cells
    node = volume.fallback.reshape(nz, ny, nx, 2, 2, 2)
    value = np.where(node >= 0, record[np.maximum(node, 0)], 0)
    return value.transpose(0, 3, 1, 4, 2, 5).reshape(2 * nz, 2 * ny, 2 * nx, 1)
