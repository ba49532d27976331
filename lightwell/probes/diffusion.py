"""Computes trust ρ, the visibility weight of a probe at the points of its cube: 1 where it sees them, else diffused.

On the graph of points that see one another, with weights w_ij = exp(-d² / 2 s²) along free edges,

    ρ_i ← Σ_j w_ij ρ_j / ((1 + λ) Σ_j w_ij)

where ρ = 1 is fixed at points that the probe sees and ρ = 0 at invalid ones. The fixed point solves a symmetric
positive definite system, which conjugate gradients solve in a few dozen products; ``sweeps`` iterates the line
above and is the reference in tests. Notation: B cubes, Q points of a cube, M edges of a cube.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse import csr_matrix, diags

from lightwell.probes.pattern import Pattern

# ℓ: distance over which diffused trust falls by a factor of e, units of the spacing.
REACH = 0.33
# Trust below this is set to 0.
LEAST = 0.01
# Relative residual at which conjugate gradients end, and largest number of products.
TOLERANCE, MOST = 1e-4, 200


def diffuse(
    pattern: Pattern,
    sees: np.ndarray,
    edges: np.ndarray,
    reach: float = REACH,
    likeness: np.ndarray | None = None,
) -> np.ndarray:
    """Solve the diffusion of trust in some cubes.

    Args:
        pattern: Points and edges of a cube.
        sees: [B, Q] bool: valid points that the probe sees.
        edges: [B, M] bool: edges of ``pattern.cube_edges`` whose ends are valid and see each other.
        reach: Distance ℓ over which diffused trust falls by a factor of e, units of the spacing.
        likeness: [B, M] factors on the edge weights by the similarity of the light at both ends, which makes ρ
            depend on the light; None for 1.

    Returns:
        [B, Q] float32 trust in [0, 1]; values below ``LEAST`` are 0.
    """
    a, b, w = _active(pattern, sees, edges, likeness)
    count = sees.size
    # Every free edge enters the equations of both its ends; only ends that are not seen are unknown.
    degree = np.bincount(a, w, count) + np.bincount(b, w, count)
    flat = sees.ravel()
    unknown = np.flatnonzero((degree > 0) & ~flat)
    rho = flat.astype(np.float32)
    if len(unknown):
        number = np.full(count, -1)
        number[unknown] = np.arange(len(unknown))
        pull = np.bincount(a, w * flat[b], count) + np.bincount(b, w * flat[a], count)
        both = (number[a] >= 0) & (number[b] >= 0)
        i, j, v = number[a[both]], number[b[both]], -w[both]
        shape = (len(unknown), len(unknown))
        matrix = csr_matrix((np.r_[v, v], (np.r_[i, j], np.r_[j, i])), shape=shape)
        matrix += diags((1 + pattern.decay(reach)) * degree[unknown])
        _, first = np.unique(unknown // sees.shape[1], return_index=True)
        rho[unknown] = _conjugate_gradients(matrix.tocsr(), pull[unknown], first)
    rho = np.clip(rho, 0, 1).reshape(sees.shape)
    rho[rho < LEAST] = 0
    return rho


def _active(pattern: Pattern, sees: np.ndarray, edges: np.ndarray, likeness: np.ndarray | None) -> Any:
    """Ends (flat indices) and weights of the free edges with an end that the probe does not see."""
    first, second, _, number = pattern.cube_edges.T
    cube, m = np.nonzero(edges & ~(sees[:, first] & sees[:, second]))
    w = pattern.weights()[number[m]]
    if likeness is not None:
        w = w * likeness[cube, m]
    offset = cube * sees.shape[1]
    return offset + first[m], offset + second[m], w


def _conjugate_gradients(matrix: csr_matrix, right: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Solve a symmetric positive definite system, preconditioned by its diagonal.

    ``first`` gives the first unknown of each cube: cubes are independent, and each has its own steps and end, so that
    its bits do not depend on the others.
    """
    inverse = 1 / matrix.diagonal()
    counts = np.diff(np.r_[first, len(right)])
    total = lambda v: np.add.reduceat(v, first)  # noqa: E731
    spread = lambda v: np.repeat(v, counts)  # noqa: E731
    x, r = np.zeros_like(right), right.copy()
    goal = TOLERANCE * np.maximum.reduceat(np.abs(right * inverse), first)
    z = inverse * r
    p, rz = z.copy(), total(r * z)
    for _ in range(MOST):
        going = (np.maximum.reduceat(np.abs(z), first) > goal) & (rz != 0)
        if not going.any():
            break
        q = matrix @ p
        curve = total(p * q)
        step = spread(np.where(going, rz / np.where(going, curve, 1), 0))
        x += step * p
        r -= step * q
        z = inverse * r
        before, rz = rz, total(r * z)
        p = np.where(spread(going), z + spread(rz / np.where(before != 0, before, 1)) * p, p)
    return x
