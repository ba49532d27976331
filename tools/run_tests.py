"""Runs the tests room by room and prints how many seconds each took; the last line is the total over Python and web.

    python tools/run_tests.py [--marks "not slow"] [--jobs 2] [--room tests/core ...] [--reports FOLDER]

A room is a folder of ``tests/``, a name of ``JOINED``, ``types`` (mypy) or ``web``. Each is a process of its own: what
a room leaves in Mitsuba is not seen by the others. Exit code 1 when a test failed or a room ended in an error.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import shlex
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ET
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
MARKS = "not slow"
# pytest: "no tests collected", such as a file of slow tests only when those are deselected.
NOTHING_SELECTED = 5
# What traces and trains nothing is one room: importing Mitsuba takes longer than these tests do.
QUICK = (
    "tests/core", "tests/graph", "tests/asset", "tests/report", "tests/test_rooms.py", "tests/test_files.py",
    "tests/test_limits.py", "tests/test_exr.py", "tests/test_interrupts.py", "tests/test_isolated.py",
    "tests/test_serve.py", "tests/test_tests.py",
)  # fmt: skip
# Rooms of several folders and files; ``small`` has the files that no other room has, too. A process takes two processor
# seconds until its first test, and five more until it has recorded the kernels of a bake.
JOINED = {
    "quick": QUICK,
    "baking": ("tests/baking", "tests/test_examples_and_benchmarks.py", "tests/test_public_api.py"),
    "learning": ("tests/fields", "tests/networks"),
    "tracing": ("tests/transport", "tests/probes"),
    "small": ("tests/basisu", "tests/cli", "tests/compatibility", "tests/engines", "tests/security"),
}
# Rooms of more than half a minute of processor time, longest first; they begin before the others, so that none of them
# is left alone at the end. With the tests marked slow, documents and Blender take longest.
LONG = (
    "baking", "tests/docs", "tests/scenes", "tests/integrations", "learning", "tracing", "quick", "small",
    "tests/cache", "tests/lens", "tests/fuzz", "types",
)  # fmt: skip
# Seconds between two looks at the running rooms.
POLL = 0.05


@dataclass(frozen=True)
class Counts:
    """How tests ended."""

    passed: int = 0
    failed: int = 0
    skipped: int = 0
    failures: tuple[str, ...] = ()
    """Names of the tests that failed, as far as the report has them."""

    def __add__(self, other: Counts) -> Counts:
        return Counts(
            self.passed + other.passed,
            self.failed + other.failed,
            self.skipped + other.skipped,
            self.failures + other.failures,
        )

    def __str__(self) -> str:
        return f"{self.passed} passed, {self.failed} failed, {self.skipped} skipped"


@dataclass(frozen=True)
class Room:
    """One command that runs tests and writes a report."""

    name: str
    command: tuple[str, ...]
    """Without the option that says where the report is written."""
    report_option: str
    """Option in front of the report's path."""
    read: Callable[[Path], Counts]
    folder: Path = ROOT
    may_be_empty: bool = False
    """Whether exit code 5, no test selected, is a success."""
    waits: bool = False
    """Whether it waits for most of its time, so that it runs beside ``jobs`` others."""


@dataclass(frozen=True)
class Result:
    """How the tests of a room ended."""

    room: str
    counts: Counts
    code: int
    seconds: float
    """Wall time."""
    processor_seconds: float
    """User and system time of the process and of all that it started, browsers included."""

    @property
    def failed(self) -> bool:
        """Whether a test failed or the room ended in an error."""
        return bool(self.code or self.counts.failed)


def read_junit(path: Path) -> Counts:
    """Read the counts of a report by pytest.

    Args:
        path: A JUnit XML file.

    Returns:
        Errors of fixtures count as failed, expected failures as skipped, as in the file.
    """
    total = Counts()
    for suite in ET.parse(path).getroot().iter("testsuite"):
        tests, failures, errors, skipped = (
            int(suite.get(key, 0)) for key in ("tests", "failures", "errors", "skipped")
        )
        failed = failures + errors
        names = tuple(
            f"{case.get('classname')}::{case.get('name')}"
            for case in suite.iter("testcase")
            if case.find("failure") is not None or case.find("error") is not None
        )
        total += Counts(max(tests - failed - skipped, 0), failed, skipped, names)
    return total


def read_vitest(path: Path) -> Counts:
    """Read the counts of a report by vitest.

    Args:
        path: A file of its json reporter.

    Returns:
        A file whose tests could not be collected counts as one failed test.
    """
    report = json.loads(path.read_text())
    unread = [
        file["name"] for file in report["testResults"] if file["status"] == "failed" and not file["assertionResults"]
    ]
    failed = [
        f"{Path(file['name']).name} > {test['fullName']}"
        for file in report["testResults"]
        for test in file["assertionResults"]
        if test["status"] == "failed"
    ]
    skipped = report["numPendingTests"] + report["numTodoTests"]
    counted = report["numFailedTests"] + len(unread)
    return Counts(report["numPassedTests"], counted, skipped, (*failed, *(Path(name).name for name in unread)))


