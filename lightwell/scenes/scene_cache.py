"""Results derived from a scene and kept in memory with it: tables, pools of points, probes."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

T = TypeVar("T")


@dataclass(frozen=True)
class Derived(Generic[T]):
    """A kind of derived result, declared by the module that computes it: ``TABLES = Derived[Tables]("…")``."""

    name: str
    """Unique name, for example 'transport.tables'."""
    most: int = 1
    """Results of this kind that a scene keeps; the least recently used are dropped."""


class SceneCache:
    """Results that belong to one scene, by kind and arguments.

    Every ``Scene`` has one, so that scenes in one process never share a result. Only one thread at a time computes
    results of a scene; other threads that request one wait for it.
    """

    def __init__(self) -> None:
        """Make an empty cache."""
        self.relit = 0
        """How many times the emitters of the scene were changed: an argument of results that depend on them."""
        self._held: dict[str, OrderedDict[Hashable, Any]] = {}
        # Reentrant, because computing one result may need another.
        self._lock = threading.RLock()

    def get(self, kind: Derived[T], make: Callable[[], T], arguments: Hashable = ()) -> T:
        """Return a result, computed on first use.

        Args:
            kind: Kind of the result.
            make: Computes the result from the scene and the arguments alone.
            arguments: Values that the result depends on besides the scene.

        Returns:
            The result.
        """
        with self._lock:
            held = self._held.setdefault(kind.name, OrderedDict())
            if arguments not in held:
                held[arguments] = make()
            held.move_to_end(arguments)
            while len(held) > kind.most:
                held.popitem(last=False)
            return held[arguments]
