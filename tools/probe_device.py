"""The query in Dr.Jit: one function unrolled over eight corners with plain gathers, for LLVM and CUDA.

Tested against ``volume.query``. The baselines fetch the harmonics in the same way, so that timings compare the
weights alone. Notation: P nodes, R records; one lane is one query.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lightwell.backend import dr, mi
from lightwell.graph.ops.activate import LEAK
from lightwell.graph.ops.encoding import sh_components
from lightwell.probes import ddgi
from lightwell.probes.file_weights import encode_weights
from lightwell.probes.lattice import CORNERS, ProbeLattice
from lightwell.probes.volume import DROPPED, FALLBACK, FINE, OPEN, TAKES_OVER, WEIGHTED, ProbeVolume
from lightwell.probes.weights import FUNCTIONS, UnweightedTrilinear, core
from lightwell.probes.weights.bare import EDGE
from lightwell.probes.weights.common import THRESHOLD
from lightwell.probes.weights.mlp import HIDDEN, TinyMlp
from lightwell.probes.weights.product import FULL, SMOOTH_HIGH, SMOOTH_LOW, ProductField
from lightwell.probes.weights.relu import HIGH, LOW, ReluField, encode

# Harmonics of a node: 27 numbers in seven packets of four.
PACKETS = 7
# Records 0 and 1 are constants: ρ = 0 and ρ = 1.
CONSTANTS = 2

Query = Callable[[mi.Point3f, mi.Vector3f], tuple[mi.Color3f, mi.Float]]


def _table(values: np.ndarray, kind=None):
    """A flat table on the device."""
    array = (kind or mi.Float)(np.ascontiguousarray(values).ravel())
    dr.make_opaque(array)
    return array


class _Light:
    """Harmonics of all nodes; adds a weighted node to a sum."""

    def __init__(self, light: np.ndarray) -> None:
        rows = np.zeros((len(light), 4 * PACKETS), np.float32)
        # Ordered by colour, so that the dot product with the normal's harmonics reads in sequence.
        rows[:, :27] = np.swapaxes(light, 1, 2).reshape(len(light), 27)
        self.table = _table(rows)

    def add(self, total: list, weight, node, active) -> list:
        rows = [dr.gather(mi.Vector4f, self.table, node * PACKETS + k, active) for k in range(PACKETS)]
        return [dr.fma(weight, row, old) for row, old in zip(rows, total)]

    @staticmethod
    def zero() -> list:
        return [mi.Vector4f(0) for _ in range(PACKETS)]

    @staticmethod
    def irradiance(total: list, n) -> mi.Color3f:
        y = sh_components(n.x, n.y, n.z, 3)
        numbers = [c for packet in total for c in packet]
        colours = [sum(a * b for a, b in zip(y, numbers[9 * c : 9 * c + 9])) for c in range(3)]
        return dr.maximum(mi.Color3f(*colours), 0)


class _Cell:
    """Cell of a point, and the position in it."""

    base = 0

    def __init__(self, lattice: ProbeLattice, y) -> None:
        h, cells = lattice.spacing, lattice.cells
        at = [(c - float(o)) * (1 / h) for c, o in zip(y, lattice.origin)]
        at = [dr.clip(a, 0, size) for a, size in zip(at, cells)]
        self.low = [dr.minimum(mi.UInt32(a), size - 1) for a, size in zip(at, cells)]
        self.f = [a - mi.Float(low) for a, low in zip(at, self.low)]
        self.shape = lattice.shape

    def corner(self, corner: np.ndarray) -> tuple:
        """Node, hat and probe-local position of one corner."""
        x, y, z = (low + int(c) for low, c in zip(self.low, corner))
        node = (z * self.shape[1] + y) * self.shape[0] + x + self.base
        hat = mi.Float(1)
        for f, c in zip(self.f, corner):
            hat *= f if c else 1 - f
        return node, hat, [f - float(c) for f, c in zip(self.f, corner)]

    def brick(self, number) -> _Cell:
        """The fine cell in the cell's brick; its corners are rows of the bricks' table."""
        fine, side = object.__new__(_Cell), FINE + 1
        at = [f * FINE for f in self.f]
        fine.low = [dr.minimum(mi.UInt32(a), FINE - 1) for a in at]
        fine.f = [a - mi.Float(low) for a, low in zip(at, fine.low)]
        fine.shape, fine.base = (side,) * 3, number * side**3
        return fine

    def number(self) -> mi.UInt32:
        """Index of the cell."""
        x, y, z = self.low
        return (z * (self.shape[1] - 1) + y) * (self.shape[0] - 1) + x

    def octant(self) -> tuple:
        """8 · index of the cell + octant of the point."""
        bits = [dr.select(f >= 0.5, mi.UInt32(1), 0) for f in self.f]
        return self.number() * 8 + bits[0] + 2 * bits[1] + 4 * bits[2]


class _Sheets:
    """Planes of cells; number 0 is none, where all corners count."""

    def __init__(self, volume: ProbeVolume) -> None:
        sheets, bricks = volume.sheets, volume.bricks
        self.planes = _table(np.concatenate([np.zeros((1, 4)), sheets.plane]).astype(np.float32))
        self.corners = _table(np.concatenate([[0xFFFF], sheets.corners]).astype(np.uint32), mi.UInt32)
        self.cells = _table((sheets.row + 1).astype(np.uint32), mi.UInt32)
        self.fine = None if bricks is None else _table((bricks.sheet + 1).astype(np.uint32), mi.UInt32)

    def of_cell(self, cell: _Cell) -> mi.UInt32:
        """Number of a cell's plane."""
        return dr.gather(mi.UInt32, self.cells, cell.number())

    def of_fine(self, cell: _Cell, brick, active) -> mi.UInt32:
        """Number of the plane of a fine cell in a brick."""
        x, y, z = cell.low
        return dr.gather(mi.UInt32, self.fine, brick * FINE**3 + (z * FINE + y) * FINE + x, active)

    def counted(self, number, f: list, active) -> mi.UInt32:
        """Bit k: corner k counts at a position in the cell."""
        plane = dr.gather(mi.Vector4f, self.planes, number, active)
        over = dr.dot(mi.Vector3f(plane.x, plane.y, plane.z), mi.Vector3f(*f)) + plane.w > 0
        return dr.gather(mi.UInt32, self.corners, number, active) >> dr.select(over, mi.UInt32(8), 0)


