"""Find libraries: a standard one ships with the package, others are baked when needed and kept in the store."""

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
# Fewest nodes for which a progress bar is shown.
FEW = 24
# Version of the results of ``bake_nodes``; part of the key of stored libraries.
BAKED = 1


class LibraryFormat:
    """Reads and writes libraries in the store: one .lwsp file each (format/LENS.md)."""

    suffix = ".lwsp"

    def __init__(self, aperture: Aperture) -> None:
        """Make the format for the libraries of one aperture.

        Args:
            aperture: Aperture of the family; a file does not contain the picture of a drawn mask.
        """
        self._aperture = aperture

    def write(self, path: Path, value: Library) -> None:
        """Write a library.

        Args:
            path: File to write.
            value: The library.
        """
        path.write_bytes(value.tobytes())
        flush(path)

    def read(self, path: Path) -> Library:
        """Read a library.

        Args:
            path: File to read.

        Returns:
            The library.
        """
        return loads(path.read_bytes(), str(path), self._aperture)


class LibraryCache:
    """Libraries by configuration: looked up in the package, then in the store; missing nodes are baked on demand."""

    def __init__(
        self,
        progress: Callable[[str, int], Callable[[int], None]] | None = None,
        keep: bool = True,
        store: Store | None = None,
    ) -> None:
        """Open the libraries of a store.

        Args:
            progress: ``progress(title, total)`` returns a function that is called with the number of nodes done.
            keep: Save baked nodes to the store.
            store: The store; None for the user's.
        """
        self._progress = progress
        self._keep = keep
        self._store = store or user_store()
        # Libraries read or begun in this process, by key.
        self._open: dict[str, Library] = {}

    def library(self, family: Family, recipe: Recipe) -> Library:
        """Return the library of a configuration, with the nodes that have been baked so far.

        Args:
            family: Family of kernels.
            recipe: How spreadlets are made.

        Returns:
            The library; the same object for the same configuration.
        """
        fresh = Library(family, recipe)
        name = fresh.key()
        if name not in self._open:
            self._open[name] = _standard(fresh) or self._stored(fresh) or fresh
        return self._open[name]

    def _stored(self, fresh: Library) -> Library | None:
        found = self._store.find(_key(fresh), _format(fresh))
        if found is None or found.key() != fresh.key():
            return None
        # What a file cannot hold, the picture of an aperture or a lens, is needed to bake further nodes.
        return Library(fresh.family, found.recipe, found.nodes)

    def ensure(self, library: Library, nodes: np.ndarray) -> int:
        """Bake the nodes that a library lacks and save them to the store.

        Args:
            library: A library from ``library``; changed in place.
            nodes: Indices of the nodes [n] that are needed.

        Returns:
            Number of nodes baked.
        """
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
    """Merge the nodes that another process has stored meanwhile into the library."""
    if old is not None and old.key() == library.key():
        library.nodes = old.nodes | library.nodes
    return library


def _standard(fresh: Library) -> Library | None:
    """Read the library that ships with the package, if there is one of this configuration."""
    path = STANDARD / f"{fresh.key()}.lwsp"
    if not path.exists():
        return None
    try:
        found = load(path, fresh.family.aperture)
    except LensError:
        return None
    return found if found.key() == fresh.key() else None
