"""Nanoseconds of a probe query by each method: one made-up lattice, the same harmonics, cell-sorted queries."""

from __future__ import annotations

from time import perf_counter

import numpy as np
import probe_device as device

from lightwell.backend import dr, mi
from lightwell.probes import ddgi
from lightwell.probes.lattice import ProbeLattice
from lightwell.probes.sheets import Sheets
from lightwell.probes.volume import OPEN, WEIGHTED, ProbeVolume
from lightwell.probes.weights import FUNCTIONS

# Share of the cells that a thin wall crosses.
CUT = 0.2
SIDE = 24


def measure(count: int, rounds: int) -> dict[str, float]:
    """Method to median nanoseconds of a query, methods taking turns."""
    lattice = ProbeLattice(np.zeros(3), 1.0, (SIDE,) * 3)
    rng, nodes = np.random.default_rng(0), SIDE**3
    light = rng.random((nodes, 9, 3)).astype(np.float32)
    place = rng.random((count, 3)) * (SIDE - 1)
    cell = np.floor(place).astype(int) @ (1, SIDE, SIDE**2)
    place = place[np.argsort(cell, kind="stable")].astype(np.float32)
    normal = rng.standard_normal((count, 3)).astype(np.float32)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    x, n = (kind(np.ascontiguousarray(v.T)) for kind, v in ((mi.Point3f, place), (mi.Vector3f, normal)))
    asked = {
        name: device.learned(_volume(name, lattice, light, rng)) for name in ("relu-field", "product-field", "mlp")
    }
    asked["trilinear"] = device.trilinear(_volume("relu-field", lattice, light, rng, OPEN))
    maps = rng.random((nodes, ddgi.SIDE, ddgi.SIDE, 2)).astype(np.float32)
    asked["ddgi"] = device.chebyshev(ddgi.Moments(lattice, lattice.nodes(), np.ones(nodes, bool), maps, light))
    taken = {name: [] for name in asked}
    for _ in range(rounds + 1):
        for name, ask in asked.items():
            start = perf_counter()
            found, _ = ask(x, n)
            dr.eval(found)
            dr.sync_thread()
            taken[name].append(perf_counter() - start)
    # The first round compiles.
    return {name: 1e9 * float(np.median(times[1:])) / count for name, times in taken.items()}


def _volume(function: str, lattice: ProbeLattice, light: np.ndarray, rng, state: int = WEIGHTED) -> ProbeVolume:
    count, f = len(lattice), FUNCTIONS[function]
    return ProbeVolume(
        lattice,
        function,
        np.full(count, state, np.uint8),
        np.arange(count, dtype=np.int32),
        f.quantised(rng.normal(0.5, 0.3, (count, f.parameters)).astype(np.float32)),
        np.full(count, 0xFFFFFFFFFFFFFFFF, np.uint64),
        np.zeros((lattice.cell_count, 8), np.int32),
        light,
        _sheets(lattice.cell_count, rng),
    )


def _sheets(cells: int, rng) -> Sheets:
    """Planes through the middles of some cells, each with four corners on a side."""
    normal = rng.standard_normal((cells, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    planes = np.column_stack([normal, -0.5 * normal.sum(axis=1)]) * (rng.random(cells) < CUT)[:, None]
    return Sheets.of_cells(planes, np.full(cells, 0xF00F, np.uint16))
