"""Fuzzing guided by coverage: atheris keeps the mutants that reach new lines of the readers and changes them further.

python fuzz_coverage.py FORMAT SEED [options of libFuzzer]
"""

from __future__ import annotations

import random
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent


def guided(name: str, seconds: float, seed: int) -> int:
    """Fuzz a format in a process of its own; returns 1 where a file failed.

    Raises:
        SystemExit: atheris is not installed.
    """
    try:
        import atheris  # noqa: F401
    except ImportError:
        raise SystemExit("fuzz: --coverage needs the package atheris; run: pip install atheris") from None
    from fuzz_formats import FORMATS

    with tempfile.TemporaryDirectory() as corpus:
        for number, case in enumerate(FORMATS[name].seeds):
            (Path(corpus) / f"seed{number}").write_bytes(number.to_bytes(1, "little") + case.data)
        limits = [f"-max_total_time={seconds:.0f}", "-timeout=10", "-rss_limit_mb=3072", "-max_len=1000000"]
        program = [sys.executable, str(HERE / "fuzz_coverage.py"), name, str(seed), corpus, f"-seed={seed}", *limits]
        done = subprocess.run(program, cwd=corpus, capture_output=True, text=True, errors="replace")
        # A run that ends in time may still abort when Dr.Jit's threads are taken down.
        failed = "DONE" not in done.stderr or "Uncaught Python exception" in done.stderr
        lines = [line for line in done.stderr.splitlines() if failed or " DONE " in line]
        print(f"{name}: " + "\n".join(lines[-40:]))
        return int(failed)


def main(name: str, seed: int, options: list[str]) -> None:
    """The process: instrument lightwell, then hand every input to the reader of a format."""
    import atheris
    from fuzz_run import GOOD, write_case
    from fuzz_worker import judge

    with atheris.instrument_imports(include=["lightwell"]), tempfile.TemporaryDirectory() as folder:
        import fuzz_readers
        from fuzz_formats import FORMATS

        format_ = FORMATS[name]
        reader = getattr(fuzz_readers, format_.reader)
        # Readers import what they need when they are called.
        for number, case in enumerate(format_.seeds):
            reader(write_case(case, Path(folder) / str(number)))

    def mutate(data: bytes, most: int, number: int) -> bytes:
        rng = random.Random(number)
        case = format_.seeds[data[0] % len(format_.seeds)] if data else format_.seeds[0]
        try:
            return data[:1] + format_.mutate(rng, case.changed(data[1:]))[: most - 1]
        except Exception:  # what was changed before is no container any more
            return atheris.Mutate(data, most)

    def one(data: bytes) -> None:
        if len(data) < 2:
            return
        case = format_.seeds[data[0] % len(format_.seeds)].changed(data[1:])
        with tempfile.TemporaryDirectory() as folder:
            found = judge(reader, write_case(case, Path(folder)))
        if found["outcome"] not in GOOD:
            raise RuntimeError(f"{found['outcome']}: {found['detail']}")

    atheris.Setup([sys.argv[0], *options], one, custom_mutator=mutate)
    atheris.Fuzz()


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), sys.argv[3:])
