"""The benchmarks of the lens in the browser and through wgpu run as smoke tests and write nothing."""

import json
import shutil
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
    if "packages are missing" in text or "Node is not installed" in text:
        pytest.skip("the web's packages are missing")
    rows = [line for line in text.splitlines() if "FLIP of ours" in line]
    assert not [line for line in rows if "DOES NOT HOLD" in line]
    assert any(" holds " in line for line in rows), text


@pytest.mark.slow
def test_a_page_that_hangs_does_not_hold_up_the_others(tmp_path):
    if not shutil.which("node") or not (ROOT / "web/node_modules").exists():
        pytest.skip("the web's packages are missing")
    (tmp_path / "color.f32").write_bytes(bytes(8 * 8 * 16))
    (tmp_path / "depth.f32").write_bytes(bytes(8 * 8 * 4))
    frame = {"width": 8, "height": 8, "near": 0.1, "far": 10, "fovY": 40, "focus": 1, "libraries": []}
    frame |= {name: str(tmp_path / f"{name}.f32") for name in ("color", "depth")}
    out = str(tmp_path / "out.f32")
    for_ever = {"name": "bokeh", "setting": {}, "rounds": 10**9, "out": out}
    draws = [for_ever, {"name": "bokeh2", "setting": {}, "rounds": 1, "out": out}, for_ever]
    (tmp_path / "job.json").write_text(json.dumps({"frame": frame, "draws": draws, "limit": 20}))
    command = ["node", str(ROOT / "tools/lens-peers.mjs"), str(tmp_path / "job.json")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=200, check=True)
    first, other, again = json.loads(done.stdout)["draws"]
    assert first == again == {"error": "bokeh did not finish in this browser within 20 s"}
    assert len(other["milliseconds"]) == 1


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
