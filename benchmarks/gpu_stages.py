"""The stages of gpu.py: each measures its figures (gpu_figures.py) and records them one by one."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from gpu_figures import Record

ROOT = Path(__file__).resolve().parents[1]
# Pixels of a frame, and those of a simulated one.
FRAME, SIMULATED_FRAME = (1920, 1080), (96, 54)
WARM_FRAMES, TIMED_FRAMES = 24, 20
# Wall seconds that the two bakes may plan with; together with start and report they fit the stage.
BEST_BUDGET, SIMULATED_BUDGET = "60s", "4s"
# Tests are stopped before the stage is, so that their summary is kept.
TEST_SECONDS = 185
# Processes of the tests, where pytest-xdist is installed.
TEST_PROCESSES = "4"

Measure = Callable[[Record, bool], None]


def device(record: Record, simulate: bool) -> None:
    """Load the variant, run a kernel, and trace rays."""
    start = time.perf_counter()
    from lightwell.backend import ACTIVE, dr, mi

    total = float(dr.sum(dr.square(dr.arange(mi.Float, 10)))[0])
    cuda = ACTIVE.variant == "cuda_ad_rgb" and abs(total - 285) < 1e-3
    record("cuda", cuda, f"{ACTIVE.variant}, Dr.Jit {dr.__version__}, {_gpu_name()}")
    try:
        scene, sensor = _cornell(64, 64)
        picture = np.array(mi.render(scene, sensor=sensor, integrator=_path_tracer(), spp=4, seed=1))
    except RuntimeError as error:
        record("optix", 0, str(error)[:200])
        return
    record("optix", bool(np.isfinite(picture).all() and picture.mean() > 0) and cuda, f"mean {picture.mean():.4g}")
    record("first", time.perf_counter() - start, "imports, scene, kernels and picture")


def tests(record: Record, simulate: bool) -> None:
    """Run ``pytest -m gpu``: closed forms, oracles and z-tests on the variant of this process."""
    files = [str(path) for path in gpu_test_files()]
    command = [sys.executable, "-m", "pytest", "-m", "gpu", "-o", "addopts=", "-p", "no:cacheprovider", *files]
    command += ["-k", "lit_plane or variant"] if simulate else []
    # The compiler takes most of the time, so that processes side by side help; it makes no benchmark.
    command += ["-n", TEST_PROCESSES, "-p", "no:benchmark"] if find_spec("xdist") and not simulate else []
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        text, _ = process.communicate(timeout=TEST_SECONDS)
    except subprocess.TimeoutExpired:
        process.kill()
        text, _ = process.communicate()
        record("failed", None, f"stopped after {TEST_SECONDS} s")
        return
    print(text)
    counts = {word: int(number) for number, word in re.findall(r"(\d+) (failed|passed|error)", text)}
    names = " ".join(re.findall(r"^(?:FAILED|ERROR) (\S+)", text, re.MULTILINE))
    record("failed", counts.get("failed", 0) + counts.get("error", 0), names[:500])
    record("passed", counts.get("passed", 0), text.strip().splitlines()[-1])


def gpu_test_files() -> list[Path]:
    """Files with tests that are marked gpu; others may need packages that a GPU machine lacks."""
    marked = (p for p in (ROOT / "tests").rglob("test_*.py") if "pytest.mark.gpu" in p.read_text())
    return sorted(marked)


def transport(record: Record, simulate: bool) -> None:
    """Path rates of ours and of Mitsuba's ``path``; ours on the processor in a process beside."""
    found = _transport_rate(1 if simulate else 5)
    record("paths", found["ours"] / 1e6, f"depth 16, one point light per sample; {_gpu_name()}")
    record("mitsuba", found["ratio"], f"Mitsuba's path {found['mitsuba'] / 1e6:.4g} M paths/s")
    if simulate:
        record("processor", 1, "simulated")
        return
    program = "import json, gpu_stages; print(json.dumps(gpu_stages._transport_rate(1)))"
    path = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    env = {**os.environ, "LIGHTWELL_VARIANT": "llvm_ad_rgb", "PYTHONPATH": path}
    done = subprocess.run([sys.executable, "-c", program], env=env, capture_output=True, text=True)
    if done.returncode:
        record("processor", None, f"no LLVM on this machine ({done.stderr.strip().splitlines()[-1][:120]})")
        return
    processor = json.loads(done.stdout.splitlines()[-1])["ours"]
    record("processor", found["ours"] / processor, f"{processor / 1e6:.4g} M paths/s on {os.cpu_count()} cores")


