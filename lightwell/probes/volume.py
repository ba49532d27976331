"""A baked probe volume and its query in NumPy, which is the definition that every other evaluator is tested against.

    E(x, n) = ⟨Y(n), (N + δ F) / (Z + δ)⟩    N = Σ_p Φ_p L_p    Z = Σ_p Φ_p    δ = ε_z (1 - Z)    Φ_p = hat_p ρ_p s_p

at y = x + offset · h · n. Z is the trusted share of the trilinear weight; F is the light of the fallback probe, the
nearest one along a free path; s_p is 0 where a sheet in the cell cuts the probe off, else 1. In a cell with a brick,
a lattice three times finer is blended in:

    N = (1 - m) N_coarse + m N_fine    Z = (1 - m) Z_coarse + m Z_fine    m = inner(y) · smoothstep(Z_fine / 0.05)

where inner is 1 at fine nodes all of whose cells lie in bricks, 0 at others and trilinear between, so that light
has no seam at the faces of bricks. Notation: P nodes of the lattice, F fine probes (indices P … P + F - 1), R
records, C cells, B bricks, N points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lightwell.probes import sh
from lightwell.probes.lattice import CORNERS, ProbeLattice
from lightwell.probes.lattice import hat as hat_of
from lightwell.probes.pattern import octants
from lightwell.probes.sheets import Sheets
from lightwell.probes.weights import FUNCTIONS, ratio, trusted

# Offset of queries on surfaces along the normal, units of h, because weights depend on a position, not on a side.
# Moving objects are queried without it: they have no wall behind them, and it could cross a wall in front of them.
OFFSET = 0.2
# ε_z: the weight of the fallback where no probe is trusted.
FALLBACK = 1e-5
# States of a node.
DROPPED, OPEN, WEIGHTED = 0, 1, 2
# A sample with less trusted weight than this is an orphan: it needs more probes or a brick.
ORPHAN = 0.05
ALL_OCTANTS = np.uint64(0xFFFFFFFFFFFFFFFF)
# Bytes of a probe's light by coding (band 0 and the step as four float16, then bytes), of a brick (its cell, its
# probes, which fine cells have a sheet), and of a sheet (four float16, the corners that count).
LIGHT_BYTES, BRICK_BYTES, SHEET_BYTES = {"l2": 32, "zh3": 20}, 264, 10

# Fine cells along an edge of a brick, and the trusted weight at which the fine lattice replaces the coarse one.
FINE, TAKES_OVER = 3, 0.05


@dataclass(frozen=True)
class Bricks:
    """Cells with a lattice of their own: FINE³ cells and (FINE + 1)³ probes; probes on a common face are shared."""

    cell: np.ndarray
    """[C] int32 index of the brick of each cell; -1: none."""
    table: np.ndarray
    """[B, 64] int32 indices of the fine probes in the volume, x fastest."""
    inner: np.ndarray
    """[F] bool: all cells around the fine node lie in bricks."""
    sheet: np.ndarray
    """[B, 27] int32 row of the plane of each fine cell in the volume's sheets, x fastest; -1: none."""


