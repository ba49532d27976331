"""Baked probes: light under some states of the variable light, reduced to bases, and the spline that mixes the bases.

The shading graph, the files, the page, and the state of an incremental bake are written from this.
Notation: P nodes, F fine probes, S states, K bases.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from lightwell.core.formats import COMPRESSED
from lightwell.core.keys import Key, key
from lightwell.core.store import Store
from lightwell.fields.protocol import ExtraFile, Shown
from lightwell.files import Arrays, write_atomically
from lightwell.graph import Graph
from lightwell.probes import ddgi
from lightwell.probes.checkpoint import VERSION, state_arrays, state_of
from lightwell.probes.file import BRIGHTEST, encode_volume
from lightwell.probes.light import SolvedVolume, relit
from lightwell.probes.low_rank import LowRank
from lightwell.probes.lower import lower
from lightwell.probes.page import write_page
from lightwell.probes.spline import SplineMix
from lightwell.probes.volume import ProbeVolume
from lightwell.probes.weights import Fit
from lightwell.scenes.scene import Scene
from lightwell.scenes.variables import Variable

# Lattices with more nodes than this have no baselines in their page: a kilobyte a node.
MOST_COMPARED = 4096
# Arrays of a spline.
SPLINE = ("at", "weights", "slope", "offset")


@dataclass(frozen=True)
class BakedProbes:
    """Baked probes; see the module."""

    lit: SolvedVolume
    rank: LowRank | None
    """Factors of the bases in the states; None: the scene's own light."""
    code: SplineMix | None
    """K factors by the light's position; None: the scene's own light."""
    unit: float
    """Radiance unit S of the shading graph."""
    preset: str
    coding: str = "zh3"

    @cached_property
    def basis(self) -> np.ndarray:
        """Compute the stored bases.

        Returns:
            [P + F, 9, 3, K] float32 spherical harmonics.
        """
        return self._bases(self.lit.solution.light)

    def _bases(self, states: np.ndarray) -> np.ndarray:
        """[P + F, 9, 3, K] bases of light."""
        return states[..., None] if self.rank is None else self.rank.bases(states)

    def lower(self) -> Graph:
        """Return the shading graph; the factors are computed once per frame.

        Returns:
            The graph.
        """
        return lower(self.lit.geometry.volume, self.unit, storable(self.basis / self.unit), self.code)

    def factors(self, light: np.ndarray) -> np.ndarray:
        """Compute the factors of the bases under a light.

        Args:
            light: [3] position of the light in metres, or direction towards the sun.

        Returns:
            [K] factors.
        """
        if self.code is None:
            return np.ones(1)
        return self.code.factors(np.reshape(light, (1, 3)))[0]

    def volume(self, light: np.ndarray | None = None, intensity: np.ndarray | float = 1.0) -> ProbeVolume:
        """Compute the probe volume under a light.

        Args:
            light: [3] position of the light in metres, or direction towards the sun; None: without a variable light.
            intensity: Intensity in cd or lx: a scalar or [3] by colour.

        Returns:
            The volume.
        """
        return self.lit.geometry.volume.lit(self._under(self.basis, light, intensity))

    def _under(self, basis: np.ndarray, light: np.ndarray | None, intensity: np.ndarray | float) -> np.ndarray:
        gain = np.ones(3) if self.code is None else np.broadcast_to(intensity, 3)
        return (basis @ self.factors(light)) * gain

    def files(
        self, role: str, glb: Path, scene: Scene, shown: Shown, store: Store | None
    ) -> tuple[list[ExtraFile], dict[str, float]]:
        """List the files beside the asset.

        ``probes-ROLE.lwp`` is for lights of three.js. ``probes-ROLE-compare.lwp`` has the baselines too;
        ``probes.html`` shows it with the scene.

        Args:
            role: Role of the fit.
            glb: Path of the asset.
            scene: The scene.
            shown: The light under which the bake is shown first.
            store: Where to keep what an incremental bake starts from; None: it is not kept.

        Returns:
            The files, and bytes per live probe by part.
        """
        lit = self.volume(shown.light, shown.intensity)
        mean = float(np.abs(lit.light[lit.alive, 0]).mean()) if lit.alive.any() else 1.0
        plain, parts = encode_volume(lit, self.coding, unit=max(mean, 1e-20))
        data = plain
        if len(lit.lattice) <= MOST_COMPARED:
            as_traced = self._under(self._bases(self.lit.start), shown.light, shown.intensity)
            support = self.lit.geometry.support
            moments = ddgi.bake_moments(scene, support, as_traced[: len(lit.lattice)], 0.0)
            data, _ = encode_volume(lit, self.coding, unit=max(mean, 1e-20), baselines=moments)
        files = [_bytes_file(f"probes-{role}.lwp", plain)]
        files += [_bytes_file(f"probes-{role}-compare.lwp", data)] if data is not plain else []
        files.append(ExtraFile("probes.html", "text/html", lambda path: write_page(path, data, glb.read_bytes())))
        if store is not None:
            store.put(state_key(role), self.arrays(shown), COMPRESSED)
        return files, parts

    def arrays(self, shown: Shown) -> Arrays:
        """Collect what an incremental bake starts from.

        Args:
            shown: The light under which the bake is shown first.

        Returns:
            Arrays of any shape by name.
        """
        facts = {"preset": self.preset, "unit": self.unit, "coding": self.coding}
        more = {"light": np.float64(shown.light), "intensity": np.float64(shown.intensity)}
        if self.code is not None and self.rank is not None:
            more["mix"] = self.rank.factors
            facts |= {"mean": self.rank.level}
            facts |= {"center": list(self.code.center), "half": self.code.half, "level": self.code.level}
            more |= {f"spline.{name}": np.asarray(getattr(self.code, name), np.float64) for name in SPLINE}
        return state_arrays(self.lit, facts, more)

    @staticmethod
    def of(arrays: Arrays) -> tuple[BakedProbes, Shown]:
        """Restore and check what ``arrays`` returned.

        Args:
            arrays: Arrays of any shape by name.

        Returns:
            The probes, and the light under which they were shown.

        Raises:
            ValueError: The arrays do not describe baked probes.
        """
        lit, facts, more = state_of(arrays)
        try:
            states = 1 if lit.lights is None else len(lit.lights)
            rank, code, good = None, None, True
            if lit.lights is not None:
                level = None if facts["level"] is None else float(facts["level"])
                tables = {name: np.asarray(more[f"spline.{name}"], np.float64) for name in SPLINE}
                code = SplineMix(tuple(float(c) for c in facts["center"]), float(facts["half"]), **tables, level=level)
                rank = LowRank(np.asarray(more["mix"], np.float64), float(facts["mean"]))
                good = rank.is_of(states) and code.gives(rank.factors.shape[1], states)
            shown = Shown(*(np.asarray(more[name], np.float64).reshape(3) for name in ("light", "intensity")))
            made = BakedProbes(lit, rank, code, float(facts["unit"]), str(facts["preset"]), str(facts["coding"]))
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError("not the state of light probes") from error
        if not good or not 0 < made.unit < 1e30 or made.coding not in ("l2", "zh3"):
            raise ValueError("not the state of light probes")
        return made, shown

    def rebaked(
        self, scene: Scene, variable: Variable, box: np.ndarray, fit: Fit | None
    ) -> tuple[BakedProbes, np.ndarray]:
        """Solve again the probes that a change of the scene affects.

        The bases are mixed as before, and nothing is trained.

        Args:
            scene: The changed scene.
            variable: Ranges of the light; None: no variable light.
            box: [2, 3] corners of the changed region, metres.
            fit: Fits interpolation weights; None: from scratch.

        Returns:
            The probes, and the [R] int numbers of those that were solved again.
        """
        lit, again = relit(scene, self.lit, box, fit, variable)
        return replace(self, lit=lit), again