def learned(volume: ProbeVolume) -> Query:
    """Build the Dr.Jit query of a volume.

    Args:
        volume: The baked volume.

    Returns:
        Function of points (metres) and unit normals that returns irradiance and trusted weight Z in [0, 1].
    """
    lattice, light = volume.lattice, _Light(volume.light)
    record = np.where(volume.state == WEIGHTED, CONSTANTS + volume.row, np.where(volume.state == OPEN, 1, 0))
    records = _table(record.astype(np.uint32), mi.UInt32)
    full = np.full(CONSTANTS, 0xFFFFFFFFFFFFFFFF, np.uint64)
    octants = np.concatenate([full, volume.octant]).view(np.uint32)
    masks = _table(octants, mi.UInt32)
    alive = volume.fallback >= 0
    back = np.where(alive, volume.fallback, 0)
    backs, known = _table(back.astype(np.uint32), mi.UInt32), mi.Bool(alive.ravel())
    rho, bricks, sheets = _rho(volume), volume.bricks, _Sheets(volume)
    if bricks is not None:
        owner, fine_nodes = _table((bricks.cell + 1).astype(np.uint32), mi.UInt32), _table(bricks.table, mi.UInt32)
        inner = mi.Float(np.concatenate([np.zeros(len(lattice), np.float32), bricks.inner]))

    def summed(cell, within, of, sheet):
        total, z = light.zero(), mi.Float(0)
        counted = sheets.counted(sheet, cell.f, within)
        for k, corner in enumerate(CORNERS):
            node, hat, u = cell.corner(corner)
            node = of(node)
            row = dr.gather(mi.UInt32, records, node, within)
            asked = (hat > 0) & (row > 0) & within & ((counted >> k) & 1 == 1)
            octant = mi.UInt32(0)
            for value, stride in zip(u, (1, 4, 16)):
                octant += dr.minimum(mi.UInt32(2 * value + 2), 3) * stride
            mask = dr.gather(mi.UInt32, masks, 2 * row + (octant >> 5), asked)
            phi = hat * rho(row, u, hat, asked)
            phi = dr.select(asked & ((mask >> (octant & 31)) & 1 == 1), phi, 0)
            total, z = light.add(total, phi, node, phi > 0), z + phi
        return total, z

    def blended(cell, total, z):
        number = dr.gather(mi.UInt32, owner, cell.number())
        within, fine = number > 0, cell.brick(dr.select(number > 0, number - 1, 0))
        of = lambda row: dr.gather(mi.UInt32, fine_nodes, row, within)  # noqa: E731
        more, share = summed(fine, within, of, sheets.of_fine(fine, dr.select(within, number - 1, 0), within))
        m, t = mi.Float(0), dr.clip(share * (1 / TAKES_OVER), 0, 1)
        for corner in CORNERS:
            row, hat, _ = fine.corner(corner)
            m += hat * dr.gather(mi.Float, inner, of(row), within)
        m *= t * t * (3 - 2 * t)
        return [dr.lerp(a, b, m) for a, b in zip(total, more)], dr.lerp(z, share, m)

    def query(x, n):
        y = x + n * (volume.offset * lattice.spacing)
        cell = _Cell(lattice, y)
        total, z = summed(cell, mi.Bool(True), lambda node: node, sheets.of_cell(cell))
        if bricks is not None:
            total, z = blended(cell, total, z)
        delta = FALLBACK * dr.maximum(1 - z, 0)
        octant = cell.octant()
        has = dr.gather(mi.Bool, known, octant) & (delta > 0)
        total = light.add(total, dr.select(has, delta, 0), dr.gather(mi.UInt32, backs, octant, has), has)
        scale = dr.select(z + delta > 0, dr.rcp(z + delta), 0)
        return light.irradiance(total, n) * scale, z

    return query


