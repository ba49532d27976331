"""Levenberg–Marquardt: its Jacobian, its promise on linear models, its advantage on small smooth functions."""

import numpy as np
import pytest

from lightwell.networks import Mlp, TrainingSettings, levenberg
from lightwell.networks.batched import BatchedSet, BatchedTrainer
from lightwell.networks.grouped import Runs
from lightwell.networks.levenberg import LevenbergMarquardt, damped_solution, forward, jacobian


def _one_run(count):
    return Runs(np.array([0]), np.array([count]))


def test_a_linear_model_is_solved_in_one_step():
    rng = np.random.default_rng(0)
    x = rng.standard_normal((200, 5)).astype(np.float32)
    y = (x @ rng.standard_normal((5, 3)) + 0.7).astype(np.float32)
    fit = LevenbergMarquardt(Mlp((5, 3), output="identity"), [1], damping=0.0)
    error = fit.step(x, y, np.ones(200), _one_run(200))
    # Normal equations in float32 of a well-conditioned problem.
    assert error[0] < 1e-9
    assert fit.parameters["b0"][0] == pytest.approx(np.full((1, 3), 0.7), abs=1e-4)


@pytest.mark.parametrize("activation", ["tanh", "sigmoid", "relu", "exp", "identity"])
def test_jacobian_agrees_with_finite_differences(activation):
    mlp = Mlp((3, 4, 2), activation, "sigmoid")
    weights = {k: v.astype(np.float64) for k, v in mlp.initial(2, 0.1).items()}
    x = np.random.default_rng(3).standard_normal((6, 3))
    j = jacobian(mlp, weights, forward(mlp, weights, x))
    at = 0
    for name, value in weights.items():
        for index in np.ndindex(value.shape):
            pair = []
            for step in (1e-6, -1e-6):
                moved = {k: v.copy() for k, v in weights.items()}
                moved[name][index] += step
                pair.append(forward(mlp, moved, x)[-1])
            # δ is kept in float32.
            np.testing.assert_allclose(j[:, :, at], ((pair[0] - pair[1]) / 2e-6).T, rtol=1e-3, atol=1e-5)
            at += 1
    assert at == j.shape[2]


def test_it_beats_adam_on_a_small_smooth_function():
    rng = np.random.default_rng(4)
    x = rng.uniform(-1, 1, (600, 2)).astype(np.float32)
    y = np.stack([np.sin(2 * x[:, 0]) * x[:, 1], np.exp(-(x**2).sum(1)), x[:, 0] ** 2], axis=1).astype(np.float32)
    mlp, weight = Mlp((2, 10, 6, 3), "tanh", "identity"), np.ones(600)
    fit = LevenbergMarquardt(mlp, [5])
    for _ in range(40):
        error = fit.step(x, y, weight, _one_run(600))
    adam = BatchedTrainer(mlp, TrainingSettings(loss="l2", rate=1e-2, batch=600), [5])
    data = BatchedSet.from_numpy(x, y, weight, _one_run(600))
    for _ in range(400):
        loss = adam.losses(adam.step(data, 400))
    # Ten times the steps of Adam, and still more than ten times its error.
    assert error[0] < 0.1 * loss[0]


def test_networks_do_not_disturb_each_other():
    rng = np.random.default_rng(6)
    x = rng.uniform(-1, 1, (150, 2)).astype(np.float32)
    y = (x @ rng.standard_normal((2, 3))).astype(np.float32)
    mlp = Mlp((2, 5, 3), "tanh", "identity")
    both, runs = LevenbergMarquardt(mlp, [1, 2, 3]), Runs(np.array([0, 100, 100]), np.array([100, 0, 50]))
    alone = LevenbergMarquardt(mlp, [3])
    for _ in range(3):
        both.step(x, y, np.ones(150), runs)
        alone.step(x[100:], y[100:], np.ones(50), _one_run(50))
    for name, value in alone.parameters.items():
        assert (both.parameters[name][2] == value[0]).all()
        assert (both.parameters[name][1] == mlp.initial(2)[name]).all()


def test_rows_of_weight_zero_do_not_count():
    rng = np.random.default_rng(7)
    x = rng.standard_normal((100, 2)).astype(np.float32)
    y = (x @ np.ones((2, 1))).astype(np.float32)
    y[::2] = 9.0
    fit = LevenbergMarquardt(Mlp((2, 1), output="identity"), [1], damping=0.0)
    fit.step(x, y, np.arange(100) % 2, _one_run(100))
    np.testing.assert_allclose(fit.parameters["w0"][0], 1.0, atol=1e-4)


def test_a_matrix_that_float32_cannot_factor_falls_back():
    """Two nearly equal columns: singular in float32, regular in float64."""
    hessian = np.array([[1.0, 1 - 1e-8], [1 - 1e-8, 1.0]])
    step = damped_solution(hessian, hessian @ np.array([1.0, 1.0]), 0.0)
    assert step is not None and step.sum() == pytest.approx(2.0, rel=1e-3)


def test_a_matrix_without_a_factor_is_no_step():
    assert damped_solution(-np.eye(2), np.ones(2), 0.0) is None


def test_a_converged_network_is_done_and_resume_is_exact():
    x = np.linspace(-1, 1, 20, dtype=np.float32)[:, None]
    fit = LevenbergMarquardt(Mlp((1, 1), output="identity"), [1])
    for _ in range(30):
        fit.step(x, 2 * x, np.ones(20), _one_run(20))
    assert fit.done[0]
    again = LevenbergMarquardt(Mlp((1, 1), output="identity"), [2])
    again.restore(fit.arrays())
    assert again.done[0] and (again.parameters["w0"] == fit.parameters["w0"]).all()


def test_large_or_unknown_networks_are_refused():
    with pytest.raises(ValueError, match=f"use 'adam' above {levenberg.MOST_WEIGHTS}"):
        LevenbergMarquardt(Mlp((12, 200, 100, 3)), [1])
    with pytest.raises(ValueError, match="no derivative of 'silu'"):
        LevenbergMarquardt(Mlp((12, 20, 3), "silu", "identity"), [1])
