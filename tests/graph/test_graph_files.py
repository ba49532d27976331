"""What is written, what is read, and what is refused: JSON, widths, costs, quantisation, hostile files."""

import copy
import json

import numpy as np
import pytest
from format_vectors import cases, perceptron
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from lightwell.graph import Buffer, Builder, Graph, Node, evaluate, graph_from_json, graph_to_json, pack, quantise

CASES = cases()
FACTORED = CASES["network_factored"][0]


def report_network() -> Graph:
    b = Builder(a=12)
    return b.build(y=perceptron(b, "a", (12, 20, 10, 3), "tanh", np.random.default_rng(0)))


@pytest.mark.parametrize("name", CASES)
def test_round_trip_is_identity(name):
    graph, inputs = CASES[name]
    document, arrays = graph_to_json(graph)
    again = graph_from_json(json.loads(json.dumps(document)), arrays)
    assert graph_to_json(again)[0] == document
    for key, value in evaluate(graph, inputs).items():
        np.testing.assert_array_equal(evaluate(again, inputs)[key], value)
        assert value.shape[1] == graph.widths[graph.outputs[key]]


def test_costs_of_the_reports_network():
    graph = report_network()
    assert (graph.macs, graph.parameters, graph.nbytes, graph.macs_per_frame, graph.fetches) == (470, 503, 2012, 0, 0)
    assert quantise(graph, "float16").nbytes == 1006
    assert FACTORED.macs == 13 * 16 + 16 * 3
    assert FACTORED.macs_per_frame == 18 * 16 + 16 * 12
    assert FACTORED.fetches == 8 + 8 * 2


@pytest.mark.parametrize("kind", ["float16", "int8", "uint8"])
@pytest.mark.parametrize("per_row", [True, False])
@pytest.mark.parametrize("shape", [(7,), (5, 9), (3, 5, 4)])
def test_quantisation_rounds_to_within_half_a_step(kind, per_row, shape):
    values = np.random.default_rng(0).normal(size=shape).astype(np.float32)
    buffer = pack(values, kind, per_row=per_row)
    error = np.abs(buffer.values() - values)
    if kind == "float16":
        step = np.spacing(np.abs(values).astype(np.float16)).astype(np.float32)
    else:
        step = buffer.row_scale()
    assert (error <= 0.5001 * step).all()
    # Rounding, not truncation: the mean signed error is far below a quarter of a step.
    assert abs(((buffer.values() - values) / step).mean()) < 0.2
    if kind == "int8" and per_row and len(shape) > 1:
        assert buffer.scale.size == np.prod(shape[:-1])


def test_quantised_constants_are_exact():
    assert pack(np.zeros((2, 3)), "int8").values().tolist() == [[0, 0, 0], [0, 0, 0]]
    assert pack(np.full(3, 0.3), "uint8").values() == pytest.approx(0.3)
    with pytest.raises(ValueError, match="expected magnitudes up to 65504"):
        pack(np.array([1e6]), "float16")


def test_builder_example_runs():
    b = Builder(position=3)
    e = b.frequency("position", octaves=4)
    h = b.activate(b.linear(e, np.zeros((16, 24)), np.zeros(16)), "silu")
    graph = b.build(radiance=b.linear(h, np.zeros((3, 16)), np.zeros(3)))
    assert graph.widths["position"] == 3 and graph.macs == 24 * 16 + 16 * 3
    with pytest.raises(ValueError, match=r"expected an op of .*, found 'conv'"):
        b.node("conv", "position")


def document_and_arrays():
    document, arrays = graph_to_json(FACTORED)
    return json.loads(json.dumps(document)), dict(arrays)


def find(document, op):
    return next(node for node in document["nodes"] if node["op"] == op)


def change(path, value):
    """A mutation that sets one thing of a document."""

    def mutate(document, arrays):
        target = document
        for key in path[:-1]:
            target = find(document, key[1:]) if isinstance(key, str) and key.startswith("@") else target[key]
        target[path[-1]] = value

    return mutate


def drop_array(document, arrays):
    arrays.pop(find(document, "grid")["buffer"])


def poison(document, arrays):
    name = find(document, "linear")["weights"]
    arrays[name] = np.full_like(arrays[name], np.nan)


def swap_nodes(document, arrays):
    document["nodes"].reverse()


def rename(document, arrays):
    document["nodes"][1]["id"] = document["nodes"][0]["id"]


def orphan(document, arrays):
    document["buffers"]["extra"] = {"shape": [1], "type": "float32"}
    arrays["extra"] = np.zeros(1, np.float32)