def _rho(volume: ProbeVolume) -> Callable:
    """ρ of records [lanes] at probe-local positions, given the hat there."""
    f = FUNCTIONS[volume.function]
    value = _value(core(f), volume)
    if not isinstance(f, UnweightedTrilinear):
        return lambda row, u, hat, active: value(row, u, active)
    # The constants hold ρ itself.
    scale = lambda row, hat: dr.select(row < CONSTANTS, 1, dr.rcp(dr.maximum(hat, EDGE)))  # noqa: E731
    return lambda row, u, hat, active: value(row, u, active) * scale(row, hat)


def _value(f, volume: ProbeVolume) -> Callable:
    """Value of a record, before it is divided by the hat for ``UnweightedTrilinear`` functions."""
    constants = np.zeros((CONSTANTS, f.parameters), np.float32)
    if isinstance(f, ReluField) and f.side == 4:
        constants[0], constants[1] = LOW, HIGH
        words = _table(encode(np.concatenate([constants, volume.params])).view(np.uint32), mi.UInt32)
        return lambda row, u, active: _trusted(_bytes(words, row, u, active))
    if isinstance(f, ReluField):
        constants[1] = 1
        table = _table(np.concatenate([constants, volume.params]))
        return lambda row, u, active: _trusted(_grid(table, f.side, row, u, active))
    if isinstance(f, TinyMlp):
        constants[1, -1] = 1
        table = _table(encode_weights(f.name, np.concatenate([constants, volume.params])), mi.UInt32)
        return lambda row, u, active: _trusted(_network(table, row, u, active))
    if isinstance(f, ProductField):
        constants[1, : f.sharp**3], constants[1, f.sharp**3 :] = 1, SMOOTH_HIGH
        record = encode_weights(volume.function, np.concatenate([constants, volume.params])).view(np.uint8)
        sharp = _table(_wide_pairs(record[:, : f.sharp**3]), mi.UInt32)
        smooth = _table(np.ascontiguousarray(record[:, f.sharp**3 : f.parameters]).view(np.uint32), mi.UInt32)

        def product(row, u, active):
            cut = dr.clip(_wide_bytes(sharp, row, u, active), 0, 1)
            return _trusted(cut * dr.rcp(1 + dr.exp(-_corners(smooth, row, u, active))) * (1 / FULL))

        return product
    raise ValueError(f"probes: no weight function '{volume.function}', expected one of {', '.join(FUNCTIONS)}")


def _trusted(raw):
    return dr.clip((raw - THRESHOLD) * (1 / (1 - THRESHOLD)), 0, 1)


def _grid(table, side: int, row, u, active):
    """Trilinear value of a record's grid."""
    at = [(value + 1) * (0.5 * (side - 1)) for value in u]
    low = [dr.minimum(mi.UInt32(a), side - 2) for a in at]
    f = [a - mi.Float(v) for a, v in zip(at, low)]
    first = row * side**3 + (low[2] * side + low[1]) * side + low[0]
    value = [dr.gather(mi.Float, table, first + int(c @ (1, side, side**2)), active) for c in CORNERS]
    for fraction in f:
        value = [dr.lerp(a, b, fraction) for a, b in zip(value[::2], value[1::2])]
    return value[0]


