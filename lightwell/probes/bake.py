"""Bakes the weights of a volume: all of them, or only where the scene has changed inside a box."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from lightwell.probes import bricks
from lightwell.probes.assemble import BrickLevel, ProbeRecords, assemble, records
from lightwell.probes.fallbacks import ROUNDS, around, fallbacks, nearest_probes
from lightwell.probes.lattice import ProbeLattice
from lightwell.probes.pattern import pattern
from lightwell.probes.sheets import changed_nodes, find_sheets
from lightwell.probes.support import Support, bake_support, touched, trust, update
from lightwell.probes.volume import Bricks, ProbeVolume
from lightwell.probes.weights import Fit
from lightwell.scenes.scene import Scene

# Largest number of nodes that a bake accepts.
MOST_NODES = 200_000


@dataclass(frozen=True)
class Geometry:
    """A volume without light and the data that it was computed from, which incremental bakes need."""

    volume: ProbeVolume
    levels: tuple[BrickLevel, ...]
    """The lattice; with bricks also their fine lattice."""
    records: tuple[ProbeRecords, ...]
    """Stored weights of each level."""
    first: np.ndarray
    """[C, 8] int32 fallback probes before octants take those of their neighbours; see ``nearest_probes``."""
    seconds: dict[str, float]
    """Duration of each stage, such as rays, trust and fit."""

    @property
    def support(self) -> Support:
        """Geometry of the lattice's level."""
        return self.levels[0].support

    @property
    def target(self) -> np.ndarray:
        """[P, Q] float16 trust of the lattice's nodes at the points of their cubes."""
        return self.levels[0].target[:, : self.levels[0].points]


def bake_geometry(
    scene: Scene,
    spacing: float,
    function: str,
    offset: Sequence[float] = (0.0, 0.0, 0.0),
    fit: Fit | None = None,
    lattice: ProbeLattice | None = None,
) -> Geometry:
    """Compute rays, trust and weights for a whole scene.

    Args:
        scene: The scene.
        spacing: Distance of the probes, metres, > 0.
        function: Name of the weight function, one of ``FUNCTIONS``.
        offset: [3] start of the lattice within a cell, in [0, 1).
        fit: Replaces the function's own fit; None for its own.
        lattice: Lattice to use in place of one made from ``spacing`` and ``offset``.

    Returns:
        The volume without bricks and without light.

    Raises:
        ValueError: The lattice has more than ``MOST_NODES`` nodes.
    """
    # Ground of kilometres gets no probes: what moves is where people look, and beyond it the outermost probes are used.
    lattice = lattice or ProbeLattice.around(scene.core, spacing, offset)
    if len(lattice) > MOST_NODES:
        raise ValueError(
            f"probes: --spacing {spacing:g} needs {len(lattice):,} nodes, more than {MOST_NODES:,}; use a wider one"
        )
    clock = [perf_counter()]
    support = bake_support(scene, lattice)
    clock.append(perf_counter())
    nodes = np.arange(len(lattice))
    level = _level(scene, support, nodes)
    clock.append(perf_counter())
    found = records(level, function, fit)
    cells = np.arange(lattice.cell_count)
    first = nearest_probes(level, found.state, cells)
    volume = assemble(level, function, found, fallbacks(level, found.state, first, cells))
    clock.append(perf_counter())
    names = ("rays", "trust", "fit")
    return Geometry(volume, (level,), (found,), first, dict(zip(names, np.diff(clock).tolist())))


def _level(scene: Scene, support: Support, nodes: np.ndarray) -> BrickLevel:
    """Trust and sheets of some nodes."""
    target = trust(scene, support, nodes)
    return BrickLevel(support, nodes, target, find_sheets(scene, support, nodes, target))


