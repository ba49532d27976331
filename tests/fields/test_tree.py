"""The regression tree: scikit-learn's own answers, exact borders, leaves that hold means."""

from dataclasses import replace

import numpy as np
from made_up import SETUP, make_query, make_samples
from sklearn.tree import DecisionTreeRegressor

from lightwell.fields.surface.partition import walk
from lightwell.fields.surface.tree import PRESETS, TreeFit, node_rows


def test_the_rows_are_the_tree_of_scikit_learn():
    rng = np.random.default_rng(0)
    x, y = rng.random((2000, 5)).astype(np.float32), rng.random((2000, 3))
    tree = DecisionTreeRegressor(min_samples_leaf=3, random_state=0).fit(x, y)
    rows, number, depth = node_rows(tree.tree_)
    # The samples themselves, and the thresholds, where ≤ and < part.
    border = x[:500].copy()
    border[:, tree.tree_.feature[0]] = np.float32(tree.tree_.threshold[0])
    for points in (x, border):
        assert (walk(rows, points) == number[tree.apply(points)]).all()
    assert depth == tree.get_depth()


def test_a_single_leaf():
    tree = DecisionTreeRegressor().fit(np.zeros((5, 2)), np.ones((5, 3)))
    rows, number, depth = node_rows(tree.tree_)
    assert (walk(rows, np.zeros((4, 2))) == 0).all() and number.tolist() == [0] and depth == 1


def test_leaves_hold_the_weighted_mean():
    """Also where the tree is grown on logarithms, whose mean is another one."""
    fit = TreeFit(SETUP, PRESETS["default"], 0)
    samples = make_samples(4000, 1, noise=0.5)
    fit.learn_from(samples)
    fit.validate_on(make_samples(400, 2))
    fit.train(10, 10)
    grown = fit.arrays()
    leaf = walk(grown["nodes"], fit.inputs.rows(samples.query))
    target = samples.radiance / SETUP.unit / samples.query.reflectance
    np.testing.assert_allclose(grown["values"][leaf].mean(axis=0), target.mean(axis=0), rtol=1e-4)


def step(query):
    return np.where(query.position[:, :1] > 0, 0.7, 0.2) * np.ones((1, 3))


def test_the_size_of_the_leaves_follows_the_noise():
    chosen = {}
    for noise in (0.0, 1.0):
        fit = TreeFit(SETUP, PRESETS["report"], 0)
        fit.learn_from(make_samples(8000, 1, step, noise))
        fit.validate_on(make_samples(1000, 2, step))
        fit.train(1, 1)
        chosen[noise] = min(fit.facts["tried"], key=lambda row: row["error"])["smallest_leaf"]
    assert chosen[1.0] > chosen[0.0]


def test_the_cap_on_leaves_is_kept():
    fit = TreeFit(SETUP, replace(PRESETS["report"], leaves=20), 0)
    fit.learn_from(make_samples(3000, 1))
    fit.validate_on(make_samples(300, 2))
    fit.train(1, 1)
    assert fit.facts["leaves"] <= 20 and fit.predict(make_query(5, 1)).shape == (5, 3)
