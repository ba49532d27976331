"""Every registered op and every test vector: NumPy against closed forms, Dr.Jit against NumPy, files against code."""

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from format_vectors import FOLDER, SCHEMA_FILE, cases, document, schema_text

from lightwell.backend import aligned, dr, mi
from lightwell.graph import OPS, Builder, Graph, compile, evaluate, evaluate_drjit
from lightwell.graph.ops.encoding import sh_components
from lightwell.graph.ops.hashgrid import PRIMES, levels
from lightwell.graph.ops.linear import MANY_EXPERTS
from lightwell.graph.ops.tree import random_tree

pytestmark = pytest.mark.gpu

CASES = cases()
# The contract: evaluators agree to this, relative to max(1, |value|).
TOLERANCE = 1e-4


def error(found: np.ndarray, expected: np.ndarray) -> float:
    return float((np.abs(found - expected) / np.maximum(1, np.abs(expected))).max())


def to_drjit(inputs):
    return {name: [mi.Float(column) for column in value.T] for name, value in inputs.items()}


def from_drjit(components, points):
    return np.stack([np.broadcast_to(np.array(component), points) for component in components], axis=1)


def run(value, b: Builder, **inputs):
    return evaluate(b.build(value=value), {k: np.asarray(v, np.float32) for k, v in inputs.items()})["value"]


@pytest.mark.parametrize("op", sorted(OPS))
def test_every_op_has_a_vector(op):
    assert any(node.op == op for graph, _ in CASES.values() for node in graph.nodes)


@pytest.mark.parametrize("name", CASES)
def test_drjit_agrees_with_numpy(name):
    graph, inputs = CASES[name]
    points = max(len(value) for value in inputs.values())
    found = evaluate_drjit(graph, to_drjit(inputs))
    for key, expected in evaluate(graph, inputs).items():
        assert error(from_drjit(found[key], points), expected) < TOLERANCE


def test_drjit_disagrees_when_weights_are_transposed():
    b = Builder(a=3)
    weights = np.arange(9.0).reshape(3, 3)
    good = b.build(value=b.linear("a", weights, np.zeros(3)))
    b = Builder(a=3)
    bad = b.build(value=b.linear("a", weights.T, np.zeros(3)))
    inputs = {"a": np.random.default_rng(0).random((4, 3), np.float32)}
    found = from_drjit(evaluate_drjit(bad, to_drjit(inputs))["value"], 4)
    assert error(found, evaluate(good, inputs)["value"]) > 100 * TOLERANCE


def test_compiled_graph_is_one_kernel_and_keeps_frame_values():
    graph, inputs = CASES["network_factored"]
    compiled = compile(graph)
    many = {name: np.repeat(value, 24, 0) if len(value) == 1 else value for name, value in inputs.items()}
    moving = to_drjit(many)
    dr.eval(moving)
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        dr.eval(compiled(moving))
        assert len(dr.kernel_history((dr.KernelType.JIT,))) == 1
        still = to_drjit(inputs)
        dr.eval(still)
        dr.kernel_history_clear()
        dr.eval(compiled(still))
        sizes = [entry["size"] for entry in dr.kernel_history((dr.KernelType.JIT,))]
    assert sizes[-1] == 24
    assert set(sizes[:-1]) == {1}


def moved(graph: Graph, begin: int) -> Graph:
    """The same graph whose tables begin some bytes behind an aligned address, as those of a file do."""

    def table(array: np.ndarray) -> np.ndarray:
        memory = aligned(np.zeros(array.nbytes + begin, np.uint8), np.uint8)
        memory[begin:] = np.frombuffer(array.tobytes(), np.uint8)
        return memory[begin:].view(array.dtype).reshape(array.shape)

    return replace(graph, buffers={k: replace(b, array=table(b.array)) for k, b in graph.buffers.items()})


@pytest.mark.parametrize("name", ["texture_5x7x4", "rows_7x4", "tree_3_6", "hashgrid_6x4_6"])
def test_tables_anywhere_in_memory_need_the_same_kernels(name):
    """Kernels depend on the alignment of what they read; what is compiled once is found on disk by the next process."""
    graph, inputs = CASES[name]
    given, kernels = to_drjit(inputs), []
    dr.eval(given)
    for begin in (0, 4, 16):
        compiled = compile(moved(graph, begin))
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            dr.kernel_history_clear()
            dr.eval(compiled(given))
            kernels.append({entry["hash"] for entry in dr.kernel_history((dr.KernelType.JIT,))})
    assert kernels[0] == kernels[1] == kernels[2]


