"""Graphs over many queries: what NumPy evaluates, however many frames the rows have."""

from __future__ import annotations

import numpy as np
import pytest

from lightwell.fields import tabulate
from lightwell.fields.base import query_inputs
from lightwell.fields.tabulate import Tabulated
from lightwell.graph import Builder, Graph, evaluate
from tests.fields.made_up import make_query

ROWS = 600


def graph() -> Graph:
    """A graph whose light network predicts a layer, and gives an output of its own."""
    rng = np.random.default_rng(2)
    b = Builder(position=3, light=3)
    x = b.linear("light", rng.standard_normal((4, 3), np.float32), np.zeros(4, np.float32), per_frame=True)
    frame = b.activate(x, "sine", per_frame=True)
    local = b.linear("position", rng.standard_normal((4, 3), np.float32), np.zeros(4, np.float32))
    return b.build(product=b.multiply(local, frame), frame=frame, local=local)


@pytest.mark.parametrize("run", [1, 30, ROWS])
def test_rows_of_few_and_of_many_frames_are_what_numpy_evaluates(run):
    query = make_query(ROWS, 1)
    query.light[:] = query.light[::run].repeat(run, axis=0)
    made = Tabulated(graph())
    found = made(query)
    inputs = {name: values for name, values in query_inputs(query).items() if name in made.graph.inputs}
    for name, expected in evaluate(made.graph, inputs).items():
        assert found[name].dtype == np.float32 and found[name].shape == (ROWS, 4)
        np.testing.assert_allclose(found[name], expected, rtol=1e-5, atol=1e-6)
    assert list(made(query, "local")) == ["local"]
    # A light that is the same for all, from outside.
    given = Tabulated(graph(), {"light": query.light[0]})(query)
    expected = evaluate(made.graph, {**inputs, "light": query.light[:1]})
    np.testing.assert_allclose(given["product"], expected["product"], rtol=1e-5, atol=1e-6)


def test_no_rows_give_tables_without_rows():
    assert Tabulated(graph())(make_query(0, 1), "product")["product"].shape == (0, 4)


def test_rows_are_parted_by_their_number_and_by_their_frames():
    parts = lambda number: [(part.start, part.stop) for part in tabulate.parts(number)]  # noqa: E731
    assert parts(np.zeros(0, int)) == []
    assert parts(np.zeros(7, int)) == [(0, 7)]
    many = np.zeros(tabulate.ROWS_AT_ONCE + 5, int)
    assert parts(many) == [(0, tabulate.ROWS_AT_ONCE), (tabulate.ROWS_AT_ONCE, len(many))]
    frames = tabulate.FRAMES_AT_ONCE
    assert parts(np.arange(2 * frames + 3)) == [(0, frames), (frames, 2 * frames), (2 * frames, 2 * frames + 3)]
