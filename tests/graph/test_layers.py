"""Products by rows of weights, which CUDA uses in place of cooperative vectors, on any backend against NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from lightwell.backend import dr, mi
from lightwell.graph.ops.layers import WRITTEN_OUT, cooperative, gathered_product, gathered_rows, row_table

pytestmark = pytest.mark.gpu

# Inputs and outputs: one number, no whole packet, written out, in a loop.
SHAPES = [(1, 1), (3, 4), (12, 20), (33, 70)]
# ... and the emitted layer of a field: its kernel takes half a minute to compile.
LARGE = pytest.param(64, 576, marks=pytest.mark.slow)


def given(inputs: int, lanes: int) -> tuple[np.ndarray, list[mi.Float]]:
    x = np.random.default_rng(1).normal(size=(lanes, inputs)).astype(np.float32)
    return x, [mi.Float(np.ascontiguousarray(column)) for column in x.T]


def found(components: list[mi.Float]) -> np.ndarray:
    return np.stack([np.array(c) for c in components], axis=1)


@pytest.mark.parametrize("lanes", [1, 37])
@pytest.mark.parametrize(("inputs", "outputs"), [*SHAPES, LARGE])
def test_rows_agree_with_numpy(inputs, outputs, lanes):
    rng = np.random.default_rng(0)
    weights, bias = rng.normal(size=(outputs, inputs)), rng.normal(size=outputs)
    x, columns = given(inputs, lanes)
    out = found(gathered_product(gathered_rows(weights[None], bias[None]), mi.UInt32(0), outputs, columns))
    expected = x @ weights.T + bias
    assert np.abs(out - expected).max() <= 1e-5 * np.abs(expected).max()


@pytest.mark.parametrize(("inputs", "outputs"), [(6, 5), (64, 40)])
def test_each_lane_reads_the_rows_of_its_expert(inputs, outputs):
    rng = np.random.default_rng(0)
    weights, bias = rng.normal(size=(7, outputs, inputs)), rng.normal(size=(7, outputs))
    x, columns = given(inputs, 37)
    expert = rng.integers(0, 7, 37)
    first = mi.UInt32(expert.astype(np.uint32) * outputs)
    out = found(gathered_product(gathered_rows(weights, bias), first, outputs, columns))
    expected = np.einsum("noi,ni->no", weights[expert], x) + bias[expert]
    assert np.abs(out - expected).max() <= 1e-5 * np.abs(expected).max()


def test_both_forms_are_tested():
    sizes = [inputs * outputs for inputs, outputs in SHAPES]
    assert min(sizes) < WRITTEN_OUT < max(sizes)


def test_a_table_made_on_the_device_has_no_bias():
    weights = np.random.default_rng(0).normal(size=(5, 9)).astype(np.float32)
    x, columns = given(9, 11)
    out = found(gathered_product(row_table(mi.TensorXf(weights)), mi.UInt32(0), 5, columns))
    assert np.allclose(out, x @ weights.T, atol=1e-5)


def test_a_product_inside_a_loop_is_one_kernel():
    """Renderers evaluate fields inside their loops over bounces."""
    weights = np.random.default_rng(0).normal(size=(64, 64)).astype(np.float32) / 16
    table = row_table(mi.TensorXf(weights))
    x, columns = given(64, 8)

    def body(i, *state):
        return i + 1, *gathered_product(table, mi.UInt32(0), 64, list(state))

    _, *out = dr.while_loop((dr.zeros(mi.UInt32, 8), *columns), lambda i, *_: i < 3, body)
    expected = x @ weights.T @ weights.T @ weights.T
    assert np.allclose(found(out), expected, atol=1e-5)


def test_the_processor_has_cooperative_vectors():
    from lightwell.backend import ACTIVE

    assert cooperative() is ACTIVE.variant.startswith("llvm")
