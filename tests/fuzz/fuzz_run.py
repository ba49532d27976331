"""Opens mutants in a limited process, one for each format, and counts what happens."""

from __future__ import annotations

import contextlib
import json
import os
import select
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

from fuzz_formats import Format
from fuzz_seeds import Case

HERE = Path(__file__).resolve().parent
# A file may take so long, seconds of processor time, and so much memory, bytes.
SECONDS, MEMORY = 10.0, 2 << 30
# A process may wait so many times longer, for a child that has no processor on a busy machine.
PATIENCE = 6.0
# Mutants that one process opens, so that what leaks is not counted against a file.
LIFE = 1500
GOOD = ("accepted", "refused")
BAD = ("crash", "hang", "memory", "traceback", "silent", "message")


@dataclass(frozen=True)
class Outcome:
    """What came of one file."""

    kind: str
    """One of ``GOOD`` and ``BAD``."""
    detail: str = ""
    bytes: int = 0
    """Memory at the peak beyond what the process held before."""


class Worker:
    """A process that opens files with one reader; started when needed, started again after a death."""

    def __init__(self, reader: str, seconds: float = SECONDS, memory: int = MEMORY):
        self._reader, self._seconds, self._memory = reader, seconds, memory
        self._process: subprocess.Popen[bytes] | None = None
        self._opened = 0

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def open(self, path: Path) -> Outcome:
        """The outcome of one file."""
        if self._process is None or self._opened >= LIFE:
            self.stop()
            self._start()
        self._opened += 1
        process = self._process
        assert process is not None and process.stdin is not None
        begin = _processor_seconds(process.pid)[0]
        try:
            process.stdin.write(f"{path}\n".encode())
            process.stdin.flush()
        except OSError:
            return self._dead()
        line = self._answer(process, begin)
        if line is None:
            self.stop()
            return Outcome("hang", f"over {self._seconds:g} s")
        if not line:
            return self._dead()
        found = json.loads(line)
        kind = "memory" if found["bytes"] > self._memory else found["outcome"]
        return Outcome(kind, found["detail"], found["bytes"])

    def stop(self) -> None:
        """End the process, if there is one."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            for stream in (self._process.stdin, self._answers, self._errors):
                with contextlib.suppress(OSError):
                    stream.close()
            self._process = None

    def _start(self) -> None:
        read, write = os.pipe()
        self._errors = tempfile.TemporaryFile()
        program = [sys.executable, str(HERE / "fuzz_worker.py"), self._reader, str(self._memory), str(write)]
        place = os.pathsep.join([str(HERE.parents[1]), *filter(None, [os.environ.get("PYTHONPATH")])])
        self._process = subprocess.Popen(
            program,
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=self._errors,
            pass_fds=(write,),
            env={**os.environ, "PYTHONPATH": place},
        )
        os.close(write)
        self._answers = os.fdopen(read, "rb")
        self._opened = 0
        # Imports take seconds on a busy machine; they are no file's.
        self._answers.readline()

    def _answer(self, process: subprocess.Popen[bytes], begin: float) -> bytes | None:
        """The line of a file; b'' where the process ended, None where it took too long."""
        waited = 0.0
        step = min(0.5, self._seconds)
        while not select.select([self._answers], [], [], step)[0]:
            used, state = _processor_seconds(process.pid)
            # A process that could run but has no processor does not hang; one that waits does, for itself or a child.
            waited += step if state != "R" else 0.0
            if used - begin > self._seconds or waited > self._seconds * PATIENCE:
                return None
        return self._answers.readline()

    def _dead(self) -> Outcome:
        process = self._process
        assert process is not None
        code = process.wait()
        self._errors.seek(0)
        text = self._errors.read()[-3000:].decode(errors="replace")
        self.stop()
        last = " | ".join(line.strip() for line in text.splitlines() if line.strip())[-400:]
        kind = "memory" if "bad_alloc" in text or "MemoryError" in text else "crash"
        return Outcome(kind, f"exit code {code}: {last}")


def _processor_seconds(pid: int) -> tuple[float, str]:
    """Processor time of a process and of the children that it has waited for, and its state: 'R' can run."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0, ""
    return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK"), fields[0]


@dataclass
class Tally:
    """Outcomes of a format."""

    format: str
    counts: Counter = field(default_factory=Counter)
    failures: list[tuple[int, Outcome]] = field(default_factory=list)
    """(index of the mutant, outcome) of all but good ones."""
    seeds: list[Outcome] = field(default_factory=list)
    """Of the sound files."""
    most_bytes: int = 0
    most_seconds: float = 0.0

    def add(self, index: int, outcome: Outcome, seconds: float) -> None:
        """Count one file."""
        self.counts[outcome.kind] += 1
        self.most_bytes = max(self.most_bytes, outcome.bytes)
        self.most_seconds = max(self.most_seconds, seconds)
        if outcome.kind not in GOOD:
            self.failures.append((index, outcome))

    @property
    def total(self) -> int:
        """Files that were opened."""
        return sum(self.counts.values())

    def told(self, most: int = 5) -> str:
        """The first failures, a line each."""
        lines = [f"{self.format} {i}: {o.kind}: {o.detail}" for i, o in self.failures[:most]]
        return "\n".join([*lines, f"... {len(self.failures) - most} more"] if len(self.failures) > most else lines)


def write_case(case: Case, folder: Path) -> Path:
    """Write the files of a case; returns what is opened."""
    for name, data in case.files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    return folder if case.entry == "." else folder / case.entry


def run(
    format_: Format,
    indices: Iterable[int],
    seed: int | str = 0,
    *,
    keep: Path | None = None,
    seconds: float = SECONDS,
    memory: int = MEMORY,
    enough: Callable[[], bool] = lambda: False,
    worker: Worker | None = None,
) -> Tally:
    """Open the seeds of a format and some of its mutants.

    Args:
        format_: The format.
        indices: Numbers of mutants.
        seed: What they are drawn from.
        keep: A folder that gets the mutants whose outcome is bad.
        seconds: Limit of processor time for one file.
        memory: Limit of memory for one file, bytes.
        enough: Asked before each file; True ends the run.
        worker: A process of the format's reader that is used and left running; None: one of its own.
    """
    tally, used = Tally(format_.name), worker or Worker(format_.reader, seconds, memory)
    with contextlib.nullcontext() if worker else used, tempfile.TemporaryDirectory() as place:
        for number, case in enumerate(format_.seeds):
            tally.seeds.append(used.open(write_case(case, Path(place) / f"seed{number}")))
        for index in indices:
            if enough():
                break
            folder = Path(place) / f"mutant{index}"
            path = write_case(format_.mutant(seed, index), folder)
            begin = time.monotonic()
            outcome = used.open(path)
            tally.add(index, outcome, time.monotonic() - begin)
            if keep is not None and outcome.kind not in GOOD:
                shutil.copytree(folder, keep / format_.name / f"{outcome.kind}-{seed}-{index}", dirs_exist_ok=True)
            shutil.rmtree(folder, ignore_errors=True)
    return tally