def storable(basis: np.ndarray) -> np.ndarray:
    """Darken probes that are too bright for the half floats of a shading graph: those beside a small lamp.

    Args:
        basis: [P, 9, 3, K] bases in the graph's unit.

    Returns:
        [P, 9, 3, K] bases whose band 0 is at most ``BRIGHTEST``; a probe that is darkened keeps its colour and the
        shape of its light.
    """
    largest = np.abs(basis[:, :1]).max(axis=(1, 2, 3), keepdims=True, initial=0)
    return basis if largest.max(initial=0) <= BRIGHTEST else basis * (BRIGHTEST / np.maximum(largest, BRIGHTEST))


def state_key(role: str) -> Key:
    """Return the key of what an incremental bake starts from, in the store of the earlier bake.

    Args:
        role: Role of the fit.

    Returns:
        The key. It names no settings, because the store belongs to one bake.
    """
    return key("probes.state", VERSION, role=role)


def singular_mix(states: np.ndarray, live: np.ndarray, rank: int) -> np.ndarray:
    """Compute the factors of the leading singular vectors, scaled so that the code of a state is about 1.

    Args:
        states: [S, P, 9, 3] light of the states.
        live: [P] bool or int indices of the probes that count.
        rank: Most bases K.

    Returns:
        [S, K] factors.
    """
    matrix = states[:, live].reshape(len(states), -1).astype(np.float64)
    # All states have equal weight, however near the light is to a wall: each is divided by its norm.
    size = np.linalg.norm(matrix, axis=1, keepdims=True)
    share = np.where(size > 0, 1 / np.maximum(size, 1e-30), 0)
    u, s, _ = np.linalg.svd(matrix * share, full_matrices=False)
    k = min(rank, len(s))
    return u[:, :k] * share * float(np.median(size)) / np.sqrt(len(states))


def _bytes_file(name: str, data: bytes) -> ExtraFile:
    return ExtraFile(name, "application/octet-stream", lambda path: write_atomically(path, data) and None)