@dataclass(frozen=True)
class ProbeVolume:
    """Weights and light (irradiance harmonics) of a lattice of probes."""

    lattice: ProbeLattice
    """Lattice of the P nodes."""
    function: str
    """Name of the weight function, one of ``FUNCTIONS``."""
    state: np.ndarray
    """[P + F] uint8: DROPPED, OPEN (ρ = 1 everywhere) or WEIGHTED."""
    row: np.ndarray
    """[P + F] int32 index of the record of a weighted node, -1 for others."""
    params: np.ndarray
    """[R, ...] float32 parameters, quantised as stored."""
    octant: np.ndarray
    """[R] uint64: bit o is set where ρ may be above 0 in octant o of the cube."""
    fallback: np.ndarray
    """[C, 8] int32 fallback node of each octant of each cell; -1: none (black)."""
    light: np.ndarray
    """[P + F, 9, 3] float32 irradiance harmonics; 0 for dropped nodes."""
    sheets: Sheets
    """Planes of thin walls in the cells; those of fine cells follow."""
    offset: float = OFFSET
    """Offset of queries along the normal, units of the spacing."""
    bricks: Bricks | None = None
    """Finer lattices in some cells."""

    def in_air(self) -> ProbeVolume:
        """Return the same volume without the offset along the normal, for objects that move.

        Returns:
            The volume.
        """
        return replace(self, offset=0.0)

    def lit(self, light: np.ndarray) -> ProbeVolume:
        """Return the same weights with other light.

        Args:
            light: [P + F, 9, 3] irradiance harmonics.

        Returns:
            The volume.
        """
        return replace(self, light=np.asarray(light, np.float32))

    @property
    def alive(self) -> np.ndarray:
        """[P + F] bool: nodes that hold light."""
        return self.state != DROPPED

    @property
    def in_doubt(self) -> np.ndarray:
        """[C] bool: cells that may need a fallback, as a node is not open or a sheet cuts them; files store these."""
        cells = np.arange(self.lattice.cell_count)
        node = self.lattice.node_number(self.lattice.cell_corner(cells)[:, None] + CORNERS)
        doubt = (self.state[node] != OPEN).any(axis=1) | (self.sheets.row >= 0)
        return doubt & (self.fallback >= 0).any(axis=1)

    def bytes_per_probe(self, coding: str = "zh3") -> dict[str, float]:
        """Return the average size of a live probe in a file.

        Args:
            coding: Coding of the light, "l2" or "zh3".

        Returns:
            Bytes of weights, light, octants and tables per live probe; ``record`` is one record with its light.
        """
        live = max(int(self.alive.sum()), 1)
        f, light = FUNCTIONS[self.function], LIGHT_BYTES[coding]
        bricks = 0 if self.bricks is None else BRICK_BYTES * len(self.bricks.table)
        # One byte per node and per cell, eight per cell with a fallback.
        tables = len(self.state) + len(self.fallback) + 8 * int(self.in_doubt.sum()) + bricks
        tables += SHEET_BYTES * len(self.sheets.plane)
        return {
            "weights": f.stored * len(self.params) / live,
            "light": float(light),
            "octants": 8.0 * len(self.params) / live,
            "tables": tables / live,
            "record": float(f.stored + light),
        }


def _rho(volume: ProbeVolume, node: np.ndarray, hat: np.ndarray, u: np.ndarray) -> np.ndarray:
    """[N, 8] float32 ρ of nodes [N, 8] at probe-local positions [N, 8, 3]."""
    state = volume.state[node]
    rho = (state == OPEN).astype(np.float32)
    asked = (state == WEIGHTED) & (hat > 0)
    record, place = volume.row[node[asked]], u[asked]
    bit = volume.octant[record] >> octants(place).astype(np.uint64) & np.uint64(1)
    f = FUNCTIONS[volume.function]
    value = ratio(f, trusted(f.raw(volume.params[record], place)), hat[asked])
    rho[asked] = np.where(bit.astype(bool), value, 0)
    return rho


