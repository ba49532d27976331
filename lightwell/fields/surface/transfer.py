"""Precomputed radiance transfer with clustered principal components (a baseline).

Indirect radiance over reflectance is linear in an expansion b(l) of the light: ``L(x, l) / ρ = T(x) b(l)``. A sun is
expanded in spherical harmonics of its direction; a near lamp in multilinear hat functions of its position over a
lattice across the range in which it moves. The transfer matrices T [3, K] of the nodes of a lattice over the scene,
read a little above the surface, are regressed from samples, from coarse lattices to fine ones. Then

    T(x) ≈ M_c + Σ_p w_p(x) E_cp

with a mean and P principal components per cluster c. Clusters are made of blocks of cells: in turns, the components of
each cluster are computed, and each block moves to the cluster that leaves the least error. The weights w are
interpolated between the nodes of a block.

Papers: Sloan, Kautz, Snyder, *Precomputed Radiance Transfer for Real-Time Rendering in Dynamic, Low-Frequency Lighting
Environments*, SIGGRAPH 2002; Sloan, Hall, Hart, Snyder, *Clustered Principal Components for Precomputed Radiance
Transfer*, SIGGRAPH 2003. What the view changes (their glossy transfer) is not represented.

Notation: K functions of the light, R cells along each axis, n of a block, B blocks, C clusters, P components.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from lightwell.fields.base import FieldSetup, Progress, query_inputs
from lightwell.fields.features import grid_point, open_builder
from lightwell.fields.surface.field import SurfaceField
from lightwell.files import Arrays
from lightwell.graph import Builder, Graph, evaluate, quantise
from lightwell.networks.checkpoint import check_like
from lightwell.networks.losses import EPSILON
from lightwell.networks.training import TrainingState
from lightwell.transport.samples import Query, Samples

# How far above the surface the lattice is read, in cells.
LIFT = 0.5
# A node's transfer is drawn to that of the coarser lattice as by so many samples.
PRIOR = 4.0
# Samples that are used at most, and rows of the graph that NumPy evaluates at a time.
MOST_SAMPLES, ROWS = 1 << 19, 1 << 16
# Iterations of the clustering (Sloan 2003, § 5: about ten), and of the k-means that starts it.
ITERATIONS, STARTING = 10, 5
CORNERS = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)])


@dataclass(frozen=True)
class TransferPreset:
    """Settings of a ``transfer`` field."""

    cells: int = 16
    """Cells of the finest lattice along each axis, a power of two times ``block``."""
    block: int = 4
    """Cells of a block along each axis."""
    clusters: int = 16
    components: int = 8
    lights: int = 4
    """Hat functions along each axis of a lamp's range."""
    bands: int = 4
    """Bands of spherical harmonics of a sun's direction, at most 4."""
    storage: str = "int8"


PRESETS: dict[str, TransferPreset] = {
    "default": TransferPreset(),
    # One cluster: plain principal components.
    "pca": TransferPreset(clusters=1, components=24),
    "small": TransferPreset(cells=8, clusters=8, components=6, lights=3),
}


@dataclass(frozen=True)
class Transfer:
    """Clustered transfer matrices."""

    cluster: np.ndarray
    """[B] cluster of each block."""
    weights: np.ndarray
    """[B, n + 1, n + 1, n + 1, P], axes z, y, x."""
    mean: np.ndarray
    """[C, 3K]."""
    components: np.ndarray
    """[C, P, 3K] orthonormal rows."""


def regress(places: np.ndarray, basis: np.ndarray, target: np.ndarray, weight: np.ndarray, cells: int) -> np.ndarray:
    """Regress the transfer matrices of the nodes of a lattice, from one cell to ``cells`` along each axis.

    Args:
        places: [N, 3] in [0, 1]^3.
        basis: [N, K] functions of the light.
        target: [N, 3].
        weight: [N] ≥ 0.
        cells: Cells along each axis, a power of two.

    Returns:
        [cells + 1, cells + 1, cells + 1, K, 3], axes z, y, x.
    """
    size = basis.shape[1]
    whole = (basis * weight[:, None]).T
    start = np.linalg.solve(whole @ basis + 1e-6 * weight.sum() * np.eye(size), whole @ target)
    nodes = np.broadcast_to(start, (2, 2, 2, size, 3)).copy()
    level = 1
    while True:
        nodes = _regressed(nodes, places, basis, target, weight, level)
        if level >= cells:
            return nodes
        nodes, level = _refined(nodes), 2 * level


