"""Ops that only move components: concat, slice."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lightwell.graph.ops.example import WIDTHS, Example, at_widths, normals
from lightwell.graph.ops.op import MAX_WIDTH, Op, Parameter, Use, register


def _slice_width(use: Use) -> int:
    end = use["start"] + use["width"]
    use.expect(
        end <= use.widths[0], f"start + width <= {use.widths[0]}, the width of the input", f"{end}", "make it shorter"
    )
    return use["width"]


def _slice_examples(rng: np.random.Generator) -> Iterator[Example]:
    for width in WIDTHS:
        yield Example(f"{width}", (normals(rng, width),), {"start": width // 2, "width": width - width // 2})


CONCAT = register(
    Op(
        name="concat",
        arity=(1, 256),
        width=lambda use: sum(use.widths),
        numpy=lambda use, *parts: np.concatenate(parts, axis=1),
        drjit=lambda use, *parts: [component for part in parts for component in part],
        examples=at_widths("n1nn"),
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
        examples=_slice_examples,
    )
)
