"""The process that opens mutants: limited in memory, one line of JSON per file. Run by ``fuzz_run``.

    python fuzz_worker.py READER MEMORY ANSWERS

Reads one path a line on standard input, opens it with a function of ``fuzz_readers`` and writes the outcome to the file
descriptor ANSWERS.
"""

from __future__ import annotations

import contextlib
import dataclasses
import faulthandler
import json
import math
import os
import resource
import sys
import traceback
import warnings
from pathlib import Path
from typing import Any

import numpy as np

# Values of a result that are looked at; arrays count as one.
MOST_VALUES = 100_000
# Words of a warning that says that numbers are not finite.
TOLD = ("finite", "infinit", "NaN", "Inf", "overflow")


def status(name: str) -> int:
    """A field of this process's status, bytes."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(name + ":"):
            return int(line.split()[1]) << 10
    return 0


def limit(memory: int) -> None:
    """Allow so many bytes of address space beyond what is in use."""
    most = status("VmSize") + memory
    resource.setrlimit(resource.RLIMIT_AS, (most, resource.getrlimit(resource.RLIMIT_AS)[1]))


def not_finite(found: Any) -> str:
    """Where NaN or infinity is among the numbers of a result; '' where nowhere."""
    waiting: list[tuple[str, Any]] = [("", found)]
    for _ in range(MOST_VALUES):
        if not waiting:
            break
        where, value = waiting.pop()
        if isinstance(value, np.ndarray):
            if value.dtype.kind in "fc" and not np.isfinite(value).all():
                return where or "array"
        elif isinstance(value, float):
            if not math.isfinite(value):
                return where or "value"
        elif isinstance(value, dict):
            waiting += [(f"{where}.{k}", v) for k, v in value.items()]
        elif isinstance(value, (list, tuple)):
            waiting += [(f"{where}[{i}]", v) for i, v in enumerate(value)]
        elif dataclasses.is_dataclass(value) and not isinstance(value, type):
            waiting += [(f"{where}.{f.name}", getattr(value, f.name, None)) for f in dataclasses.fields(value)]
    return ""


def _told(found: Any, heard: list[str]) -> bool:
    said = [*heard, *(map(str, found.get("warnings", [])) if isinstance(found, dict) else [])]
    return any(word in text for text in said for word in TOLD)


def _memory(error: BaseException | None) -> bool:
    """Whether an error comes from memory that ran out."""
    while error is not None:
        if isinstance(error, MemoryError) or "bad_alloc" in str(error) or "Unable to allocate" in str(error):
            return True
        error = error.__cause__ or error.__context__
    return False


def refusal(error: BaseException, names: list[str]) -> tuple[str, str]:
    """Outcome and detail of an exception: a refusal has one line that names the file."""
    text = str(error)
    if _memory(error):
        return "memory", text[:300]
    if not isinstance(error, (ValueError, OSError)) or isinstance(error, UnicodeError):
        place = traceback.extract_tb(error.__traceback__)
        last = next((f for f in reversed(place) if "/lightwell/" in f.filename), place[-1])
        return (
            "traceback",
            f"{type(error).__name__}: {text[:200]} ({Path(last.filename).name}:{last.lineno} {last.name})",
        )
    if "\n" in text or not text.strip() or not any(name in text for name in names) or len(text) > 2000:
        return "message", f"{type(error).__name__}: {text[:300]}"
    return "refused", text[:300]


def names_of(path: Path) -> list[str]:
    """The names that a message may call a case by: any of its files, or its folder."""
    folder = path if path.is_dir() else path.parent
    return [folder.name, *(p.name for p in folder.rglob("*") if p.is_file())]


def judge(reader: Any, path: Path) -> dict[str, Any]:
    """Open a file; the outcome, its detail and the bytes of memory it took at its peak."""
    Path("/proc/self/clear_refs").write_text("5")
    before = status("VmRSS")
    with warnings.catch_warnings(record=True) as heard, np.errstate(all="ignore"):
        warnings.simplefilter("always")
        try:
            found = reader(path)
            where = not_finite(found)
            silent = where and not _told(found, [str(w.message) for w in heard])
            outcome, detail = ("silent", where) if silent else ("accepted", "")
            del found
        except (Exception, SystemExit) as error:
            outcome, detail = refusal(error, names_of(path))
    return {"outcome": outcome, "detail": detail, "bytes": max(status("VmHWM") - before, 0)}


def keep_processes(memory: int) -> None:
    """Let the processes in which lightwell runs native readers live on from file to file.

    Starting one for every file takes ten times longer than reading it. One that dies is started again, as ever.
    """
    from lightwell.core import isolated
    from lightwell.exr import decoding
    from lightwell.scenes import mitsuba_files

    class Kept(isolated.Worker):
        """Ends with a request that dies or takes too much, not with the file that it was started for."""

        asking = False

        def __exit__(self, *_: object) -> None:
            pass

        def ask(self, request: isolated.Arrays, most_bytes: int) -> isolated.Arrays:
            self.asking = True
            try:
                return super().ask(request, most_bytes)
            finally:
                self.asking = False

        def stop(self) -> int:
            return super().stop() if self.asking else 0

    known: dict[str, Kept] = {}

    def kept(function: str, **_: float) -> Kept:
        return known.setdefault(function, Kept(function, seconds=55.0, memory=memory))

    decoding.Worker = mitsuba_files.Worker = kept


def main() -> None:
    """Answer until standard input ends."""
    reader, memory, answers = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
    import fuzz_readers

    if reader in ("scene", "frame"):
        keep_processes(memory)

    faulthandler.enable()
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    function = getattr(fuzz_readers, reader)
    fuzz_readers.prepare(reader)
    with os.fdopen(answers, "w") as out, contextlib.suppress(KeyboardInterrupt):
        print("ready", file=out, flush=True)
        for line in sys.stdin:
            limit(memory)
            print(json.dumps(judge(function, Path(line.rstrip("\n")))), file=out, flush=True)


if __name__ == "__main__":
    main()
