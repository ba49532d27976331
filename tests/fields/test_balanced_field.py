"""The field ``balanced``: no dead experts, no seams, nothing that pops; what ships is what was learned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_up import SETUP, smooth, unit

from lightwell.core.formats import ARRAYS
from lightwell.fields.base import FieldSetup, query_inputs
from lightwell.fields.surface import balanced
from lightwell.fields.surface.cells import Cells, light_bins, signature
from lightwell.fields.surface.examples import Examples
from lightwell.fields.surface.inputs import Inputs
from lightwell.fields.surface.lattice import Gate, VertexLattice
from lightwell.files import under
from lightwell.graph import evaluate, graph_from_json, graph_to_json
from lightwell.networks.checkpoint import restore
from lightwell.networks.grouped import GroupedRows
from lightwell.transport.samples import Query, Samples

EXPERTS, STEPS = 6, 240
SMALL = replace(balanced.PRESETS["default"], experts=EXPERTS, cells=8, hidden=(12, 8))
SMALL = replace(SMALL, training=replace(SMALL.training, batch=256, evaluate_every=40))


def room(count: int, seed: int, kind: str = "point") -> Query:
    """Points on the inside of the walls of the cube [−1, 1]³, seen and lit from anywhere in it."""
    rng = np.random.default_rng(seed)
    position = rng.uniform(-1, 1, (count, 3))
    axis, side, rows = rng.integers(0, 3, count), rng.choice([-1.0, 1.0], count), np.arange(count)
    normal = np.zeros((count, 3))
    position[rows, axis], normal[rows, axis] = side, -side
    light = unit(rng.standard_normal((count, 3))) if kind == "sun" else rng.uniform(-0.8, 0.8, (count, 3))
    columns = [position, normal, unit(normal + 0.5 * unit(rng.standard_normal((count, 3)))), light]
    columns += [rng.uniform(0.2, 0.8, (count, 3)), np.full((count, 1), 0.6), np.zeros((count, 1))]
    return Query(*(np.asarray(c, np.float32) for c in columns))


def samples(count: int, seed: int, radiance=smooth, noise: float = 0.0, query: Query | None = None) -> Samples:
    query, rng = query or room(count, seed), np.random.default_rng(seed + 1000)
    halves = [(radiance(query) * (1 + noise * rng.uniform(-1, 1, (count, 1)))).astype(np.float32) for _ in range(2)]
    return Samples(query, *halves, np.ones(count, np.float32), np.zeros(count, np.uint32))


def begin(preset=SMALL, seed: int = 0, setup: FieldSetup = SETUP, count: int = 12_000, **options):
    fit = balanced.BalancedFit(setup, preset, seed)
    fit.learn_from(samples(count, 1, **options))
    fit.validate_on(samples(3000, 2, **options))
    return fit


@pytest.fixture(scope="module")
def fit():
    """Trained once, with noise in the targets."""
    fit = begin(noise=0.3)
    fit.train(STEPS, STEPS)
    return fit


def moved(query: Query, **columns) -> Query:
    return Query(**(vars(query) | columns))


# ------------------------------------------------------------------ shares


def test_no_expert_is_dead_and_none_is_full(fit):
    for query in (fit.examples.query, room(20_000, 9)):
        share = np.bincount(fit.segment(query), minlength=EXPERTS) * EXPERTS / len(query)
        # New points: three standard deviations of a share that is counted on 20,000 of them.
        slack = 0 if query is fit.examples.query else 3 * np.sqrt(EXPERTS / len(query))
        assert share.min() >= SMALL.floor - slack
        assert share.max() <= SMALL.cap + slack
    assert fit.facts["dead"] == []
    assert len(fit.facts["curves"]["step"]) == 1 + min(SMALL.rounds, int(balanced.ROUNDS_SHARE * STEPS / 25))


# ------------------------------------------------------------------ seams


def walk(count: int = 40_001, height: float = 0.31) -> Query:
    """Along a wall in fine steps, seen and lit from one place."""
    ones = np.ones((count, 1))
    position = np.concatenate([np.linspace(-0.95, 0.95, count)[:, None], height * ones, -ones], axis=1)
    columns = [position, ones * [0, 0, 1], ones * [0, 0, 1], ones * [0.1, 0.2, 0.3]]
    columns += [0.5 * np.ones((count, 3)), 0.6 * ones, 0 * ones]
    return Query(*(np.asarray(c, np.float32) for c in columns))


def alone(fit, query: Query) -> np.ndarray:
    """[N, 3] prediction of the first expert by itself, as hard gates have it."""
    split = fit.gate(query)
    rows = Inputs(SETUP, fit.preset.inputs, fit.preset.octaves).rows(query)
    outputs = GroupedRows(rows, split.first, fit.preset.experts).evaluate(fit.mlp, fit.weights)
    return outputs * SETUP.unit * query.reflectance


def folded(fit) -> dict[str, np.ndarray]:
    """[M, …] current weights for inputs as they are: W (x − c) / s + b = (W / s) x + (b − (W / s) c)."""
    arrays = under("field", fit.arrays())
    weights = under("trainer.value", arrays)
    weights["w0"] = weights["w0"] / arrays["spread"][:, :, None]
    weights["b0"] = weights["b0"] - np.einsum("ef,efo->eo", arrays["center"], weights["w0"])[:, None]
    return weights


def largest(steps: np.ndarray) -> float:
    return float(np.abs(steps).max())


def test_the_blend_has_no_seam(fit):
    met = 0
    for height in (-0.73, -0.2, 0.31, 0.66):
        query = walk(height=height)
        graph = fit.lower()
        shipped = evaluate(graph, query_inputs(query))["radiance"] * query.reflectance
        hard, first = np.diff(alone(fit, query), axis=0), fit.segment(query)
        borders = first[1:] != first[:-1]
        met += borders.sum()
        if not borders.any():
            continue
        # The blend changes by no more than the experts differ, over a step of the lattice. Its slope is at most 1.5 of
        # that (smoothstep) times 4, where a third expert is near; the slope of the experts themselves comes on top.
        fine = 1.9 / (len(query) - 1) / fit.gate.lattice.step
        bound = 6 * fine * largest(hard) + 2 * largest(hard[~borders]) + 1e-6
        for values in (fit.predict(query), shipped):
            steps = np.diff(values, axis=0)
            assert largest(steps) <= bound
            # One expert per point does jump there.
            assert largest(hard[borders]) > 10 * largest(steps[borders])
    assert met > 3


def test_the_border_is_learned_as_well_as_the_interior(fit):
    test = samples(8000, 5)
    error = (np.abs(fit.predict(test.query) - test.radiance) / (test.radiance + 0.01 * SETUP.unit)).mean(axis=1)
    band = fit.gate(test.query).share > 0
    assert 0.05 < band.mean() < 0.9
    assert error[band].mean() <= 1.2 * error[~band].mean()
    # The mean as a constant scores 0.5.
    assert error.mean() < 0.1


# ------------------------------------------------------------------ light and eye


def test_light_and_eye_move_no_border(fit):
    query, graph = room(4000, 3), fit.lower()
    before = evaluate(graph, query_inputs(query))
    other = moved(query, light=query.light[::-1].copy(), view=unit(query.normal + 0.1).astype(np.float32))
    after = evaluate(graph, query_inputs(other))
    for name in ("segment", "overlap", "second"):
        assert (before[name] == after[name]).all()
    assert (before["radiance"] != after["radiance"]).any()


def test_the_gate_sees_what_the_light_does():
    """A wall whose left half answers to the light and whose right half does not: the same normal, the same plane."""

    def split(query):
        lit = 0.1 + 0.8 * (query.light[:, 1:2] > 0) * (query.position[:, 0:1] < 0)
        return query.reflectance * lit

    data = samples(20_000, 4, split, query=moved(walk(20_000), light=room(20_000, 4).light))
    height = np.random.default_rng(0).uniform(-1, 1, 20_000)
    data.query.position[:, 1] = height
    examples = Examples.of(data, SETUP, Inputs(SETUP, "lean"), True)
    lattice = VertexLattice.around(SETUP, data.query, 8)
    cells = Cells.of(lattice, examples)
    found, x = signature(cells, examples), cells.mean(data.query.position)[:, 0]
    left, right = found[x < -0.05, 0], found[x > 0.05, 0]
    assert abs(left.mean() - right.mean()) > 5 * max(left.std(), right.std())


def test_bins_of_the_light_hold_equally_many():
    light = np.random.default_rng(0).normal(size=(6400, 3)) * [3, 1, 0.1]
    assert set(np.bincount(light_bins(light))) == {100}
    assert (light_bins(np.zeros((10, 3))) == 0).all()


# ------------------------------------------------------------------ the lattice


def test_two_sides_of_a_thin_wall_have_different_experts():
    """A wall that is much thinner than a step of the lattice."""
    query = room(8000, 0)
    query.position[:, 2] = np.where(np.arange(8000) % 2, 0.005, -0.005)
    query.normal[:] = np.sign(query.position[:, 2:3]) * [0, 0, 1]
    lattice = VertexLattice.around(SETUP, query, 8)
    number, cell = np.unique(lattice.cell(query), return_inverse=True)
    front = np.zeros(len(number), np.int64)
    front[cell[query.position[:, 2] > 0]] = 1
    split = Gate(lattice, lattice.scores(number, front, 2))(query)
    assert (split.first == (query.position[:, 2] > 0)).all()
    assert (split.share == 0).all()


def test_neighbours_are_those_that_touch():
    lattice = VertexLattice(np.zeros(3), 1.0, (3, 4, 5))
    cells = np.random.default_rng(0).permutation(60)[:25]
    place = np.stack(np.unravel_index(cells, lattice.shape), axis=1)
    near = np.abs(place[:, None] - place).max(axis=2) == 1
    pairs = lattice.neighbours(cells)
    found = np.zeros_like(near)
    found[pairs[:, 0], pairs[:, 1]] = True
    assert (found == near).all() and len(pairs) == near.sum()


# ------------------------------------------------------------------ what ships


def test_what_ships_is_what_was_learned(fit):
    query, graph = room(4000, 6), fit.lower()
    out = evaluate(graph, query_inputs(query))
    # Half-precision weights (11 bits) over a few layers.
    assert np.allclose(out["radiance"] * query.reflectance, fit.predict(query), rtol=2e-2, atol=1e-2 * SETUP.unit)
    assert graph.macs == pytest.approx(fit.macs, abs=20)
    split = fit.gate(query)
    assert (out["segment"][:, 0] == split.first).mean() > 0.999
    assert np.allclose(out["overlap"][:, 0], split.share, atol=1e-3)
    again = graph_from_json(*graph_to_json(graph))
    assert (evaluate(again, query_inputs(query))["radiance"] == out["radiance"]).all()


def test_the_default_is_small():
    fit = begin(balanced.PRESETS["default"], setup=replace(SETUP, matte=True))
    fit.train(2, 2)
    assert sum(buffer.nbytes for buffer in fit.lower().buffers.values()) <= 60_000


# ------------------------------------------------------------------ the promises of every fit


def test_killed_and_resumed_ends_with_the_same_bits(tmp_path):
    steps, straight, part = 90, begin(), begin()
    straight.train(steps, steps)
    part.train(50, steps)
    ARRAYS.write(tmp_path / "fit.npz", part.arrays())
    again = begin()
    restore(again, ARRAYS.read(tmp_path / "fit.npz"))
    again.train(steps, steps)
    query = room(500, 7)
    assert (again.predict(query) == straight.predict(query)).all()
    assert again.facts == straight.facts
    assert again.state.step == straight.state.step and again.state.best_error == straight.state.best_error


def test_dealing_anew_changes_no_expert():
    """New cells scale an expert's inputs anew, and what it computes stays the same."""
    trained = begin(replace(SMALL, rounds=1))
    trained.train(30, 100_000)
    # A rate of 0: training changes no weight, so that what changes is the cells.
    fit = begin(replace(SMALL, rounds=1, training=replace(SMALL.training, rate=0.0)))
    restore(fit, trained.arrays())
    before, first = folded(fit), {name: value.copy() for name, value in fit.arrays().items()}
    # A hundred steps: a quarter of them is over, and the second assignment is due.
    fit.train(31, 100)
    after, second = folded(fit), fit.arrays()
    for name, value in before.items():
        assert np.allclose(after[name], value, rtol=1e-4, atol=1e-5)
    assert first["field.counts"].tolist() == [1, 1] and second["field.counts"].tolist() == [2, 2]
    assert not np.array_equal(first["field.center"], second["field.center"])


@pytest.mark.parametrize("kind", ["sun", "static"])
def test_every_kind_of_light(kind):
    fit = balanced.BalancedFit(replace(SETUP, light=kind), SMALL, 0)
    query = room(3000, 1, kind)
    if kind == "static":
        query.light[:] = 0
    fit.learn_from(samples(3000, 1, query=query))
    fit.validate_on(samples(3000, 2, query=query))
    fit.train(60, 60)
    out = evaluate(fit.lower(), query_inputs(query))
    assert out["radiance"].shape == (3000, 3) and np.isfinite(out["radiance"]).all()


def test_few_samples_do():
    """Fewer samples than experts and cells."""
    fit = begin(count=5)
    fit.train(60, 60)
    assert np.isfinite(fit.predict(room(100, 1))).all()


def test_more_samples_can_come():
    """As the bake does it: train a part, replace the samples by more of them, train on."""
    fit = begin(count=3000)
    fit.train(40, 90)
    fit.learn_from(samples(6000, 9))
    fit.train(90, 90)
    assert fit.state.step == 90
    assert np.isfinite(fit.predict(room(10, 1))).all()
