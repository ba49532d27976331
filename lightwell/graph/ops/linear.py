"""Matrix-vector products: linear (stored weights, optionally one set per expert), matvec (computed weights)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from lightwell.graph.ops.example import Example, indices, normals
from lightwell.graph.ops.layers import cooperative, gathered_product, gathered_rows
from lightwell.graph.ops.lookup import drjit_rounded_index, rounded_index
from lightwell.graph.ops.op import MAX_WIDTH, Op, Parameter, Use, register


def _linear_width(use: Use) -> int:
    weights, bias = use.buffers["weights"].shape, use.buffers["bias"].shape
    inputs, outputs = use.widths[0], weights[-2]
    rank = 3 if len(use.widths) == 2 else 2
    shape = "[experts, out, in] with an index" if rank == 3 else "[out, in] without an index"
    use.expect(len(weights) == rank, f"weights {shape}", f"{list(weights)}", "add or drop the index input")
    use.expect(weights[-1] == inputs, f"weights for inputs of width {inputs}", f"{list(weights)}", "export them again")
    use.expect(bias == weights[:-1], f"a bias {list(weights[:-1])}", f"{list(bias)}", "export it again")
    if rank == 3:
        use.expect(use.widths[1] == 1, "an index of width 1", f"width {use.widths[1]}", "slice it")
    return outputs


def _numpy_linear(use: Use, a: np.ndarray, index: np.ndarray | None = None) -> np.ndarray:
    """[N, in] -> [N, out]."""
    weights, bias = use.values("weights"), use.values("bias")
    if index is None:
        return a @ weights.T + bias
    expert = rounded_index(index, len(weights))
    out = np.empty((len(a), weights.shape[1]), np.float32)
    for e in np.unique(expert):
        rows = expert == e
        out[rows] = a[rows] @ weights[e].T + bias[e]
    return out


# From this many experts on, a small layer reads its weights by gathers: a call for each costs more than the layer.
MANY_EXPERTS = 1024
# Largest layer, in weights, whose gathers are written out one by one.
SMALL_LAYER = 1024


def _is_gathered(use: Use) -> bool:
    if not cooperative():
        return True
    experts, *layer = use.buffers["weights"].shape if len(use.widths) == 2 else (1, 0)
    return experts >= MANY_EXPERTS and int(np.prod(layer)) <= SMALL_LAYER


def _prepare_linear(use: Use) -> Any:
    """Packs weights and bias of every expert for cooperative vectors, or for gathers."""
    if not _is_gathered(use):
        return _prepare_layers(use)
    shape = use.buffers["weights"].shape[-2:]
    weights, bias = use.values("weights").reshape(-1, *shape), use.values("bias").reshape(-1, shape[0])
    return {"rows": gathered_rows(weights, bias)}


def _prepare_layers(use: Use) -> Any:
    import drjit.nn as nn

    from lightwell.backend import mi

    weights, bias = use.values("weights"), use.values("bias")
    if weights.ndim == 2:
        weights, bias = weights[None], bias[None]
    pairs = [nn.pack(mi.TensorXf(w), mi.TensorXf(b[:, None]), layout="inference") for w, b in zip(weights, bias)]
    return {"layers": pairs}


def _drjit_linear(use: Use, a: Any, index: Any = None) -> Any:
    import drjit.nn as nn

    if _is_gathered(use):
        return _drjit_gathered(use, a, index)
    if index is None:
        weights, bias = use.state["layers"][0]
        return nn.matvec(weights, a, bias)
    return _drjit_expert(use, a, index[0])


def _drjit_gathered(use: Use, a: list[Any], index: Any) -> list[Any]:
    """Reads the weights of each point's expert, or of the only one."""
    from lightwell.backend import mi

    experts, outputs, _ = (1, *use.buffers["weights"].shape)[-3:]
    first = mi.UInt32(0) if index is None else drjit_rounded_index(index[0], experts) * outputs
    return gathered_product(use.state["rows"], first, outputs, a)


def _drjit_expert(use: Use, a: list[Any], index: Any) -> list[Any]:
    """Calls the layer of each point's expert: points that lie together share an expert, so that packets run whole."""
    import drjit.nn as nn

    from lightwell.backend import dr

    def layer(weights: Any, bias: Any) -> Any:
        return lambda *inputs: list(nn.matvec(weights, nn.CoopVec(*inputs), bias))

    layers = use.state["layers"]
    return dr.switch(drjit_rounded_index(index, len(layers)), [layer(weights, bias) for weights, bias in layers], *a)


def _linear_examples(rng: np.random.Generator) -> Iterator[Example]:
    for inputs, outputs in ((1, 1), (3, 4), (5, 9), (12, 20)):
        params = {"weights": rng.normal(size=(outputs, inputs)), "bias": rng.normal(size=outputs)}
        yield Example(f"{inputs}_{outputs}", (normals(rng, inputs),), params)
    for experts, inputs, outputs in ((1, 3, 2), (5, 6, 7)):
        params = {"weights": rng.normal(size=(experts, outputs, inputs)), "bias": rng.normal(size=(experts, outputs))}
        given = normals(rng, inputs), indices(rng, experts)
        yield Example(f"experts_{experts}_{inputs}_{outputs}", given, params)


LINEAR = register(
    Op(
        name="linear",
        arity=(1, 2),
        parameters={"weights": Parameter("buffer", ranks=(2, 3)), "bias": Parameter("buffer", ranks=(1, 2))},
        width=_linear_width,
        numpy=_numpy_linear,
        drjit=_drjit_linear,
        macs=lambda use: use.buffers["weights"].shape[-2] * use.buffers["weights"].shape[-1],
        prepare=_prepare_linear,
        packed=lambda use: len(use.widths) == 1 and cooperative(),
        examples=_linear_examples,
    )
)


def _matvec_width(use: Use) -> int:
    rows, (matrix, columns) = use["rows"], use.widths
    use.expect(
        matrix == rows * columns, f"a matrix of {rows} x {columns} = {rows * columns} numbers", f"{matrix}", "slice it"
    )
    return rows


def _drjit_matvec(use: Use, m: Any, a: Any) -> Any:
    from lightwell.backend import dr

    columns, out = len(a), []
    for row in range(use["rows"]):
        total = m[row * columns] * a[0]
        for column in range(1, columns):
            total = dr.fma(m[row * columns + column], a[column], total)
        out.append(total)
    return out


def _matvec_examples(rng: np.random.Generator) -> Iterator[Example]:
    for rows, columns in ((1, 1), (3, 5), (8, 4)):
        yield Example(f"{rows}_{columns}", (normals(rng, rows * columns), normals(rng, columns)), {"rows": rows})


MATVEC = register(
    Op(
        name="matvec",
        arity=(2, 2),
        parameters={"rows": Parameter("integer", 1, MAX_WIDTH)},
        width=_matvec_width,
        numpy=lambda use, m, a: np.einsum("nrc,nc->nr", m.reshape(len(a), use["rows"], a.shape[1]), a),
        drjit=_drjit_matvec,
        macs=lambda use: use["rows"] * use.widths[1],
        examples=_matvec_examples,
    )
)
