"""Bakes of many scenes, one after the other, with one report; an interrupted batch goes on where it was.

OUT/batch.json     state and figures of each scene
OUT/batch.html     the same as a page
OUT/NAME/          what ``bake`` writes, for each scene
OUT/logs/NAME.txt  what was done, with times
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import lightwell
from lightwell.baking.side_by_side import COLUMNS, aligned
from lightwell.core.keys import digest
from lightwell.core.output import BAKE_FILES, BATCH_FILES, holds_output
from lightwell.core.progress import Progress
from lightwell.core.scene_options import BUILTINS
from lightwell.files import files_beside, make_folder, write_atomically
from lightwell.report.batch_html import batch_html

# States of a scene.
DONE, FAILED, STARTED, WAITING = "done", "failed", "started", "waiting"
# Folder of the logs of the scenes.
LOGS = "logs"
# Exit code of an interrupted command.
INTERRUPTED = 130
# Endings of scenes that are one file; others name files beside them.
_ONE_FILE = (".glb",)


@dataclass(frozen=True)
class BatchScene:
    """A scene of a batch."""

    name: str
    """Its name in the report, and its folder."""
    source: str
    """Built-in scene or path."""
    out: Path
    """Folder to write."""
    words: tuple[str, ...] = ()
    """Options of ``lightwell bake``."""

    def signature(self, without: Sequence[Path] = ()) -> str:
        """Compute the hash of everything that decides the bake: files of the scene, options, version.

        Args:
            without: Files and folders beside the scene that are none of it.

        Returns:
            Hexadecimal digits.
        """
        files = [] if self.source in BUILTINS else list(_file_states(Path(self.source), without))
        return digest(json.dumps([lightwell.__version__, self.source, self.words, files]).encode())


@dataclass(frozen=True)
class BatchSettings:
    """Settings of a batch."""

    out: Path
    """Folder to write."""
    scenes: tuple[BatchScene, ...]
    force: bool = False
    """Overwrite files that lightwell did not write."""
    aside: tuple[Path, ...] = ()
    """Files that are no part of a scene that they lie beside: the log of the command, the settings file."""

    def written(self) -> list[Path]:
        """List what the batch writes: no part of a scene that it lies beside.

        Returns:
            Files and folders.
        """
        folders = [self.out, *(scene.out for scene in self.scenes)]
        files = [file for folder in folders for name in (*BAKE_FILES, *BATCH_FILES) for file in folder.glob(name)]
        return [*folders, self.out / LOGS, *files]


@holds_output("batch", lambda settings: BATCH_FILES)
def batch(settings: BatchSettings, run: Callable[[Sequence[str]], int], progress: Progress) -> dict[str, Any]:
    """Bake scenes that are not baked yet; one that fails does not end the batch, Ctrl-C (``KeyboardInterrupt``) does.

    Args:
        settings: The scenes and the folder.
        run: Runs a command line of lightwell; returns its exit code.
        progress: Takes a line for each scene.

    Returns:
        Content of ``batch.json``.
    """
    known, without = _known(settings.out), [*settings.written(), *settings.aside]
    # Before the first bake: an interrupt must not lose what an earlier run has said of later scenes.
    rows = [_begun(scene, settings.out, known.get(scene.name, {}), without) for scene in settings.scenes]
    for k, (scene, row) in enumerate(zip(settings.scenes, rows)):
        if row["state"] == DONE:
            continue
        resumed = row["state"] == STARTED
        rows[k] = row | {"state": STARTED}
        _write(settings.out, rows)
        progress.say(f"[bold]{scene.name}[/] ({k + 1} of {len(rows)}){', goes on' if resumed else ''}")
        rows[k] = row | _baked(scene, settings, resumed, run)
        _write(settings.out, rows)
    numbers = _write(settings.out, rows)
    progress.say(_table(rows))
    return numbers


def _baked(
    scene: BatchScene, settings: BatchSettings, resumed: bool, run: Callable[[Sequence[str]], int]
) -> dict[str, Any]:
    """Bake a scene; its state and figures."""
    log = make_folder(settings.out / LOGS) / f"{scene.name}.txt"
    log.unlink(missing_ok=True)
    start = perf_counter()
    words = ["bake", scene.source, f"--out={scene.out}", "--config=none", f"--log={log}", *scene.words]
    code = run([*words, *(["--force"] if settings.force else []), *(["--resume"] if resumed else [])])
    seconds = round(perf_counter() - start, 1)
    if code == INTERRUPTED:
        raise KeyboardInterrupt
    if code:
        return {"state": FAILED, "reason": _reason(log, code), "seconds": seconds}
    return {"state": DONE, "seconds": seconds} | _figures(scene.out)


def _begun(scene: BatchScene, out: Path, before: Mapping[str, Any], without: Sequence[Path]) -> dict[str, Any]:
    """The row of a scene before it is baked; that of an earlier run where it is finished or can go on."""
    signature = scene.signature(without)
    if before.get("signature") == signature:
        finished = before.get("state") == DONE and (scene.out / "report.json").is_file()
        if finished or before.get("state") == STARTED:
            return dict(before)
    folder = scene.out.relative_to(out).as_posix() if scene.out.is_relative_to(out) else str(scene.out)
    row = {"name": scene.name, "scene": scene.source, "folder": folder, "signature": signature}
    return row | {"state": WAITING, "reason": "", "seconds": None} | dict.fromkeys(_FIGURES)


_FIGURES = ("field", "preset", "relative_error", "noise_floor", "psnr_db", "bytes", "macs_per_pixel", "verdict")


def _figures(folder: Path) -> dict[str, Any]:
    try:
        report = json.loads((folder / "report.json").read_text())
    except (OSError, ValueError):
        return {}
    return {key: report.get(key) for key in _FIGURES}


def _reason(log: Path, code: int) -> str:
    """The error that ended a bake, from its log."""
    try:
        lines = [line for line in log.read_text(encoding="utf-8").splitlines() if " ERROR " in line]
    except OSError:
        lines = []
    if lines:
        return lines[-1].partition(" ERROR ")[2].partition(":")[2].strip()[:300]
    return f"the process was ended by signal {-code}" if code < 0 else f"ended with code {code}; see logs/{log.name}"


def _known(out: Path) -> Mapping[str, Mapping[str, Any]]:
    """The rows of an earlier run by name; none where its file is absent or damaged."""
    try:
        found = json.loads((out / "batch.json").read_text())
        return {row["name"]: row for row in found["scenes"] if isinstance(row["signature"], str)}
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return {}


def _write(out: Path, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    numbers = {"scenes": list(rows), "versions": {"lightwell": lightwell.__version__}}
    write_atomically(out / "batch.json", json.dumps(numbers, indent=1) + "\n")
    write_atomically(out / "batch.html", batch_html(numbers))
    return numbers


def _table(rows: Sequence[Mapping[str, Any]]) -> str:
    columns = [column for column in COLUMNS if column[0] in ("relative_error", "psnr_db", "bytes", "macs_per_pixel")]
    chosen = [("name", "scene", "{}"), ("state", "state", "{}"), *columns, ("seconds", "seconds", "{:.0f}")]
    text = aligned([dict(row) for row in rows], chosen)
    failed = [f"{row['name']}: {row['reason']}" for row in rows if row["state"] == FAILED]
    return "\n".join([text, *failed])


def _file_states(path: Path, without: Sequence[Path]) -> Iterator[str]:
    """Hash of a scene's file, and size and time of the files beside it that it may name."""
    try:
        yield digest(path.read_bytes())
        if path.suffix.lower() in _ONE_FILE:
            return
        for other, state in files_beside(path, without):
            yield f"{other.relative_to(path.parent).as_posix()} {state.st_size} {state.st_mtime_ns}"
    except OSError as error:
        yield f"cannot be read: {error.strerror}"
