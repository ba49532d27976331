"""Networks that are trained together end as those that are trained alone."""

import numpy as np
import pytest

from lightwell.networks import Mlp, TrainingSettings, batched
from lightwell.networks.batched import BatchedSet, BatchedTrainer
from lightwell.networks.grouped import GroupedRows, Runs, sort_into_runs

MLP = Mlp((4, 6, 3), "tanh", "sigmoid")
COUNTS = np.array([300, 40, 0, 77, 5])
SEEDS = [3, 1, 4, 1, 5]


def _rows(seed=0):
    rng = np.random.default_rng(seed)
    x = rng.random((COUNTS.sum(), 4)).astype(np.float32)
    y = np.stack([x[:, 0] * x[:, 1], 0.5 * x[:, 2], np.full(len(x), 0.3)], axis=1).astype(np.float32)
    return x, y, rng.uniform(0.5, 1.5, len(x))


def _runs(counts):
    return Runs(np.concatenate([[0], np.cumsum(counts)[:-1]]), np.asarray(counts))


def _train(rows, runs, seeds, settings, steps=30, **options):
    trainer = BatchedTrainer(MLP, settings, seeds, **options)
    data = BatchedSet.from_numpy(*rows, runs)
    for _ in range(steps):
        trainer.step(data, steps)
    return trainer


SETTINGS = {
    "adam": TrainingSettings(batch=16, rate=1e-2),
    "sgd": TrainingSettings(
        batch=16, optimiser="sgd", schedule="report", rate=0.5, tau=2.0, decay=1e-3, loss="relative", initial_bias=0.25
    ),
}


@pytest.mark.parametrize("name", sorted(SETTINGS))
def test_together_is_as_alone(name):
    rows, runs = _rows(), _runs(COUNTS)
    together = _train(rows, runs, SEEDS, SETTINGS[name])
    for e in np.flatnonzero(COUNTS):
        own = slice(runs.first[e], runs.first[e] + COUNTS[e])
        alone = _train([a[own] for a in rows], _runs([COUNTS[e]]), [SEEDS[e]], SETTINGS[name])
        for key, value in alone.parameters.items():
            # The same products; their sums may be grouped otherwise, 30 steps of float32.
            np.testing.assert_allclose(together.parameters[key][e], value[0], rtol=1e-4, atol=1e-5)


def test_a_network_without_rows_stays_as_it_is():
    together = _train(_rows(), _runs(COUNTS), SEEDS, TrainingSettings(batch=16))
    for key, value in MLP.initial(SEEDS[2]).items():
        assert (together.parameters[key][2] == value).all()


def test_a_step_is_plain_gradient_descent():
    """Against NumPy with finite differences: w − μ ∂/∂w mean(loss)."""
    x, y, _ = (a[:16] for a in _rows())
    settings = TrainingSettings(batch=16, optimiser="sgd", schedule="constant", rate=0.1, clip=0.0, loss="l2")
    trainer = _train((x, y, np.ones(16)), _runs([16]), [7], settings, steps=1)
    start = MLP.initial(7)

    def loss(weights):
        h = np.tanh(x.astype(float) @ weights["w0"] + weights["b0"])
        return np.mean((1 / (1 + np.exp(-(h @ weights["w1"] + weights["b1"]))) - y) ** 2)

    for key, index in (("w0", (1, 2)), ("b0", (0, 3)), ("w1", (4, 1)), ("b1", (0, 0))):
        moved = [{k: v.astype(float) for k, v in start.items()} for _ in range(2)]
        moved[0][key][index] += 1e-5
        moved[1][key][index] -= 1e-5
        gradient = (loss(moved[0]) - loss(moved[1])) / 2e-5
        step = trainer.parameters[key][0][index] - start[key][index]
        assert step == pytest.approx(-0.1 * gradient, rel=1e-3, abs=1e-7)


def test_launches_do_not_matter():
    """Memory for two networks a launch gives what one launch gives."""
    whole = _train(_rows(), _runs(COUNTS), SEEDS, SETTINGS["adam"])
    memory = 2 * batched.COPIES * sum(MLP.sizes) * 4 * 16
    parts = _train(_rows(), _runs(COUNTS), SEEDS, SETTINGS["adam"], memory=memory)
    assert whole.launches == 1 and parts.launches == 3
    for key, value in whole.parameters.items():
        np.testing.assert_allclose(parts.parameters[key], value, rtol=1e-4, atol=1e-5)