def with_bricks(scene: Scene, geometry: Geometry, chosen: np.ndarray, fit: Fit | None = None) -> Geometry:
    """Add bricks to a volume.

    Args:
        scene: The scene.
        geometry: Volume without bricks.
        chosen: [B] sorted indices of the cells that get a brick.
        fit: Replaces the weight function's own fit; None for its own.

    Returns:
        The volume with bricks; the same object when no cell is chosen.
    """
    if not len(chosen):
        return geometry
    clock, coarse, volume = perf_counter(), geometry.levels[0], geometry.volume
    nodes, table = bricks.layout(volume.lattice, chosen)
    cells = bricks.fine_cells(volume.lattice, chosen)
    lattice = bricks.fine_lattice(volume.lattice)
    support = bake_support(scene, lattice, pattern(bricks.FINE_POINTS), cells, nodes)
    level = _level(scene, support, nodes)
    found = records(level, volume.function, fit)
    made = assemble(coarse, volume.function, geometry.records[0], volume.fallback, (level, found, table))
    seconds = geometry.seconds | {"bricks": perf_counter() - clock}
    return Geometry(made, (coarse, level), (geometry.records[0], found), geometry.first, seconds)


def rebake(scene: Scene, before: Geometry, box: np.ndarray, fit: Fit | None = None) -> tuple[Geometry, np.ndarray]:
    """Compute the weights again after the scene has changed inside a box.

    Everything that the box does not touch keeps its bytes, and what it touches gets those of a whole bake. Bricks
    stay where they are.

    Args:
        scene: The scene after the change.
        before: The bake before the change.
        box: [2, 3] least and greatest corner, metres.
        fit: Replaces the weight function's own fit; None for its own.

    Returns:
        The new bake, and the indices of the probes whose weights were computed again.
    """
    clock, box = perf_counter(), np.asarray(box, np.float64)
    levels, found, rows = [], [], []
    for level, kept in zip(before.levels, before.records):
        made, changed = _again(scene, level, box)
        levels.append(made)
        found.append(records(made, before.volume.function, fit, changed, kept))
        rows.append(changed)
    coarse, volume = levels[0], before.volume
    # Fallbacks of the cells whose corners have changed, and of the cells that take theirs.
    near = _cells_of(coarse.support.lattice, coarse.nodes[rows[0]])
    first = before.first.copy()
    first[near] = nearest_probes(coarse, found[0].state, near)
    wide = around(coarse.support.lattice, near, ROUNDS // 2 + 1)
    fallback = volume.fallback.copy()
    fallback[wide] = fallbacks(coarse, found[0].state, first, wide)
    table: Bricks | None = volume.bricks
    fine = None if table is None else (levels[1], found[1], table)
    whole = assemble(coarse, volume.function, found[0], fallback, fine)
    whole = replace(whole, light=np.where(whole.alive[:, None, None], volume.light, 0), offset=volume.offset)
    again = np.concatenate([r + (len(volume.lattice) if k else 0) for k, r in enumerate(rows)])
    return Geometry(whole, tuple(levels), tuple(found), first, {"rebake": perf_counter() - clock}), again


def _again(scene: Scene, level: BrickLevel, box: np.ndarray) -> tuple[BrickLevel, np.ndarray]:
    """A level after the rays of touched cells and cubes have been cast again, and the rows of the changed nodes."""
    support = level.support.copy()
    cells, near, nodes = touched(support.lattice, box)
    cells, near = (part[support.slot[part] >= 0] for part in (cells, near))
    rows = np.flatnonzero(np.isin(level.nodes, nodes))
    update(scene, support, cells, near, level.nodes[rows])
    target = level.target.copy()
    if len(rows):
        target[rows] = trust(scene, support, level.nodes[rows])
    sheets = find_sheets(scene, support, level.nodes, target, near, level.sheets)
    # A record depends on the sheets of its cube as well.
    others = np.isin(level.nodes, changed_nodes(support.lattice, level.sheets, sheets))
    rows = np.union1d(rows, np.flatnonzero(others))
    return BrickLevel(support, level.nodes, target, sheets), rows


def _cells_of(lattice: ProbeLattice, nodes: np.ndarray) -> np.ndarray:
    """Sorted indices of the cells around some nodes."""
    cells = np.unique(lattice.node_cells(nodes))
    return cells[cells >= 0]
