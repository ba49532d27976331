"""Inputs of networks for many samples, computed by the same shading graph as in the viewer."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from lightwell.backend import dr, mi, upload_floats
from lightwell.fields.base import query_inputs
from lightwell.graph import Compiled, Graph, compile
from lightwell.graph.graph import FRAME_INPUTS
from lightwell.transport.samples import Query

# Rows that are computed at a time; bounds memory.
ROWS_AT_ONCE = 1 << 20


class Tabulated:
    """A graph over queries, as a function that returns NumPy arrays."""

    def __init__(self, graph: Graph, frame: Mapping[str, np.ndarray] | None = None) -> None:
        """Compile a graph.

        Args:
            graph: Graph with the inputs of a query.
            frame: Inputs [C] that are the same for all queries, by name.
        """
        self.graph, self.frame = graph, frame or {}
        self._compiled: Compiled = compile(graph)

    def width(self, output: str) -> int:
        """Return the width of an output.

        Args:
            output: Name of the output.

        Returns:
            Numbers per query.
        """
        return self.graph.widths[self.graph.outputs[output]]

    def __call__(self, query: Query, *names: str) -> dict[str, np.ndarray]:
        """Output name → [N, C] float32; of the outputs with these names, or of all."""
        return {name: np.array(table) for name, table in self.tensors(query, *names).items()}

    def tensors(self, query: Query, *names: str) -> dict[str, Any]:
        """Compute outputs and leave them on the device.

        Args:
            query: N queries.
            names: Names of the outputs; none: all.

        Returns:
            [N, C] tensors by name.
        """
        names = names or tuple(self.graph.outputs)
        out = {name: dr.empty(mi.Float, len(query) * self.width(name)) for name in names}
        for begin in range(0, len(query), ROWS_AT_ONCE):
            part = query[begin : begin + ROWS_AT_ONCE]
            inputs = query_inputs(part)
            columns = {
                name: _columns(inputs[name], name in FRAME_INPUTS)
                for name in self.graph.inputs
                if name not in self.frame
            }
            columns |= {name: [dr.opaque(mi.Float, float(c)) for c in value] for name, value in self.frame.items()}
            outputs, row = self._compiled(columns), dr.arange(mi.UInt32, len(part)) + dr.opaque(mi.UInt32, begin)
            for name in names:
                # Whole rows are written by the kernel: copies of single columns took most of the time.
                dr.scatter(out[name], mi.ArrayXf(outputs[name]), row)
            dr.eval(out)
        return {name: mi.TensorXf(out[name], (len(query), self.width(name))) for name in names}


def _columns(values: np.ndarray, per_frame: bool) -> list[mi.Float]:
    """Columns of an input [N, C]; single numbers where a frame input is the same for all, so that what depends on it
    alone is computed once."""
    same = per_frame and len(values) > 0 and bool((values == values[0]).all())
    return [upload_floats(c) for c in (values[:1] if same else values).T]