def _transport_rate(rounds: int) -> dict[str, Any]:
    """Rates of the Cornell box."""
    from transport_rate import measure

    from lightwell.scenes import load

    return measure(load("cornell"), rounds)


def training(record: Record, simulate: bool) -> None:
    """Training steps beside the same network in NumPy on the processor."""
    from training_rate import measure

    found = measure(rounds=1 if simulate else 5)["milliseconds"]
    record("step", found["lightwell"], _gpu_name())
    record("numpy", found["numpy"] / found["lightwell"], f"NumPy {found['numpy']:.3g} ms on {os.cpu_count()} cores")


def bake(record: Record, simulate: bool) -> None:
    """The demo and a bake at the best quality, each as a user starts it."""
    out = ROOT / ("out/gpu-simulated/bakes" if simulate else "out/gpu/bakes")
    short = ["--budget", SIMULATED_BUDGET] if simulate else []
    scene = ["cornell"] if simulate else []
    seconds, error = _bake(["demo", *scene, "--no-open", *short], out / "demo")
    record("demo", seconds, "packages installed before the clock starts")
    record("demo-error", error, "relative error of the indirect light")
    quality = ["--quality", "best", "--budget", SIMULATED_BUDGET if simulate else BEST_BUDGET]
    seconds, error = _bake(["bake", "cornell", *quality], out / "best")
    record("best", seconds, f"--budget {quality[-1]}")
    record("best-error", error, "relative error of the indirect light")


def _bake(words: list[str], out: Path) -> tuple[float, float]:
    """(wall seconds, relative error) of a command of lightwell that writes a report."""
    start = time.perf_counter()
    command = [sys.executable, "-m", "lightwell.cli", *words, "-o", str(out), "--force"]
    done = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    if done.returncode:
        raise RuntimeError(f"{words[0]}: {done.stderr.strip().splitlines()[-1]}")
    seconds = time.perf_counter() - start
    return seconds, float(json.loads((out / "report.json").read_text())["relative_error"])


def cache(record: Record, simulate: bool) -> None:
    """Milliseconds of a frame with the radiance cache, and of what the cache adds: training and a query per pixel."""
    from lightwell.backend import mi
    from lightwell.cache import NrcIntegrator, settings_of

    width, height = SIMULATED_FRAME if simulate else FRAME
    scene, sensor = _cornell(width, height)
    nrc = NrcIntegrator(settings=settings_of({"mode": "frames"}))
    render = lambda integrator, seed: mi.render(scene, sensor=sensor, integrator=integrator, spp=1, seed=seed)  # noqa: E731
    frames, trained, plain = [], [], []
    for seed in range(4 if simulate else WARM_FRAMES + TIMED_FRAMES):
        frames.append(_milliseconds(lambda seed=seed: render(nrc, seed)))
        trained.append(1e3 * nrc.last.seconds["train"])
        plain.append(_milliseconds(lambda seed=seed: render(_path_tracer(), seed)))
    warm = slice(2 if simulate else WARM_FRAMES, None)
    query = _query_milliseconds(nrc.cache, width * height)
    train = median(trained[warm])
    note = f"Cornell box {width}x{height}, {_gpu_name()}"
    record("frame", median(frames[warm]), note)
    record("path", median(plain[warm]), note)
    # An upper bound: the training includes its own paths, the query is one of every pixel.
    record("overhead", train + query, f"{note}: training with its paths {train:.4g} ms, queries {query:.4g} ms")


