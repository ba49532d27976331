"""What an incremental bake of a surface field starts from: weights, a part of the samples, and the scene's parts.

A bake with ``--keep`` stores it in ``OUT/.lightwell/store``, an entry for each role.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np

from lightwell.core.formats import ARRAYS
from lightwell.core.keys import Key, key
from lightwell.core.store import Store
from lightwell.fields.base import FieldSetup
from lightwell.fields.protocol import Role
from lightwell.files import Arrays, prefixed, under
from lightwell.scenes.parts import ScenePart
from lightwell.transport.samples import Query, Samples, SurfacePoints, columns_of

# Version of the entry.
VERSION = 4
# Most samples that are kept: whole runs of one light, from all shards.
MOST_SAMPLES = 1 << 18
# Facts of the set-up that are kept.
_SETUP = ("center", "half_extent", "unit", "light", "size", "matte", "relief")


@dataclass(frozen=True)
class EditState:
    """The state of one role."""

    samples: Samples
    points: SurfacePoints
    """The points of the samples, by triangle."""
    learner: Arrays
    """See ``Learner.arrays``."""
    parts: Sequence[ScenePart]
    """Parts of the scene as it was."""
    facts: Mapping[str, Any]
    """Field, preset, seed, steps, paths, set-up and variable; JSON values."""

    def setup(self) -> dict[str, Any]:
        """Return the set-up as arguments of ``FieldSetup``.

        Returns:
            Values by name, without scene and variable.
        """
        values = dict(self.facts["setup"])
        return values | {name: tuple(values[name]) for name in ("center", "size") if values[name] is not None}

    def arrays(self) -> Arrays:
        """Return the state as it is stored.

        Returns:
            Arrays [...] by name.
        """
        about = {"facts": dict(self.facts), "parts": [asdict(part) for part in self.parts]}
        found = prefixed("query", columns_of(self.samples.query))
        found |= {f.name: getattr(self.samples, f.name) for f in fields(Samples) if f.name != "query"}
        found |= {name: getattr(self.points, name) for name in ("triangle", "barycentric")}
        found |= prefixed("learner", self.learner)
        return found | {"about": np.frombuffer(json.dumps(about).encode(), np.uint8)}

    @staticmethod
    def of(arrays: Arrays) -> EditState:
        """Read the state from stored arrays.

        Args:
            arrays: Result of ``arrays``.

        Returns:
            The state.

        Raises:
            ValueError: An array is missing or wrong.
        """
        try:
            about = json.loads(arrays["about"].tobytes())
            query = Query(**under("query", arrays))
            columns = {f.name: arrays[f.name] for f in fields(Samples) if f.name != "query"}
            points = SurfacePoints(columns["shape"], arrays["triangle"], arrays["barycentric"], query.view)
            parts = [ScenePart.of_json(part) for part in about["parts"]]
            return EditState(Samples(query, **columns), points, under("learner", arrays), parts, about["facts"])
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f"a state that cannot be read ({error})") from None


def edit_key(role: Role) -> Key:
    """Compute the key of the state of a role; the store is that of one bake.

    Args:
        role: The role.

    Returns:
        The key.
    """
    return key("surface.edit", VERSION, role=role)


def find_states(store: Store, roles: Sequence[Role]) -> dict[Role, EditState]:
    """Read the states that a store holds.

    Args:
        store: Store of a bake that was made with ``--keep``.
        roles: Roles to look for.

    Returns:
        The states that are there. One that cannot be read is a ``ValueError``.
    """
    found = {role: store.find(edit_key(role), ARRAYS) for role in roles}
    return {role: EditState.of(arrays) for role, arrays in found.items() if arrays is not None}


def setup_json(setup: FieldSetup) -> dict[str, Any]:
    """Write a set-up as JSON values.

    Args:
        setup: The set-up.

    Returns:
        Its values, without scene and variable.
    """
    return json.loads(json.dumps({name: getattr(setup, name) for name in _SETUP}))


def kept_rows(count: int, run: int, most: int = MOST_SAMPLES) -> np.ndarray:
    """Choose rows of light-major samples: whole runs, evenly over all.

    Args:
        count: Number of rows.
        run: Rows of a light.
        most: Most rows.

    Returns:
        [K] int64 rows.
    """
    runs = count // run
    chosen = np.unique(np.linspace(0, runs - 1, min(runs, max(most // run, 1))).astype(np.int64))
    return (chosen[:, None] * run + np.arange(run)).ravel()
