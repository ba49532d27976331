"""Evaluation of the shading graph of a field, as it is written."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy

import numpy as np

from lightwell.fields.tabulate import Tabulated
from lightwell.graph import Graph
from lightwell.transport.samples import Query


class Baked:
    """A shading graph as it is written, evaluated on queries; the result is radiance, reflectance included."""

    def __init__(self, graph: Graph, frame: Mapping[str, np.ndarray] | None = None) -> None:
        """Compile a graph.

        Args:
            graph: Shading graph with an output ``radiance`` that is divided by the reflectance.
            frame: Inputs [C] that are the same at all points, by name.
        """
        self.graph = graph
        self._table = Tabulated(graph, frame)

    def __call__(self, query: Query) -> np.ndarray:
        """[N, 3] radiance for a unit light."""
        return self._table(query, "radiance")["radiance"] * query.reflectance

    def with_frame(self, **frame: np.ndarray) -> Baked:
        """Return the same graph with other inputs that all points share, such as ``lamps``; nothing is compiled anew.

        Args:
            **frame: Inputs [C] by name.

        Returns:
            The graph.
        """
        other = copy(self)
        other._table = copy(self._table)
        other._table.frame = {**self._table.frame, **frame}
        return other

    @property
    def segmented(self) -> bool:
        """Whether the graph has several experts and returns their indices."""
        return "segment" in self.graph.outputs

    def segments(self, query: Query) -> tuple[np.ndarray, np.ndarray]:
        """Return which experts shade each point.

        Args:
            query: N queries.

        Returns:
            [N] int64 index of the first expert, and [N] float32 share of the second one, in [0, 0.5].
        """
        names = (name for name in ("segment", "overlap") if name in self.graph.outputs)
        found = {name: value[:, 0] for name, value in self._table(query, *names).items()}
        index = np.rint(found["segment"]).astype(np.int64)
        return index, found.get("overlap", np.zeros(len(query), np.float32))
