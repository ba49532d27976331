r"""A baked probe volume and its query in NumPy: the definition that every other evaluator is tested against.

    E(x, n) = ⟨Y(n), (N + δ F) / (Z + δ)⟩    N = Σ_p Φ_p L_p    Z = Σ_p Φ_p    δ = ε_z (1 - Z)    Φ_p = hat_p ρ_p

at y = x + offset · h · n. Z is the share of trilinear weight that may be trusted; F is the probe to fall back to, the
nearest by a free path. In a cell with a brick, a lattice three times finer joins in:

    N = (1 - m) N_coarse + m N_fine    Z = (1 - m) Z_coarse + m Z_fine    m = inner(y) · smoothstep(Z_fine / 0.05)

where inner is 1 on fine nodes all of whose cells lie in bricks, 0 on others, trilinear between: light has no seam at
the face of a brick. Notation: P nodes of the lattice, F fine probes (numbers P … P + F - 1), R records, C cells, B
bricks, N points.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lightwell.probes import sh
from lightwell.probes.lattice import CORNERS, Lattice
from lightwell.probes.lattice import hat as hat_of
from lightwell.probes.pattern import octants
from lightwell.probes.weights import FUNCTIONS, ratio, trusted

# Places on surfaces are looked up this far off along the normal, units of h: a weight knows a place, not a side. What
# moves has no wall behind it and asks without an offset, which could carry it through a wall in front of it.
OFFSET = 0.2
# ε_z: the weight of the fallback where nothing may be trusted.
FALLBACK = 1e-5
# What a node is.
DROPPED, OPEN, WEIGHTED = 0, 1, 2
# A query with less trusted weight than this is an orphan: probes or bricks are missing there.
ORPHAN = 0.05
ALL_OCTANTS = np.uint64(0xFFFFFFFFFFFFFFFF)
# Bytes of a probe's light by coding (three half floats and one of a step, then bytes), and of a brick: its cell, its
# probes.
LIGHT_BYTES, BRICK_BYTES = {"l2": 32, "zh3": 20}, 260

# Fine cells along an edge of a brick, and what a fine lattice must be trusted before it takes over.
FINE, TAKES_OVER = 3, 0.05


@dataclass(frozen=True)
class Bricks:
    """Cells with a lattice of their own: FINE³ cells, (FINE + 1)³ probes, those on a common face shared."""

    cell: np.ndarray
    """[C] int32 brick of each cell, -1: none."""
    table: np.ndarray
    """[B, 64] int32 numbers of the fine probes, x fastest."""
    inner: np.ndarray
    """[F] bool: all cells round the fine node lie in bricks."""


@dataclass(frozen=True)
class ProbeVolume:
    """Geometry (weights) and light (harmonics) of a lattice of probes."""

    lattice: Lattice
    function: str
    """Name of the weight function, one of ``FUNCTIONS``."""
    state: np.ndarray
    """[P + F] uint8: DROPPED, OPEN (ρ = 1 everywhere) or WEIGHTED."""
    row: np.ndarray
    """[P + F] int32 record of a weighted node, -1 for others."""
    params: np.ndarray
    """[R, ...] float32 parameters, quantised as stored."""
    octant: np.ndarray
    """[R] uint64: bit o is set where octant o of the cube may be trusted at all."""
    fallback: np.ndarray
    """[C, 8] int32 node to fall back to in each octant of each cell; -1: none (black)."""
    light: np.ndarray
    """[P + F, 9, 3] float32 irradiance harmonics; 0 for dropped nodes."""
    offset: float = OFFSET
    """Of surfaces, along their normals, units of h."""
    bricks: Bricks | None = None

    def in_air(self) -> ProbeVolume:
        """The same volume asked by what moves: without an offset."""
        return replace(self, offset=0.0)

    def lit(self, light: np.ndarray) -> ProbeVolume:
        """The same weights under other light [P + F, 9, 3]."""
        return replace(self, light=np.asarray(light, np.float32))

    @property
    def alive(self) -> np.ndarray:
        """[P + F] bool: nodes that hold light."""
        return self.state != DROPPED

    @property
    def in_doubt(self) -> np.ndarray:
        """[C] bool: cells that may ask for a fallback: not all of their nodes are open. Files hold no others."""
        cells = np.arange(self.lattice.cell_count)
        node = self.lattice.node_number(self.lattice.cell_corner(cells)[:, None] + CORNERS)
        return (self.state[node] != OPEN).any(axis=1) & (self.fallback >= 0).any(axis=1)

    def bytes_per_probe(self, coding: str = "zh3") -> dict[str, float]:
        """Bytes of the parts of a live probe, as in files: weights, light, mask and tables; averages."""
        live = max(int(self.alive.sum()), 1)
        f, light = FUNCTIONS[self.function], LIGHT_BYTES[coding]
        bricks = 0 if self.bricks is None else BRICK_BYTES * len(self.bricks.table)
        # A byte a node, a byte a cell, eight where there is a fallback.
        tables = len(self.state) + len(self.fallback) + 8 * int(self.in_doubt.sum()) + bricks
        return {
            "weights": f.stored * len(self.params) / live,
            "light": float(light),
            "octants": 8.0 * len(self.params) / live,
            "tables": tables / live,
            "record": float(f.stored + light),
        }


def _rho(volume: ProbeVolume, node: np.ndarray, hat: np.ndarray, u: np.ndarray) -> np.ndarray:
    """[N, 8] float32 ρ of nodes [N, 8] at their places [N, 8, 3]."""
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
    """Nodes [N, 8], hat [N, 8] and ρ [N, 8] of the lattice at places [N, 3] (already off their surfaces)."""
    node, hat, u = volume.lattice.corners(y)
    return node, hat.astype(np.float32), _rho(volume, node, hat, u)


def fine_trust_at(volume: ProbeVolume, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Fine probes [N, 8], hat [N, 8], ρ [N, 8] and share m [N] at places [N, 3]; m = 0 where there is no brick."""
    bricks = volume.bricks
    cell, f = volume.lattice.locate(y)
    brick = bricks.cell[volume.lattice.cell_number(cell)]
    at = f * FINE
    low = np.minimum(at.astype(np.int64), FINE - 1)
    local = (low[:, None] + CORNERS) @ np.array([1, FINE + 1, (FINE + 1) ** 2])
    node = bricks.table[np.maximum(brick, 0)[:, None], local]
    u = (at - low)[:, None] - CORNERS
    weight = hat_of(u) * (brick >= 0)[:, None]
    rho = _rho(volume, node, weight, u)
    inner = (weight * bricks.inner[node - len(volume.lattice)]).sum(axis=1)
    return node, weight.astype(np.float32), rho, inner * smoothstep((weight * rho).sum(axis=1) / TAKES_OVER)


