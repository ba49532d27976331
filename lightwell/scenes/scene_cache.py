"""What has been worked out from a scene and is kept in memory with it: tables, pools of points, probes."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

T = TypeVar("T")


@dataclass(frozen=True)
class Derived(Generic[T]):
    """A kind of result that scenes keep, declared by the module that makes it: ``TABLES = Derived[Tables]("…")``."""

    name: str
    """Tells kinds apart, for example 'transport.tables'."""
    most: int = 1
    """Results of this kind that a scene keeps; those not used for longest are dropped."""


class SceneCache:
    """Results that belong to one scene, by kind and arguments.

    Every ``Scene`` has one, so that scenes in one process never share a result. One thread at a time makes a result of
    a scene; others that ask wait for it.
    """

    def __init__(self) -> None:
        self._held: dict[str, OrderedDict[Hashable, Any]] = {}
        # Reentrant, because making one result may need another.
        self._lock = threading.RLock()

    def get(self, kind: Derived[T], make: Callable[[], T], arguments: Hashable = ()) -> T:
        """Return the result of ``kind`` for ``arguments``, made on first use.

        Args:
            kind: What is asked for.
            make: Makes the result from the scene and the arguments, and from nothing else.
            arguments: What the result depends on besides the scene.
        """
        with self._lock:
            held = self._held.setdefault(kind.name, OrderedDict())
            if arguments not in held:
                held[arguments] = make()
            held.move_to_end(arguments)
            while len(held) > kind.most:
                held.popitem(last=False)
            return held[arguments]