def _query_milliseconds(cache: Any, count: int) -> float:
    """Median time of ``count`` queries of a cache at random vertices."""
    from lightwell.backend import dr, mi
    from lightwell.cache.features import Vertex

    draw = mi.PCG32(count).next_float32
    p = mi.Point3f(draw(), draw(), draw())
    n = dr.normalize(mi.Vector3f(draw(), draw(), draw()) - 0.5)
    v = Vertex(p, n, dr.normalize(mi.Vector3f(draw(), draw(), draw()) - 0.5), draw(), mi.Color3f(draw()), None)
    dr.eval(v)
    packed = cache.predictor.packed("ema")
    return median(_milliseconds(lambda: cache.predictor.radiance(packed, v)) for _ in range(TIMED_FRAMES))


def live(record: Record, simulate: bool) -> None:
    """Pictures per second of the live page, end to end over HTTP."""
    from radiance_cache_live import rates

    size, seconds = (32, 1.0) if simulate else (512, 6.0)
    found = rates("cornell", size, seconds, 2 if simulate else WARM_FRAMES)
    for name in ("rest", "orbit"):
        stages = ", ".join(f"{k} {v:.3g} ms" for k, v in found[name].items() if k != "fps")
        record(name, found[name]["fps"], stages)


def probes(record: Record, simulate: bool) -> None:
    """Nanoseconds of a probe query, methods in turns."""
    sys.path.insert(0, str(ROOT / "tools"))
    from probe_time import measure

    found = measure(1 << 14 if simulate else 1 << 22, 1 if simulate else 9)
    record("mlp", found["mlp"] / found["ddgi"], ", ".join(f"{k} {v:.3g} ns" for k, v in found.items()))


def shading(record: Record, simulate: bool) -> None:
    """Full-screen passes of fields through wgpu."""
    from gpu_shading import measure

    measure(record, simulate)


def lens(record: Record, simulate: bool) -> None:
    """The browser's lens through wgpu."""
    from gpu_lens import measure

    measure(record, simulate)


MEASURES: dict[str, Measure] = {
    "device": device, "tests": tests, "transport": transport, "training": training, "bake": bake, "cache": cache,
    "live": live, "probes": probes, "shading": shading, "lens": lens,
}  # fmt: skip


def _cornell(width: int, height: int) -> tuple[Any, Any]:
    """The Cornell box with a point light as a Mitsuba scene, and a sensor."""
    from lightwell.backend import mi
    from lightwell.cache.live_scene import LiveScene
    from lightwell.scenes import load

    found = LiveScene(load("cornell"), 16)
    sensor = mi.load_dict(
        {
            "type": "perspective",
            "fov": found.camera.fov,
            "fov_axis": "y",
            "to_world": found.camera.pose(),
            "sampler": {"type": "independent", "sample_count": 1},
            "film": {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"}},
        }
    )
    return found.scene, sensor


def _path_tracer() -> Any:
    """Mitsuba's own, unlimited depth."""
    from lightwell.backend import mi

    return mi.load_dict({"type": "path", "max_depth": -1})


def _milliseconds(work: Callable[[], object]) -> float:
    """Wall milliseconds of a piece of work, the device's included."""
    from lightwell.backend import dr

    dr.sync_thread()
    start = time.perf_counter()
    result = work()
    dr.eval(result)
    dr.sync_thread()
    return 1e3 * (time.perf_counter() - start)


def _gpu_name() -> str:
    """What nvidia-smi calls the GPU, or the variant."""
    try:
        query = ["nvidia-smi", "--query-gpu=name,driver_version", "--format=csv,noheader"]
        return subprocess.run(query, capture_output=True, text=True, timeout=10).stdout.splitlines()[0]
    except (OSError, IndexError, subprocess.TimeoutExpired):
        from lightwell.backend import ACTIVE

        return f"no NVIDIA GPU, {ACTIVE.variant}"
