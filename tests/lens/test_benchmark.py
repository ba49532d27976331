"""The benchmark runs as a smoke test and writes nothing."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.slow
def test_the_quick_benchmark_prints_rows_and_writes_nothing():
    results = ROOT / "benchmarks/results/lens.json"
    before = results.read_bytes() if results.exists() else None
    argv = [sys.executable, "benchmarks/lens.py", "--quick", "--only", "energy,spill,hd,gpu"]
    done = subprocess.run(argv, cwd=ROOT, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr[-2000:]
    assert "foreground spill" in done.stdout and "DOES NOT HOLD" not in done.stdout
    assert (results.read_bytes() if results.exists() else None) == before
