"""The work folder of a bake or comparison, from which an interrupted one is resumed; it is inside the output folder.

OUT/.lightwell/bake.json     the settings that the work belongs to
OUT/.lightwell/store/        results and checkpoints (``core.store``)
OUT/.lightwell/samples/      folders of samples (``transport.shards``)
"""

from __future__ import annotations

import hashlib
import json
import logging
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter
from typing import Any, Protocol, TypeVar

import lightwell
from lightwell.core.cluster_options import NAMES as CLUSTER
from lightwell.core.formats import JSON, Format
from lightwell.core.keys import Key, key
from lightwell.core.store import Store
from lightwell.files import make_folder, write_atomically

T = TypeVar("T")
LOG = logging.getLogger("lightwell.store")
FOLDER = ".lightwell"
# Key of the wall time beside the seconds of each stage.
WALL = "wall"

# Settings that do not change what is computed, so that a resumed bake may differ in them.
_FREE = ("out", "force", "resume", "keep", "views", "view_size", "scene", "fields", "limits", "allow_paths", *CLUSTER)
# Version of the entries of a bake; their keys also hold that of lightwell.
_VERSION = 6


class WorkSettings(Protocol):
    """Settings of a bake or comparison that the work folder needs."""

    out: Path
    """Output folder."""
    resume: bool
    """Continue the work of an interrupted bake."""
    keep: bool
    """Keep the work folder when the bake is done."""


@dataclass(frozen=True)
class WorkPart:
    """The results of one part of a bake, such as a role, in its store."""

    store: Store
    made_from: Mapping[str, Any]
    """What all of these results are made from, besides the name of each; values that ``keys.key`` takes."""

    def part(self, **made_from: Any) -> WorkPart:
        """Return a part of this part.

        Args:
            **made_from: What its results are made from in addition.

        Returns:
            The part.
        """
        return WorkPart(self.store, {**self.made_from, **made_from})

    def get(self, name: str, make: Callable[[], T], format: Format[T]) -> T:
        """Return a result; make and store it if it is absent.

        Args:
            name: Name of the result, such as 'lightmap.sides'.
            make: Makes the result.
            format: File format of the result.

        Returns:
            The result as the format reads it.
        """
        return self.store.get(self._key(name), make, format)

    def find(self, name: str, format: Format[T]) -> T | None:
        """Return a result, if it is stored.

        Args:
            name: Name of the result.
            format: File format of the result.

        Returns:
            The result, or None when it is absent or damaged; the log says so in one line.
        """
        return self.store.find(self._key(name), format)

    def put(self, name: str, value: T, format: Format[T]) -> None:
        """Store a result in place of the present one, such as the next checkpoint of a training.

        Args:
            name: Name of the result.
            value: The result.
            format: File format of the result.
        """
        self.store.put(self._key(name), value, format)

    def _key(self, name: str) -> Key:
        return key(name, _VERSION, **self.made_from)


class Work:
    """Checkpoints, plans, samples and elapsed seconds of one bake or comparison."""

    def __init__(self, settings: WorkSettings, scene_digest: str, started: float | None = None) -> None:
        """Prepare the work folder; nothing is written before it is used: a refused bake leaves no files.

        Args:
            settings: Settings of the bake.
            scene_digest: Hash of the scene.
            started: ``perf_counter()`` at the start of the bake; None: now.
        """
        self._started = perf_counter() if started is None else started
        # Wall seconds of the earlier runs of this bake.
        self._earlier = 0.0
        self.settings = settings
        self.folder = settings.out / FOLDER
        # Whether the folder stays when the bake is done.
        self.keep = settings.keep
        # Seconds by stage over all runs of this bake.
        self.seconds: dict[str, float] = {}
        self._signature = _signature(settings, scene_digest)
        self._open = False

    @property
    def elapsed(self) -> float:
        """Wall seconds since the start of the bake, over all runs."""
        return self._earlier + perf_counter() - self._started

    def skip(self, seconds: float) -> None:
        """Leave out time in which the bake was paused.

        Args:
            seconds: Seconds, ≥ 0.
        """
        self._started += seconds

    @property
    def store(self) -> Store:
        """The store of the bake; the first use reuses or removes the work of an earlier bake.

        The work of a bake with other settings or of another scene cannot be resumed: that is a ``ValueError``.
        """
        if not self._open:
            self._begin()
        return store_of(self.settings.out)

    def part(self, **made_from: Any) -> WorkPart:
        """Return a part of the bake's store.

        Args:
            **made_from: What its results are made from besides the scene and the settings, such as ``role='static'``.

        Returns:
            The part.
        """
        return WorkPart(self.store, {"bake": self._signature, **made_from})

    def samples(self, name: str) -> Path:
        """Return a folder of samples.

        Args:
            name: Name of the folder.

        Returns:
            Its path; ``transport.shards`` creates it.
        """
        return self.store.folder.with_name("samples") / name

    def _begin(self) -> None:
        self._open = True
        manifest = self.folder / "bake.json"
        found = _read_manifest(manifest) if self.settings.resume else None
        if found is not None:
            if found.get("signature") != self._signature:
                raise ValueError(
                    f"bake: '{self.folder}' holds a bake of other settings or another scene, or of another lightwell "
                    f"({found.get('lightwell', 'unknown')}, this is {lightwell.__version__}); "
                    "repeat it with the same ones, or start anew without --resume"
                )
            stored = self.part().find("work.seconds", JSON) or {}
            self._earlier = stored.pop(WALL, 0.0)
            self.seconds |= stored
            return
        shutil.rmtree(self.folder, ignore_errors=True)
        make_folder(self.folder)
        about = {"signature": self._signature, "lightwell": lightwell.__version__, "settings": _plain(self.settings)}
        write_atomically(manifest, json.dumps(about))

    def close(self) -> None:
        """Remove the work folder, unless it is kept."""
        if not self.keep:
            shutil.rmtree(self.folder, ignore_errors=True)

    @contextmanager
    def timed(self, stage: str) -> Iterator[None]:
        """Add the wall time of a block to a stage.

        Args:
            stage: Name of the stage.

        Yields:
            Nothing.
        """
        start, before = perf_counter(), self.seconds.get(stage, 0.0)
        try:
            yield
        finally:
            self.seconds[stage] = before + perf_counter() - start
            if self._open and self.folder.exists():
                self.part().put("work.seconds", self.seconds | {WALL: self.elapsed}, JSON)


def store_of(out: Path) -> Store:
    """Open the store in the work folder of a bake.

    Args:
        out: Output folder of the bake.

    Returns:
        The store; it has no limit, because a bake needs what it has stored.
    """
    return Store(out / FOLDER / "store", limit=None)


def _signature(settings: WorkSettings, scene_digest: str) -> str:
    decisive = {k: v for k, v in _plain(settings).items() if k not in _FREE}
    text = json.dumps({"scene": scene_digest, "lightwell": lightwell.__version__, **decisive}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def _plain(settings: WorkSettings) -> dict[str, Any]:
    return json.loads(json.dumps(asdict(settings), default=str))  # type: ignore[call-overload]


def _read_manifest(path: Path) -> dict[str, Any] | None:
    """The manifest of an interrupted bake; None where it is absent, or damaged, which the log notes in one line."""
    try:
        found = json.loads(path.read_text())
    except FileNotFoundError:
        return None
    except (OSError, ValueError, RecursionError):
        found = None
    if isinstance(found, dict):
        return found
    LOG.warning("'%s' is damaged; the bake begins anew", path)
    return None