def _refined(nodes: np.ndarray) -> np.ndarray:
    """Nodes of twice as many cells, interpolated."""
    for axis in range(3):
        a = np.moveaxis(nodes, axis, 0)
        fine = np.empty((2 * len(a) - 1, *a.shape[1:]), a.dtype)
        fine[::2], fine[1::2] = a, 0.5 * (a[1:] + a[:-1])
        nodes = np.moveaxis(fine, 0, axis)
    return nodes


def _regressed(
    prior: np.ndarray, places: np.ndarray, basis: np.ndarray, target: np.ndarray, weight: np.ndarray, cells: int
) -> np.ndarray:
    """Nodes that fit the samples around them, drawn to ``prior``; those without samples keep it."""
    scaled = np.clip(places, 0, 1) * cells
    low = np.minimum(scaled.astype(int), cells - 1)
    share = scaled - low
    node, size = [], []
    for corner in CORNERS:
        x, y, z = (low + corner).T
        node.append((z * (cells + 1) + y) * (cells + 1) + x)
        size.append(np.prod(np.where(corner, share, 1 - share), axis=1) * weight)
    owner, amount = np.concatenate(node), np.concatenate(size)
    sample = np.tile(np.arange(len(places)), len(CORNERS))
    order = np.argsort(owner, kind="stable")
    order = order[amount[order] > 0]
    starts = np.flatnonzero(np.diff(owner[order], prepend=-1))
    flat = prior.reshape(-1, *prior.shape[3:]).copy()
    ridge = PRIOR * weight.mean() * np.eye(basis.shape[1]) * np.square(basis).sum(axis=1).mean() / basis.shape[1]
    for rows in np.split(order, starts[1:]) if len(order) else ():
        which = sample[rows]
        here, b = flat[owner[rows[0]]], basis[which]
        gram = (b * amount[rows, None]).T
        flat[owner[rows[0]]] = here + np.linalg.solve(gram @ b + ridge, gram @ (target[which] - b @ here))
    return flat.reshape(prior.shape)