def _bytes(words, row, u, active):
    """Trilinear value of a grid of 4³ bytes: a row of four along x is one word, so four reads give eight values."""
    at = [(value + 1) * 1.5 for value in u]
    low = [dr.minimum(mi.UInt32(a), 2) for a in at]
    f = [a - mi.Float(v) for a, v in zip(at, low)]
    first, shift = row * 16 + low[2] * 4 + low[1], low[0] * 8
    value = []
    for step in (0, 1, 4, 5):
        word = dr.gather(mi.UInt32, words, first + step, active) >> shift
        left, right = (mi.Float(mi.Int32((word >> s) & 255)) for s in (0, 8))
        value.append(dr.lerp(left, right, f[0]))
    for fraction in f[1:]:
        value = [dr.lerp(a, b, fraction) for a, b in zip(value[::2], value[1::2])]
    return value[0] * ((HIGH - LOW) / 255) + LOW


def _wide_pairs(codes: np.ndarray) -> np.ndarray:
    """[R, 5, 4, 4] words of grids [R, 125] of bytes: rows of five along x in two words, those at y, y + 1 together."""
    rows = np.pad(codes.reshape(-1, 5, 5, 5), ((0, 0), (0, 0), (0, 0), (0, 3)))
    return np.concatenate([rows[:, :, :4], rows[:, :, 1:]], axis=-1).view(np.uint32)


def _wide_bytes(words, row, u, active):
    """Trilinear value of a grid of 5³ bytes: two packets."""
    at = [(value + 1) * 2 for value in u]
    low = [dr.minimum(mi.UInt32(a), 3) for a in at]
    f = [a - mi.Float(v) for a, v in zip(at, low)]
    first, shift, last, value = row * 20 + low[2] * 4 + low[1], low[0] * 8, low[0] == 3, []
    for step in (0, 4):
        packet = dr.gather(mi.Vector4u, words, first + step, active)
        for word, more in (packet.x, packet.y), (packet.z, packet.w):
            left = word >> shift
            pair = [mi.Float(mi.Int32(w & 255)) for w in (left, dr.select(last, more, left >> 8))]
            value.append(dr.lerp(*pair, f[0]))
    for fraction in f[1:]:
        value = [dr.lerp(a, b, fraction) for a, b in zip(value[::2], value[1::2])]
    return value[0] * ((HIGH - LOW) / 255) + LOW


def _corners(words, row, u, active):
    """Trilinear value of a grid of 2³ bytes: one packet."""
    packet = dr.gather(mi.Vector2u, words, row, active)
    value = [mi.Float(mi.Int32((word >> s) & 255)) for word in packet for s in (0, 8, 16, 24)]
    for place in u:
        value = [dr.lerp(a, b, 0.5 * place + 0.5) for a, b in zip(value[::2], value[1::2])]
    return value[0] * ((SMOOTH_HIGH - SMOOTH_LOW) / 255) + SMOOTH_LOW


