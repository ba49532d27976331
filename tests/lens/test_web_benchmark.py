"""The benchmarks of the lens in the browser and through wgpu run as smoke tests and write nothing."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "benchmarks/results/lens.json"


def _run(*argv: str) -> str:
    before = RESULTS.read_bytes() if RESULTS.exists() else None
    done = subprocess.run([sys.executable, *argv], cwd=ROOT, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr[-2000:]
    assert (RESULTS.read_bytes() if RESULTS.exists() else None) == before
    return done.stdout


@pytest.mark.slow
def test_ours_is_closer_to_the_lens_than_every_other_page():
    text = _run("benchmarks/lens_web.py", "--quick", "--only", "flip")
    assert text.count("web: FLIP of ours over") == 4 and "FLIP of ours over three.js' BokehPass" in text
    assert not [line for line in text.splitlines() if "FLIP of ours" in line and "DOES NOT HOLD" in line]


# In Chromium web/test/lens.test.ts holds the same program against Python in every run.
@pytest.mark.slow
def test_the_browsers_program_runs_through_wgpu_and_agrees_with_python(tmp_path):
    import wgpu

    if wgpu.gpu.request_adapter_sync() is None:
        pytest.skip("no adapter")
    out = str(tmp_path)
    _run("benchmarks/gpu.py", "--simulate", "--patience", "6", "--only", "lens", "--out", out)
    rows = {row["what"]: row for row in json.loads((tmp_path / "gpu.json").read_text())}
    assert rows["GPU: the browser's lens, PSNR against Python"]["holds"] is True
