"""Baking the weights of a volume, whole or only where a box of the scene has changed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from lightwell.probes.assemble import assemble
from lightwell.probes.lattice import Lattice
from lightwell.probes.support import Support, bake_support, touched, trust, update
from lightwell.probes.volume import ProbeVolume
from lightwell.scenes.scene import Scene

# Largest lattice that a bake takes on without being asked for a coarser one.
MOST_NODES = 200_000


@dataclass(frozen=True)
class Geometry:
    """A volume without light, and what it was made of: kept for incremental bakes."""

    volume: ProbeVolume
    support: Support
    target: np.ndarray
    """[P, Q] float16 trust."""
    seconds: dict[str, float]
    """Of rays, trust and fit."""


def bake_geometry(
    scene: Scene, spacing: float, function: str, offset=(0.0, 0.0, 0.0), fit=None, lattice: Lattice | None = None
) -> Geometry:
    """Rays, trust and weights of a whole scene."""
    lattice = lattice or Lattice.around(scene.bounds, spacing, offset)
    if len(lattice) > MOST_NODES:
        raise ValueError(
            f"probes: --spacing {spacing:g} needs {len(lattice):,} nodes, more than {MOST_NODES:,}; use a wider one"
        )
    clock = [perf_counter()]
    support = bake_support(scene, lattice)
    clock.append(perf_counter())
    # Rounded before it is used, so that a bake that goes on from what was kept does the same.
    target = trust(scene, support, np.arange(len(lattice))).astype(np.float16)
    clock.append(perf_counter())
    volume = assemble(support, target.astype(np.float32), function, fit=fit)
    clock.append(perf_counter())
    names = ("rays", "trust", "fit")
    return Geometry(volume, support, target, dict(zip(names, np.diff(clock).tolist())))


def rebake(scene: Scene, before: Geometry, box: np.ndarray, fit=None) -> tuple[Geometry, np.ndarray]:
    """The weights after the scene has changed inside ``box`` [2, 3]; and the nodes that were computed again.

    Everything that the box does not touch keeps its bytes.
    """
    cells, near, nodes = touched(before.support.lattice, np.asarray(box, np.float64))
    kept = before.support
    support = replace(
        kept,
        valid=kept.valid.copy(),
        free=kept.free.copy(),
        origin=kept.origin.copy(),
        alive=kept.alive.copy(),
    )
    clock = perf_counter()
    update(scene, support, cells, near, nodes)
    target = before.target.copy()
    target[nodes] = trust(scene, support, nodes)
    old = before.volume
    fitted = (old.row, old.params)
    volume = assemble(support, target.astype(np.float32), old.function, fit=fit, kept=fitted, changed=nodes)
    volume = replace(volume, light=np.where(volume.alive[:, None, None], old.light, 0))
    return Geometry(volume, support, target, {"rebake": perf_counter() - clock}), nodes
