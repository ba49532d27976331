"""Where work on a scene runs that can be divided by rows, such as path tracing: in this process, or on many machines.

A row's numbers depend on its own number and the settings alone, not on how rows are divided: the same bytes come from
one process and from a hundred.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

Arrays = dict[str, np.ndarray]


class RowExecutor(Protocol):
    """Runs functions of ``lightwell.transport.row_tasks`` on other machines."""

    def rows(
        self, task: str, settings: Mapping[str, Any], columns: Arrays, lanes: int, shared: Arrays | None = None
    ) -> Arrays:
        """Compute the results of all rows. Work that fails on several machines is a ``RuntimeError`` of one line.

        Args:
            task: Name of the function, one of ``row_tasks.TASKS``.
            settings: Settings of the function; JSON values.
            columns: Inputs of N rows by name, [N, ...] each.
            lanes: Paths of a row, which decide how many rows make a unit of work.
            shared: Arrays [...] by name that all rows share; None: none.

        Returns:
            Results by name, [N, ...] each, in the order of the rows.
        """
