"""Levenberg–Marquardt for small networks (Hagan & Menhaj 1994): the optimiser of radiance regression functions.

With J = ∂f/∂w and the residual r = y − f over the whole set, one step solves

    (JᵀJ + λ diag JᵀJ) δ = Jᵀ r,     w ← w + δ when that lowers ‖r‖²

λ × 0.1 on success, λ × 10 and another try on failure. The products and the Cholesky factor are BLAS and LAPACK in
float32; a factorisation that fails is repeated in float64. Notation: E networks, P weights of each, C outputs.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from scipy.linalg import lapack
from threadpoolctl import threadpool_limits

from lightwell.files import Arrays, prefixed, under
from lightwell.graph.ops.activate import FUNCTIONS
from lightwell.networks.batched import initial_batch, keep_better
from lightwell.networks.checkpoint import check_like
from lightwell.networks.grouped import Runs
from lightwell.networks.mlp import Mlp

# A step takes P² numbers and P³ operations per network: above this P a gradient method is the better choice.
MOST_WEIGHTS = 1000
# Factors of λ, tries of a step, the first λ and the λ that replaces zero.
SUCCESS, FAILURE, TRIES = 0.1, 10.0, 6
INITIAL_DAMPING, LEAST_DAMPING = 1e-2, 1e-8
# A step that lowers the error by less than this share is the last.
LEAST_GAIN = 1e-6
# Rows whose Jacobian is in memory at a time.
ROWS_AT_ONCE = 4096
# Share of the largest diagonal element of JᵀJ that is added to every element, so that weights without influence stay
# unchanged.
LEAST_DIAGONAL = 1e-9

# Derivatives of activations, written in the function's value.
_DERIVATIVES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "identity": np.ones_like,
    "tanh": lambda a: 1 - a * a,
    "sigmoid": lambda a: a * (1 - a),
    "relu": lambda a: (a > 0).astype(a.dtype),
    "exp": lambda a: a,
}


class LevenbergMarquardt:
    """Trains E networks of the shape ``mlp``, each with its own damping λ; those that no step improves are ``done``."""

    def __init__(
        self,
        mlp: Mlp,
        seeds: Sequence[int] | np.ndarray,
        damping: float = INITIAL_DAMPING,
        initial: Mapping[str, np.ndarray] | None = None,
    ) -> None:
        """Prepare a training.

        Args:
            mlp: Shape of the networks.
            seeds: E seeds of the initial weights.
            damping: The first λ, > 0.
            initial: Weights to start from, [E, ...] arrays; None: random ones.

        Raises:
            ValueError: A network has too many weights, or an activation has no derivative here.
        """
        weights = sum(a * b + b for a, b in zip(mlp.sizes, mlp.sizes[1:]))
        if weights > MOST_WEIGHTS:
            raise ValueError(f"levenberg: {weights} weights are too many; use 'adam' above {MOST_WEIGHTS}")
        for name in set(mlp.activations) - set(_DERIVATIVES):
            raise ValueError(f"levenberg: no derivative of '{name}'; choose one of {', '.join(_DERIVATIVES)}")
        self.mlp = mlp
        start = initial_batch(mlp, seeds) if initial is None else initial
        self.parameters = {name: np.array(value, np.float32) for name, value in start.items()}
        self.best = {name: value.copy() for name, value in self.parameters.items()}
        self.best_error = np.full(len(seeds), np.inf)
        self.damping = np.full(len(seeds), damping)
        self.done = np.zeros(len(seeds), bool)
        # [E] mean weighted squared error after the last step.
        self._error = np.full(len(seeds), np.nan)

    def __len__(self) -> int:
        return len(self.done)

    def step(self, features: np.ndarray, target: np.ndarray, weight: np.ndarray, runs: Runs) -> np.ndarray:
        """Do one step of every network on all of its rows.

        Args:
            features: [N, F] inputs, in the order of ``runs``.
            target: [N, C] targets.
            weight: [N] weights.
            runs: Rows of each network.

        Returns:
            [E] mean weighted squared error after each network's last step.
        """

        def one(e: int) -> None:
            rows = slice(runs.first[e], runs.first[e] + runs.count[e])
            self._error[e] = self._step_one(e, features[rows], target[rows], weight[rows])

        # One thread per network: BLAS releases the interpreter, and its own threads are slow on small matrices.
        with threadpool_limits(1, "blas"), ThreadPoolExecutor(os.cpu_count()) as pool:
            list(pool.map(one, np.flatnonzero((runs.count > 0) & ~self.done)))
        return self._error.copy()

    def _step_one(self, e: int, x: np.ndarray, y: np.ndarray, w: np.ndarray) -> float:
        start = {name: value[e] for name, value in self.parameters.items()}
        root = np.sqrt(np.maximum(w, 0)).astype(np.float32)
        hessian, gradient, before = normal_equations(self.mlp, start, x, y, root)
        for _ in range(TRIES):
            step = damped_solution(hessian, gradient, self.damping[e])
            if step is not None:
                moved = _add(start, step)
                after = float(np.mean((root[:, None] * (y - forward(self.mlp, moved, x)[-1])) ** 2))
                if after < before:
                    for name, value in moved.items():
                        self.parameters[name][e] = value
                    self.damping[e] *= SUCCESS
                    self.done[e] = before - after < LEAST_GAIN * before
                    return after
            self.damping[e] = max(self.damping[e] * FAILURE, LEAST_DAMPING)
        self.done[e] = True
        return before

    def look(self, error: np.ndarray) -> np.ndarray:
        """Keep the current weights of the networks whose error is the least so far.

        Args:
            error: [E] validation errors.

        Returns:
            [E] bool, the networks that improved.
        """
        return keep_better(self.best, self.best_error, self.parameters, error)

    # ------------------------------------------------------------------ checkpoints

    def arrays(self) -> Arrays:
        """Collect the state that a resumed training needs.

        Returns:
            Named arrays.
        """
        own = {"damping": self.damping, "done": self.done, "best_error": self.best_error}
        return prefixed("value", self.parameters) | prefixed("best", self.best) | own

    def restore(self, arrays: Arrays) -> None:
        """Restore the state of a training of the same shape and number of networks.

        Args:
            arrays: Result of ``arrays``.
        """
        check_like(arrays, self.arrays())
        self.parameters = {name: value.copy() for name, value in under("value", arrays).items()}
        self.best = {name: value.copy() for name, value in under("best", arrays).items()}
        self.damping, self.done, self.best_error = (arrays[n].copy() for n in ("damping", "done", "best_error"))


def forward(mlp: Mlp, weights: Mapping[str, np.ndarray], x: np.ndarray) -> list[np.ndarray]:
    """Evaluate all layers of one network.

    Args:
        mlp: Shape of the network.
        weights: Weights ``w0 [in, out], b0 [1, out], …``.
        x: [n, in] inputs.

    Returns:
        Values of the layers, input first, [n, width] each.
    """
    values = [x]
    for k, activation in enumerate(mlp.activations):
        values.append(FUNCTIONS[activation].numpy(values[-1] @ weights[f"w{k}"] + weights[f"b{k}"]))
    return values


def jacobian(mlp: Mlp, weights: Mapping[str, np.ndarray], values: list[np.ndarray]) -> np.ndarray:
    """Compute ∂f/∂w by backpropagation.

    Args:
        mlp: Shape of the network.
        weights: Weights ``w0 [in, out], b0 [1, out], …``.
        values: Result of ``forward``, [n, width] each.

    Returns:
        [C, n, P]; P runs over w0, b0, w1, … row-major.
    """
    count, outputs = values[-1].shape
    derivative = _DERIVATIVES[mlp.output]
    # δ [C, n, width]: derivative of output c by the sums that enter layer k.
    delta = np.zeros((outputs, count, outputs), np.float32)
    for c in range(outputs):
        delta[c, :, c] = derivative(values[-1])[:, c]
    blocks: list[np.ndarray] = []
    for k in reversed(range(mlp.layers)):
        by_weight = values[k][None, :, :, None] * delta[:, :, None, :]
        blocks[:0] = [by_weight.reshape(outputs, count, -1), delta]
        if k:
            delta = (delta @ weights[f"w{k}"].T) * _DERIVATIVES[mlp.activation](values[k])
    return np.concatenate(blocks, axis=2)


def normal_equations(
    mlp: Mlp, weights: Mapping[str, np.ndarray], x: np.ndarray, y: np.ndarray, root: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """Sum up the normal equations over rows.

    Args:
        mlp: Shape of the network.
        weights: Weights ``w0 [in, out], b0 [1, out], …``.
        x: [n, in] inputs.
        y: [n, C] targets.
        root: [n] factor of every row, the root of its weight.

    Returns:
        JᵀJ [P, P], Jᵀr [P] and the mean squared error.
    """
    hessian, gradient, squares = np.zeros((), np.float32), np.zeros((), np.float32), 0.0
    for begin in range(0, len(x), ROWS_AT_ONCE):
        rows = slice(begin, begin + ROWS_AT_ONCE)
        values = forward(mlp, weights, x[rows])
        residual = (root[rows, None] * (y[rows] - values[-1])).astype(np.float32)
        j = (jacobian(mlp, weights, values) * root[None, rows, None]).reshape(residual.size, -1)
        hessian = hessian + j.T @ j
        gradient = gradient + j.T @ residual.T.ravel()
        squares += float(np.square(residual, dtype=np.float64).sum())
    return hessian, gradient, squares / y.size


def damped_solution(hessian: np.ndarray, gradient: np.ndarray, damping: float) -> np.ndarray | None:
    """Solve (H + λ diag H) δ = g.

    Args:
        hessian: [P, P] H, symmetric.
        gradient: [P] g.
        damping: λ, ≥ 0.

    Returns:
        [P] δ, or None when H is not positive definite even in float64.
    """
    diagonal = np.diag(hessian).astype(np.float64)
    for kind, solve in ((np.float32, lapack.sposv), (np.float64, lapack.dposv)):
        matrix = hessian.astype(kind)
        np.fill_diagonal(matrix, diagonal * (1 + damping) + LEAST_DIAGONAL * max(float(diagonal.max()), 1e-30))
        _, step, info = solve(matrix, gradient.astype(kind)[:, None], lower=1)
        if info == 0 and np.isfinite(step).all():
            return step[:, 0].astype(np.float32)
    return None


def _add(weights: Mapping[str, np.ndarray], step: np.ndarray) -> dict[str, np.ndarray]:
    """Add δ [P], in the order of ``jacobian``, to the weights."""
    moved, begin = {}, 0
    for name, value in weights.items():
        moved[name] = value + step[begin : begin + value.size].reshape(value.shape)
        begin += value.size
    return moved
