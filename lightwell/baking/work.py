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

from lightwell.files import write_atomically
from lightwell.scenes.scene import Scene

FOLDER = ".lightwell"

# Settings that do not change what is computed, so that a resumed bake may differ in them.
_FREE = ("out", "force", "resume", "keep", "views", "view_size", "scene", "fields", "limits")


class Settings(Protocol):
    """What the work folder needs of the dataclass that decides a job."""

    out: Path
    resume: bool
    keep: bool


class Work:
    """Checkpoints, plans, samples and elapsed seconds of one bake or comparison."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.folder = settings.out / FOLDER
        # Seconds by stage over all runs of this bake.
        self.seconds: dict[str, float] = {}

    def open(self, scene: Scene) -> None:
        """Create the folder, or take up the one that is there when ``--resume`` was given."""
        signature = self._signature(scene)
        manifest = self.folder / "bake.json"
        if self.settings.resume and manifest.exists():
            found = json.loads(manifest.read_text())
            if found["signature"] != signature:
                raise ValueError(
                    f"bake: '{self.folder}' holds a bake of other settings or another scene; "
                    "repeat it with the same ones, or start anew without --resume"
                )
            self._load_seconds()
            return
        shutil.rmtree(self.folder, ignore_errors=True)
        _make(self.folder)
        write_json(manifest, {"signature": signature, "settings": _plain(self.settings)})

    def _signature(self, scene: Scene) -> str:
        decisive = {k: v for k, v in _plain(self.settings).items() if k not in _FREE}
        text = json.dumps({"scene": scene.digest, **decisive}, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()

    def part(self, name: str) -> Path:
        """A sub-folder."""
        folder = self.folder / name
        folder.mkdir(parents=True, exist_ok=True)
        return folder

    def close(self) -> None:
        """Remove everything, unless ``--keep`` was given."""
        if not self.settings.keep:
            shutil.rmtree(self.folder, ignore_errors=True)

    # ------------------------------------------------------------------ seconds

    @contextmanager
    def timed(self, stage: str) -> Iterator[None]:
        """Add the wall time of a block to a stage."""
        start, before = perf_counter(), self.seconds.get(stage, 0.0)
        try:
            yield
        finally:
            self.seconds[stage] = before + perf_counter() - start
            if self.folder.exists():
                write_json(self.folder / "seconds.json", self.seconds)

    def _load_seconds(self) -> None:
        path = self.folder / "seconds.json"
        if path.exists():
            self.seconds = json.loads(path.read_text())


def check_output(out: Path) -> None:
    """Find out before an hour of work, not after it, that the result cannot be written."""
    if out.exists() and not out.is_dir():
        raise ValueError(f"bake: output '{out}' is a file; name a folder with -o")
    _make(out)
    probe = out / ".write-test"
    try:
        probe.write_bytes(b"lightwell")
        probe.unlink()
    except OSError as error:
        raise ValueError(
            f"bake: cannot write to output folder '{out}' ({error.strerror}); choose another with -o or free some space"
        ) from error


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ValueError(
            f"bake: cannot create output folder '{folder}' ({error.strerror}); choose another with -o"
        ) from error


def write_json(path: Path, data: object) -> None:
    """Write JSON, whole or not at all."""
    write_atomically(path, json.dumps(data))


def _plain(settings: Settings) -> dict:
    return json.loads(json.dumps(asdict(settings), default=str))
