"""Ops that only move components: concat, slice."""

from __future__ import annotations

import numpy as np

from lightwell.graph.ops.op import MAX_WIDTH, Op, Parameter, Use, register


def _slice_width(use: Use) -> int:
    end = use["start"] + use["width"]
    use.expect(
        end <= use.widths[0], f"start + width <= {use.widths[0]}, the width of the input", f"{end}", "make it shorter"
    )
    return use["width"]


CONCAT = register(
    Op(
        name="concat",
        arity=(1, 256),
        width=lambda use: sum(use.widths),
        numpy=lambda use, *parts: np.concatenate(parts, axis=1),
        drjit=lambda use, *parts: [component for part in parts for component in part],
    )
)

SLICE = register(
    Op(
        name="slice",
        arity=(1, 1),
        parameters={"start": Parameter("integer", 0, MAX_WIDTH), "width": Parameter("integer", 1, MAX_WIDTH)},
        width=_slice_width,
        numpy=lambda use, a: a[:, use["start"] : use["start"] + use["width"]],
        drjit=lambda use, a: a[use["start"] : use["start"] + use["width"]],
    )
)