def pytest_options(places: tuple[str, ...]) -> tuple[str, ...]:
    """Choose the options of pytest for a room.

    Args:
        places: Files and folders of tests, from the root of the repository.

    Returns:
        The durations of the longest tests are printed. The plugin of Hypothesis, which imports all of it when the tests
        have ended (a second of processor time), is left out where no test uses it.
    """
    paths = [ROOT / place for place in places]
    files = [file for path in paths for file in (path.rglob("*.py") if path.is_dir() else (path,))]
    used = any("from hypothesis import" in file.read_text() for file in files)
    return ("--durations=5", "--durations-min=1", *(() if used else ("-p", "no:hypothesispytest")))


def python_rooms(marks: str) -> list[Room]:
    """List the rooms of the Python tests.

    Args:
        marks: Expression of pytest's ``-m``; empty for all tests.

    Returns:
        Those of ``JOINED``, then the other folders of tests.
    """
    folders = [path for path in sorted((ROOT / "tests").glob("[a-z]*/")) if path.is_dir()]
    files = sorted((ROOT / "tests").glob("test_*.py"))
    taken = {place for places in JOINED.values() for place in places}
    free = {path: name for path in (*folders, *files) if (name := str(path.relative_to(ROOT))) not in taken}
    joined = JOINED | {"small": (*JOINED["small"], *(free[path] for path in files if path in free))}
    rooms = [*joined.items(), *((free[path], (free[path],)) for path in folders if path in free)]
    pytest = (sys.executable, "-m", "pytest", "-m", marks)
    return [
        Room(name, (*pytest, *pytest_options(places), *places), "--junitxml=", read_junit, may_be_empty=True)
        for name, places in rooms
    ]


def web_room() -> Room:
    """Describe the room of the web tests.

    Returns:
        The room; Chromium is that of the environment or what ``tools/find-chromium.sh`` finds.
    """
    command = ("npm", "test", "--silent", "--", "--reporter=default", "--reporter=json")
    return Room("web", command, "--outputFile.json=", read_vitest, ROOT / "web", waits=True)


def types_room() -> Room:
    """Describe the room that checks types.

    Returns:
        The room, which counts as one test.
    """
    return Room("types", (sys.executable, "-m", "mypy"), "--junit-xml=", read_junit)


def all_rooms(marks: str) -> list[Room]:
    """List all rooms in the order in which they begin.

    Args:
        marks: Expression of pytest's ``-m``; empty for all tests.

    Returns:
        The web first, which takes longer than the processor works for it, then the rooms of ``LONG`` and the others.
    """
    order = {name: number for number, name in enumerate(LONG)}
    others = [types_room(), *python_rooms(marks)]
    return [web_room(), *sorted(others, key=lambda room: order.get(room.name, len(order)))]


def start(room: Room, folder: Path, environment: dict[str, str]) -> subprocess.Popen[bytes]:
    """Start the tests of a room.

    Args:
        room: What to run.
        folder: Where the log and the report are written.
        environment: Environment of the process.

    Returns:
        The running process.
    """
    print(f"{room.name}: {shlex.join(room.command[1:])}", flush=True)
    stem = room.name.replace("/", "-")
    counted = (sys.executable, str(ROOT / "tools/count_orphans.py"))
    command = [*counted, *room.command, f"{room.report_option}{folder / stem}.report"]
    with (folder / f"{stem}.log").open("wb") as log:
        return subprocess.Popen(command, cwd=room.folder, env=environment, stdout=log, stderr=subprocess.STDOUT)


def result(room: Room, folder: Path, code: int, seconds: float, processor_seconds: float) -> Result:
    """Read how a room ended and print its log.

    Args:
        room: What ran.
        folder: Where its log and report are.
        code: Exit code.
        seconds: Wall time.
        processor_seconds: User and system time.

    Returns:
        What the report says; a room without one has failed.
    """
    stem = room.name.replace("/", "-")
    report = folder / f"{stem}.report"
    if room.may_be_empty and code == NOTHING_SELECTED:
        code = 0
    counts = room.read(report) if report.exists() else Counts()
    if not report.exists():
        code = code or 1
    if code and not counts.failed:
        counts += Counts(failed=1)
    print(f"\n== {room.name}\n{(folder / f'{stem}.log').read_text(errors='replace').rstrip()}")
    print(f"== {room.name}: {counts}, {seconds:.0f} s, {processor_seconds:.0f} s of processor time", flush=True)
    return Result(room.name, counts, code, seconds, processor_seconds)


