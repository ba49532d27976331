"""The work folder of a bake or comparison, from which an interrupted one is resumed; it is inside the output folder."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from time import perf_counter
from typing import Protocol

import lightwell
from lightwell.core.json_files import read_json
from lightwell.files import make_folder, write_atomically

FOLDER = ".lightwell"

# Settings that do not change what is computed, so that a resumed bake may differ in them.
_FREE = ("out", "force", "resume", "keep", "views", "view_size", "scene", "fields", "limits", "allow_paths")


class WorkSettings(Protocol):
    """Settings of a bake or comparison that the work folder needs."""

    out: Path
    """Output folder."""
    resume: bool
    """Continue the work of an interrupted bake."""
    keep: bool
    """Keep the work folder when the bake is done."""


class Work:
    """Checkpoints, plans, samples and elapsed seconds of one bake or comparison."""

    def __init__(self, settings: WorkSettings, scene_digest: str) -> None:
        """Prepare the work folder; nothing is written before the first ``part``: a refused bake leaves no files.

        Args:
            settings: Settings of the bake.
            scene_digest: Hash of the scene.
        """
        self.settings = settings
        self.folder = settings.out / FOLDER
        # Seconds by stage over all runs of this bake.
        self.seconds: dict[str, float] = {}
        self._digest = scene_digest
        self._open = False

    def part(self, name: str) -> Path:
        """Return a sub-folder; the first call reuses or removes the work of an earlier bake.

        The work of a bake with other settings or of another scene cannot be resumed: that is a ``ValueError``.

        Args:
            name: Name of the sub-folder.

        Returns:
            Path of the sub-folder, which exists.
        """
        if not self._open:
            self._begin()
        folder = self.folder / name
        folder.mkdir(parents=True, exist_ok=True)
        return folder

    def _begin(self) -> None:
        self._open = True
        signature = self._signature()
        manifest = self.folder / "bake.json"
        found = read_json(manifest, dict) if self.settings.resume else None
        if found is not None:
            if found.get("signature") != signature:
                raise ValueError(
                    f"bake: '{self.folder}' holds a bake of other settings or another scene, or of another lightwell "
                    f"({found.get('lightwell', 'unknown')}, this is {lightwell.__version__}); "
                    "repeat it with the same ones, or start anew without --resume"
                )
            self.seconds |= read_json(self.folder / "seconds.json", dict) or {}
            return
        shutil.rmtree(self.folder, ignore_errors=True)
        make_folder(self.folder)
        about = {"signature": signature, "lightwell": lightwell.__version__, "settings": _plain(self.settings)}
        write_json(manifest, about)

    def _signature(self) -> str:
        decisive = {k: v for k, v in _plain(self.settings).items() if k not in _FREE}
        text = json.dumps({"scene": self._digest, "lightwell": lightwell.__version__, **decisive}, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()

    def close(self) -> None:
        """Remove the work folder, unless the settings keep it."""
        if not self.settings.keep:
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
                write_json(self.folder / "seconds.json", self.seconds)


def write_json(path: Path, data: object) -> None:
    """Write a JSON file; an error leaves no partial file.

    Args:
        path: File to write.
        data: Value of JSON types.
    """
    write_atomically(path, json.dumps(data))


def _plain(settings: WorkSettings) -> dict:
    return json.loads(json.dumps(asdict(settings), default=str))
