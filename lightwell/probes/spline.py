"""Mixing factors of K bases, interpolated between states of a light, and of what moves beside it.

A thin-plate spline (Duchon 1977) in D = 3 + M coordinates: three of the place of the light, or of a direction, and the
sliders of M movers, all from -1 to 1 or so:

    c_k(x) = Σ_s w_sk φ(|x - x_s|²) + a_k · x + b_k,   φ(q) = q log(q + ε)

It passes through the factors of all S states. Where the brightness of the light in the air changes by orders of
magnitude, as with a lamp near walls, the spline is that of the factors over their norm and of the logarithm of the
norm, and c_k is the product: bright states do not spread into dim ones between them. The coordinates of a sun on its
arc lie in a plane, those of an environment map that turns on a circle: the system then has many solutions, of which
the least is taken.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lightwell.graph import Builder, evaluate
from lightwell.graph.ops.activate import EXP_LOW

# ε: beside a state, q is known to a few millionths in single precision.
EPSILON = 1e-6


@dataclass(frozen=True)
class EndStop:
    """What changes the factors where something stands at an end of its range; see ``lightwell.probes.end_stops``."""

    mover: int
    """Index of its slider."""
    at: float
    """The slider there, 0 or 1."""
    reach: float
    """How far from there the change fades out, of the range."""
    change: np.ndarray
    """[K, K] what is added to the factors, as a function of them."""

    def node(self, b: Builder, factors: str) -> str:
        """Add the change to a graph.

        Args:
            b: Graph under construction with the input ``pose``.
            factors: Name of the node with the K factors.

        Returns:
            Name of the node with the changed ones.
        """
        frame, count = {"per_frame": True}, len(self.change)
        slope = (2 * self.at - 1) / self.reach
        near = b.affine(b.slice("pose", self.mover, 1, **frame), [slope], [1 - slope * self.at], **frame)
        near = b.clamp(near, low=0.0, high=1.0, **frame)
        change = b.linear(factors, self.change, np.zeros(count), **frame)
        return b.add(factors, b.multiply(change, b.concat(*[near] * count, **frame), **frame), **frame)


@dataclass(frozen=True)
class SplineMix:
    """A spline; notation of the module."""

    center: tuple[float, float, float]
    """Middle of the places of the light, metres; 0 for directions."""
    half: float
    """Half of their longest edge, metres; 1 for directions."""
    at: np.ndarray
    """[S, D] coordinates of the states."""
    weights: np.ndarray
    """[K, S] w."""
    slope: np.ndarray
    """[K, D] a."""
    offset: np.ndarray
    """[K] b."""
    level: float | None = None
    """Logarithm of the largest norm of the factors: the last row of ``weights``, ``slope`` and ``offset`` is then the
    logarithm of the norm less this; None: all rows are factors."""
    stops: tuple[EndStop, ...] = ()
    """End stops at which something is dark."""

    @staticmethod
    def of(
        light: np.ndarray, pose: np.ndarray, factors: np.ndarray, directions: bool, levels: bool = False
    ) -> SplineMix:
        """Make the spline through states.

        Args:
            light: [S, 3] positions of the light, metres, or unit directions.
            pose: [S, M] sliders of what moves.
            factors: [S, K] factors of the bases in these states.
            directions: Whether the light has a direction in place of a position.
            levels: Whether factors and their norm are interpolated apart.

        Returns:
            The spline.
        """
        level = None
        if levels and (largest := float(np.linalg.norm(factors, axis=1).max())) > 0:
            norm = np.maximum(np.linalg.norm(factors, axis=1, keepdims=True), largest * np.exp(EXP_LOW))
            level = float(np.log(largest))
            factors = np.concatenate([factors / norm, np.log(norm) - level], axis=1)
        low, high = light.min(axis=0).astype(np.float64), light.max(axis=0).astype(np.float64)
        x, y, z = (0.0, 0.0, 0.0) if directions else (float(v) for v in (low + high) / 2)
        half = 1.0 if directions else max(float((high - low).max()) / 2, 1e-6)
        at = np.concatenate([(light - np.array([x, y, z])) / half, 2 * pose - 1], axis=1).astype(np.float64)
        count, size = at.shape
        q = np.square(at[:, None] - at[None]).sum(axis=2)
        rest = np.concatenate([at, np.ones((count, 1))], axis=1)
        system = np.block([[q * np.log(q + EPSILON), rest], [rest.T, np.zeros((size + 1, size + 1))]])
        wanted = np.concatenate([factors, np.zeros((size + 1, factors.shape[1]))])
        found = np.linalg.lstsq(system, wanted, rcond=1e-9)[0].T
        return SplineMix((x, y, z), half, at, found[:, :count], found[:, count:-1], found[:, -1], level)

    def gives(self, bases: int, states: int) -> bool:
        """Check a spline of one light that was read from a file.

        Args:
            bases: K that is expected.
            states: S that is expected.

        Returns:
            Whether all numbers are finite and of these sizes.
        """
        rows = bases + (self.level is not None)
        sizes = (self.at.shape, self.weights.shape, self.slope.shape, self.offset.shape)
        numbers = (*self.center, self.half, self.level or 0.0)
        finite = all(np.isfinite(v).all() for v in (self.at, self.weights, self.slope, self.offset, numbers))
        return sizes == ((states, 3), (rows, states), (rows, 3), (rows,)) and finite and 0 < self.half < 1e9

    @property
    def inputs(self) -> dict[str, int]:
        """Inputs of a graph that the factors depend on, and their widths."""
        movers = self.at.shape[1] - 3
        return {"light": 3} | ({"pose": movers} if movers else {})

    def mixed(self, b: Builder, bases: str) -> str:
        """Add the sum of the bases times their factors to a graph.

        Args:
            b: Graph under construction with ``inputs``.
            bases: Name of the node with the bases [27 K], the factor's index fastest.

        Returns:
            Name of the node with the 27 numbers.
        """
        return b.matvec(bases, self.node(b), 27)

    def node(self, b: Builder) -> str:
        """Add the spline to a graph.

        Args:
            b: Graph under construction with ``inputs``.

        Returns:
            Name of the node with the K factors.
        """
        found = self._spline(b)
        for stop in self.stops:
            found = stop.node(b, found)
        return found

    def _spline(self, b: Builder) -> str:
        """The factors of the spline alone."""
        frame, movers, count = {"per_frame": True}, self.at.shape[1] - 3, len(self.at)
        x = b.affine("light", [1 / self.half] * 3, [-c / self.half for c in self.center], **frame)
        if movers:
            x = b.concat(x, b.affine("pose", [2.0] * movers, [-1.0] * movers, **frame), **frame)
        # |x - x_s|² = |x|² - 2 x_s · x + |x_s|².
        rows = np.concatenate([np.ones((count, 1)), -2 * self.at], axis=1)
        q = b.linear(b.concat(b.dot(x, x, **frame), x, **frame), rows, np.square(self.at).sum(axis=1), **frame)
        phi = b.multiply(q, b.log(q, EPSILON, **frame), **frame)
        weights = np.concatenate([self.weights, self.slope], axis=1)
        found = b.linear(b.concat(phi, x, **frame), weights, self.offset, **frame)
        if self.level is None:
            return found
        bases = len(weights) - 1
        # No light is brighter than the brightest state: the spline of the norm would overshoot near walls.
        norm = b.clamp(b.slice(found, bases, 1, **frame), EXP_LOW, 0.0, **frame)
        norm = b.scale(b.activate(norm, "exp", **frame), float(np.exp(self.level)), **frame)
        return b.multiply(b.slice(found, 0, bases, **frame), b.concat(*[norm] * bases, **frame), **frame)

    def factors(self, light: np.ndarray, pose: np.ndarray | None = None) -> np.ndarray:
        """Compute the factors of the bases.

        Args:
            light: [N, 3] positions in metres, or unit directions.
            pose: [N, M] sliders of what moves; None: nothing does.

        Returns:
            [N, K] factors.
        """
        b = Builder(**self.inputs)
        graph = b.build(code=self.node(b))
        given = {"light": np.float32(light)} | ({} if pose is None else {"pose": np.float32(pose)})
        return evaluate(graph, given)["code"]