REFUSED = [
    (change(["version"], 2), "version: 1 was expected"),
    (change(["extra"], 1), "Additional properties are not allowed"),
    (change(["@grid", "op"], "conv"), "node 'n.*, 'op': 'conv' is not one of"),
    (change(["@grid", "mode"], "nearest"), "node 'n.*'mode' was unexpected"),
    (change(["@grid", "buffer"], "nothing"), "expected the name of a buffer, found 'nothing'; declare it"),
    (change(["@frequency", "octaves"], 10**400), "is greater than the maximum"),
    (change(["@frequency", "octaves"], 2.5), "is not of type 'integer'"),
    (change(["@frequency", "octaves"], 24), "node 'n.*': expected weights for inputs of width 144"),
    (change(["@reciprocal", "epsilon"], float("nan")), "expected a finite number"),
    (change(["@reciprocal", "epsilon"], float("inf")), "is greater than the maximum"),
    (change(["@reciprocal", "epsilon"], 0), "is less than the minimum"),
    (change(["@affine", "scale"], [1]), "expected a list of 3 numbers, found a list of 1"),
    (change(["@affine", "scale"], [1, 2, "x"]), "is not of type 'number'"),
    (change(["@activate", "function"], "gelu"), "'gelu' is not one of"),
    (change(["@activate", "inputs"], []), "node 'n.*, 'inputs'"),
    (change(["@affine", "inputs"], ["position"]), "expected a per_frame node to use frame inputs only"),
    (change(["outputs", "radiance"], "nowhere"), "output 'radiance': expected the name of an input or node"),
    (change(["inputs", "bad name"], 3), "does not match"),
    (change(["inputs", "position"], 10**9), "is greater than the maximum"),
    (change(["inputs", "position"], 2), "node 'n.*': expected"),
    (change(["buffers", "w0", "shape"], [1 << 20, 1 << 20]), "expected at most"),
    (change(["buffers", "w0", "shape"], [1 << 60]), "is greater than the maximum"),
    (change(["buffers", "w0", "type"], "int8"), "expected .* numbers of int8"),
    (change(["buffers", "w0", "type"], "pickle"), "'pickle' is not one of"),
    (change(["buffers", "w0", "offset"], 1), "expected a scale beside the offset"),
    (change(["buffers", "w0", "scale"], 1), "expected no scale or offset on a float type"),
    (change(["@hashgrid", "levels"], 3), "expected a buffer of"),
    (drop_array, "expected its numbers beside the JSON, found none"),
    (poison, "expected finite numbers, found NaN or infinity"),
    (swap_nodes, "expected inputs that are graph inputs or earlier nodes"),
    (rename, "expected a new name, found one that is taken"),
    (orphan, "buffer 'extra': expected a buffer that some node uses"),
]


@pytest.mark.parametrize("mutate, message", REFUSED, ids=range(len(REFUSED)))
def test_wrong_files_are_refused_in_one_line(mutate, message):
    document, arrays = document_and_arrays()
    mutate(document, arrays)
    with pytest.raises(ValueError, match=message) as caught:
        graph_from_json(document, arrays)
    text = str(caught.value)
    assert text.startswith("graph: ") and "\n" not in text and ";" in text and len(text) < 500


TREE_REFUSED = [
    ([[0.5, 0, -1, -2]], "axis that is an integer from 0 to 1, found 0.5 in row 0"),
    ([[2, 0, -1, -2]], "axis that is an integer from 0 to 1, found 2.0 in row 0"),
    ([[-1, 0, -1, -2]], "axis that is an integer from 0 to 1"),
    ([[0, 0, -1.5, -2]], "children that are integers"),
    ([[0, 0, -1, -3e7]], "children that are integers of magnitude up to 16777216"),
    ([[0, 0, 0, -2]], r"children above their parent's row and below 1, or leaves, found \[0.0, -2.0\] in row 0"),
    ([[0, 0, 1, -2], [0, 0, 0, -1]], "children above their parent's row and below 2, or leaves"),
    ([[0, 0, 1, -2]], "children above their parent's row and below 1"),
    ([[0, 0, 1, -1], [0, 0, 2, -1], [1, 0, -1, -2]], "a tree of at most 2 levels, its depth, found more"),
]


@pytest.mark.parametrize("nodes, message", TREE_REFUSED)
def test_wrong_trees_are_refused(nodes, message):
    b = Builder(a=2)
    b.tree("a", nodes, depth=2, name="t")
    with pytest.raises(ValueError, match=message) as caught:
        b.build(leaf="t")
    assert "\n" not in str(caught.value) and "node 't'" in str(caught.value)