def run(rooms: list[Room], jobs: int, environment: dict[str, str], reports: Path | None = None) -> Iterator[Result]:
    """Run rooms, some at once.

    Args:
        rooms: What to run, in this order.
        jobs: Rooms that run at once, ≥ 1, besides those that wait for most of their time.
        environment: Environment of the processes.
        reports: Folder that keeps the logs and reports of the rooms; None: they are deleted.

    Yields:
        A result as soon as its room has ended.
    """
    waiting, running = deque(rooms), dict[int, tuple[Room, subprocess.Popen[bytes], float]]()
    with contextlib.ExitStack() as cleared:
        if reports is None:
            folder = Path(cleared.enter_context(tempfile.TemporaryDirectory(prefix="lightwell-tests-")))
        else:
            folder = reports.resolve()
            folder.mkdir(parents=True, exist_ok=True)
        try:
            while waiting or running:
                while waiting and (waiting[0].waits or sum(not one[0].waits for one in running.values()) < jobs):
                    room = waiting.popleft()
                    process = start(room, folder, environment)
                    running[process.pid] = room, process, time.monotonic()
                time.sleep(POLL)
                for pid in list(running):
                    # Not Popen.poll: the processor time of each process is wanted.
                    found, status, usage = os.wait4(pid, os.WNOHANG)
                    if not found:
                        continue
                    room, process, begin = running.pop(pid)
                    process.returncode = code = os.waitstatus_to_exitcode(status)
                    yield result(room, folder, code, time.monotonic() - begin, usage.ru_utime + usage.ru_stime)
        finally:
            for _, process, _ in running.values():
                process.terminate()
                process.wait()


def summary(results: list[Result], seconds: float) -> str:
    """Write the table of rooms, the rooms and tests that failed, and the total.

    Args:
        results: How the rooms ended.
        seconds: Wall time of all.

    Returns:
        Several lines, longest room first; the last is ``N passed, N failed, N skipped``.
    """
    width = max((len(one.room) for one in results), default=0)
    lines = ["", f"{'room':{width}}  seconds  processor  tests"]
    for one in sorted(results, key=lambda one: -one.seconds):
        lines.append(f"{one.room:{width}}  {one.seconds:7.1f}  {one.processor_seconds:9.1f}  {one.counts}")
    lines.append(f"{'all':{width}}  {seconds:7.1f}  {sum(one.processor_seconds for one in results):9.1f}")
    for one in results:
        if one.failed:
            lines += [f"FAILED {one.room} (exit code {one.code})", *(f"  {name}" for name in one.counts.failures)]
    return "\n".join([*lines, str(sum((one.counts for one in results), Counts()))])


# Worker threads of Dr.Jit and of NumPy's linear algebra.
THREADS = ("LIGHTWELL_THREADS", "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS")


def environment(side_by_side: bool) -> dict[str, str]:
    """Make the environment of the tests.

    Args:
        side_by_side: Whether rooms run at once. Each then has one worker thread, unless the environment says otherwise:
            threads that wait for work of others take a quarter more processor time.

    Returns:
        That of this process, with ``CHROMIUM`` where a browser is found.
    """
    found = subprocess.run([ROOT / "tools/find-chromium.sh"], stdout=subprocess.PIPE, text=True, check=False)
    chromium = {"CHROMIUM": found.stdout.strip()} if found.returncode == 0 else {}
    threads = dict.fromkeys(THREADS, "1") if side_by_side else {}
    return threads | os.environ | chromium


def main(arguments: list[str] | None = None) -> int:
    """Run the tests and print the summary.

    Args:
        arguments: Words of the command line; the process's own when not given.

    Returns:
        Exit code: 1 when something failed, else 0.
    """
    parser = argparse.ArgumentParser(description="Run the tests room by room; the last line is the total.")
    parser.add_argument("--marks", default=MARKS, help="expression of pytest's -m; '' runs all (default: %(default)r)")
    parser.add_argument(
        "--jobs",
        type=int,
        # One more than there are processors: a room waits now and then, for a disk or a process that it started.
        default=(os.cpu_count() or 1) + 1,
        help="rooms that run at once, beside that of the web (default: one more than there are processors)",
    )
    parser.add_argument(
        "--room", action="append", help="only this, such as tests/core, types, python or web (may be repeated)"
    )
    parser.add_argument("--reports", type=Path, help="folder that keeps the logs and reports of the rooms")
    asked = parser.parse_args(arguments)
    rooms = all_rooms(asked.marks)
    wanted = {name.rstrip("/") for name in asked.room or ("python", "web")}
    if unknown := wanted - {"python"} - {room.name for room in rooms}:
        parser.error(
            f"no room {', '.join(sorted(unknown))}; choose from {', '.join(room.name for room in rooms)}, python"
        )
    if "python" in wanted:
        wanted |= {room.name for room in rooms} - {"web"}
    begin, chosen, jobs = time.monotonic(), [room for room in rooms if room.name in wanted], max(asked.jobs, 1)
    results = list(run(chosen, jobs, environment(min(len(chosen), jobs) > 1), asked.reports))
    print(summary(results, time.monotonic() - begin))
    return int(any(one.failed for one in results))


if __name__ == "__main__":
    sys.exit(main())
