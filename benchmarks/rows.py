"""Rows of figures: what was asked, what was measured, whether it holds, and on which machine."""

from __future__ import annotations

import json
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

from lightwell.doctor import machine, version_of

RESULTS = Path(__file__).parent / "results"
VERDICTS = {True: "yes", False: "**no**", None: "–"}


@dataclass(frozen=True)
class Row:
    """One figure of a list of what is asked."""

    what: str
    asked: str
    """In words, with the sign of the comparison: '>= 0.8'."""
    measured: float | None
    """None: could not be measured here; ``note`` says why."""
    unit: str
    holds: bool | None
    machine: str
    note: str = ""


def at_least(what: str, bar: float, measured: float | None, unit: str, note: str = "") -> Row:
    """A row that holds when the figure reaches ``bar``."""
    holds = None if measured is None else bool(measured >= bar)
    return Row(what, f">= {bar:g}", _rounded(measured), unit, holds, _machine(), note)


def at_most(what: str, bar: float, measured: float | None, unit: str, note: str = "") -> Row:
    """A row that holds when the figure stays below ``bar``."""
    holds = None if measured is None else bool(measured <= bar)
    return Row(what, f"<= {bar:g}", _rounded(measured), unit, holds, _machine(), note)


def _rounded(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.4g}")


def _machine() -> str:
    parts = [
        machine(),
        _processor(),
        f"Python {platform.python_version()}",
        f"Mitsuba {version_of('mitsuba')}",
        *_gpu(),
    ]
    return ", ".join(parts)


def _gpu() -> list[str]:
    """The NVIDIA GPU of this machine, if it has one."""
    if shutil.which("nvidia-smi"):
        query = ["nvidia-smi", "--query-gpu=name", "--format=csv,noheader"]
        return subprocess.run(query, capture_output=True, text=True, timeout=10).stdout.splitlines()[:1]
    return []


def _processor() -> str:
    try:
        text = Path("/proc/cpuinfo").read_text()
        return next(line.split(":")[1].strip() for line in text.splitlines() if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or "unknown processor"


def without_bar(what: str, measured: float | None, unit: str, note: str = "") -> Row:
    """A row that nothing is asked of."""
    return Row(what, "–", _rounded(measured), unit, None, _machine(), note)


def of_gpu(what: str, figure: str) -> Row:
    """The row of a figure that benchmarks/gpu.py has measured on a GPU, under the name ``what``."""
    found = {row["what"]: row for row in json.loads((RESULTS / "gpu.json").read_text())}[figure]
    return Row(**found | {"what": what, "note": f"by benchmarks/gpu.py: {found['note']}"})


def chosen(option: str, given: str | None, known: Iterable[str]) -> list[str]:
    """The comma-separated words of an option, all of them where none was given; ends with code 2 at an unknown one."""
    names = list(known)
    words = [word.strip() for word in given.split(",") if word.strip()] if given else names
    for word in words:
        if word not in names:
            print(f"error: {option} {word}: expected some of {', '.join(names)}", file=sys.stderr)
            raise SystemExit(2)
    return words


def publish(topic: str, rows: list[Row], quick: bool = False, folder: Path = RESULTS) -> None:
    """Print the rows; write ``FOLDER/TOPIC.json`` unless it is only a smoke run. Rows not measured now are kept."""
    for row in rows:
        verdict = {True: "holds", False: "DOES NOT HOLD", None: "no bar"}[row.holds]
        verdict = "not measured" if row.measured is None else verdict
        measured = "–" if row.measured is None else f"{row.measured:g} {row.unit}"
        print(f"{row.what:<72} asked {row.asked:<10} measured {measured:<22} {verdict}  {row.note}")
    if quick:
        return
    path = folder / f"{topic}.json"
    old = {row["what"]: row for row in json.loads(path.read_text())} if path.exists() else {}
    for row in rows:
        if row.measured is not None or row.what not in old:
            old[row.what] = asdict(row)
    folder.mkdir(exist_ok=True)
    temporary = path.with_suffix(".part")
    temporary.write_text(json.dumps(list(old.values()), indent=1) + "\n")
    os.replace(temporary, path)


def markdown(topic: str) -> str:
    """The rows of a topic as a Markdown table, for the README."""
    lines = ["| figure | asked | measured | holds |", "|---|---|---|---|"]
    for row in json.loads((RESULTS / f"{topic}.json").read_text()):
        measured = "–" if row["measured"] is None else f"{row['measured']:g} {row['unit']}"
        asked = row["asked"].replace(">=", "≥").replace("<=", "≤")
        lines.append(f"| {row['what']} | {asked} | {measured} | {VERDICTS[row['holds']]} |")
    return "\n".join(lines)


if __name__ == "__main__":
    print(markdown(sys.argv[1] if len(sys.argv) > 1 else "main_job"))
