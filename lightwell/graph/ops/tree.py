"""A binary tree that finds the leaf of a point: the regions of a field that has one small network in each."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from lightwell.graph.ops.example import Example, coordinates
from lightwell.graph.ops.fetch import gather_row
from lightwell.graph.ops.op import MAX_EXACT, Op, Parameter, Use, register

MAX_DEPTH = 64


def _width(use: Use) -> int:
    """Checks the whole tree, so that no runtime has to guard its walk: it stays in the buffer and ends in a leaf."""
    buffer = use.buffers["nodes"]
    rows = buffer.shape[0]
    use.expect(buffer.type == "float32", "nodes of type float32", buffer.type, "export them unrounded")
    use.expect(
        buffer.shape[1] == 4, "rows of axis, threshold, below, above", f"{list(buffer.shape)}", "export them again"
    )
    use.expect(rows <= MAX_EXACT, f"at most {MAX_EXACT} rows", f"{rows}", "prune the tree")
    nodes = buffer.values()
    axis, children = nodes[:, 0], nodes[:, 2:]
    valid = (axis == np.floor(axis)) & (axis >= 0) & (axis < use.widths[0])
    _expect_rows(use, valid, axis, f"an axis that is an integer from 0 to {use.widths[0] - 1}")
    valid = (children == np.floor(children)) & (np.abs(children) <= MAX_EXACT)
    _expect_rows(use, valid.all(axis=1), children, f"children that are integers of magnitude up to {MAX_EXACT}")
    own = np.arange(rows)[:, None]
    valid = (children < 0) | ((children > own) & (children < rows))
    _expect_rows(use, valid.all(axis=1), children, f"children above their parent's row and below {rows}, or leaves")
    levels = _levels(children.astype(np.int64), use["depth"] + 1)
    use.expect(
        levels <= use["depth"], f"a tree of at most {use['depth']} levels, its depth", "more", "raise depth or prune it"
    )
    return 1


def _expect_rows(use: Use, valid: np.ndarray, found: np.ndarray, expected: str) -> None:
    """Require every row to be valid; the error names the first that is not."""
    row = int(np.argmin(valid))
    use.expect(bool(valid[row]), f"{expected}", f"{found[row].tolist()} in row {row}", "export the tree again")


def _levels(children: np.ndarray, limit: int) -> int:
    """Levels of interior nodes that can be reached from the root, counted up to ``limit``: [n, 2] -> int."""
    frontier, levels = np.zeros(1, np.int64), 0
    while frontier.size and levels < limit:
        below = children[frontier].ravel()
        frontier = np.unique(below[below >= 0])
        levels += 1
    return levels


def _numpy_tree(use: Use, a: np.ndarray) -> np.ndarray:
    """[N, C] -> [N, 1]: the number of the leaf."""
    nodes = use.values("nodes")
    at = np.zeros(len(a), np.int64)
    walking = np.arange(len(a))
    while walking.size:
        axis, threshold, below, above = nodes[at[walking]].T
        child = np.where(a[walking, axis.astype(np.int64)] < threshold, below, above)
        at[walking] = child.astype(np.int64)
        walking = walking[child >= 0]
    return (-1 - at)[:, None].astype(np.float32)


def _prepare(use: Use) -> Any:
    from lightwell.backend import dr, upload_floats

    nodes = upload_floats(use.values("nodes").ravel())
    dr.make_opaque(nodes)
    return {"nodes": nodes}


def _drjit_tree(use: Use, a: Any) -> Any:
    from lightwell.backend import dr, mi

    # A leaf number has no derivative, and a loop over values that have one would record them.
    a = [mi.Float(dr.detach(component)) for component in a]

    def step(child: Any) -> Any:
        axis, threshold, below, above = gather_row(use.state["nodes"], mi.UInt32(child), 4)
        value = a[0]
        for k in range(1, len(a)):
            value = dr.select(axis == k, a[k], value)
        return (mi.Int32(dr.select(value < threshold, below, above)),)

    def inside(child: Any) -> Any:
        return child >= 0

    (child,) = dr.while_loop((mi.Int32(0),), inside, step, labels=("child",))
    return [mi.Float(-1 - child)]


def random_tree(width: int, depth: int, rng: np.random.Generator) -> np.ndarray:
    """Draw a tree over the unit cube.

    Args:
        width: Axes.
        depth: Levels of the first branch, the deepest.
        rng: Source of the numbers.

    Returns:
        [n, 4] float32 nodes.
    """
    nodes: list[list[float]] = []
    leaves = 0

    def grow(level: int, deep: bool) -> int:
        nonlocal leaves
        if level == depth or (not deep and rng.random() < 0.4):
            leaves += 1
            return -leaves
        row = len(nodes)
        nodes.append([])
        axis, threshold = int(rng.integers(width)), float(np.float32(rng.uniform(0.2, 0.8)))
        nodes[row] = [axis, threshold, grow(level + 1, deep), grow(level + 1, False)]
        return row

    grow(0, True)
    return np.asarray(nodes, np.float32)


def _examples(rng: np.random.Generator) -> Iterator[Example]:
    for width, depth in ((1, 1), (3, 6), (6, 12)):
        params = {"nodes": random_tree(width, depth, rng), "depth": depth}
        yield Example(f"{width}_{depth}", (coordinates(rng, width),), params)


TREE = register(
    Op(
        name="tree",
        arity=(1, 1),
        parameters={
            "nodes": Parameter("buffer", ranks=(2,), exact=True),
            "depth": Parameter("integer", 1, MAX_DEPTH),
        },
        width=_width,
        numpy=_numpy_tree,
        drjit=_drjit_tree,
        fetches=lambda use: use["depth"],
        prepare=_prepare,
        examples=_examples,
    )
)
