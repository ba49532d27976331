"""Inputs of networks for many samples, computed by the same shading graph as in the viewer."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import islice, pairwise
from typing import Any

import numpy as np

from lightwell.backend import dr, mi, upload_floats, upload_integers
from lightwell.fields.base import query_inputs
from lightwell.graph import Compiled, Graph, compile, evaluate
from lightwell.graph.graph import FRAME_INPUTS
from lightwell.transport.samples import Query

# Rows that are computed at a time, and frames that they may have; bounds memory.
ROWS_AT_ONCE, FRAMES_AT_ONCE = 1 << 20, 1 << 14


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
        self._frame = graph.frame_part()

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
        inputs = query_inputs(query)
        number = self._frame_numbers(inputs)
        for rows in parts(number):
            own = {name: values[rows] for name, values in inputs.items()}
            columns = {
                name: _columns(own[name], name in FRAME_INPUTS) for name in self.graph.inputs if name not in self.frame
            }
            columns |= {name: [dr.opaque(mi.Float, float(c)) for c in value] for name, value in self.frame.items()}
            outputs = self._compiled(columns, self._settled(own, number[rows]))
            row = dr.arange(mi.UInt32, rows.stop - rows.start) + dr.opaque(mi.UInt32, rows.start)
            for name in names:
                # Whole rows are written by the kernel: copies of single columns took most of the time.
                dr.scatter(out[name], mi.ArrayXf(outputs[name]), row)
            dr.eval(out)
        return {name: mi.TensorXf(out[name], (len(query), self.width(name))) for name in names}

    def _frame_numbers(self, inputs: Mapping[str, np.ndarray]) -> np.ndarray:
        """[N] numbers of the frames of the rows: neighbours with the same frame inputs share one."""
        rows = len(next(iter(inputs.values())))
        changes = np.zeros(rows, bool)
        for name in self._frame.inputs if self._frame else ():
            if name not in self.frame:
                changes[1:] |= (inputs[name][1:] != inputs[name][:-1]).any(axis=1)
        return np.cumsum(changes)

    def _settled(self, inputs: Mapping[str, np.ndarray], number: np.ndarray) -> dict[str, list[mi.Float]] | None:
        """Per-frame values that the rows read, of [K] frames, by NumPy.

        A kernel would compute them for each row, and its compilation takes seconds: the network of a light predicts
        some hundred weights.
        """
        if self._frame is None:
            return None
        first = np.flatnonzero(np.diff(number, prepend=-1))
        frames = {
            name: np.reshape(self.frame[name], (1, -1)) if name in self.frame else inputs[name][first]
            for name in self._frame.inputs
        }
        found = evaluate(self._frame, frames)
        table = np.concatenate(list(found.values()), axis=1)
        held, width = upload_floats(table.ravel()), dr.opaque(mi.UInt32, table.shape[1])
        begin = (upload_integers(number - number[0]) if len(table) > 1 else mi.UInt32(0)) * width
        columns = iter([dr.gather(mi.Float, held, begin + k) for k in range(table.shape[1])])
        return {name: list(islice(columns, values.shape[1])) for name, values in found.items()}


def parts(number: np.ndarray) -> Iterator[slice]:
    """Part rows into those that are computed at a time.

    Args:
        number: [N] ascending numbers of the frames of the rows.

    Yields:
        The rows of each part.
    """
    block = np.arange(len(number)) // ROWS_AT_ONCE
    ends = np.flatnonzero((np.diff(block) != 0) | (np.diff(number // FRAMES_AT_ONCE) != 0)) + 1
    for begin, end in pairwise([0, *ends.tolist(), len(number)]):
        if end > begin:
            yield slice(begin, end)


def _columns(values: np.ndarray, per_frame: bool) -> list[mi.Float]:
    """Columns of an input [N, C]; single numbers where a frame input is the same for all, so that what depends on it
    alone is computed once."""
    same = per_frame and len(values) > 0 and bool((values == values[0]).all())
    return [upload_floats(c) for c in (values[:1] if same else values).T]