def smoothstep(x: np.ndarray) -> np.ndarray:
    """3 x² - 2 x³ of x clipped to [0, 1]."""
    x = np.clip(x, 0, 1)
    return x * x * (3 - 2 * x)


def coefficients(volume: ProbeVolume, x: np.ndarray, n: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes [N, 9], their shares [N, 9] of the light at x on the side of n, and Z [N]; the last is the fallback. With
    bricks there are 17: eight of the lattice, eight fine ones, the fallback."""
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
    """[N] node to fall back to."""
    cell, f = volume.lattice.locate(y)
    octant = (f >= 0.5) @ np.array([1, 2, 4])
    return volume.fallback[volume.lattice.cell_number(cell), octant]


def query(volume: ProbeVolume, x: np.ndarray, n: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Irradiance [N, 3] at places x [N, 3] for unit normals n [N, 3], and the trusted share Z [N]."""
    node, share, z = coefficients(volume, x, n)
    e = np.einsum("nk,nkbc->nbc", share, volume.light[node])
    return np.maximum(sh.evaluate(e, n), 0), z


def explain(volume: ProbeVolume, x, n) -> list[dict]:
    """What each probe adds at one place: node, hat, ρ, share. For people who ask why it is dark here."""
    x, n = np.asarray(x, float).reshape(1, 3), np.asarray(n, float).reshape(1, 3)
    y = x + volume.offset * volume.lattice.spacing * n
    node, hat, rho = (v[0] for v in trust_at(volume, y))
    if volume.bricks is not None:
        more = [v[0] for v in fine_trust_at(volume, y)[:3]]
        node, hat, rho = (np.concatenate(pair) for pair in zip((node, hat, rho), more))
    nodes, share, _ = coefficients(volume, x, n)
    names = ("dropped", "open", "weighted")
    found = [
        {"node": int(p), "state": names[volume.state[p]], "hat": float(a), "rho": float(r), "share": float(s)}
        for p, a, r, s in zip(node, hat, rho, share[0])
    ]
    return [
        *found,
        {"node": int(nodes[0, -1]), "state": "fallback", "hat": 0.0, "rho": 0.0, "share": float(share[0, -1])},
    ]
