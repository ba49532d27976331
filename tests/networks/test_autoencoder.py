"""The tied-weight gater: gradient, what its loss is made of, balance."""

import numpy as np
import pytest

from lightwell.networks.autoencoder import GateTraining, TiedAutoencoder


def _rows(count=64, width=5, seed=0):
    return np.random.default_rng(seed).uniform(-0.9, 0.9, (count, width))


def test_gradient_agrees_with_finite_differences():
    coder, x = TiedAutoencoder((5, 4, 6, 3), decay=1e-2), _rows()
    parameters = {k: v + 0.1 for k, v in coder.initial(1).items()}
    _, gradient = coder.loss(parameters, x)
    for name, value in parameters.items():
        for index in np.ndindex(value.shape):
            pair = []
            for step in (1e-6, -1e-6):
                moved = {k: v.copy() for k, v in parameters.items()}
                moved[name][index] += step
                pair.append(coder.loss(moved, x)[0])
            # Central differences in float64.
            assert gradient[name][index] == pytest.approx((pair[0] - pair[1]) / 2e-6, rel=1e-5, abs=1e-9)


def test_the_loss_is_reconstruction_decay_and_balance():
    x = _rows()
    plain = TiedAutoencoder((5, 3), decay=0.0, balance=0.0)
    parameters = plain.initial(2)
    code = plain.encode(parameters, x)
    reconstruction = np.mean((x - np.tanh(code @ parameters["w0"].T)) ** 2)
    assert plain.loss(parameters, x)[0] == pytest.approx(reconstruction)
    full = TiedAutoencoder((5, 3), decay=0.5, balance=6.0)
    expected = reconstruction + 0.5 * (parameters["w0"] ** 2).sum() + 6 * np.var(code.mean(axis=0))
    assert full.loss(parameters, x)[0] == pytest.approx(expected)


def test_weights_are_tied_and_counted_as_published():
    """12-20-20-10: the coder has 840 products and 890 numbers."""
    coder = TiedAutoencoder()
    parameters = coder.initial(0)
    assert sum(parameters[f"w{k}"].size for k in range(3)) == 840
    assert sum(parameters[f"{n}{k}"].size for k in range(3) for n in "wb") == 890


def test_the_balance_keeps_mean_codes_alike():
    # Inputs that are not centred give codes that are not alike by themselves.
    x, spread = _rows(4000) ** 2, {}
    for balance in (0.0, 6.0):
        coder = TiedAutoencoder((5, 8, 4), balance=balance)
        parameters, history = coder.train(x, GateTraining(epochs=4, batch=64), seed=3)
        spread[balance] = np.std(coder.encode(parameters, x).mean(axis=0))
        assert history[-1] < history[0]
    # Over seeds the ratio is 0.1 to 0.33.
    assert spread[6.0] < 0.5 * spread[0.0]


def test_updates_are_limited_and_seeds_repeat():
    coder, x = TiedAutoencoder((5, 4, 3)), _rows(1000)
    settings = GateTraining(epochs=2, most_updates=10)
    a, b = (coder.train(x, settings, seed=1)[0] for _ in range(2))
    assert all((a[k] == b[k]).all() for k in a)
    few = coder.train(x[np.random.default_rng((1, 1000)).permutation(1000)[:80]], settings, seed=1)
    assert len(few[1]) == 2
