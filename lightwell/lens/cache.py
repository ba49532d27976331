"""Where libraries live: a standard one ships with the package, others are baked when needed and kept in the store."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from lightwell.core.keys import Key, key
from lightwell.core.store import Store, user_store
from lightwell.files import flush
from lightwell.lens.aperture import Aperture
from lightwell.lens.bake import bake_nodes
from lightwell.lens.errors import LensError
from lightwell.lens.families import Family
from lightwell.lens.library import Library, load, loads
from lightwell.lens.recipes import Recipe

STANDARD = Path(__file__).parent / "standard"
# Baking fewer nodes than this is over before a bar could be read.
FEW = 24
# Version of what ``bake_nodes`` makes; part of the name under which libraries are stored.
BAKED = 1


class LibraryFormat:
    """Libraries of the store: one .lwsp file each (format/LENS.md)."""

    suffix = ".lwsp"

    def __init__(self, aperture: Aperture) -> None:
        """``aperture``: that of the family, which a file of a drawn mask does not hold."""
        self._aperture = aperture

    def write(self, path: Path, value: Library) -> None:
        path.write_bytes(value.tobytes())
        flush(path)

    def read(self, path: Path) -> Library:
        return loads(path.read_bytes(), str(path), self._aperture)


class Shelf:
    """Libraries by configuration: looked up beside the code, then in the store, baked where they lack nodes."""

    def __init__(
        self,
        progress: Callable[[str, int], Callable[[int], None]] | None = None,
        keep: bool = True,
        store: Store | None = None,
    ) -> None:
        """Open the libraries of a store.

        Args:
            progress: ``progress(title, total)`` returns a function that is told how many nodes were done.
            keep: Store what is baked.
            store: None: the user's store.
        """
        self._progress = progress
        self._keep = keep
        self._store = store or user_store()
        # Libraries read or begun in this process, by key.
        self._open: dict[str, Library] = {}

    def library(self, family: Family, recipe: Recipe) -> Library:
        """The library of a configuration, with the nodes that are known so far."""
        fresh = Library(family, recipe)
        name = fresh.key()
        if name not in self._open:
            self._open[name] = _standard(fresh) or self._stored(fresh) or fresh
        return self._open[name]

    def _stored(self, fresh: Library) -> Library | None:
        found = self._store.find(_key(fresh), _format(fresh))
        return found if found is not None and found.key() == fresh.key() else None

    def ensure(self, library: Library, nodes: np.ndarray) -> int:
        """Bake the nodes that a library lacks and keep them; returns how many."""
        missing = library.missing(nodes)
        if not missing:
            return 0
        advance = self._progress("bake spreadlets", len(missing)) if self._progress and len(missing) >= FEW else None
        library.nodes.update(bake_nodes(library.family, missing, library.recipe, advance or (lambda n: None)))
        if self._keep:
            try:
                self._store.update(_key(library), lambda old: _joined(library, old), _format(library))
            except OSError:
                self._keep = False
        return len(missing)


def _key(library: Library) -> Key:
    return key("lens.library", BAKED, configuration=library.key())


def _format(library: Library) -> LibraryFormat:
    return LibraryFormat(library.family.aperture)


def _joined(library: Library, old: Library | None) -> Library:
    """The library with the nodes that another process has stored meanwhile."""
    if old is not None and old.key() == library.key():
        library.nodes = old.nodes | library.nodes
    return library


def _standard(fresh: Library) -> Library | None:
    """The library that ships with the package, if it is of this configuration."""
    path = STANDARD / f"{fresh.key()}.lwsp"
    if not path.exists():
        return None
    try:
        found = load(path, fresh.family.aperture)
    except LensError:
        return None
    return found if found.key() == fresh.key() else None
