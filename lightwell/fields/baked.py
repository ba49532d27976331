"""Evaluation of the shading graph of a field, as it is written."""

from __future__ import annotations

import numpy as np

from lightwell.fields.tabulate import Tabulated
from lightwell.graph import Graph
from lightwell.transport.samples import Query


class Baked:
    """A shading graph as it is written, evaluated on queries; the result is radiance, reflectance included."""

    def __init__(self, graph: Graph) -> None:
        """Compile a graph.

        Args:
            graph: Shading graph with an output ``radiance`` that is divided by the reflectance.
        """
        self.graph = graph
        self._table = Tabulated(graph)

    def __call__(self, query: Query) -> np.ndarray:
        """[N, 3] radiance for a unit light."""
        return self._table(query, "radiance")["radiance"] * query.reflectance

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
