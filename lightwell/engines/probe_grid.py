"""Irradiance probes on a lattice, without holes, for engines that interpolate between all of them.

Engines have no visibility weights: a probe inside a wall takes the light of the nearest probe in the open.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from lightwell.limits import Limits
from lightwell.probes import sh
from lightwell.probes.file import read
from lightwell.probes.lattice import ProbeLattice

# From the signs of the graph's harmonics to positive multiples of 1, y, z, x, xy, yz, 3z² − 1, xz, x² − y².
SIGNS = np.array([1, -1, 1, -1, 1, -1, 1, -1, 1.0])
# Harmonics that are odd in x.
ODD_IN_X = np.array([3, 4, 7])


@dataclass(frozen=True)
class ProbeGrid:
    """Probes at all nodes of a lattice."""

    lattice: ProbeLattice
    """The nodes; x runs fastest, then y, then z."""
    irradiance: np.ndarray
    """[P, 9, 3] float64 irradiance harmonics, signs included, in the order of the graph's ``sh``."""

    @property
    def radiance(self) -> np.ndarray:
        """[P, 9, 3] float64 radiance harmonics without signs, as Godot and three.js store them."""
        return self.irradiance * (SIGNS / sh.TO_IRRADIANCE)[:, None]

    def along(self, direction: Sequence[float]) -> np.ndarray:
        """Evaluate the irradiance of every probe for one normal.

        Args:
            direction: [3] unit normal.

        Returns:
            [P, 3] irradiance ≥ 0.
        """
        basis = sh.basis(np.asarray([direction], float))[0]
        return np.maximum(np.einsum("k,pkc->pc", basis, self.irradiance), 0)


def read_grid(files: Sequence[Path], limits: Limits | None = None) -> ProbeGrid:
    """Read probe volumes of the same lattice and add their light.

    Args:
        files: At least one .lwp file; roles of one bake.
        limits: Largest memory that a volume may need; None for the defaults of ``Limits``.

    Returns:
        The probes of the coarse lattice; finer probes of bricks are left out.

    Raises:
        ValueError: A file is no probe volume, or the lattices differ.
    """
    volumes = [read(file, limits) for file in files]
    lattice = volumes[0].lattice
    total = np.zeros((len(lattice), 9, 3))
    for file, volume in zip(files, volumes):
        if volume.lattice.shape != lattice.shape or not np.allclose(volume.lattice.origin, lattice.origin):
            raise ValueError(f"export: '{file}' has another lattice than '{files[0]}'; bake their lights together")
        total += filled(volume.light[: len(lattice)], volume.alive[: len(lattice)], lattice)
    return ProbeGrid(lattice, total)


def filled(light: np.ndarray, alive: np.ndarray, lattice: ProbeLattice) -> np.ndarray:
    """Give every probe that holds no light that of the nearest one that does.

    Args:
        light: [P, 9, 3] harmonics.
        alive: [P] bool: the probe holds light.
        lattice: The lattice of the P nodes.

    Returns:
        [P, 9, 3] float64 harmonics; zeros where no probe holds light.
    """
    out = np.asarray(light, np.float64).copy()
    if alive.any() and not alive.all():
        positions = lattice.nodes()
        nearest = cKDTree(positions[alive]).query(positions[~alive])[1]
        out[~alive] = out[alive][nearest]
    return out
