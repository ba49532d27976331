"""The loop learns, repeats itself to the bit, resumes to the bit, and survives poison."""

import numpy as np
import pytest

from lightwell.core.formats import ARRAYS
from lightwell.networks import Mlp, Trainer, TrainingSet, TrainingSettings
from lightwell.networks.checkpoint import restore
from lightwell.networks.loop import TrainingState

ROWS, WIDTH = 4096, 6


@pytest.fixture(scope="module")
def data():
    rng = np.random.default_rng(0)
    x = rng.random((ROWS, WIDTH)).astype(np.float32)
    y = np.stack([x[:, 0] * x[:, 1] + 0.1, x[:, 2] + 0.2, np.full(ROWS, 0.3)], axis=1).astype(np.float32)
    return x, y


def _trainer(settings=None, seed=0):
    settings = settings or TrainingSettings(batch=512, evaluate_every=20, rate=2e-2)
    return Trainer(Mlp((WIDTH, 16, 3)), settings, seed)


def _error(trainer, x, y):
    return lambda p: float(np.mean(np.abs(trainer.network.evaluate(p, x) - y) / (y + 0.01)))


def _fit(data, steps, total, trainer=None, weight=None):
    x, y = data
    trainer = trainer or _trainer()
    weight = np.ones(ROWS) if weight is None else weight
    trainer.fit(TrainingSet.from_numpy(x, y, weight), _error(trainer, x, y), steps, total)
    return trainer


def test_error_falls(data):
    trainer = _fit(data, 400, 400)
    assert trainer.state.best_error < 0.08
    assert trainer.state.history[0][2] > 2 * trainer.state.best_error


def test_the_same_seed_gives_the_same_bits(data):
    a, b = _fit(data, 60, 60), _fit(data, 60, 60)
    assert all((a.parameters[k] == b.parameters[k]).all() for k in a.parameters)


def test_another_seed_gives_other_weights(data):
    a, b = _fit(data, 20, 20), _fit(data, 20, 20, _trainer(seed=1))
    assert any((a.parameters[k] != b.parameters[k]).any() for k in a.parameters)


@pytest.mark.parametrize("optimiser", ["adam", "adam_grid", "sgd"])
def test_resumed_training_ends_with_the_same_bits(data, tmp_path, optimiser):
    settings = TrainingSettings(batch=512, evaluate_every=20, optimiser=optimiser, decay=1e-4)
    whole = _fit(data, 80, 80, _trainer(settings))
    part = _fit(data, 40, 80, _trainer(settings))
    ARRAYS.write(tmp_path / "fit.npz", part.arrays())
    resumed = _trainer(settings)
    restore(resumed, ARRAYS.read(tmp_path / "fit.npz"))
    _fit(data, 80, 80, resumed)
    assert all((whole.parameters[k] == resumed.parameters[k]).all() for k in whole.parameters)
    assert all((whole.best[k] == resumed.best[k]).all() for k in whole.best)
    assert whole.state == resumed.state


def test_a_checkpoint_of_another_network_is_refused(data):
    other = Trainer(Mlp((WIDTH, 8, 3)), TrainingSettings(), 0)
    with pytest.raises(ValueError, match="the network needs"):
        restore(other, _fit(data, 20, 20).arrays())


def test_early_stopping_keeps_the_best_weights(data):
    """With targets that are pure noise the validation error stops falling, and the loop ends early."""
    x, _ = data
    noise = np.random.default_rng(5).exponential(1.0, (ROWS, 3)).astype(np.float32)
    trainer = _trainer(TrainingSettings(batch=512, evaluate_every=5, patience=4))
    held_out = noise[::-1].copy()
    error = _error(trainer, x, held_out)
    stopped = trainer.fit(TrainingSet.from_numpy(x, noise, np.ones(ROWS)), error, 1000, 1000)
    assert stopped and trainer.state.step < 1000
    assert error(trainer.best) == pytest.approx(trainer.state.best_error)