def test_the_same_seed_gives_the_same_bits():
    a, b = (_train(_rows(), _runs(COUNTS), SEEDS, SETTINGS["adam"]) for _ in range(2))
    assert all((a.parameters[k] == b.parameters[k]).all() for k in a.parameters)


def test_resumed_training_ends_with_the_same_bits():
    rows, runs = _rows(), _runs(COUNTS)
    data = BatchedSet.from_numpy(*rows, runs)
    whole = _train(rows, runs, SEEDS, SETTINGS["adam"], 20)
    part = BatchedTrainer(MLP, SETTINGS["adam"], SEEDS)
    for _ in range(10):
        part.step(data, 20)
    resumed = BatchedTrainer(MLP, SETTINGS["adam"], [0] * 5)
    resumed.restore(part.arrays())
    for _ in range(10):
        resumed.step(data, 20)
    assert all((whole.parameters[k] == resumed.parameters[k]).all() for k in whole.parameters)


def test_a_checkpoint_of_other_networks_is_refused():
    other = BatchedTrainer(Mlp((4, 5, 3)), TrainingSettings(), [1])
    with pytest.raises(ValueError, match="the network needs"):
        other.restore(BatchedTrainer(MLP, TrainingSettings(), [1]).arrays())


def test_a_poisoned_row_harms_no_network():
    x, y, w = _rows()
    y[7] = np.nan
    trainer = _train((x, y, w), _runs(COUNTS), SEEDS, SETTINGS["adam"])
    assert all(np.isfinite(v).all() for v in trainer.parameters.values())


def test_each_network_keeps_its_own_best():
    trainer = BatchedTrainer(MLP, SETTINGS["adam"], SEEDS)
    data = BatchedSet.from_numpy(*_rows(), _runs(COUNTS))
    trainer.look(np.array([1.0, 1, 1, 1, 1]))
    first = {k: v.copy() for k, v in trainer.best.items()}
    trainer.step(data, 2)
    better = trainer.look(np.array([0.5, 2, 1, 0.5, np.nan]))
    assert better.tolist() == [True, False, False, True, False]
    now = trainer.parameters
    assert (trainer.best["w0"][0] == now["w0"][0]).all() and (trainer.best["w0"][1] == first["w0"][1]).all()


def test_batches_cover_every_row_in_an_epoch():
    trainer = BatchedTrainer(MLP, TrainingSettings(batch=16), [9])
    seen = np.zeros(64, int)
    for trainer.steps in range(4):
        seen[(trainer.starts(np.array([64]))[0] + np.arange(16)) % 64] += 1
    assert (seen == 1).all()


def test_padding_wastes_at_most_a_quarter():
    sizes = {batched.padded(n) for n in range(1, 5000)}
    assert all(n <= batched.padded(n) <= max(1.25 * n, n) for n in range(1, 5000))
    assert len(sizes) < 60


def test_rows_are_sorted_into_runs():
    group = np.array([2, 0, -1, 2, 0, 2])
    order, runs = sort_into_runs(group, 4, 0)
    assert (group[order] == [0, 0, 2, 2, 2]).all()
    assert runs.count.tolist() == [2, 0, 3, 0] and runs.first.tolist() == [0, 2, 2, 5]
    assert (runs.group == [0, 0, 2, 2, 2]).all()


def test_grouped_evaluation_is_each_network_on_its_rows():
    rng = np.random.default_rng(1)
    weights = batched.initial_batch(MLP, range(20))
    x, group = rng.random((1000, 4)).astype(np.float32), rng.integers(0, 19, 1000)
    y = GroupedRows(x, group, 20).evaluate(MLP, weights)
    for e in range(19):
        own = {name: value[e] for name, value in weights.items()}
        np.testing.assert_allclose(y[group == e], MLP.evaluate(own, x[group == e]), rtol=1e-5, atol=1e-6)
