"""Balanced assignment against brute force; floors and caps are kept."""

from itertools import product

import numpy as np
import pytest

from lightwell.networks.assignment import assign_cells


def _total(cost, weight, expert):
    return (weight * cost[np.arange(len(cost)), expert]).sum()


def _best(cost, weight, least, most):
    """Least total over all assignments within floor and cap."""
    cells, experts = cost.shape
    best = np.inf
    for choice in product(range(experts), repeat=cells):
        load = np.bincount(choice, weight, experts)
        if load.min() >= least - 1e-9 and load.max() <= most + 1e-9:
            best = min(best, _total(cost, weight, np.array(choice)))
    return best


@pytest.mark.parametrize("seed", range(12))
def test_cells_of_equal_weight_are_placed_optimally(seed):
    rng = np.random.default_rng(seed)
    cost, weight = rng.random((7, 3)), np.full(7, 2.5)
    least, most = 0.3 * weight.sum() / 3, 1.3 * weight.sum() / 3
    expert = assign_cells(cost, weight, least, most)
    assert _total(cost, weight, expert) == pytest.approx(_best(cost, weight, least, most))


@pytest.mark.parametrize("seed", range(12))
def test_other_cells_nearly(seed):
    """What whole cells cost above the optimum: no more than moving as many cells as there are experts."""
    rng = np.random.default_rng(100 + seed)
    cost, weight = rng.random((8, 3)), rng.uniform(0.5, 1.5, 8)
    least, most = 0.3 * weight.sum() / 3, 1.4 * weight.sum() / 3
    expert = assign_cells(cost, weight, least, most)
    load = np.bincount(expert, weight, 3)
    assert load.min() >= least - 1e-6 and load.max() <= most + 1e-6
    assert _total(cost, weight, expert) <= _best(cost, weight, least, most) + 3 * np.ptp(cost) * weight.max()


def test_floor_and_cap_hold_where_all_want_the_same_expert():
    """One expert is best everywhere and one is worst everywhere: neither all nor none."""
    rng = np.random.default_rng(0)
    cells, experts = 600, 16
    cost, weight = rng.random((cells, experts)), rng.uniform(1, 20, cells)
    cost[:, 3] -= 5
    cost[:, 7] += 5
    mean = weight.sum() / experts
    load = np.bincount(assign_cells(cost, weight, 0.3 * mean, 1.3 * mean), weight, experts)
    assert load.max() <= 1.3 * mean * (1 + 1e-6)
    assert load.min() >= 0.3 * mean * (1 - 1e-6)
    # Both limits are used: the loved expert is full, the unloved one at its floor but for one cell.
    assert load[3] > 1.3 * mean - weight.max() and load[7] < 0.3 * mean + weight.max()


def test_a_loose_cap_lets_every_cell_have_its_wish():
    cost = np.random.default_rng(1).random((50, 4))
    assert (assign_cells(cost, np.ones(50), 0, 50) == cost.argmin(axis=1)).all()


def test_cells_too_heavy_for_the_cap_are_placed_nevertheless():
    expert = assign_cells(np.eye(3), np.array([10.0, 1.0, 1.0]), 0.0, 5.0)
    assert expert.shape == (3,) and set(expert) <= {0, 1, 2}


def test_fewer_cells_than_experts():
    assert len(set(assign_cells(np.random.default_rng(0).random((3, 8)), np.ones(3), 0.1, 0.5))) >= 1


def test_one_expert_has_all():
    assert (assign_cells(np.ones((5, 1)), np.ones(5), 0, 5) == 0).all()


def test_an_impossible_cap_is_refused():
    with pytest.raises(ValueError, match="cannot share 10; lower the floor or raise the cap"):
        assign_cells(np.zeros((10, 2)), np.ones(10), 0, 4)


def test_the_same_costs_give_the_same_experts():
    rng = np.random.default_rng(2)
    cost, weight = rng.random((200, 6)), rng.uniform(1, 3, 200)
    a, b = (assign_cells(cost, weight, 10, 80) for _ in range(2))
    assert (a == b).all()
