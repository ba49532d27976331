"""Bakes that the live page starts, in a process of their own."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from lightwell.core.scene_edits import SceneEdits
from lightwell.files import write_atomically

# Characters of a line that the page shows.
MOST = 300


class ChildBake:
    """A bake of the scene of the live page, with its edits."""

    def __init__(self, words: Sequence[str], out: Path) -> None:
        """Start the bake; it ends when this process ends.

        Args:
            words: Words after ``lightwell``.
            out: Folder that it writes.
        """
        self.out = out
        """Folder that the bake writes."""
        argv = [sys.executable, "-m", "lightwell.cli.child", *words]
        self._process = subprocess.Popen(
            argv, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, errors="replace"
        )
        self._start, self._end, self._line = time.monotonic(), 0.0, "starting"
        self._reader = threading.Thread(target=self._read, name="bake", daemon=True)
        self._reader.start()

    @staticmethod
    def start(scene: str, out: Path, options: Sequence[str], edits: SceneEdits, quality: str) -> ChildBake:
        """Write the edits, and bake the scene with them.

        Args:
            scene: Scene file or name of a built-in scene.
            out: Folder to write.
            options: Options of the scene, as words.
            edits: What the page has changed.
            quality: Quality of the bake.

        Returns:
            The running bake.
        """
        words = ["bake", scene, "-o", str(out), "--quality", quality, *options]
        if edits:
            out.mkdir(parents=True, exist_ok=True)
            file = out / "edits.json"
            write_atomically(file, edits.to_json().encode())
            words += ["--edits", str(file)]
        return ChildBake(words, out)

    def _read(self) -> None:
        """Keep the last line that the bake says."""
        assert self._process.stderr is not None
        for line in self._process.stderr:
            if words := " ".join(line.split()):
                self._line = words[:MOST]
        self._process.wait()
        self._end = time.monotonic()

    def state(self) -> dict[str, Any]:
        """Say how far the bake is.

        Returns:
            ``running``, ``seconds``, ``line`` (what it said last) and ``failed`` ('' while it runs or has succeeded).
        """
        running = self._reader.is_alive()
        seconds = (time.monotonic() if running else self._end) - self._start
        failed = "" if running or self._process.returncode == 0 else self._line
        return {"running": running, "seconds": round(seconds, 1), "line": self._line, "failed": failed}
