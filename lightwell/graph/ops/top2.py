"""The two largest of many weights and the share of the second: a gate between two experts that leaves no seam."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from lightwell.graph.ops.example import POINTS, Example
from lightwell.graph.ops.op import MAX_NUMBER, Op, Use, register

# Least sum of two excesses that is divided by: where all weights agree, the first has it all.
LEAST_SUM = 1e-8


def _width(use: Use) -> int:
    use.expect(use.widths[0] >= 2, "at least two weights", f"{use.widths[0]}", "use the only expert without a gate")
    return 3


def _numpy_top2(use: Use, g: np.ndarray) -> np.ndarray:
    """[N, M] -> [N, 3]: index of the largest, index of the second, share of the second in [0, ½]."""
    order = np.argsort(-g, axis=1, kind="stable")  # of equals, the lower index first
    ranked = np.take_along_axis(g, order[:, :3], axis=1)
    third = ranked[:, 2] if g.shape[1] > 2 else np.zeros(len(g), np.float32)
    a, b = ranked[:, 0] - third, ranked[:, 1] - third
    r = b / np.maximum(a + b, np.float32(LEAST_SUM))
    share = r * r * (np.float32(3) - np.float32(2) * r)
    return np.stack([order[:, 0].astype(np.float32), order[:, 1].astype(np.float32), share], axis=1)


def _drjit_top2(use: Use, g: Any) -> Any:
    from lightwell.backend import dr, mi

    # Ranked so far: values v0 >= v1 >= v2 and indices of the first two.
    ahead = g[0] >= g[1]
    i0, i1 = dr.select(ahead, mi.Float(0), mi.Float(1)), dr.select(ahead, mi.Float(1), mi.Float(0))
    v0, v1 = dr.maximum(g[0], g[1]), dr.minimum(g[0], g[1])
    v2 = mi.Float(-MAX_NUMBER if len(g) > 2 else 0)
    for k in range(2, len(g)):
        first, second = g[k] > v0, g[k] > v1
        v2 = dr.select(second, v1, dr.maximum(v2, g[k]))
        i1 = dr.select(first, i0, dr.select(second, mi.Float(k), i1))
        v1 = dr.select(first, v0, dr.select(second, g[k], v1))
        i0, v0 = dr.select(first, mi.Float(k), i0), dr.maximum(v0, g[k])
    a, b = v0 - v2, v1 - v2
    r = b / dr.maximum(a + b, LEAST_SUM)
    return [i0, i1, r * r * (3 - 2 * r)]


def _examples(rng: np.random.Generator) -> Iterator[Example]:
    for width in (2, 3, 4, 9, 67):
        g = rng.uniform(0, 1, (POINTS, width))
        g[0], g[1] = 0, 0.5  # all equal: the first two
        g[2], g[3] = np.arange(width), np.arange(width)[::-1]
        yield Example(f"{width}", (g,))


TOP2 = register(Op(name="top2", arity=(1, 1), width=_width, numpy=_numpy_top2, drjit=_drjit_top2, examples=_examples))
