"""Opens damaged files of every format and counts how that ends.

    python benchmarks/fuzz.py --mutants 1500            # so many of each format; writes results/reliability.json
    python benchmarks/fuzz.py --minutes 60              # as many as that takes, of a random seed, which is printed
    python benchmarks/fuzz.py --formats ply --seed 7 --first 123 --mutants 1 --keep bad    # one mutant again
    python benchmarks/fuzz.py --formats lwp --minutes 5 --coverage    # guided by coverage

Formats of Python (``tests/fuzz``) are opened as ``lightwell info``, ``lightwell lens`` and calls of Python do, each in
a process of its own with limited memory. Formats with the prefix ``web-`` go through the readers and both printers of
the web runtime in Node (``web/fuzz``). ``atheris`` (pip install atheris) has wheels for CPython 3.11 to 3.13 on Linux.
"""

from __future__ import annotations

import argparse
import functools
import json
import random
import shutil
import subprocess
import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from rows import Row, at_least, at_most, chosen, publish

ROOT = Path(__file__).resolve().parents[1]
sys.path.append(str(ROOT / "tests" / "fuzz"))

from fuzz_formats import FORMATS  # noqa: E402
from fuzz_run import GOOD, Outcome, Tally, run  # noqa: E402

WEB = ("web-glb", "web-lwp", "web-lwsp")
# What the web's fuzzer calls its outcomes, in the words of ``fuzz_run``.
WEB_KINDS = {
    "accepted": "accepted",
    "refused": "refused",
    "crashes": "crash",
    "hangs": "hang",
    "too_much_memory": "memory",
    "silent_nan": "silent",
    "uncaught": "traceback",
}
# What is asked: mutants altogether and of each format.
ALL, EACH = 20_000, 1500
# Outcomes that must not happen, as the rows call them.
ASKED = {
    "crashes": ("crash",),
    "hangs over 10 s": ("hang",),
    "files that take over 2 GiB": ("memory",),
    "tracebacks, or messages that are not one line with the file's name": ("traceback", "message"),
    "silent NaN or infinity": ("silent",),
}


