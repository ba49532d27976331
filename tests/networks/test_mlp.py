"""The network against NumPy, its gradient against finite differences."""

import numpy as np
import pytest

from lightwell.backend import dr, mi
from lightwell.networks import Mlp
from lightwell.networks.mlp import ACTIVATIONS, EXP_HIGH, EXP_LOW

pytestmark = pytest.mark.gpu

NUMPY = {
    "identity": lambda x: x,
    "relu": lambda x: np.maximum(x, 0),
    "sigmoid": lambda x: 1 / (1 + np.exp(-x)),
    "silu": lambda x: x / (1 + np.exp(-x)),
    "sine": np.sin,
    "softplus": lambda x: np.logaddexp(0, x),
    "tanh": np.tanh,
    "exp": lambda x: np.exp(np.clip(x, EXP_LOW, EXP_HIGH)),
}


def test_every_activation_has_a_numpy_twin():
    assert set(ACTIVATIONS) == set(NUMPY)


@pytest.mark.parametrize("activation", sorted(ACTIVATIONS))
def test_forward_agrees_with_numpy(activation):
    rng = np.random.default_rng(0)
    mlp = Mlp((5, 8, 3), activation, "identity")
    weights = mlp.initial(1, bias=0.25)
    x = rng.standard_normal((33, 5)).astype(np.float32)
    hidden = NUMPY[activation](x.astype(np.float64) @ weights["w0"] + weights["b0"])
    expected = hidden @ weights["w1"] + weights["b1"]
    # float32 sums of 8 products.
    np.testing.assert_allclose(mlp.evaluate(weights, x), expected, rtol=2e-5, atol=2e-5)


def test_macs_of_the_report_network():
    assert Mlp((12, 20, 10, 3)).macs == 470
    assert Mlp((12, 200, 100, 3)).macs == 22_700


def test_gradient_agrees_with_finite_differences():
    mlp = Mlp((4, 6, 3), "silu", "exp")
    weights = mlp.initial(2)
    x = np.random.default_rng(3).standard_normal((16, 4)).astype(np.float32)
    tensors = {name: mi.TensorXf(value) for name, value in weights.items()}
    for tensor in tensors.values():
        dr.enable_grad(tensor)
    dr.backward(dr.sum(mlp(tensors, mi.TensorXf(x)), axis=None))

    def total(name, index, step):
        moved = {n: v.copy() for n, v in weights.items()}
        moved[name][index] += step
        return float(mlp.evaluate(moved, x).astype(np.float64).sum())

    for name, index in (("w0", (1, 2)), ("b0", (0, 3)), ("w1", (4, 1)), ("b1", (0, 0))):
        expected = (total(name, index, 1e-2) - total(name, index, -1e-2)) / 2e-2
        # Central differences of step 1e-2 in float32.
        assert float(np.array(dr.grad(tensors[name]))[index]) == pytest.approx(expected, rel=2e-2, abs=2e-3)


def test_initial_weights_are_bounded_and_seeded():
    a, b = Mlp((12, 20, 10, 3)).initial(7, 0.25), Mlp((12, 20, 10, 3)).initial(7, 0.25)
    assert all((a[k] == b[k]).all() for k in a)
    assert np.abs(a["w0"]).max() <= np.sqrt(6 / 32)
    assert (a["b1"] == 0.25).all()