def test_drjit_takes_vectors_and_single_floats():
    b = Builder(a=3, s=1)
    compiled = compile(b.build(value=b.multiply("a", "s")))
    out = compiled({"a": mi.Vector3f(1, 2, 3), "s": mi.Float(2)})["value"]
    assert [component[0] for component in out] == [2, 4, 6]


@pytest.mark.parametrize("name", CASES)
def test_files_are_up_to_date(name):
    """Everything but the outputs exactly; those to the contract, because machines differ in the last bit."""
    stored = json.loads((FOLDER / f"{name}.json").read_text())
    fresh = json.loads(json.dumps(document(name, *CASES[name])))
    outputs, expected = stored.pop("outputs"), fresh.pop("outputs")
    assert stored == fresh, "run 'python tools/format_vectors.py'"
    for key, value in expected.items():
        assert error(np.array(outputs[key]["data"]), np.array(value["data"])) < 1e-5


def test_files_are_these_and_small():
    files = list(FOLDER.glob("*.json"))
    assert {path.stem for path in files} == set(CASES)
    assert sum(path.stat().st_size for path in files) < 1_000_000
    assert SCHEMA_FILE.read_text() == schema_text(), "run 'python tools/format_vectors.py'"


def test_format_describes_every_op():
    table = (FOLDER.parent / "FORMAT.md").read_text().split("### Operations")[1].split("###")[0]
    first = "".join(line.split("|")[1] for line in table.splitlines() if line.startswith("|"))
    assert set(re.findall(r"`(\w+)`", first)) == set(OPS)


def test_frequency_is_exact_at_high_octaves():
    b = Builder(a=1)
    x = np.random.default_rng(0).uniform(-1, 1, (200, 1)).astype(np.float32)
    found = run(b.frequency("a", 20), b, a=x).reshape(200, 20, 2)
    angle = np.exp2(np.arange(20)) * math.pi * x.astype(np.float64)
    np.testing.assert_allclose(found, np.stack([np.sin(angle), np.cos(angle)], -1), atol=1e-6)


def test_oneblob_is_the_integral_of_a_gaussian():
    b = Builder(a=2)
    x = np.random.default_rng(0).random((20, 2), np.float32)
    found = run(b.oneblob("a", 8), b, a=x).reshape(20, 2, 8)
    for index in np.ndindex(found.shape):
        row, component, bin = index
        edges = [(edge - 8 * float(x[row, component])) / math.sqrt(2) for edge in (bin, bin + 1)]
        assert found[index] == pytest.approx(0.5 * (math.erf(edges[1]) - math.erf(edges[0])), abs=1e-6)


def test_sh_is_orthonormal_and_in_the_order_of_drjit():
    grid = (np.arange(128) + 0.5) / 128
    cosine, phi = np.meshgrid(2 * grid - 1, 2 * np.pi * grid)
    sine = np.sqrt(1 - cosine**2)
    x, y, z = (v.ravel() for v in (sine * np.cos(phi), sine * np.sin(phi), cosine))
    basis = np.stack(sh_components(x, y, z, 4))
    np.testing.assert_allclose(basis @ basis.T * (4 * np.pi / len(x)), np.eye(16), atol=2e-3)
    expected = dr.sh_eval(mi.Vector3f(0.48, -0.6, 0.64), 3)
    np.testing.assert_allclose(sh_components(0.48, -0.6, 0.64, 4), [v[0] for v in expected], atol=1e-6)


@pytest.mark.parametrize("shape", [(1, 1, 2), (3, 5, 4), (2, 3, 4, 3)])
def test_tables_return_texels_at_centres_and_are_linear_between(shape):
    dimensions = len(shape) - 1
    table = np.random.default_rng(0).normal(size=shape).astype(np.float32)
    b = Builder(p=dimensions)
    value = b.texture("p", table) if dimensions == 2 else b.grid("p", table)
    indices = np.array(list(np.ndindex(shape[:-1])))
    centres = ((indices + 0.5) / shape[:-1])[:, ::-1]
    np.testing.assert_allclose(run(value, b, p=centres), table.reshape(-1, shape[-1]), atol=1e-5)
    low = run(value, b, p=np.full((1, dimensions), -9.0))
    np.testing.assert_allclose(low[0], table[(0,) * dimensions])