def trust_at(volume: ProbeVolume, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Evaluate the trust of the eight lattice nodes around each point.

    Args:
        volume: The volume.
        y: [N, 3] points with the offset along the normal applied, metres.

    Returns:
        [N, 8] indices of nodes, [N, 8] hat and [N, 8] trust ρ in [0, 1].
    """
    node, hat, u = volume.lattice.corners(y)
    cell, f = volume.lattice.locate(y)
    counted = volume.sheets.counted(volume.sheets.row[volume.lattice.cell_number(cell)], f)
    return node, hat.astype(np.float32), _rho(volume, node, hat, u) * counted


def fine_trust_at(volume: ProbeVolume, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Evaluate the trust of the eight fine probes around each point.

    Args:
        volume: Volume with bricks.
        y: [N, 3] points with the offset along the normal applied, metres.

    Returns:
        [N, 8] indices of probes, [N, 8] hat, [N, 8] trust ρ in [0, 1], and [N] share m of the fine lattice, which is 0
        in cells without a brick.
    """
    bricks = volume.bricks
    cell, f = volume.lattice.locate(y)
    brick = bricks.cell[volume.lattice.cell_number(cell)]
    at = f * FINE
    low = np.minimum(at.astype(np.int64), FINE - 1)
    local = (low[:, None] + CORNERS) @ np.array([1, FINE + 1, (FINE + 1) ** 2])
    node = bricks.table[np.maximum(brick, 0)[:, None], local]
    u = (at - low)[:, None] - CORNERS
    weight = hat_of(u) * (brick >= 0)[:, None]
    part = low @ np.array([1, FINE, FINE**2])
    row = np.where(brick >= 0, bricks.sheet[np.maximum(brick, 0), part], -1)
    rho = _rho(volume, node, weight, u) * volume.sheets.counted(row, at - low)
    inner = (weight * bricks.inner[node - len(volume.lattice)]).sum(axis=1)
    return node, weight.astype(np.float32), rho, inner * smoothstep((weight * rho).sum(axis=1) / TAKES_OVER)


def smoothstep(x: np.ndarray) -> np.ndarray:
    """Compute 3 x² - 2 x³.

    Args:
        x: [...] numbers, clamped to [0, 1].

    Returns:
        [...] numbers in [0, 1].
    """
    x = np.clip(x, 0, 1)
    return x * x * (3 - 2 * x)


def coefficients(volume: ProbeVolume, x: np.ndarray, n: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compute the normalised weights of all probes that contribute to a query.

    Args:
        volume: The volume.
        x: [N, 3] points, metres.
        n: [N, 3] unit normals; 0 for no offset.

    Returns:
        [N, 9] indices of probes, [N, 9] their weights, and [N] trusted weight Z; the last of the nine is the fallback.
        With bricks there are 17: eight of the lattice, eight fine ones and the fallback.
    """
    y = np.asarray(x, np.float64) + volume.offset * volume.lattice.spacing * np.asarray(n, np.float64)
    node, hat, rho = trust_at(volume, y)
    phi = hat * rho
    if volume.bricks is not None:
        fine, weight, rho, m = fine_trust_at(volume, y)
        node = np.concatenate([node, fine], axis=1)
        phi = np.concatenate([phi * (1 - m)[:, None], weight * rho * m[:, None]], axis=1)
    z = phi.sum(axis=1)
    back = fallback_node(volume, y)
    delta = FALLBACK * np.maximum(1 - z, 0)
    total = z + delta
    share = np.concatenate([phi, (delta * (back >= 0))[:, None]], axis=1) / np.where(total > 0, total, 1)[:, None]
    return np.concatenate([node, np.maximum(back, 0)[:, None]], axis=1), share, z


def fallback_node(volume: ProbeVolume, y: np.ndarray) -> np.ndarray:
    """Return the fallback probe of each point.

    Args:
        volume: The volume.
        y: [N, 3] points with the offset along the normal applied, metres.

    Returns:
        [N] int32 index of the node; -1: none.
    """
    cell, f = volume.lattice.locate(y)
    octant = (f >= 0.5) @ np.array([1, 2, 4])
    return volume.fallback[volume.lattice.cell_number(cell), octant]


def query(volume: ProbeVolume, x: np.ndarray, n: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute the irradiance at some points.

    Args:
        volume: The volume.
        x: [N, 3] points, metres.
        n: [N, 3] unit normals.

    Returns:
        [N, 3] irradiance, ≥ 0, and [N] trusted weight Z in [0, 1].
    """
    node, share, z = coefficients(volume, x, n)
    e = np.einsum("nk,nkbc->nbc", share, volume.light[node])
    return np.maximum(sh.evaluate(e, n), 0), z


def explain(volume: ProbeVolume, x: Sequence[float], n: Sequence[float]) -> list[dict[str, Any]]:
    """List what each probe contributes at one point, to find out why it is dark or leaks.

    Args:
        volume: The volume.
        x: [3] point, metres.
        n: [3] unit normal.

    Returns:
        One entry per probe: ``node``, ``state``, ``hat``, ``rho`` and ``share``, the last one for the fallback.
    """
    point, normal = np.asarray(x, float).reshape(1, 3), np.asarray(n, float).reshape(1, 3)
    y = point + volume.offset * volume.lattice.spacing * normal
    node, hat, rho = (v[0] for v in trust_at(volume, y))
    if volume.bricks is not None:
        more = [v[0] for v in fine_trust_at(volume, y)[:3]]
        node, hat, rho = (np.concatenate(pair) for pair in zip((node, hat, rho), more))
    nodes, share, _ = coefficients(volume, point, normal)
    names = ("dropped", "open", "weighted")
    found = [
        {"node": int(p), "state": names[volume.state[p]], "hat": float(a), "rho": float(r), "share": float(s)}
        for p, a, r, s in zip(node, hat, rho, share[0])
    ]
    return [
        *found,
        {"node": int(nodes[0, -1]), "state": "fallback", "hat": 0.0, "rho": 0.0, "share": float(share[0, -1])},
    ]