def cluster_blocks(
    vectors: np.ndarray, clusters: int, components: int, seed: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cluster blocks of vectors by the error that the principal components of a cluster leave (Sloan et al. 2003).

    Args:
        vectors: [B, V, D] V vectors of each block.
        clusters: C, at most; blocks of fewer clusters than asked for are possible.
        components: P.
        seed: Seed of the start.

    Returns:
        Cluster of each block [B], means [C, D], and components [C, P, D]: orthonormal rows, zero where there are fewer.
    """
    blocks, _, width = vectors.shape
    clusters = min(clusters, blocks)
    middle, rng = vectors.mean(axis=1), np.random.default_rng(seed)
    seeds = middle[rng.permutation(blocks)[:clusters]]
    for _ in range(STARTING):
        _, cluster = cKDTree(seeds).query(middle)
        members = [middle[cluster == c] for c in range(clusters)]
        seeds = np.stack([m.mean(axis=0) if len(m) else old for m, old in zip(members, seeds)])
    mean, parts = np.zeros((clusters, width)), np.zeros((clusters, components, width))
    for iteration in range(ITERATIONS):
        for c in np.unique(cluster):
            x = vectors[cluster == c].reshape(-1, width)
            mean[c] = x.mean(axis=0)
            _, _, rows = np.linalg.svd(x - mean[c], full_matrices=False)
            parts[c] = 0
            parts[c, : min(components, len(rows))] = rows[:components]
        if iteration + 1 < ITERATIONS:
            before, cluster = cluster, _best_cluster(vectors, mean, parts)
            if np.array_equal(before, cluster):
                break
    return cluster, mean, parts


def _best_cluster(vectors: np.ndarray, mean: np.ndarray, parts: np.ndarray) -> np.ndarray:
    """[B] cluster that leaves the least squared error of a block."""
    errors = []
    for m, rows in zip(mean, parts):
        x = vectors - m
        errors.append(np.square(x).sum(axis=(1, 2)) - np.square(x @ rows.T).sum(axis=(1, 2)))
    return np.argmin(errors, axis=0)


class TransferFit:
    """See ``lightwell.fields.base.Learner``. The fit is solved for in one go, when it is first asked for."""

    def __init__(self, setup: FieldSetup, preset: TransferPreset, seed: int) -> None:
        """Start a fit.

        Args:
            setup: Bounds, light and radiance unit of the scene.
            preset: Settings.
            seed: Seed of the clustering.
        """
        self._setup, self.preset, self._seed = setup, preset, seed
        self.state = TrainingState()
        self.facts: dict[str, Any] = {}
        # Range of the lamp, from the first samples.
        self._range: np.ndarray | None = None
        self._graph: Graph | None = None
        self._samples: Samples
        self._validation: Samples

    @property
    def macs(self) -> int:
        """Multiply-accumulates per pixel."""
        return self.lower().macs

    # ------------------------------------------------------------------ data

    def learn_from(self, samples: Samples) -> None:
        """Set the training samples.

        Args:
            samples: Path-traced samples.
        """
        self._samples, self._graph = samples, None
        if self._range is None:
            self._range = np.array([samples.query.light.min(axis=0), samples.query.light.max(axis=0)], float)

    def validate_on(self, samples: Samples) -> None:
        """Set the held-out samples on which the error is measured.

        Args:
            samples: Path-traced samples.
        """
        self._validation = samples

    def train(
        self, until: int, total: int, progress: Progress | None = None, checkpoint: Callable[[], None] | None = None
    ) -> bool:
        """Solve for the transfer.

        Args:
            until: Step to count up to.
            total: Steps of the schedule.
            progress: Called with the state and ``total`` after the solution.
            checkpoint: Called after the solution.

        Returns:
            True: nothing is left to do.
        """
        reference = self._validation.radiance / self._setup.unit
        error = np.abs(self.predict(self._validation.query) / self._setup.unit - reference) / (reference + EPSILON)
        self.state.step = self.state.best_step = until
        self.state.samples_seen = len(self._samples)
        self.state.best_error = float(error.mean())
        self.state.history.append((until, self.state.best_error, self.state.best_error))
        if progress:
            progress(self.state, total)
        if checkpoint:
            checkpoint()
        return True

    def predict(self, query: Query) -> np.ndarray:
        """Predict radiance.

        Args:
            query: N queries.

        Returns:
            [N, 3] radiance, reflectance included.
        """
        return self._evaluated(self.lower(), query, "radiance") * query.reflectance

    def arrays(self) -> Arrays:
        """Return the state of a resumed training; the transfer is solved for anew.

        Returns:
            Arrays by name.
        """
        return self.state.arrays()

    def restore(self, arrays: Arrays) -> None:
        """Restore the state.

        Args:
            arrays: Result of ``arrays``.
        """
        check_like(arrays, self.arrays(), ("history",))
        self.state = TrainingState.of(arrays)

    # ------------------------------------------------------------------ solve and lower

    def lower(self) -> Graph:
        """Return the shading graph.

        Returns:
            The graph.
        """
        if self._graph is None:
            occupied, transfer = self._solved()
            self._graph = quantise(self._lowered(occupied, transfer), self.preset.storage)
        return self._graph

    def _solved(self) -> tuple[np.ndarray, Transfer]:
        """(places [B, 3] of the blocks that surfaces touch, x first; their transfer)."""
        preset, samples = self.preset, self._samples
        if len(samples) > MOST_SAMPLES:
            samples = samples[np.sort(np.random.default_rng(self._seed).permutation(len(samples))[:MOST_SAMPLES])]
        b = open_builder()
        graph = b.build(place=self._place(b), basis=self._basis(b))
        place, basis = (self._evaluated(graph, samples.query, name).astype(float) for name in ("place", "basis"))
        target = samples.radiance / (self._setup.unit * samples.query.reflectance)
        weight = np.where(np.isfinite(target).all(axis=1), samples.weight, 0)
        nodes = regress(place, basis, np.where(weight[:, None] > 0, target, 0), weight, preset.cells)
        n = preset.block
        inside = np.minimum((np.clip(place, 0, 1) * preset.cells / n).astype(int), preset.cells // n - 1)
        occupied = np.unique(inside, axis=0)
        flat = nodes.reshape(*nodes.shape[:3], -1)
        parts = [flat[z * n : z * n + n + 1, y * n : y * n + n + 1, x * n : x * n + n + 1] for x, y, z in occupied]
        vectors = np.stack(parts).reshape(len(occupied), -1, flat.shape[-1])
        cluster, mean, rows = cluster_blocks(vectors, preset.clusters, preset.components, self._seed)
        weights = np.einsum("bvd,bpd->bvp", vectors - mean[cluster][:, None], rows[cluster])
        self.facts = {"blocks": len(occupied), "clusters": len(mean), "light_functions": basis.shape[1]}
        return occupied, Transfer(cluster, weights.reshape(len(occupied), n + 1, n + 1, n + 1, -1), mean, rows)

    def _evaluated(self, graph: Graph, query: Query, name: str) -> np.ndarray:
        """[N, C] of an output, by NumPy."""
        found = []
        for start in range(0, len(query), ROWS):
            inputs = query_inputs(query[start : start + ROWS])
            named = {key: inputs[key] for key in graph.inputs}
            value = evaluate(graph, named)[name]
            found.append(np.broadcast_to(value, (len(inputs["position"]), value.shape[1])))
        return np.concatenate(found)

    def _place(self, b: Builder) -> str:
        """Place in the lattice, [0, 1]^3."""
        return b.clamp(grid_point(b, self._setup, LIFT / self.preset.cells), 0.0, 1.0)

    def _basis(self, b: Builder) -> str:
        """Functions of the light, once per frame; without a variable light the constant 1."""
        if self._setup.light == "static":
            return b.affine(b.slice("position", 0, 1), [0.0], [1.0])
        if self._setup.light == "sun":
            return b.sh("light", self.preset.bands, per_frame=True)
        assert self._range is not None
        low, size = self._range[0], self._range[1] - self._range[0]
        counts = np.where(size > 0, self.preset.lights, 1)
        # Node i of k lies at the centre of texel i: hat functions are what a table of unit vectors interpolates.
        scale = np.where(size > 0, (counts - 1) / (np.maximum(size, 1e-12) * counts), 0)
        at = b.affine("light", scale, 0.5 / counts - low * scale, per_frame=True)
        total = int(counts.prod())
        return b.grid(at, np.eye(total).reshape(*counts[::-1], total), per_frame=True)

    def _lowered(self, occupied: np.ndarray, transfer: Transfer) -> Graph:
        b, n, side = open_builder(), self.preset.block, self.preset.cells // self.preset.block
        place, basis = self._place(b), self._basis(b)
        # Every block of the lattice names the nearest one that has a transfer, and where that begins.
        cells = np.stack(np.meshgrid(*[np.arange(side)] * 3, indexing="ij"), axis=-1)[..., ::-1].reshape(-1, 3)
        _, nearest = cKDTree(occupied).query(cells)
        table = np.column_stack([nearest, occupied[nearest] * n]).reshape(side, side, side, 4)
        block = b.nearest(place, table)
        inside = b.subtract(b.scale(place, self.preset.cells), b.slice(block, 1, 3))
        inside = b.clamp(inside, 0.0, float(n))
        number = b.slice(block, 0, 1)
        # Blocks are stacked along z; nodes lie at the centres of texels, so that no block reads another.
        count, width = len(occupied), n + 1
        offset = b.concat(b.scale(number, 0.0), b.scale(number, 0.0), b.scale(number, 1 / count))
        size = np.array([width, width, width * count])
        at = b.add(b.affine(inside, 1 / size, 0.5 / size), offset)
        components = transfer.weights.shape[-1]
        weights = b.grid(at, transfer.weights.reshape(count * width, width, width, components))
        cluster = b.rows(number, transfer.cluster[:, None].astype(float))
        matrices, functions = _matrices(transfer), transfer.mean.shape[1] // 3
        y = b.linear(basis, matrices.reshape(len(transfer.mean), -1, functions), np.zeros(matrices.shape[:2]), cluster)
        x = b.add(b.slice(y, 0, 3), b.matvec(b.slice(y, 3, 3 * components), weights, 3))
        return b.build(radiance=b.scale(b.clamp(x, 0.0, 1e6), self._setup.unit))


def _matrices(transfer: Transfer) -> np.ndarray:
    """[C, 3 (1 + P), K]: rows of the mean, then of the colours, each with all components."""
    clusters, width = transfer.mean.shape
    mean = transfer.mean.reshape(clusters, width // 3, 3).transpose(0, 2, 1)
    parts = transfer.components.reshape(clusters, -1, width // 3, 3).transpose(0, 3, 1, 2)
    return np.concatenate([mean, parts.reshape(clusters, -1, width // 3)], axis=1)


FIELD = SurfaceField("transfer", PRESETS, TransferFit)