def test_grid_reproduces_a_linear_function_of_x_y_z():
    size = np.array([4, 5, 6])  # D, H, W
    z, y, x = np.meshgrid(*((np.arange(s) + 0.5) / s for s in size), indexing="ij")
    b = Builder(p=3)
    value = b.grid("p", (1 + 2 * x - 3 * y + 4 * z)[..., None])
    p = np.random.default_rng(0).uniform(0.2, 0.8, (50, 3))
    np.testing.assert_allclose(run(value, b, p=p)[:, 0], 1 + p @ [2, -3, 4], atol=1e-5)


def test_hashgrid_by_hand():
    layout = levels(3, 4, 1.5, 8)
    assert [(level.cells, level.dense, level.entries, level.offset) for level in layout] == [
        (4, True, 125, 0),
        (6, False, 256, 125),
        (9, False, 256, 381),
    ]
    table = np.random.default_rng(0).normal(size=(637, 1)).astype(np.float32)
    b = Builder(p=3)
    value = b.hashgrid("p", table, 3, 4, 1.5, 8)
    vertex = np.array([1, 2, 3])
    found = [run(value, b, p=[vertex / level.cells])[0, i] for i, level in enumerate(layout)]
    hashed = (1 * PRIMES[0] ^ 2 * PRIMES[1] ^ 3 * PRIMES[2]) % 256
    expected = [table[1 + 5 * (2 + 5 * 3), 0], table[125 + hashed, 0], table[381 + hashed, 0]]
    np.testing.assert_allclose(found, expected, atol=1e-5)


def test_experts_use_their_own_weights_with_the_index_rounded_and_clamped():
    weights = np.arange(3.0).reshape(3, 1, 1)
    b = Builder(a=1, i=1)
    value = b.linear("a", weights, np.zeros((3, 1)), index="i")
    index = np.array([[-5.0], [0.4], [0.6], [1.4], [99.0]])
    np.testing.assert_array_equal(run(value, b, a=np.ones((5, 1)), i=index)[:, 0], [0, 0, 1, 1, 2])


@pytest.mark.parametrize("experts", [MANY_EXPERTS - 1, MANY_EXPERTS])
def test_many_experts_agree_with_numpy(experts):
    rng = np.random.default_rng(0)
    b = Builder(a=6, i=1)
    weights, bias = rng.normal(size=(experts, 5, 6)), rng.normal(size=(experts, 5))
    graph = b.build(value=b.linear("a", weights, bias, index="i"))
    index = np.concatenate([[-3, experts + 9], rng.integers(0, experts, 62)])[:, None]
    inputs = {"a": rng.normal(size=(64, 6)).astype(np.float32), "i": index.astype(np.float32)}
    found = from_drjit(evaluate_drjit(graph, to_drjit(inputs))["value"], 64)
    assert error(found, evaluate(graph, inputs)["value"]) < TOLERANCE


# x < 0.5 ? (y < 0.25 ? leaf 0 : leaf 2) : leaf 1
TREE = [[0, 0.5, 1, -2], [1, 0.25, -1, -3]]


def test_tree_by_hand():
    b = Builder(a=2)
    a = [[0.4, 0.1], [0.4, 0.25], [0.5, 0.0], [-9, 9], [9, -9]]
    assert run(b.tree("a", TREE, depth=2), b, a=a)[:, 0].tolist() == [0, 2, 1, 2, 1]


def test_leaves_of_a_random_tree_are_boxes_that_partition_space():
    nodes = random_tree(3, 7, np.random.default_rng(0))
    b = Builder(a=3)
    points = np.random.default_rng(1).random((2000, 3), np.float32)
    found = run(b.tree("a", nodes, depth=7), b, a=points)[:, 0]
    for row, (low, high) in leaf_boxes(nodes).items():
        inside = ((points >= low) & (points < high)).all(axis=1)
        np.testing.assert_array_equal(found == row, inside)


def leaf_boxes(nodes, row=0, low=(-np.inf,) * 3, high=(np.inf,) * 3):
    """Leaf number -> its box, by recursion: the oracle of the walk."""
    if row < 0:
        return {-1 - row: (low, high)}
    axis, threshold, below, above = nodes[row]
    here = np.arange(len(low)) == axis
    below_high = np.where(here, np.minimum(high, threshold), high)
    above_low = np.where(here, np.maximum(low, threshold), low)
    return leaf_boxes(nodes, int(below), low, below_high) | leaf_boxes(nodes, int(above), above_low, high)


