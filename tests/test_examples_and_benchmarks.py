"""Examples run as they stand; benchmarks run as a smoke test."""

import runpy
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture
def run_here(monkeypatch, capsys):
    """A function that runs a file with the words of its command line in this process, and returns what it printed."""

    def run(path: str, *words: str) -> str:
        monkeypatch.chdir(ROOT)
        monkeypatch.setattr(sys, "argv", [path, *words])
        runpy.run_path(path, run_name="__main__")
        return capsys.readouterr().out

    return run


def _run(*argv: str) -> str:
    done = subprocess.run([sys.executable, *argv], cwd=ROOT, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


def test_the_examples_run(tmp_path, run_here):
    out = str(tmp_path / "room")
    assert "error" in run_here("examples/bake_a_room.py", out)
    assert "radiance" in run_here("examples/evaluate_baked_light.py", out)


def test_the_quick_benchmark_prints_rows_and_writes_nothing(run_here):
    results = ROOT / "benchmarks/results/main_job.json"
    before = results.read_bytes() if results.exists() else None
    # tests/graph/test_evaluators.py compiles the vectors of the parity in every run.
    text = run_here("benchmarks/main_job.py", "--quick", "--only", "demo")
    assert "not part of --quick" in text and "asked" in text
    assert (results.read_bytes() if results.exists() else None) == before


@pytest.mark.slow
def test_the_quick_benchmark_times_training_and_inference_and_measures_the_parity():
    text = _run("benchmarks/main_job.py", "--quick", "--only", "inference,training,parity")
    assert "training: time of a step" in text and "in Dr.Jit over sgemm" in text
    assert "parity NumPy / Dr.Jit" in text


@pytest.mark.slow
def test_the_bytes_of_a_field_are_compared_and_nothing_is_written():
    stored, results = ROOT / "benchmarks/field_bytes.json", ROOT / "benchmarks/results/architecture.json"
    before = stored.read_bytes(), results.read_bytes()
    text = _run("benchmarks/field_bytes.py", "--only", "mlp")
    assert "fields that have the stored bytes" in text and ("differ: mlp" in text or "recorded on" in text)
    assert (stored.read_bytes(), results.read_bytes()) == before


def test_the_quick_web_benchmark_prints_rows_and_writes_nothing(run_here):
    results = ROOT / "benchmarks/results/web.json"
    before = results.read_bytes()
    text = run_here("benchmarks/web.py", "--quick")
    assert "picture of Babylon.js" in text and "first picture of the Cornell box" in text
    assert results.read_bytes() == before


@pytest.mark.slow
def test_the_quick_benchmark_of_changing_light_measures_tracing_and_key_light_maps_and_writes_nothing(tmp_path):
    results = ROOT / "benchmarks/results/changing_light.json"
    before = results.read_bytes()
    asked = ("--scenes", "none", "--quick", "--tracing", "--keys", "--keep", str(tmp_path))
    rows = _run("benchmarks/changing_light.py", *asked).splitlines()
    for what in ("tracing time, 16 groups over one at equal noise", "day: above blended key light maps"):
        assert any(row.startswith(what) and "not measured" not in row for row in rows)
    assert (tmp_path / "day/report.json").exists() and results.read_bytes() == before


@pytest.mark.slow
def test_the_quick_probe_benchmark_prints_rows_and_writes_nothing():
    results = ROOT / "benchmarks/results/light_probes.json"
    before = results.read_bytes() if results.exists() else None
    text = _run("benchmarks/light_probes.py", "--quick", "--only", "memory,s1-5")
    assert "bright leak over trilinear's" in text and "payload over DDGI's bytes" in text
    assert (results.read_bytes() if results.exists() else None) == before


@pytest.mark.slow
def test_the_quick_light_map_benchmark_prints_rows_and_writes_nothing():
    results = ROOT / "benchmarks/results/neural_lightmap.json"
    before = results.read_bytes() if results.exists() else None
    text = _run("benchmarks/neural_lightmap.py", "--quick")
    assert "leak: texels that read another chart at mip 3" in text and "subsurface surfaces: PSNR" in text
    assert (results.read_bytes() if results.exists() else None) == before


@pytest.mark.slow
def test_the_quick_radiance_cache_benchmark_prints_rows_and_writes_nothing():
    results = ROOT / "benchmarks/results/radiance_cache.json"
    before = results.read_bytes() if results.exists() else None
    text = _run("benchmarks/radiance_cache.py", "--quick", "--only", "equal,frame,lag,gpu")
    assert "equal time: geometric mean of the five scenes" in text and "GPU" in text
    given = ROOT.parent / "shared" / "scenes" / "mitsuba" / "cornell-box"
    assert "light switch" in text or not given.exists()
    assert (results.read_bytes() if results.exists() else None) == before


@pytest.mark.slow
def test_the_quick_kill_benchmark_prints_rows_and_writes_nothing():
    results = ROOT / "benchmarks/results/reliability.json"
    before = results.read_bytes() if results.exists() else None
    text = _run("benchmarks/kills.py", "--quick", "--seed", "1")
    assert "kill -9, sequence: ends with the bytes of the uninterrupted run" in text and "measured 2 of 2" in text
    assert (results.read_bytes() if results.exists() else None) == before


def test_an_unknown_part_of_a_benchmark_ends_with_one_line(run_here, capsys):
    with pytest.raises(SystemExit) as ended:
        run_here("benchmarks/radiance_cache.py", "--only", "nonsense")
    said = capsys.readouterr()
    assert ended.value.code == 2 and not said.out
    assert said.err.strip().startswith("error: --only nonsense: expected some of equal, ")
    assert len(said.err.strip().splitlines()) == 1
