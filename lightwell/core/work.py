"""The work folder of a bake or comparison: what a killed bake is resumed from. It lives inside the output folder."""

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


class Settings(Protocol):
    """What the work folder needs of the dataclass that decides a job."""

    out: Path
    resume: bool
    keep: bool


class Work:
    """Checkpoints, plans, samples and elapsed seconds of one bake or comparison."""

    def __init__(self, settings: Settings, scene_digest: str) -> None:
        """Nothing is written before the first ``part``, so that a bake that is refused leaves nothing behind."""
        self.settings = settings
        self.folder = settings.out / FOLDER
        # Seconds by stage over all runs of this bake.
        self.seconds: dict[str, float] = {}
        self._digest = scene_digest
        self._open = False

    def part(self, name: str) -> Path:
        """Return a sub-folder; the first call takes up the work that is there when ``resume`` was asked for.

        Raises:
            ValueError: What is there belongs to other settings or another scene.
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
        """Remove everything, unless it shall be kept."""
        if not self.settings.keep:
            shutil.rmtree(self.folder, ignore_errors=True)

    @contextmanager
    def timed(self, stage: str) -> Iterator[None]:
        """Add the wall time of a block to a stage."""
        start, before = perf_counter(), self.seconds.get(stage, 0.0)
        try:
            yield
        finally:
            self.seconds[stage] = before + perf_counter() - start
            if self._open and self.folder.exists():
                write_json(self.folder / "seconds.json", self.seconds)


def write_json(path: Path, data: object) -> None:
    """Write JSON, whole or not at all."""
    write_atomically(path, json.dumps(data))


def _plain(settings: Settings) -> dict:
    return json.loads(json.dumps(asdict(settings), default=str))
