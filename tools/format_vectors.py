"""Test vectors: graphs, inputs and outputs that every runtime must reproduce.

``python tools/format_vectors.py`` writes `format/graph.schema.json` from the registered ops and
`format/vectors/*.json` from the NumPy evaluator. A vector holds
``{"name", "graph", "arrays": {buffer: numbers as stored}, "inputs": {name: {"shape", "data"}}, "outputs": ...}``;
float16 buffers hold the numbers themselves, which their 16 bits represent exactly.
"""

from __future__ import annotations

import argparse
import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from lightwell.graph.builder import Builder
from lightwell.graph.evaluate import evaluate
from lightwell.graph.graph import Graph
from lightwell.graph.ops import OPS
from lightwell.graph.ops.activate import FUNCTIONS
from lightwell.graph.ops.hashgrid import levels
from lightwell.graph.quantise import quantise
from lightwell.graph.serial import graph_to_json, schema

FORMAT = Path(__file__).parents[1] / "format"
FOLDER = FORMAT / "vectors"
SCHEMA_FILE = FORMAT / "graph.schema.json"
POINTS = 24
SEED = 20240607


def _coordinates(rng: np.random.Generator, width: int) -> np.ndarray:
    """Points mostly in the unit cube, some outside, on its borders and in its middle: [N, width]."""
    points = rng.uniform(-0.1, 1.1, (POINTS, width))
    points[:4] = np.array([0, 1, 0.5, -3])[:, None]
    return points


def _values(rng: np.random.Generator, width: int, spread: float = 2.0) -> np.ndarray:
    points = rng.normal(0, spread, (POINTS, width))
    points[0] = 0
    return points


def _directions(rng: np.random.Generator, width: int = 3) -> np.ndarray:
    d = rng.normal(size=(POINTS, width))
    d[:3] = np.eye(3, width)
    return d / np.linalg.norm(d, axis=1, keepdims=True)


def perceptron(
    b: Builder, value: str, sizes: tuple[int, ...], function: str, rng: np.random.Generator, **options
) -> str:
    """Add fully connected layers of the given widths with random weights; the last one has no activation."""
    for i, (inputs, outputs) in enumerate(pairwise(sizes)):
        weights = rng.normal(0, inputs**-0.5, (outputs, inputs))
        value = b.linear(value, weights, rng.normal(0, 0.3, outputs), **options)
        value = b.activate(value, function, **options) if i + 2 < len(sizes) else value
    return value


def _hashgrid(b: Builder, rng, value: str, count: int, base: float, growth: float, log2: int, channels: int) -> str:
    last = levels(count, base, growth, log2)[-1]
    return b.hashgrid(value, rng.normal(0, 0.5, (last.offset + last.entries, channels)), count, base, growth, log2)


