"""Intermediate results of a light map bake, so that an interrupted bake can be resumed and gives the same bytes."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path

import numpy as np

from lightwell.fields.lightmap.trace import TriangleSides, ViewSamples
from lightwell.files import load_arrays, save_arrays
from lightwell.transport.irradiance import Irradiance
from lightwell.transport.lightmap_query import LightmapQuery

LOG = logging.getLogger("lightwell.bake")
QUERY = tuple(LightmapQuery.__dataclass_fields__)
EYES = ("half_a", "half_b", "weight")
LIGHT = ("half_a", "half_b", "direction", "wrong")


def kept(path: Path, make: Callable[[], dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Read arrays from a file, or make and write them (to a temporary name, then renamed).

    A damaged file is made again, with a warning.

    Args:
        path: File in ``.npz`` format.
        make: Makes the arrays, of any shape.

    Returns:
        Arrays by name.
    """
    if path.exists():
        try:
            return load_arrays(path, "damaged, and made again")
        except ValueError as error:
            LOG.warning("bake: %s", error)
    made = make()
    save_arrays(path, made)
    return made


def kept_sides(path: Path, make: Callable[[], TriangleSides]) -> TriangleSides:
    """Read or make the sides that a light map stores; see ``kept``.

    Args:
        path: File in ``.npz`` format.
        make: Makes the sides.

    Returns:
        The sides.
    """

    def arrays():
        made = make()
        faint = np.zeros_like(made.lit) if made.faint is None else made.faint
        return {"lit": made.lit, "dark": made.dark, "faint": faint}

    return TriangleSides(**kept(path, arrays))


def kept_light(path: Path, make: Callable[[], Irradiance]) -> Irradiance:
    """Read or make irradiance; see ``kept``.

    Args:
        path: File in ``.npz`` format.
        make: Makes the irradiance.

    Returns:
        The irradiance.
    """

    def arrays():
        made = make()
        return {name: getattr(made, name) for name in LIGHT}

    return Irradiance(**kept(path, arrays))


def kept_eyes(path: Path, make: Callable[[], ViewSamples]) -> ViewSamples:
    """Read or make samples of radiance towards views; see ``kept``.

    Args:
        path: File in ``.npz`` format.
        make: Makes the samples.

    Returns:
        The samples.
    """

    def arrays():
        made = make()
        found = {f"query.{name}": getattr(made.query, name) for name in QUERY}
        return found | {name: getattr(made, name) for name in EYES}

    found = kept(path, arrays)
    query = LightmapQuery(**{name: found[f"query.{name}"] for name in QUERY})
    return ViewSamples(query, *(found[name] for name in EYES))


def kept_counts(path: Path, make: Callable[[], tuple[int, int]]) -> tuple[int, int]:
    """Read or make two counts that depend on the speed of the machine; see ``kept``.

    Args:
        path: File in ``.npz`` format.
        make: Makes the counts.

    Returns:
        The counts.
    """
    found = kept(path, lambda: {"counts": np.array(make(), np.int64)})["counts"]
    return int(found[0]), int(found[1])
