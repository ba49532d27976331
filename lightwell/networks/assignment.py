"""Balanced assignment of cells of unequal weight to experts whose load has a lower and an upper limit.

Notation: N cells, M experts, C[c, e] cost of a cell's unit of weight under an expert, w weights. The problem is

    min Σ_c w_c C[c, e(c)]     with     least ≤ Σ_{c : e(c) = e} w_c ≤ most     for every expert e.

If cells may be shared between experts, this is a transport problem, which is a linear programme: its vertices split at
most M of the N cells, and none when all cells have the same weight. It is solved exactly; then each split cell is given
to one expert, and violated limits are repaired by moving cells.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.optimize import linprog

# Smaller shares of a cell at an expert count as zero: tolerance of the solver (HiGHS: 1e-7) with a margin.
LEAST_SHARE = 1e-5
# Tolerance of both limits, relative to the upper one: rounding of the sums.
SLACK = 1e-9


def assign_cells(cost: np.ndarray, weight: np.ndarray, least: float, most: float) -> np.ndarray:
    """Assign each cell to one expert at the least total cost, within the limits on the load.

    The result is optimal for cells of equal weight, else within the cost of moving M cells. The limits hold exactly
    unless single cells are too heavy (a cell above ``most``, or fewer cells than experts).

    Args:
        cost: [N, M] cost per unit of weight, finite.
        weight: [N] weights, > 0.
        least: Load that every expert must have at least.
        most: Load that no expert may exceed.

    Returns:
        [N] int, the expert of each cell.

    Raises:
        ValueError: No shares satisfy the limits.
    """
    cost, weight = np.asarray(cost, np.float64), np.asarray(weight, np.float64)
    total, experts = weight.sum(), cost.shape[1]
    if not least * experts <= total * (1 + SLACK) or not most * experts >= total * (1 - SLACK):
        raise ValueError(
            f"assign: {experts} experts with {least:.6g} to {most:.6g} each cannot share {total:.6g}; "
            "lower the floor or raise the cap"
        )
    if experts == 1:
        return np.zeros(len(cost), np.int64)
    share = _transport(cost, weight, *_whole(weight, least, most, experts))
    expert = np.where(share > LEAST_SHARE, cost, np.inf).argmin(axis=1)
    whole = share.max(axis=1) > 1 - LEAST_SHARE
    expert[whole] = share[whole].argmax(axis=1)
    return _repaired(expert, cost, weight, least, most)


def _whole(weight: np.ndarray, least: float, most: float, experts: int) -> tuple[float, float]:
    """Round the limits to whole cells where all have the same weight: no vertex of the problem then splits a cell."""
    unit = weight[0]
    if np.any(weight != unit):
        return least, most
    low, high = np.ceil(least / unit - SLACK) * unit, np.floor(most / unit + SLACK) * unit
    fits = low * experts <= weight.sum() <= high * experts
    return (low, high) if fits else (least, most)


def _transport(cost: np.ndarray, weight: np.ndarray, least: float, most: float) -> np.ndarray:
    """Compute [N, M] optimal shares of the cells at the experts, a vertex solution (dual simplex of HiGHS)."""
    cells, experts = cost.shape
    # In units of the mean weight, so that the solver's absolute tolerances do not depend on the scale.
    unit = weight.mean()
    load = sparse.kron((weight / unit)[None], sparse.eye(experts))
    solution = linprog(
        (cost * (weight / unit)[:, None]).ravel(),
        A_ub=sparse.vstack([load, -load]),
        b_ub=np.repeat([most / unit, -least / unit], experts),
        A_eq=sparse.kron(sparse.eye(cells), np.ones((1, experts))),
        b_eq=np.ones(cells),
        method="highs-ds",
    )
    if solution.x is None:
        raise RuntimeError(f"assign: the transport problem was not solved ({solution.message}); are all costs finite?")
    return solution.x.reshape(cells, experts)


def _repaired(expert: np.ndarray, cost: np.ndarray, weight: np.ndarray, least: float, most: float) -> np.ndarray:
    """Move cells one by one, the cheapest per unit of weight first, until the limits hold or no move helps."""
    expert, slack = expert.copy(), SLACK * most
    for _ in range(2 * len(expert)):
        load = np.bincount(expert, weight, cost.shape[1])
        over, under = load - most, least - load
        if over.max() > slack:
            full = int(over.argmax())
            move = _cheapest(np.flatnonzero(expert == full), load < most, expert, cost, weight, load, 0, most + slack)
        elif under.max() > slack:
            needy = np.arange(len(load)) == under.argmax()
            givers = np.flatnonzero(~needy[expert])
            move = _cheapest(givers, needy, expert, cost, weight, load, least - slack, most + slack)
        else:
            break
        if move is None:
            break
        cell, to = move
        expert[cell] = to
    return expert


def _cheapest(
    cells: np.ndarray,
    targets: np.ndarray,
    expert: np.ndarray,
    cost: np.ndarray,
    weight: np.ndarray,
    load: np.ndarray,
    least: float,
    most: float,
) -> tuple[int, int] | None:
    """Find the cheapest move (cell, new expert) of one of ``cells`` to one of ``targets`` [M] that keeps the old expert
    at ``least`` or above and the new one at ``most`` or below; None when there is none."""
    old = expert[cells]
    extra = cost[cells] - cost[cells, old][:, None]
    allowed = targets & (load + weight[cells, None] <= most) & (load[old] - weight[cells] >= least)[:, None]
    extra = np.where(allowed, extra, np.inf)
    k, to = np.unravel_index(extra.argmin(), extra.shape) if extra.size else (0, 0)
    return (int(cells[k]), int(to)) if extra.size and np.isfinite(extra[k, to]) else None