def test_a_training_that_ended_early_ends_there_when_it_is_resumed(data):
    x, _ = data
    noise = np.random.default_rng(5).exponential(1.0, (ROWS, 3)).astype(np.float32)
    rows = TrainingSet.from_numpy(x, noise, np.ones(ROWS))
    settings = TrainingSettings(batch=512, evaluate_every=5, patience=4)
    whole, kept = _trainer(settings), []
    error = _error(whole, x, noise[::-1].copy())
    assert whole.fit(rows, error, 1000, 2000, checkpoint=lambda: kept.append(whole.arrays()))
    assert whole.state.stopped == 1000 > whole.state.step
    resumed = _trainer(settings)
    restore(resumed, kept[-1])
    assert resumed.fit(rows, error, 1000, 2000) and resumed.state == whole.state
    assert all((whole.parameters[k] == resumed.parameters[k]).all() for k in whole.parameters)
    # The next stage goes on from there, in both.
    for trainer in (whole, resumed):
        trainer.fit(rows, error, 2000, 2000)
    assert resumed.state == whole.state and whole.state.history[-1][0] > kept[-1]["step"][0]
    assert all((whole.best[k] == resumed.best[k]).all() for k in whole.best)
    with pytest.raises(ValueError, match="'stopped' is not a count"):
        restore(_trainer(settings), kept[-1] | {"stopped": np.array(-1)})


def test_a_poisoned_row_does_not_reach_the_weights(data):
    x, y = data
    y = y.copy()
    y[7] = np.nan
    trainer = _trainer(TrainingSettings(batch=512, evaluate_every=1000))
    table = TrainingSet.from_numpy(x, y, np.ones(ROWS))
    for _ in range(16):
        trainer.step(table, 16)
    assert all(np.isfinite(v).all() for v in trainer.parameters.values())


def test_weights_count(data):
    """Rows of weight 0 have no influence: the fit of half the rows ignores the other half's wrong targets."""
    x, y = data
    wrong = y.copy()
    wrong[::2] = 3.0
    weight = np.where(np.arange(ROWS) % 2, 2.0, 0.0)
    trainer = _trainer()
    trainer.fit(TrainingSet.from_numpy(x, wrong, weight), _error(trainer, x, y), 300, 300)
    assert trainer.state.best_error < 0.1


def test_batches_cover_every_row_in_an_epoch(data):
    trainer = _trainer(TrainingSettings(batch=512))
    seen = np.zeros(ROWS, int)
    for step in range(ROWS // 512):
        trainer.state.step = step
        start = trainer.next_start(TrainingSet.from_numpy(*data, np.ones(ROWS)))
        seen[(start + np.arange(512)) % ROWS] += 1
    assert (seen == 1).all()


def test_a_set_that_grows_is_used_whole(data):
    """After more rows have come, batches reach them: a step on a set whose old rows weigh nothing still moves."""
    x, y = data
    trainer = _trainer(TrainingSettings(batch=512, evaluate_every=1000, clip=0.0))
    trainer.step(TrainingSet.from_numpy(x[:1024], y[:1024], np.ones(1024)), 100)
    before = trainer.parameters["w0"]
    weight = np.where(np.arange(ROWS) < 1024, 0.0, 1.0)
    grown = TrainingSet.from_numpy(x, y, weight)
    losses = [trainer.step(grown, 100).numpy()[0] for _ in range(8)]
    # One epoch of 8 batches over 4,096 rows, a quarter of which weighs nothing: at least 5 batches have a loss.
    assert sum(loss > 0 for loss in losses) >= 5
    assert (trainer.parameters["w0"] != before).any()


@pytest.mark.parametrize(
    ("steps", "best"), [([4, 100, 2], np.inf), ([4, 100, 2], np.nan), ([4, 100], 0.5), ([-1, 0, 0], 0.5)]
)
def test_progress_that_cannot_be_is_refused(steps, best):
    arrays = {"step": np.array(steps), "history": np.zeros((0, 3)), "best_error": np.array(best)}
    with pytest.raises(ValueError, match=r"'step'|'best_error'"):
        TrainingState.of(arrays)
    unmeasured = {**arrays, "step": np.array([4, 100, 0]), "best_error": np.array(np.inf)}
    assert TrainingState.of(unmeasured) == TrainingState(4, 100, np.inf, 0)
