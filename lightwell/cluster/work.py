"""What travels to a worker for a unit of work, and the inputs that a worker makes from it and keeps."""

from __future__ import annotations

import pickle
import zlib
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from lightwell.core.keys import array_digest, key
from lightwell.scenes.executor import Arrays, Inputs, Recipe
from lightwell.scenes.scene import Scene
from lightwell.transport.row_recipes import inputs_of

# Inputs of calls that a worker keeps: their number, and their bytes. The last ones stay, however large they are.
MOST_KEPT, MOST_BYTES = 4, 256 << 20


@dataclass(frozen=True)
class Order:
    """What all units of a call have in common."""

    task: str
    """Name in ``row_tasks.TASKS``."""
    scene: str
    """Digest of a scene that the worker has."""
    settings: Mapping[str, Any]
    """Settings of the task."""
    recipe: Recipe | None = None
    """How the worker makes the rows, without the recipe's arrays; None: they are sent."""
    name: str = ""
    """Name of the recipe with its arrays, as ``recipe_name`` makes it."""

    def packed(self) -> bytes:
        """Pack the order.

        Returns:
            A few hundred bytes.
        """
        return zlib.compress(pickle.dumps(self))


@dataclass(frozen=True)
class Work:
    """Some rows of a call, for a worker."""

    order: bytes
    """An ``Order``, packed."""
    first: int
    """Number of the first row."""
    count: int
    """Rows."""
    columns: Arrays
    """[count, ...] by name; empty where the order has a recipe."""
    digest: str
    """``inputs_digest`` of the rows: what those that are made must have."""

    def unpacked(self) -> Order:
        """Unpack the order.

        Returns:
            The order.
        """
        order: Order = pickle.loads(zlib.decompress(self.order))
        return order

    def nbytes(self) -> int:
        """Count the bytes that travel.

        Returns:
            Bytes of the pickled work.
        """
        arrays: list[pickle.PickleBuffer] = []
        text = pickle.dumps(self, protocol=5, buffer_callback=arrays.append)
        return len(text) + sum(array.raw().nbytes for array in arrays)


def recipe_name(recipe: Recipe) -> str:
    """Name a recipe by all that it is made from.

    Args:
        recipe: The recipe, with its arrays.

    Returns:
        40 hexadecimal digits.
    """
    return key("rows.recipe", 1, name=recipe.name, settings=recipe.settings, arrays=recipe.arrays).digest


def inputs_digest(columns: Arrays, shared: Mapping[str, str]) -> str:
    """Compute the digest of the inputs of some rows.

    Args:
        columns: [N, ...] by name.
        shared: The arrays that the rows share, as ``array_names`` names them.

    Returns:
        40 hexadecimal digits; other numbers, types, shapes or names have others.
    """
    return key("rows.inputs", 1, rows=columns, shared=shared).digest


def array_names(arrays: Arrays) -> dict[str, str]:
    """Name arrays by type, shape and digest.

    Args:
        arrays: [...] by name.

    Returns:
        Texts of three words by name; the last word is the digest (``core.keys.array_digest``).
    """
    return {name: f"{a.dtype.str} {'x'.join(map(str, a.shape)) or 1} {array_digest(a)}" for name, a in arrays.items()}


class MadeInputs:
    """The inputs that a worker has made by recipes; it keeps the last few."""

    def __init__(self, most: int = MOST_KEPT, most_bytes: int = MOST_BYTES) -> None:
        """Begin with none.

        Args:
            most: Inputs that are kept.
            most_bytes: Bytes of their arrays; the last ones are kept in any case.
        """
        self._most, self._most_bytes = most, most_bytes
        self._held: OrderedDict[tuple[str, str], tuple[Inputs, dict[str, str]]] = OrderedDict()

    def __len__(self) -> int:
        return len(self._held)

    def clear(self) -> None:
        """Forget all inputs."""
        self._held.clear()

    @property
    def nbytes(self) -> int:
        """Bytes of the arrays that are kept."""
        return sum(
            value.nbytes for made, _ in self._held.values() for part in vars(made).values() for value in part.values()
        )

    def rows(self, scene: Scene, order: Order, work: Work, arrays: Arrays) -> Inputs | None:
        """Make the rows of a unit, or take them from inputs that are kept.

        Args:
            scene: The scene.
            order: What the unit says; it has a recipe.
            work: The unit.
            arrays: Arrays of the recipe.

        Returns:
            Columns [count, ...] of the unit, and what rows share. None: they are other ones than the command has.
        """
        assert order.recipe is not None
        name = (order.scene, order.name)
        if name not in self._held:
            made = inputs_of(scene, replace(order.recipe, arrays=arrays))
            self._held[name] = made, array_names(made.shared)
        self._held.move_to_end(name)
        while len(self._held) > 1 and (len(self._held) > self._most or self.nbytes > self._most_bytes):
            self._held.popitem(last=False)
        made, shared = self._held[name]
        columns = {n: value[work.first : work.first + work.count] for n, value in made.columns.items()}
        return Inputs(columns, made.shared) if inputs_digest(columns, shared) == work.digest else None