def test_wrong_lookups_are_refused():
    for add in (lambda b: b.rows("a", np.zeros((3, 2))), lambda b: b.nearest("a", np.zeros((2, 2, 2, 1)))):
        b = Builder(a=2)
        with pytest.raises(ValueError, match=r"of width [13], found width 2; slice"):
            b.build(value=add(b))
    b = Builder(a=2)
    rounded = Buffer(np.array([[0, 0, -1, -2]], np.float16), "float16")
    with pytest.raises(ValueError, match="expected nodes of type float32, found float16"):
        b.build(value=b.tree("a", rounded, 1))
    b = Builder(a=1)
    with pytest.raises(ValueError, match="expected at least two weights, found 1"):
        b.build(value=b.top2("a"))


def test_quantisation_keeps_trees_and_indices_exact():
    b = Builder(p=3)
    leaf = b.tree("p", [[0, 0.123456789, -1, -4000]], depth=1)
    few, many = np.array([[3.0], [-7.0], [200.0]]), np.arange(5000.0)[:, None]
    cells = b.nearest("p", many.reshape(5, 10, 10, 10))
    graph = b.build(few=b.rows(leaf, few), many=b.rows(leaf, many), cells=cells)
    for kind in ("float16", "int8", "uint8"):
        small = quantise(graph, kind)
        assert sorted(buffer.type for buffer in small.buffers.values()) == ["float32", "float32", "float32", "uint8"]
        for name in graph.buffers:
            np.testing.assert_array_equal(small.buffers[name].values(), graph.buffers[name].values())


def test_only_keeps_what_an_output_needs():
    graph, inputs = CASES["network_segments"]
    light = graph.only("segment")
    assert set(light.inputs) == {"position"} and light.macs == 3 * 16 + 16 * 5
    assert {node.op for node in light.nodes} == {"affine", "linear", "activate", "top2", "slice"}
    np.testing.assert_array_equal(evaluate(light, inputs)["segment"], evaluate(graph, inputs)["segment"])
    assert graph_to_json(graph.only(*graph.outputs))[0] == graph_to_json(graph)[0]
    with pytest.raises(ValueError, match="expected one of radiance, segment, overlap, found 'depth'"):
        graph.only("depth")


def test_absurd_work_is_refused():
    nodes = [Node("n0", "concat", ("a",) * 2)]
    nodes += [Node(f"n{i}", "concat", (f"n{i - 1}",) * 2) for i in range(1, 30)]
    with pytest.raises(ValueError, match="expected a value of width 1 to 4096"):
        Graph({"a": 4}, {}, nodes, {"y": "n29"})
    weights = {"w": Buffer(np.zeros((4096, 4096), np.int8), "int8", 1.0), "b": Buffer(np.zeros(4096))}
    params = {"weights": "w", "bias": "b"}
    with pytest.raises(ValueError, match=r"expected at most .* multiply-adds"):
        Graph(
            {"a": 4096}, weights, [Node("x", "linear", ("a",), params), Node("y", "linear", ("x",), params)], {"y": "y"}
        )


def test_deep_nesting_is_refused():
    document, arrays = document_and_arrays()
    deep: list = []
    for _ in range(100_000):
        deep = [deep]
    document["nodes"][0]["inputs"] = deep
    with pytest.raises(ValueError):
        graph_from_json(document, arrays)


JUNK = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.integers(-3, 300),
    st.floats(),
    st.text(max_size=5),
    st.sampled_from(["n0", "n1", "w0", "position", "linear", "float16", "int8"]),
    st.lists(st.integers(-2, 9), max_size=4),
    st.dictionaries(st.text(max_size=3), st.integers(), max_size=2),
)


def places(value, path=()):
    """Every path into a document."""
    yield path
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, child in items:
        yield from places(child, (*path, key))


PLACES = {name: list(places(graph_to_json(CASES[name][0])[0])) for name in ("network_factored", "network_experts_int8")}


@given(data=st.data())
@settings(max_examples=300, deadline=None, suppress_health_check=list(HealthCheck))
def test_mutated_files_raise_value_errors_only(data):
    name = data.draw(st.sampled_from(sorted(PLACES)))
    document, arrays = graph_to_json(CASES[name][0])
    document = copy.deepcopy(document)
    for _ in range(data.draw(st.integers(1, 3))):
        path = data.draw(st.sampled_from(PLACES[name][1:]))
        target = document
        try:
            for key in path[:-1]:
                target = target[key]
            if data.draw(st.booleans()):
                target[path[-1]] = data.draw(JUNK)
            else:
                del target[path[-1]]
        except (KeyError, IndexError, TypeError):
            continue  # an earlier mutation removed the place
    try:
        graph = graph_from_json(document, arrays)
    except ValueError as error:
        assert "\n" not in str(error)
    else:
        evaluate(graph, {key: np.zeros((2, width)) for key, width in graph.inputs.items()})