def _small_ops(rng: np.random.Generator) -> dict[str, tuple[Graph, dict[str, np.ndarray]]]:
    """Ops that move or combine components, at widths around the four of a register."""
    out = {}
    for width in (1, 3, 4, 9):
        a, c = _values(rng, width), _values(rng, width)
        b = Builder(a=width, c=width, s=1)
        values = {
            "affine": b.affine("a", rng.normal(size=width), rng.normal(size=width)),
            "concat": b.concat("a", "s", "c", "a"),
            "slice": b.slice("a", width // 2, width - width // 2),
            "add": b.add("a", "c"),
            "add_one": b.add("s", "a"),
            "subtract": b.subtract("a", "c"),
            "subtract_one": b.subtract("s", "c"),
            "multiply": b.multiply("a", "c"),
            "multiply_one": b.multiply("a", "s"),
            "scale": b.scale("a", -1.75),
            "dot": b.dot("a", "c"),
            "length": b.length("a"),
            "normalize": b.normalize("a"),
            "reflect": b.reflect(b.normalize("c"), "a"),
            "log": b.log("a", 1e-3),
            "reciprocal": b.reciprocal(b.multiply("a", "a"), 0.01),
            "clamp": b.clamp("a", -0.5, 1.25),
            "select": b.select("s", "a", "c"),
            "blend": b.blend("s", "a", "c"),
        }
        for name, value in values.items():
            out.setdefault(f"{name.removesuffix('_one')}_{width}", []).append((name, value))
        inputs = {"a": a, "c": c, "s": _values(rng, 1)}
        for name in {f"{name.removesuffix('_one')}_{width}" for name in values}:
            out[name] = (b, inputs, dict(out[name]))
    return {name: (b.build(**outputs).only(*outputs), inputs) for name, (b, inputs, outputs) in out.items()}


def _encodings(rng: np.random.Generator) -> dict[str, tuple[Graph, dict[str, np.ndarray]]]:
    out = {}
    for width, octaves in ((1, 1), (3, 5), (2, 12)):
        b = Builder(p=width)
        graph = b.build(value=b.frequency("p", octaves))
        out[f"frequency_{width}_{octaves}"] = (graph, {"p": _values(rng, width, 1.0)})
    for width, bins in ((1, 2), (3, 8), (2, 16)):
        b = Builder(p=width)
        out[f"oneblob_{width}_{bins}"] = (b.build(value=b.oneblob("p", bins)), {"p": _coordinates(rng, width)})
    for degree in (1, 2, 3, 4):
        b = Builder(d=3)
        out[f"sh_{degree}"] = (b.build(value=b.sh("d", degree)), {"d": _directions(rng)})
    return out


def _tables(rng: np.random.Generator) -> dict[str, tuple[Graph, dict[str, np.ndarray]]]:
    out = {}
    for height, width, channels in ((1, 1, 3), (5, 7, 4), (8, 4, 6), (3, 9, 1), (4, 4, 2)):
        b = Builder(p=2)
        graph = b.build(value=b.texture("p", rng.normal(size=(height, width, channels))))
        out[f"texture_{height}x{width}x{channels}"] = (graph, {"p": _coordinates(rng, 2)})
    for shape in ((1, 2, 3, 1), (4, 5, 6, 2), (3, 3, 3, 12), (2, 3, 4, 3)):
        b = Builder(p=3)
        graph = b.build(value=b.grid("p", rng.normal(size=shape)))
        out["grid_" + "x".join(map(str, shape))] = (graph, {"p": _coordinates(rng, 3)})
    for count, base, growth, log2, channels in (
        (1, 1, 1, 3, 1),
        (4, 4, 1.5, 8, 2),
        (6, 2, 2, 6, 4),
        (3, 16, 1.3, 7, 3),
    ):
        b = Builder(p=3)
        graph = b.build(value=_hashgrid(b, rng, "p", count, base, growth, log2, channels))
        out[f"hashgrid_{count}x{channels}_{log2}"] = (graph, {"p": _coordinates(rng, 3)})
    b = Builder(p=3)
    graph = b.build(value=b.grid("p", rng.normal(size=(4, 4, 4, 8))))
    for kind in ("float16", "int8", "uint8"):
        out[f"grid_{kind}"] = (quantise(graph, kind), {"p": _coordinates(rng, 3)})
    b = Builder(p=3)
    graph = quantise(b.build(value=_hashgrid(b, rng, "p", 4, 3, 1.7, 7, 2)), "int8")
    out["hashgrid_int8"] = (graph, {"p": _coordinates(rng, 3)})
    return out


def _lookups(rng: np.random.Generator) -> dict[str, tuple[Graph, dict[str, np.ndarray]]]:
    """Ops that choose: none of their points lies where rounding decides."""
    out = {}
    for width, depth in ((1, 1), (3, 6), (6, 12)):
        nodes = random_tree(width, depth, rng)
        b = Builder(a=width)
        out[f"tree_{width}_{depth}"] = (b.build(value=b.tree("a", nodes, depth)), {"a": _coordinates(rng, width)})
    for rows, channels in ((1, 3), (7, 4), (300, 6)):
        b = Builder(index=1)
        index = rng.integers(0, rows, (POINTS, 1)) + rng.uniform(-0.4, 0.4, (POINTS, 1))
        index[:2] = [[-4.0], [1e6]]
        table = rng.normal(size=(rows, channels))
        out[f"rows_{rows}x{channels}"] = (b.build(value=b.rows("index", table)), {"index": index})
    for shape in ((1, 2, 3, 1), (4, 5, 6, 2), (3, 3, 3, 12)):
        b = Builder(p=3)
        graph = b.build(value=b.nearest("p", rng.normal(size=shape)))
        out["nearest_" + "x".join(map(str, shape))] = (graph, {"p": _coordinates(rng, 3)})
    b = Builder(p=3)
    indices = b.nearest("p", rng.integers(0, 8000, (4, 4, 4, 2)))
    out["nearest_indices_int8"] = (quantise(b.build(value=indices), "int8"), {"p": _coordinates(rng, 3)})
    for width in (2, 3, 4, 9, 67):
        b = Builder(g=width)
        g = rng.uniform(0, 1, (POINTS, width))
        g[0], g[1] = 0, 0.5  # all equal: the first two
        g[2], g[3] = np.arange(width), np.arange(width)[::-1]
        out[f"top2_{width}"] = (b.build(value=b.top2("g")), {"g": g})
    return out


def random_tree(width: int, depth: int, rng: np.random.Generator) -> np.ndarray:
    """Nodes [n, 4] of a tree over [0, 1]^width whose first branch has ``depth`` levels."""
    nodes: list[list[float]] = []
    leaves = 0

    def grow(level: int, deep: bool) -> int:
        nonlocal leaves
        if level == depth or (not deep and rng.random() < 0.4):
            leaves += 1
            return -leaves
        row = len(nodes)
        nodes.append([])
        axis, threshold = rng.integers(width), np.float32(rng.uniform(0.2, 0.8))
        nodes[row] = [axis, threshold, grow(level + 1, deep), grow(level + 1, False)]
        return row

    grow(0, True)
    return np.asarray(nodes, np.float32)


def _layers(rng: np.random.Generator) -> dict[str, tuple[Graph, dict[str, np.ndarray]]]:
    out = {}
    for inputs, outputs in ((1, 1), (3, 4), (5, 9), (12, 20)):
        b = Builder(a=inputs)
        value = b.linear("a", rng.normal(size=(outputs, inputs)), rng.normal(size=outputs))
        out[f"linear_{inputs}_{outputs}"] = (b.build(value=value), {"a": _values(rng, inputs)})
    for experts, inputs, outputs in ((1, 3, 2), (5, 6, 7)):
        b = Builder(a=inputs, index=1)
        weights, bias = rng.normal(size=(experts, outputs, inputs)), rng.normal(size=(experts, outputs))
        graph = b.build(value=b.linear("a", weights, bias, index="index"))
        index = rng.integers(0, experts, (POINTS, 1)) + rng.uniform(-0.4, 0.4, (POINTS, 1))
        index[:2] = [[-4.0], [1e6]]
        out[f"linear_experts_{experts}_{inputs}_{outputs}"] = (graph, {"a": _values(rng, inputs), "index": index})
    for rows, columns in ((1, 1), (3, 5), (8, 4)):
        b = Builder(m=rows * columns, a=columns)
        graph = b.build(value=b.matvec("m", "a", rows))
        out[f"matvec_{rows}_{columns}"] = (graph, {"m": _values(rng, rows * columns), "a": _values(rng, columns)})
    for function in FUNCTIONS:
        b = Builder(a=5)
        a = _values(rng, 5, 3.0)
        a[1], a[2] = -30, 30
        out[f"activate_{function}"] = (b.build(value=b.activate("a", function)), {"a": a})
    return out


def _scene(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Inputs of a whole field in a room of two metres."""
    return {
        "position": rng.uniform(-1, 1, (POINTS, 3)),
        "normal": _directions(rng),
        "view": _directions(rng),
        "light": rng.uniform(-0.8, 0.8, (1, 3)),
    }


SCENE_INPUTS = ("position", "normal", "view", "light")


def _start() -> Builder:
    return Builder(**dict.fromkeys(SCENE_INPUTS, 3))


def _whole_networks(rng: np.random.Generator) -> dict[str, Graph]:
    names, start = SCENE_INPUTS, _start
    b = start()
    report = b.build(radiance=b.activate(perceptron(b, b.concat(*names), (12, 20, 10, 3), "tanh", rng), "sigmoid"))

    b = start()
    x = b.affine("position", [0.5] * 3, [0.5] * 3)
    to_light = b.subtract("light", "position")
    near = b.log(b.length(to_light), 0.01)
    cosine = b.dot("normal", b.normalize(to_light))
    mirror = b.reflect("normal", "view")
    code = b.concat(b.frequency(x, 5), b.sh("normal", 3), b.oneblob(b.affine("light", [0.5] * 3, [0.5] * 3), 4))
    code = b.concat(code, near, cosine, mirror)
    encoded = b.build(radiance=b.activate(perceptron(b, code, (56, 64, 64, 3), "silu", rng), "exp"))

    b = start()
    value, index = b.concat(*names), b.affine(b.slice("position", 0, 1), [2.0], [1.5])
    for inputs, outputs, function in ((12, 20, "tanh"), (20, 10, "tanh"), (10, 3, "sigmoid")):
        weights = rng.normal(0, inputs**-0.5, (4, outputs, inputs))
        value = b.activate(b.linear(value, weights, rng.normal(0, 0.3, (4, outputs)), index=index), function)
    experts = b.build(radiance=value)

    b = start()
    frame = dict(per_frame=True)
    code = b.frequency(b.affine("light", [0.5] * 3, [0.5] * 3, **frame), 3, **frame)
    code = b.activate(perceptron(b, code, (18, 16, 12), "relu", rng, **frame), "tanh", **frame)
    x = b.affine("position", [0.5] * 3, [0.5] * 3)
    features = b.concat(b.grid(x, rng.normal(0, 0.6, (4, 4, 4, 8))), _hashgrid(b, rng, x, 2, 3, 2, 6, 2))
    head = b.concat(b.multiply(features, code), b.reciprocal(b.length(b.subtract("light", "position")), 0.1))
    factored = b.build(radiance=b.activate(perceptron(b, head, (13, 16, 3), "leaky_relu", rng), "softplus"))

    b = start()
    matrix = perceptron(b, "light", (3, 16, 8 * 12), "silu", rng, **frame)
    hidden = b.activate(b.matvec(matrix, b.concat("position", "normal", "view", "light"), 8), "silu")
    hyper = b.build(radiance=perceptron(b, hidden, (8, 3), "silu", rng))

    b = start()
    # More per-frame numbers than a uniform array takes: they travel in a texture.
    code = b.frequency("light", 24, **frame)
    matrix = b.concat(code, code, code, b.scale(code, 0.5, **frame), **frame)
    hidden = b.concat(*names)
    wide = b.build(radiance=perceptron(b, b.activate(b.matvec(matrix, hidden, 48), "tanh"), (48, 3), "tanh", rng))

    return {
        "wide_frame": wide,
        "report": report,
        "encoded": encoded,
        "experts": experts,
        "factored": factored,
        "hyper": hyper,
    }


def _segments(rng: np.random.Generator) -> Graph:
    """One expert per leaf of a tree, and a second one where two meet."""
    b = _start()
    x = b.affine("position", [0.5] * 3, [0.5] * 3)
    leaf = b.tree(x, random_tree(3, 4, rng), 4)
    gate = b.top2(b.activate(perceptron(b, x, (3, 16, 5), "silu", rng), "softplus"))
    first = b.slice(gate, 0, 1)
    share = b.slice(gate, 2, 1)
    head = b.concat(*SCENE_INPUTS, b.rows(leaf, rng.normal(0, 0.5, (40, 4))))
    weights, bias = rng.normal(0, 0.25, (5, 3, 16)), rng.normal(0, 0.3, (5, 3))
    pair = [b.activate(b.linear(head, weights, bias, index=b.slice(gate, i, 1)), "sigmoid") for i in (0, 1)]
    return b.build(radiance=b.blend(share, *pair), segment=first, overlap=share)


def _networks(rng: np.random.Generator) -> dict[str, tuple[Graph, dict[str, np.ndarray]]]:
    plain = _whole_networks(rng)
    out = {f"network_{name}": graph for name, graph in plain.items()}
    out |= {f"network_{name}_float16": quantise(plain[name], "float16") for name in ("encoded", "experts")}
    out |= {f"network_{name}_int8": quantise(plain[name], "int8") for name in ("report", "experts", "factored")}
    scene = _scene(rng)
    out["network_segments"] = _segments(rng)
    return {name: (graph, scene) for name, graph in out.items()}


def _lamps(rng: np.random.Generator) -> dict[str, tuple[Graph, dict[str, np.ndarray]]]:
    """Five lamps whose layers are added up once per frame."""
    count, width, frame = 5, 12, dict(per_frame=True)
    b = Builder(**dict.fromkeys(("position", "normal"), 3), lamps=3 * count)
    x = b.affine("position", [0.5] * 3, [0.5] * 3)
    features = b.concat(_hashgrid(b, rng, x, 2, 3, 2, 6, 2), "normal")
    features = b.activate(perceptron(b, features, (7, 16, width), "silu", rng), "exp")
    dimmers = b.affine("lamps", rng.uniform(0.5, 2, 3 * count), [0.0] * 3 * count, **frame)
    parts = [b.slice(dimmers, c * count, count, **frame) for c in range(3)]
    merged = [b.linear(part, rng.uniform(0, 0.3, (width, count)), np.zeros(width), **frame) for part in parts]
    graph = b.build(radiance=b.matvec(b.concat(*merged, **frame), features, 3))
    scene = _scene(rng) | {"lamps": rng.uniform(0, 1.5, (1, 3 * count)) * (rng.random((1, 3 * count)) < 0.7)}
    return {"network_lamps": (graph, scene)}


def cases() -> dict[str, tuple[Graph, dict[str, np.ndarray]]]:
    """Every test vector: name to graph and inputs (float32 [N, C], or [1, C] for what a frame shares)."""
    makers = (_small_ops, _encodings, _tables, _layers, _networks, _lookups, _lamps)
    found = {}
    for number, maker in enumerate(makers):
        found |= maker(np.random.default_rng((SEED, number)))
    missing = set(OPS) - {node.op for graph, _ in found.values() for node in graph.nodes}
    if missing:
        raise ValueError(
            f"graph: expected a test vector for every op, found none for {', '.join(sorted(missing))}; add one"
        )
    return {
        name: (graph, {k: v.astype(np.float32) for k, v in inputs.items()}) for name, (graph, inputs) in found.items()
    }


def _numbers(array: np.ndarray) -> list:
    """Flat list of the shortest decimals that read back as the same stored numbers."""
    flat = array.ravel()
    return flat.tolist() if array.dtype.kind in "iu" else [float(str(x)) for x in flat]


def _tensor(array: np.ndarray) -> dict[str, Any]:
    return {"shape": list(array.shape), "data": _numbers(array)}


def document(name: str, graph: Graph, inputs: dict[str, np.ndarray]) -> dict[str, Any]:
    """What the file of one vector holds."""
    shape, arrays = graph_to_json(graph)
    return {
        "name": name,
        "graph": shape,
        "arrays": {key: _numbers(array) for key, array in arrays.items()},
        "inputs": {key: _tensor(value) for key, value in inputs.items() if key in graph.inputs},
        "outputs": {key: _tensor(value) for key, value in evaluate(graph, inputs).items()},
    }


def schema_text() -> str:
    """Contents of the schema file."""
    return json.dumps(schema(), indent=1) + "\n"


def main() -> None:
    """Write the schema and all vectors, and remove vectors that are no longer made."""
    argparse.ArgumentParser(description=main.__doc__).parse_args()
    SCHEMA_FILE.write_text(schema_text())
    FOLDER.mkdir(parents=True, exist_ok=True)
    found = cases()
    for name, (graph, inputs) in found.items():
        (FOLDER / f"{name}.json").write_text(json.dumps(document(name, graph, inputs), separators=(",", ":")) + "\n")
    for path in FOLDER.glob("*.json"):
        if path.stem not in found:
            path.unlink()


if __name__ == "__main__":
    main()
