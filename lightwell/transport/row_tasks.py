"""Functions that trace rows independently of each other: what other machines are asked to compute.

A function takes the scene, its settings (JSON values), columns of rows, the number of the first row, and arrays that
all rows share. Its version is part of the key of stored results; raise it when the same arguments give other bytes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from lightwell.scenes.executor import Arrays, Recipe
from lightwell.scenes.scene import Scene

RowFunction = Callable[[Scene, Mapping[str, Any], Arrays, int, Arrays], Arrays]
"""(scene, settings, columns of rows, number of the first row, shared arrays) -> results [rows, ...] by name."""


@dataclass(frozen=True)
class RowTask:
    """A function of rows."""

    place: str
    """``module:name`` of a ``RowFunction``."""
    version: int = 1

    def __call__(
        self, scene: Scene, settings: Mapping[str, Any], columns: Arrays, first: int, shared: Arrays
    ) -> Arrays:
        """Compute rows in this process.

        Args:
            scene: The scene.
            settings: Settings of the function.
            columns: Inputs of the rows, [N, ...] by name.
            first: Number of the first row.
            shared: Arrays [...] that all rows share.

        Returns:
            Results of the rows, [N, ...] by name.
        """
        module, name = self.place.split(":")
        function: RowFunction = getattr(import_module(module), name)
        return function(scene, settings, columns, first, shared)


TASKS = {
    "radiance": RowTask("lightwell.transport.radiance:radiance_rows", 3),
    "radiosity": RowTask("lightwell.transport.radiosity:radiosity_rows", 2),
    "irradiance": RowTask("lightwell.transport.irradiance:irradiance_rows"),
    "gathered-irradiance": RowTask("lightwell.transport.gather:gathered_irradiance_rows"),
    "air-light": RowTask("lightwell.probes.trace:air_light_rows"),
    "air-ends": RowTask("lightwell.probes.gathered:air_end_rows"),
    "picture": RowTask("lightwell.transport.camera:picture_rows", 2),
}


def rows_of(
    scene: Scene,
    task: str,
    settings: Mapping[str, Any],
    columns: Arrays,
    lanes: int,
    shared: Arrays | None = None,
    recipe: Recipe | None = None,
) -> Arrays:
    """Compute all rows of a task, in this process or by the executor of the scene; see ``RowExecutor.rows``.

    Args:
        scene: The scene.
        task: Name of the function, one of ``TASKS``.
        settings: Settings of the function; JSON values.
        columns: Inputs of N rows by name, [N, ...] each.
        lanes: Paths of a row.
        shared: Arrays [...] by name that all rows share; None: none.
        recipe: How workers make ``columns`` and ``shared`` again; None: they are sent.

    Returns:
        Results by name, [N, ...] each, in the order of the rows.
    """
    if scene.executor is None:
        return TASKS[task](scene, settings, columns, 0, shared or {})
    return scene.executor.rows(task, settings, columns, lanes, shared, recipe=recipe)
