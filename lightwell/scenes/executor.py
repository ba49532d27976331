"""Where work on a scene runs that can be divided by rows, such as path tracing: in this process, or on many machines.

A row's numbers depend on its own number and the settings alone, not on how rows are divided: the same bytes come from
one process and from a hundred.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

Arrays = dict[str, np.ndarray]


@dataclass(frozen=True)
class Recipe:
    """How a worker makes the inputs of a call again, so that they need not be sent."""

    name: str
    """Name of the function, one of ``row_recipes.RECIPES``."""
    settings: Mapping[str, Any]
    """Its settings; JSON values, a few hundred bytes."""
    arrays: Arrays = field(default_factory=dict)
    """[...] by name: what it needs besides the scene. Every worker gets them once."""
    calls: int = 1
    """Calls with the same arrays that are expected; where rows are fewer bytes than arrays, rows are sent."""


@dataclass(frozen=True)
class Inputs:
    """What the rows of a call are traced from."""

    columns: Arrays
    """[N, ...] by name."""
    shared: Arrays = field(default_factory=dict)
    """[...] by name: arrays that all rows share."""


class RowExecutor(Protocol):
    """Runs functions of ``lightwell.transport.row_tasks`` on other machines."""

    def rows(
        self,
        task: str,
        settings: Mapping[str, Any],
        columns: Arrays,
        lanes: int,
        shared: Arrays | None = None,
        recipe: Recipe | None = None,
    ) -> Arrays:
        """Compute the results of all rows. Work that fails on several machines is a ``RuntimeError`` of one line.

        Args:
            task: Name of the function, one of ``row_tasks.TASKS``.
            settings: Settings of the function; JSON values.
            columns: Inputs of N rows by name, [N, ...] each.
            lanes: Paths of a row, which decide how many rows make a unit of work.
            shared: Arrays [...] by name that all rows share; None: none.
            recipe: Makes ``columns`` and ``shared`` again, to the bit; None: they are sent.

        Returns:
            Results by name, [N, ...] each, in the order of the rows.
        """
