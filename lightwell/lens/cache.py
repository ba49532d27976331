"""Where libraries live: a standard one ships with the package, others are baked when needed and kept."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from lightwell.lens.bake import bake_nodes
from lightwell.lens.errors import LensError
from lightwell.lens.families import Family
from lightwell.lens.library import Library, load
from lightwell.lens.recipes import Recipe

STANDARD = Path(__file__).parent / "standard"
# Baking fewer nodes than this is over before a bar could be read.
FEW = 24


def folder() -> Path:
    """The cache: LIGHTWELL_CACHE, else the platform's own place for caches."""
    if chosen := os.environ.get("LIGHTWELL_CACHE"):
        return Path(chosen) / "lens"
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", Path.home())) / "lightwell" / "lens"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "lightwell" / "lens"


class Shelf:
    """Libraries by configuration: looked up beside the code, then in the cache, baked where they lack nodes."""

    def __init__(self, progress: Callable[[str, int], Callable[[int], None]] | None = None, keep: bool = True) -> None:
        """``progress(title, total)`` returns a function that is told how many nodes were done; ``keep`` writes."""
        self._progress = progress
        self._keep = keep
        # Libraries read or begun in this process, by key.
        self._open: dict[str, Library] = {}

    def library(self, family: Family, recipe: Recipe) -> Library:
        """The library of a configuration, with the nodes that are known so far."""
        fresh = Library(family, recipe)
        key = fresh.key()
        if key not in self._open:
            self._open[key] = self._read(key, family) or fresh
        return self._open[key]

    def _read(self, key: str, family: Family) -> Library | None:
        for place in (STANDARD, folder()):
            path = place / f"{key}.lwsp"
            if path.exists():
                try:
                    found = load(path, family.aperture)
                    if found.key() == key:
                        return found
                except LensError:
                    continue
        return None

    def ensure(self, library: Library, nodes: np.ndarray) -> int:
        """Bake the nodes that a library lacks and keep them; returns how many."""
        missing = library.missing(nodes)
        if not missing:
            return 0
        advance = self._progress("bake spreadlets", len(missing)) if self._progress and len(missing) >= FEW else None
        library.nodes.update(bake_nodes(library.family, missing, library.recipe, advance or (lambda n: None)))
        if self._keep:
            try:
                library.save(folder() / f"{library.key()}.lwsp")
            except OSError:
                self._keep = False
        return len(missing)