def _network(table, row, u, active):
    """Value of a record's network, from the bytes of a file's record: eight reads of four words, not 29.

    The steps are applied to the neurons instead of the weights, because the activation is homogeneous.
    """
    words = [w for k in range(8) for w in dr.gather(mi.Vector4u, table, row * 8 + k, active)]
    steps = [dr.reinterpret_array(mi.Float, w) for w in words[29:]]
    signed = lambda k: mi.Float((mi.Int32(words[k // 4]) << (24 - 8 * (k % 4))) >> 24)  # noqa: E731
    leaky = lambda v: dr.maximum(v, v * LEAK)  # noqa: E731
    take = lambda first, count: [signed(k) for k in range(first, first + count)]  # noqa: E731
    h = [leaky(_dot(take(4 * k, 3), u, signed(4 * k + 3))) * steps[0] for k in range(HIDDEN)]
    first = 4 * HIDDEN
    bias = first + HIDDEN**2
    h = [leaky(_dot(take(first + HIDDEN * k, HIDDEN), h, signed(bias + k))) * steps[1] for k in range(HIDDEN)]
    return _dot(take(bias + HIDDEN, HIDDEN), h, signed(bias + 2 * HIDDEN)) * steps[2]


def _dot(a, b, start):
    for x, y in zip(a, b):
        start = dr.fma(x, y, start)
    return start


def trilinear(volume: ProbeVolume) -> Query:
    """Build the Dr.Jit query of trilinear interpolation, without dropped nodes.

    Args:
        volume: The baked volume; its weights are not used.

    Returns:
        Function of points (metres) and unit normals that returns irradiance and the sum of the weights.
    """
    lattice, light, live = volume.lattice, _Light(volume.light), mi.Bool(volume.state != DROPPED)

    def query(x, n):
        y = x + n * (volume.offset * lattice.spacing)
        cell, total, z = _Cell(lattice, y), light.zero(), mi.Float(0)
        for corner in CORNERS:
            node, hat, _ = cell.corner(corner)
            weight = dr.select(dr.gather(mi.Bool, live, node), hat, 0)
            total, z = light.add(total, weight, node, weight > 0), z + weight
        return light.irradiance(total, n) * dr.select(z > 0, dr.rcp(z), 0), z

    return query


def chebyshev(moments: ddgi.Moments) -> Query:
    """Build the Dr.Jit query of the baseline with distance moments.

    The maps get a border of one texel, so that a fetch is a plain bilinear one.

    Args:
        moments: The baseline.

    Returns:
        Function of points (metres) and unit normals that returns irradiance and the sum of the weights.
    """
    lattice, light = moments.lattice, _Light(moments.light)
    side, wide = ddgi.SIDE, ddgi.SIDE + 2
    maps = _table(_bordered(moments.maps))
    origins, live = _table(np.pad(moments.origin, ((0, 0), (0, 1)))), mi.Bool(moments.alive)

    def fetch(node, d, active):
        p = d / (dr.abs(d.x) + dr.abs(d.y) + dr.abs(d.z))
        fold = [(1 - dr.abs(b)) * dr.select(a >= 0, 1.0, -1.0) for a, b in ((p.x, p.y), (p.y, p.x))]
        at = [dr.select(p.z < 0, f, v) for f, v in zip(fold, (p.x, p.y))]
        at = [(a + 1) * (0.5 * side) + 0.5 for a in at]
        low = [mi.UInt32(a) for a in at]
        f = [a - mi.Float(v) for a, v in zip(at, low)]
        first = (node * wide + low[1]) * wide + low[0]
        texel = [dr.gather(mi.Vector2f, maps, first + k, active) for k in (0, 1, wide, wide + 1)]
        return dr.lerp(dr.lerp(texel[0], texel[1], f[0]), dr.lerp(texel[2], texel[3], f[0]), f[1])

    def query(x, n):
        y = x + n * (moments.bias * lattice.spacing)
        cell, total, z = _Cell(lattice, y), light.zero(), mi.Float(0)
        for corner in CORNERS:
            node, _, u = cell.corner(corner)
            active = dr.gather(mi.Bool, live, node)
            o = dr.gather(mi.Vector4f, origins, node, active)
            to_probe, facing = mi.Vector3f(o.x, o.y, o.z) - y, mi.Vector3f(o.x, o.y, o.z) - x
            r = dr.norm(to_probe)
            wrap = dr.square(0.5 * dr.dot(facing, n) * dr.rsqrt(dr.maximum(dr.squared_norm(facing), 1e-18)) + 0.5)
            moment = fetch(node, -to_probe / dr.maximum(r, 1e-9), active)
            variance = dr.abs(dr.square(moment.x) - moment.y)
            c = variance / dr.maximum(variance + dr.square(r - moment.x), 1e-12)
            w = (wrap + ddgi.WRAP) * dr.select(r > moment.x, dr.maximum(c * c * c, ddgi.LEAST), 1)
            w = dr.maximum(w, 1e-6)
            w = dr.select(w < ddgi.CRUSH, w * w * w / ddgi.CRUSH**2, w)
            for value in u:
                w *= dr.maximum(1 - dr.abs(value), ddgi.FLOOR)
            w = dr.select(active, w, 0)
            total, z = light.add(total, w, node, active), z + w
        return light.irradiance(total, n) * dr.select(z > 0, dr.rcp(z), 0), z

    return query


def _bordered(maps: np.ndarray) -> np.ndarray:
    """[P, 18, 18, 2] octahedral maps with a border that wraps as on an octahedron."""
    side = maps.shape[1]
    at = np.arange(-1, side + 1)
    y, x = np.meshgrid(at, at, indexing="ij")
    over_x, over_y = (x < 0) | (x >= side), (y < 0) | (y >= side)
    row = np.where(over_x, side - 1 - y, y)
    column = np.where(over_y, side - 1 - x, x)
    return maps[:, np.clip(row, 0, side - 1), np.clip(column, 0, side - 1)]