def web(name: str, mutants: int, seconds: float, seed: int, first: int) -> Tally:
    """Mutants of a format through the readers and printers of the web runtime."""
    node = shutil.which("node")
    tally = Tally(name)
    if node is None or not (ROOT / "web" / "node_modules").exists():
        print(f"{name}: needs Node and web/node_modules; run: make test-web", file=sys.stderr)
        return tally
    program = [
        node,
        str(ROOT / "web" / "fuzz" / "run.mjs"),
        "--formats",
        name.removeprefix("web-"),
        "--seed",
        str(seed),
    ]
    kinds = len(_web_kinds())
    program += ["--mutants", str(-(-mutants // kinds)), "--first", str(first // kinds), "--seconds", f"{seconds:.0f}"]
    found = json.loads(subprocess.run(program, cwd=ROOT / "web", capture_output=True, text=True, check=True).stdout)
    tally.counts = Counter({kind: found[key] for key, kind in WEB_KINDS.items() if found[key]})
    for failure in found["failures"]:
        fault, _, what = failure["what"].partition(": ")
        tally.failures.append((failure["number"], Outcome(WEB_KINDS[fault], f"{failure['kind']}: {what}")))
    return tally


def _web_kinds() -> list[str]:
    """Names of the kinds of damage of the web's fuzzer, whose mutants are counted for each kind."""
    text = (ROOT / "web" / "fuzz" / "mutators.ts").read_text()
    body = text[text.index("export const MUTATORS") :]
    return [
        line.split(":")[0].strip() for line in body[: body.index("\n}")].splitlines()[1:] if ":" in line or "," in line
    ]


def fuzz(names: list[str], arguments: argparse.Namespace) -> list[Tally]:
    """All formats, some at a time; prints a line as each ends."""
    share = 60 * arguments.minutes * arguments.jobs / len(names) if arguments.minutes else 1e9
    with ProcessPoolExecutor(arguments.jobs) as pool:
        return list(pool.map(functools.partial(one, share, arguments), names))


def one(seconds: float, arguments: argparse.Namespace, name: str) -> Tally:
    """One format for at most so many seconds; prints a line, and the first failures."""
    begin = time.monotonic()
    last = arguments.first + (arguments.mutants if not arguments.minutes else 1 << 40)
    if name in WEB:
        tally = web(name, min(last - arguments.first, 10**7), seconds, arguments.seed, arguments.first)
    else:
        late = lambda: time.monotonic() - begin > seconds  # noqa: E731
        tally = run(FORMATS[name], range(arguments.first, last), arguments.seed, keep=arguments.keep, enough=late)
    print(line(tally, time.monotonic() - begin), flush=True)
    if tally.failures:
        print(tally.told(10), flush=True)
    return tally


def line(tally: Tally, seconds: float) -> str:
    """Counts of a format in words."""
    counts = ", ".join(f"{kind} {tally.counts[kind]}" for kind in (*GOOD, *sorted(set(tally.counts) - set(GOOD))))
    slowest = f"slowest {tally.most_seconds:.1f} s, largest {tally.most_bytes >> 20} MiB" if tally.most_seconds else ""
    return f"{tally.format:<11} {tally.total:>7} mutants in {seconds:>5.0f} s: {counts}; {slowest}"


def rows(tallies: list[Tally], seed: int) -> list[Row]:
    """What is asked of all formats together."""
    counts = sum((tally.counts for tally in tallies), Counter())
    fewest = min(tallies, key=lambda tally: tally.total)
    note = f"{len(tallies)} formats, seed {seed}"
    found = [
        at_least("fuzz: mutants over all formats, Python and TypeScript", ALL, counts.total(), "files", note),
        at_least("fuzz: mutants of the format with fewest", EACH, fewest.total, "files", fewest.format),
    ]
    for what, kinds in ASKED.items():
        where = ", ".join(sorted({t.format for t in tallies if any(t.counts[kind] for kind in kinds)}))
        found.append(at_most(f"fuzz: {what}", 0, sum(counts[kind] for kind in kinds), "files", where))
    return found


def coverage(names: list[str], arguments: argparse.Namespace) -> int:
    """Fuzz guided by the lines that a file reaches, one format after the other; ends at the first failure of each."""
    from fuzz_coverage import guided

    seconds = 60 * (arguments.minutes or 1) / len(names)
    return max(guided(name, seconds, arguments.seed) for name in names if name not in WEB)


def main(argv: list[str] | None = None) -> int:
    """Run; exit code 1 where a file did what none may."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, help="time for all formats together, in place of --mutants")
    parser.add_argument("--mutants", type=int, default=EACH, help="mutants of each format (default: %(default)s)")
    parser.add_argument("--first", type=int, default=0, help="number of the first mutant")
    parser.add_argument("--seed", type=int, help="what mutants are drawn from (default: random, printed)")
    parser.add_argument("--formats", help=f"some of {', '.join([*FORMATS, *WEB])} (default: all)")
    parser.add_argument("--jobs", type=int, default=2, help="formats at a time (default: %(default)s)")
    parser.add_argument("--keep", type=Path, help="a folder that gets the files that failed")
    parser.add_argument("--coverage", action="store_true", help="guided by coverage, with atheris")
    parser.add_argument("--quick", action="store_true", help="write no rows")
    arguments = parser.parse_args(argv)
    if arguments.seed is None:
        arguments.seed = random.SystemRandom().randrange(1 << 31)
    print(f"seed {arguments.seed}")
    names = chosen("--formats", arguments.formats, [*FORMATS, *WEB])
    if arguments.coverage:
        return coverage(names, arguments)
    tallies = fuzz(names, arguments)
    publish("reliability", rows(tallies, arguments.seed), arguments.quick or arguments.formats is not None)
    return int(any(tally.failures for tally in tallies))


if __name__ == "__main__":
    sys.exit(main())
