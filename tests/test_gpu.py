"""The GPU benchmark and its bundle, without a GPU: stages end by themselves, what is not measured stays null."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import time
from pathlib import Path

import gpu
import gpu_bundle
import gpu_figures
import gpu_stages
import pytest

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "benchmarks/results/gpu.json"


@pytest.mark.gpu
def test_the_variant_is_the_one_that_was_asked_for():
    from lightwell.backend import ACTIVE, dr, mi

    assert os.environ.get("LIGHTWELL_VARIANT", ACTIVE.variant) == ACTIVE.variant
    assert float(dr.sum(dr.square(dr.arange(mi.Float, 10)))[0]) == 285


def test_the_stages_end_within_eight_minutes_each_and_twenty_two_together():
    assert max(stage.seconds for stage in gpu_figures.STAGES) <= 480
    assert sum(stage.seconds for stage in gpu_figures.STAGES) <= 22 * 60
    assert {stage.name for stage in gpu_figures.STAGES} == set(gpu_stages.MEASURES)


def test_every_row_is_in_the_results_and_null_until_a_gpu_has_measured_it():
    rows = {row["what"]: row for row in json.loads(RESULTS.read_text())}
    asked = [figure for stage in gpu_figures.STAGES for figure in stage.figures]
    assert [f.what for f in asked if f.what not in rows] == []
    processors = [what for what, row in rows.items() if row["measured"] is not None and "llvm" in row["note"]]
    assert processors == []


def test_a_stage_that_does_not_end_is_stopped_with_its_children_and_keeps_what_it_measured(tmp_path):
    record, child = tmp_path / "stage.jsonl", tmp_path / "child"
    program = (
        "import subprocess, sys, time, pathlib; sys.path.insert(0, 'benchmarks'); import gpu_figures;"
        f"gpu_figures.Record(pathlib.Path({str(record)!r}))('a', 2.5, 'one');"
        f"p = subprocess.Popen(['sleep', '600']); pathlib.Path({str(child)!r}).write_text(str(p.pid)); time.sleep(600)"
    )
    start = time.monotonic()
    limit = 20
    why = gpu.run_limited([sys.executable, "-c", program], limit, {**os.environ}, tmp_path / "log")
    assert why == "stopped at its limit of 20 s" and time.monotonic() - start < limit + gpu.GRACE + 5
    assert gpu_figures.recorded(record) == {"a": {"measured": 2.5, "note": "one"}}
    # On a busy machine a killed process is still there for a moment.
    until = time.monotonic() + 60
    while _runs(child.read_text()) and time.monotonic() < until:
        time.sleep(0.1)
    assert not _runs(child.read_text())


def _runs(process: str) -> bool:
    """Whether a process runs; one that has ended may wait for its parent to read its status."""
    try:
        return Path(f"/proc/{process}/stat").read_text().split()[2] != "Z"
    except OSError:
        return False


def test_a_stage_that_fails_says_why_in_its_rows(tmp_path):
    log = tmp_path / "log"
    why = gpu.run_limited([sys.executable, "-c", "raise RuntimeError('no driver')"], 60, {**os.environ}, log)
    assert why == "failed: RuntimeError: no driver"
    rows = gpu_figures.STAGES[0].rows({"cuda": {"measured": 1.0, "note": "H100"}}, why)
    assert [row.measured for row in rows] == [1.0, None, None] and rows[1].note == why and rows[1].holds is None


def test_a_line_that_was_cut_off_is_no_figure(tmp_path):
    path = tmp_path / "stage.jsonl"
    gpu_figures.Record(path)("a", 1, "")
    with path.open("a") as file:
        file.write('{"key": "b", "meas')
    assert list(gpu_figures.recorded(path)) == ["a"]


def test_a_call_without_time_runs_nothing_and_finished_stages_are_not_run_again(tmp_path, capsys):
    gpu.run_all(["training", "lens"], tmp_path, simulate=True, minutes=0, again=False)
    rows = {row["what"]: row for row in json.loads((tmp_path / "gpu.json").read_text())}
    assert len(rows) == 4 and all(r["measured"] is None and r["note"] == gpu.NO_TIME for r in rows.values())
    gpu_figures.Record(tmp_path / "lens.jsonl").finish()
    capsys.readouterr()
    gpu.run_all(["lens"], tmp_path, simulate=True, minutes=22, again=False)
    assert capsys.readouterr().out == "# lens: finished before\n"


def test_the_simulation_measures_a_stage_and_writes_nowhere_else(tmp_path):
    before = RESULTS.read_bytes()
    words = ["benchmarks/gpu.py", "--simulate", "--patience", "6", "--only", "device", "--out", str(tmp_path)]
    done = subprocess.run([sys.executable, *words], cwd=ROOT, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr[-2000:]
    assert RESULTS.read_bytes() == before
    rows = [row for row in json.loads((tmp_path / "gpu.json").read_text()) if row["measured"] is not None]
    # OptiX counts on CUDA alone.
    assert len(rows) == 3 and [row["holds"] for row in rows] == [False, False, None]


@pytest.mark.slow
def test_the_whole_simulation_measures_every_row(tmp_path):
    words = ["benchmarks/gpu.py", "--simulate", "--patience", "10", "--out", str(tmp_path)]
    done = subprocess.run([sys.executable, *words], cwd=ROOT, capture_output=True, text=True, timeout=7200)
    assert done.returncode == 0, done.stderr[-2000:]
    rows = json.loads((tmp_path / "gpu.json").read_text())
    assert [row["what"] for row in rows if row["measured"] is None] == []


def test_marked_tests_are_found():
    names = {path.relative_to(ROOT / "tests").as_posix() for path in gpu_stages.gpu_test_files()}
    assert {"transport/test_closed_form.py", "transport/test_against_mitsuba.py", "cache/test_transport.py"} <= names


@pytest.mark.parametrize(
    ("name", "kept"),
    [
        ("mitsuba/cuda_ad_rgb.cpython-312-x86_64-linux-gnu.so", True),
        ("mitsuba/cuda_ad_spectral.cpython-312-x86_64-linux-gnu.so", False),
        ("mitsuba/llvm_ad_rgb.cpython-312-x86_64-linux-gnu.so", False),
        ("mitsuba/plugins/path.so", True),
        ("mitsuba/plugins/volpathmis.so", False),
        ("mitsuba/plugins/sunsky.so", True),
        ("mitsuba/data/sunsky/sunsky_datasets.bin", True),
        ("mitsuba/libmitsuba.so", True),
        ("numpy/_core/tests/test_umath.py", False),
        ("numpy/testing/__init__.py", True),
        ("drjit/__init__.pyi", False),
        ("numpy-2.3.0.dist-info/METADATA", True),
    ],
)
def test_the_bundle_keeps_what_runs(name, kept):
    assert gpu_bundle.is_kept(name) is kept


def test_the_bundle_has_every_dependency():
    """Imports that a bundle lacks were first met on a GPU machine."""
    from importlib.metadata import requires

    names = {re.split(r"[\s;<>=!~\[(]", need)[0].lower() for need in requires("lightwell") if "extra ==" not in need}
    packed = {name.lower() for name in (*gpu_bundle.PACKAGES, *gpu_bundle.OMITTED)}
    assert "mitsuba" in names and names <= packed


def test_headers_that_are_read_at_run_time_stay_in_the_bundle():
    assert gpu_bundle.is_kept("wgpu/resources/combined_header.h") and not gpu_bundle.is_kept(
        "drjit/include/drjit/jit.h"
    )


def test_every_plug_in_that_is_named_stays_in_the_bundle():
    named = set()
    for path in [*(ROOT / "lightwell").rglob("*.py"), *gpu_stages.gpu_test_files(), ROOT / "tests/transport/rooms.py"]:
        named |= set(re.findall(r'"type": "([a-z_0-9]+)"', path.read_text()))
    assert "hdrfilm" in named
    assert [name for name in sorted(named - {"volpath"}) if not gpu_bundle.is_kept(f"mitsuba/plugins/{name}.so")] == []