def test_rows_round_and_clamp():
    b = Builder(i=1)
    table = np.arange(6.0).reshape(3, 2)
    index = np.array([[-5.0], [0.49], [0.5], [1.4], [99.0]])
    np.testing.assert_array_equal(run(b.rows("i", table), b, i=index), table[[0, 0, 1, 1, 2]])


def test_nearest_is_the_texel_around_a_point():
    table = np.random.default_rng(0).normal(size=(2, 3, 4, 2)).astype(np.float32)
    b = Builder(p=3)
    value = b.nearest("p", table)
    z, y, x = np.array(list(np.ndindex(2, 3, 4))).T
    for shift in (0.02, 0.5, 0.98):
        p = np.stack([(x + shift) / 4, (y + shift) / 3, (z + shift) / 2], axis=1)
        np.testing.assert_array_equal(run(value, b, p=p), table[z, y, x])
    np.testing.assert_array_equal(run(value, b, p=[[1, 1, 1], [-3, 0, 5]]), [table[1, 2, 3], table[1, 0, 0]])


def test_top2_shares_are_smooth_where_experts_change_places():
    b = Builder(g=3)
    value = b.top2("g")
    assert run(value, b, g=[[0.2, 0.5, 0.3], [1, 1, 0], [0, 0, 0], [0, 1, 0]])[:, :2].tolist() == [
        [1, 2],
        [0, 1],
        [0, 1],
        [1, 0],
    ]
    # a = 0.3, b = 0.1, so r = 1/4.
    assert run(value, b, g=[[0.2, 0.5, 0.3]])[0, 2] == pytest.approx(0.25**2 * 2.5, rel=1e-5)
    # Along a path on which every pair changes places, the blend of three constants never jumps.
    t = np.linspace(0, 1, 20001)
    g = np.stack([np.sin(3 * t), np.cos(2 * t) ** 2, 0.5 + 0.2 * np.sin(17 * t)], axis=1) ** 2
    first, second, share = run(value, b, g=g).T
    constants = np.array([1.0, 5.0, -3.0])
    blended = constants[first.astype(int)] * (1 - share) + constants[second.astype(int)] * share
    assert len(set(zip(first, second))) > 3 and share.min() >= 0 and share.max() <= 0.5
    assert np.abs(np.diff(blended)).max() < 0.02


def test_top2_of_two_uses_no_third():
    b = Builder(g=2)
    assert run(b.top2("g"), b, g=[[0.25, 0.75]])[0] == pytest.approx([1, 0, 0.25**2 * 2.5])


def test_small_ops_in_closed_form():
    n, v = np.array([[0, 0, 1.0]]), np.array([[1.0, 2, 3]])
    b = Builder(n=3, v=3)
    assert run(b.reflect("n", "v"), b, n=n, v=v).tolist() == [[-1, -2, 3]]
    b = Builder(v=3)
    assert run(b.normalize("v"), b, v=[[0, 0, 0.0]]).tolist() == [[0, 0, 0]]
    b = Builder(v=3)
    assert run(b.clamp("v", 1.5, 2.5), b, v=v).tolist() == [[1.5, 2, 2.5]]
    b = Builder(v=3)
    np.testing.assert_allclose(run(b.log("v", 1e-3), b, v=-v), np.full((1, 3), math.log(1e-3)), rtol=1e-6)
    b = Builder(t=1, n=3, v=3)
    assert run(b.blend("t", "n", "v"), b, t=[[0.5]], n=n, v=v).tolist() == [[0.5, 1, 2]]
    b = Builder(t=1, n=3, v=3)
    assert run(b.select("t", "n", "v"), b, t=[[0.0]], n=n, v=v).tolist() == v.tolist()


def test_inputs_are_checked():
    b = Builder(a=3)
    graph: Graph = b.build(value=b.length("a"))
    with pytest.raises(ValueError, match=r"input 'a': expected \[N, 3\], found \[4, 2\]; reshape it"):
        evaluate(graph, {"a": np.zeros((4, 2))})
    with pytest.raises(ValueError, match=r"input 'a': expected \[N, 3\], found nothing; pass it"):
        evaluate(graph, {})
    with pytest.raises(ValueError, match="input 'a': expected 3 components, found 2"):
        evaluate_drjit(graph, {"a": [mi.Float(0), mi.Float(0)]})
