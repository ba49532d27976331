"""The budget of a graph: the numbers of format/budget.json, counted as the web runtime counts them."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lightwell.graph import graph_from_json
from lightwell.graph.budget import BUDGET, check_budget, graph_work, live_numbers
from lightwell.limits import Limits

FORMAT = Path(__file__).parents[2] / "format"


def _graph(nodes, radiance="y", buffers=None, inputs=None, budget=BUDGET):
    declared = {name: {"shape": list(array.shape), "type": "float32"} for name, array in (buffers or {}).items()}
    document = {
        "version": 1,
        "inputs": inputs or {"position": 3},
        "buffers": declared,
        "nodes": nodes,
        "outputs": {"radiance": radiance},
    }
    return graph_from_json(document, buffers or {}, budget)


def _held(count, budget=BUDGET):
    """Encodings that are all needed by the last sum: the same graph as in web/test/budget.test.ts."""
    nodes = [{"id": f"k{i}", "op": "frequency", "inputs": ["position"], "octaves": 24} for i in range(count)]
    nodes.append({"id": "all", "op": "concat", "inputs": [node["id"] for node in nodes]})
    return _graph(
        [*nodes, {"id": "y", "op": "slice", "inputs": ["all"], "start": 0, "width": 3}], "y", None, None, budget
    )


def test_the_numbers_are_those_of_the_format():
    shared = json.loads((FORMAT / "budget.json").read_text())
    assert {name: shared[name] for name in ("work", "work_per_frame", "live", "text")} == vars(BUDGET)
    assert Limits().work == BUDGET.work


def test_vectors_are_within_the_budget():
    for path in sorted((FORMAT / "vectors").glob("*.json")):
        vector = json.loads(path.read_text())
        types = {name: spec["type"] for name, spec in vector["graph"]["buffers"].items()}
        arrays = {name: np.asarray(vector["arrays"][name], types[name]) for name in types}
        graph = graph_from_json(vector["graph"], arrays)
        assert graph.macs <= graph_work(graph) <= BUDGET.work


def test_a_small_file_cannot_ask_for_much_work():
    nodes = [
        {"id": "wide", "op": "concat", "inputs": ["position"] * 255},
        {"id": "n0", "op": "concat", "inputs": ["wide"] * 5},
    ]
    nodes += [{"id": f"n{i}", "op": "add", "inputs": [f"n{i - 1}", f"n{i - 1}"]} for i in range(1, 2000)]
    nodes.append({"id": "y", "op": "slice", "inputs": ["n1999"], "start": 0, "width": 3})
    with pytest.raises(
        ValueError, match=r"expected at most 100000 operations per pixel, found 7\d{6}; .*raise"
    ) as error:
        _graph(nodes)
    assert "\n" not in str(error.value)


def test_work_and_numbers_are_counted_as_in_the_web_runtime():
    buffers = {"w": np.zeros((500, 3), np.float32), "b": np.zeros(500, np.float32)}
    layer = {"id": "y", "op": "linear", "inputs": ["position"], "weights": "w", "bias": "b"}
    assert graph_work(_graph([layer], buffers=buffers)) == 1500 + 500
    frame = _graph([layer | {"inputs": ["light"], "per_frame": True}], buffers=buffers, inputs={"light": 3})
    assert (graph_work(frame), graph_work(frame, per_frame=True)) == (0, 2000)
    with pytest.raises(ValueError, match="at most 1999 operations per frame, found 2000"):
        check_budget(frame, replace(BUDGET, work_per_frame=1999))
    grid = {"id": "y", "op": "grid", "inputs": ["position"], "buffer": "g"}
    assert graph_work(_graph([grid], buffers={"g": np.zeros((2, 2, 2, 5), np.float32)})) == 8 * 5 + 5
    assert live_numbers(_held(6)) == 2 * 6 * 144
    with pytest.raises(ValueError, match="at most 2048 numbers needed at a time, found 4032"):
        _held(14)
    assert live_numbers(_held(14, replace(BUDGET, live=1 << 14))) == 4032
