"""Test vectors: graphs, inputs and outputs that every runtime must reproduce.

``python tools/format_vectors.py`` writes `format/graph.schema.json` from the ops and `format/vectors/*.json`:
examples of each op and whole networks, evaluated with NumPy. A vector holds
``{"name", "graph", "arrays": {buffer: numbers as stored}, "inputs": {name: {"shape", "data"}}, "outputs": ...}``;
float16 buffers hold the numbers themselves, which their 16 bits represent exactly.
"""

from __future__ import annotations

import argparse
import json
from itertools import pairwise
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from lightwell.graph.builder import Builder
from lightwell.graph.evaluate import evaluate
from lightwell.graph.graph import Graph
from lightwell.graph.ops import OPS, Op
from lightwell.graph.ops.example import POINTS, coordinates, directions
from lightwell.graph.ops.hashgrid import levels
from lightwell.graph.ops.tree import random_tree
from lightwell.graph.pose_basis import PoseBasis
from lightwell.graph.quantise import quantise
from lightwell.graph.serial import graph_to_json, schema
from lightwell.probes.code import StateMix
from lightwell.probes.lattice import ProbeLattice
from lightwell.probes.lower import shaded
from lightwell.probes.spline import SplineMix
from lightwell.probes.split.cut import Cuts
from lightwell.probes.split.fit import rounded
from lightwell.probes.split.grid import SplitGrid
from lightwell.probes.split.lower import lower
from lightwell.probes.split.volume import FeatureVolume

FORMAT = Path(__file__).parents[1] / "format"
FOLDER = FORMAT / "vectors"
SCHEMA_FILE = FORMAT / "graph.schema.json"
SEED = 20240607

Vectors = dict[str, tuple[Graph, dict[str, np.ndarray]]]
"""Name to graph and inputs, [N, C] or [1, C] for what a frame shares."""


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


def _examples(op: Op) -> Vectors:
    """Graphs of one node: what the op shows of itself."""
    out = {}
    for example in op.examples(np.random.default_rng((SEED, crc32(op.name.encode())))):
        inputs = {chr(ord("a") + i): values for i, values in enumerate(example.inputs)}
        b = Builder(**{name: values.shape[1] for name, values in inputs.items()})
        value = b.node(op.name, *inputs, **example.params)
        out[f"{op.name}_{example.name}"] = (b.build(value=value), inputs)
    if not out:
        raise ValueError(f"graph: expected a test vector for every op, found none for {op.name}; give it examples")
    return out


def _stored_types(rng: np.random.Generator) -> Vectors:
    """Tables whose numbers are stored in fewer bits."""
    out = {}
    b = Builder(p=3)
    graph = b.build(value=b.grid("p", rng.normal(size=(4, 4, 4, 8))))
    for kind in ("float16", "int8", "uint8"):
        out[f"grid_{kind}"] = (quantise(graph, kind), {"p": coordinates(rng, 3)})
    b = Builder(p=3)
    graph = quantise(b.build(value=_hashgrid(b, rng, "p", 4, 3, 1.7, 7, 2)), "int8")
    out["hashgrid_int8"] = (graph, {"p": coordinates(rng, 3)})
    b = Builder(p=3)
    at = b.nearest("p", rng.integers(0, 8000, (4, 4, 4, 2)))
    out["nearest_indices_int8"] = (quantise(b.build(value=at), "int8"), {"p": coordinates(rng, 3)})
    return out


def _scene(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Inputs of a whole field in a room of two metres."""
    return {
        "position": rng.uniform(-1, 1, (POINTS, 3)),
        "normal": directions(rng),
        "view": directions(rng),
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


def _networks(rng: np.random.Generator) -> Vectors:
    plain = _whole_networks(rng)
    out = {f"network_{name}": graph for name, graph in plain.items()}
    out |= {f"network_{name}_float16": quantise(plain[name], "float16") for name in ("encoded", "experts")}
    out |= {f"network_{name}_int8": quantise(plain[name], "int8") for name in ("report", "experts", "factored")}
    scene = _scene(rng)
    out["network_segments"] = _segments(rng)
    return {name: (graph, scene) for name, graph in out.items()}


def _lamps(rng: np.random.Generator) -> Vectors:
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


def _volume(rng: np.random.Generator) -> Vectors:
    """A feature volume of twelve cells: five have a plane, one has no air."""
    lattice = ProbeLattice(np.full(3, -1.0), 0.7, (4, 3, 3))
    row = np.full(lattice.cell_count, -1, np.int32)
    row[[0, 2, 5, 6, 9]] = np.arange(5)
    normal = rng.normal(size=(5, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    planes = np.column_stack([normal, -(normal * rng.uniform(0.3, 0.7, (5, 3))).sum(axis=1)])
    sides = np.where(np.arange(lattice.cell_count) == 7, 0, 1 + (row >= 0))
    first = np.where(sides > 0, np.cumsum(sides) - sides, -1).astype(np.int32)
    nodes = rng.integers(0, 30, (sides.sum(), 8)).astype(np.int32)
    grid = SplitGrid(lattice, Cuts(row, planes), first, nodes, np.zeros((0, 3), np.int32))
    features, decoder = rng.normal(0.5, 0.3, (30, 5)), rng.normal(0, 0.3, (27, 5))
    decoder[:3] += 1
    graph = lower(FeatureVolume(grid, rounded(features), decoder.astype(np.float16).astype(np.float32)))
    scene = _scene(rng)
    # Evaluators may round a place that lies in a plane, or in a face of a cell, to either side.
    at, f = lattice.locate(scene["position"] + 0.14 * scene["normal"])
    plane = planes[row[lattice.cell_number(at)]]
    far = np.abs((f * plane[:, :3]).sum(axis=1) + plane[:, 3]) > 1e-3
    far &= (np.abs(f - 0.5) < 0.499).all(axis=1) | ~((f > 0) & (f < 1)).all(axis=1)
    chosen = np.resize(np.flatnonzero(far), len(far))
    return {"network_volume": (graph, {name: values[chosen] for name, values in scene.items() if len(values) > 1})}


def _probe_light(rng: np.random.Generator) -> Vectors:
    """Light of probes that follows everything: a light and two movers, and five lamps and two movers."""
    out, scene = {}, _scene(rng)
    grid = PoseBasis(((0.0, 0.4, 1.0), (0.0, 1.0)))
    states = rng.uniform(-0.8, 0.8, (20, 3)), rng.random((20, 2)), rng.normal(size=(20, 4))
    for name, mixing in (
        ("light", SplineMix.of(*states, directions=False)),
        ("lamps", StateMix(rng.normal(size=(grid.count, 5, 4)), grid, lamps=True)),
    ):
        b = Builder(position=3, normal=3, **mixing.inputs)
        bases = b.linear("position", rng.normal(0, 0.3, (108, 3)), rng.normal(0.5, 0.3, 108))
        graph = b.build(radiance=shaded(b, mixing.mixed(b, bases), 1.0))
        more = {"lamps": rng.uniform(0, 1.5, (1, 15)), "pose": rng.random((1, 2))}
        out[f"network_probe_{name}"] = (graph, scene | more)
    return out


def cases() -> Vectors:
    """Make every test vector; inputs are float32."""
    found: Vectors = {}
    for op in OPS.values():
        found |= _examples(op)
    # These seeds keep the vectors that there are as they are.
    for number, maker in ((4, _networks), (6, _lamps), (7, _stored_types), (8, _volume), (9, _probe_light)):
        found |= maker(np.random.default_rng((SEED, number)))
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
