"""Joint and multinomial gates: gradients, learning a split that is known, repetition."""

import numpy as np
import pytest

from lightwell.backend import dr, mi
from lightwell.networks import Mlp, TrainingSettings
from lightwell.networks.mixture import EXPERTS, GATE, MixtureSet, MixtureTrainer, coefficients

EXPERT, GATER = Mlp((2, 4, 3), "tanh", "sigmoid"), Mlp((2, 6, 3), "tanh", "identity")


def _rows(count=512, seed=0):
    """Two regions with functions of their own: left and right of x = 0."""
    x = np.random.default_rng(seed).uniform(-1, 1, (count, 2)).astype(np.float32)
    left = x[:, :1] < 0
    y = np.where(left, 0.2 + 0.1 * x[:, 1:], 0.8 - 0.1 * x[:, 1:]) * np.ones((1, 3))
    return x, x, y.astype(np.float32), np.ones(count)


def _trainer(estimator, seed=0, **changes):
    settings = TrainingSettings(**({"loss": "l2", "batch": 128, "rate": 1e-2} | changes))
    return MixtureTrainer(EXPERT, GATER, estimator, settings, seed)


def _expected_loss(parameters, rows):
    x, g, y, w = rows
    single = lambda part, e: {k: v[e] for k, v in parameters[part].items()}  # noqa: E731
    losses = np.stack([((EXPERT.evaluate(single(EXPERTS, e), x) - y) ** 2).mean(1) for e in range(3)], 1)
    z = GATER.evaluate(single(GATE, 0), g).astype(float)
    p = np.exp(z - z.max(1, keepdims=True))
    p /= p.sum(1, keepdims=True)
    return float(((p * losses).sum(1) * w).mean())


def test_a_joint_step_descends_the_expected_loss():
    """One step of plain gradient descent against finite differences, for experts and gate."""
    rows = _rows(128)
    trainer = _trainer("joint", optimiser="sgd", schedule="constant", rate=1.0, clip=0.0)
    before = trainer.parameters
    loss = trainer.step(MixtureSet.from_numpy(*rows), 1)
    assert float(loss[0]) == pytest.approx(_expected_loss(before, rows), rel=1e-4)
    after = trainer.parameters
    for part, name, index in ((EXPERTS, "w0", (1, 0, 2)), (EXPERTS, "b1", (2, 0, 1)), (GATE, "w1", (0, 3, 1))):
        pair = []
        for step in (1e-2, -1e-2):
            moved = {p: {k: v.copy() for k, v in w.items()} for p, w in before.items()}
            moved[part][name][index] += step
            pair.append(_expected_loss(moved, rows))
        # Central differences of step 1e-2 in float32.
        expected = -(pair[0] - pair[1]) / 2e-2
        assert after[part][name][index] - before[part][name][index] == pytest.approx(expected, rel=2e-2, abs=2e-5)


def test_the_score_function_is_unbiased():
    """The mean of many multinomial draws is the joint gradient, by coordinates of z; one expert per draw."""
    rng, experts = np.random.default_rng(1), 3
    loss, z = rng.random(experts), rng.standard_normal(experts)
    batch = 200_000
    losses, zs = mi.Float(np.repeat(loss, 3 * batch)), mi.Float(np.tile(z, batch))
    joint = coefficients("joint", losses, zs, batch, experts, mi.UInt32(1))
    drawn = coefficients("multinomial", losses, zs, batch, experts, mi.UInt32(1))
    chosen, gate = (np.array(a).reshape(batch, experts) for a in drawn[:2])
    assert (chosen.sum(axis=1) == 1).all()
    # Standard errors of 200,000 draws are below 1.2e-3 for probabilities and losses of at most 1; four of them.
    np.testing.assert_allclose(chosen.mean(axis=0), np.array(joint[0])[:experts], atol=5e-3)
    np.testing.assert_allclose(gate.mean(axis=0), np.array(joint[1])[:experts], atol=5e-3)


@pytest.mark.parametrize("estimator", ["joint", "multinomial"])
def test_it_learns(estimator):
    rows, trainer = _rows(), _trainer(estimator, rate=3e-2)
    first, data = _expected_loss(trainer.parameters, rows), MixtureSet.from_numpy(*rows)
    for _ in range(300):
        trainer.step(data, 300)
    assert _expected_loss(trainer.parameters, rows) < 0.2 * first


def test_the_sampled_gradient_is_noisier():
    variance = {}
    for estimator in ("joint", "multinomial"):
        trainer, data = _trainer(estimator), MixtureSet.from_numpy(*_rows())
        for _ in range(50):
            trainer.step(data, 50)
        variance[estimator] = trainer.gradient_variance()
    assert variance["multinomial"] > 3 * variance["joint"]


@pytest.mark.parametrize("estimator", ["joint", "multinomial"])
def test_resumed_training_ends_with_the_same_bits(estimator):
    data = MixtureSet.from_numpy(*_rows())
    whole = _trainer(estimator)
    for step in range(20):
        if step == 10:
            kept = whole.arrays()
        whole.step(data, 20)
    resumed = _trainer(estimator, seed=0)
    resumed.restore(kept)
    for _ in range(10):
        resumed.step(data, 20)
    for part, weights in whole.parameters.items():
        assert all((resumed.parameters[part][k] == v).all() for k, v in weights.items())


def test_equal_gate_outputs_share_equally():
    p, push, _ = coefficients("joint", dr.ones(mi.Float, 4 * 2 * 3), dr.zeros(mi.Float, 8), 2, 4, mi.UInt32(0))
    assert np.allclose(p, 0.25) and np.allclose(push, 0)
