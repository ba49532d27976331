"""The figures of the main job, measured side by side on this machine.

    python benchmarks/main_job.py            every figure; writes results/main_job.json (about 20 minutes on 2 cores)
    python benchmarks/main_job.py --quick    a smoke run of a few seconds; writes nothing
    python benchmarks/main_job.py --only transport,training

The demo is timed in a fresh clone with an empty environment; the packages are installed before the clock starts.
The browser parity comes from `make test`, which writes web/test-results/parity.json.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from rows import Row, at_least, at_most, chosen, publish, without_bar

ROOT = Path(__file__).resolve().parents[1]
SCENES = ROOT.parent / "shared" / "scenes" / "mitsuba"
# Scenes whose path rate is asked for; given scenes that users do not have are skipped.
TRANSPORT = {"Cornell box": SCENES / "cornell-box/scene.xml", "veach-ajar": SCENES / "veach-ajar/scene_mi3.xml"}


def transport(quick: bool) -> list[Row]:
    """Our paths per second over Mitsuba's own path integrator."""
    from transport_rate import measure

    from lightwell.scenes import load

    rows = []
    for name, path in TRANSPORT.items():
        what = f"transport: paths/s of ours over Mitsuba's path, {name}"
        if not path.exists():
            rows.append(at_least(what, 0.8, None, "ratio", "the scene is not on this machine"))
            continue
        figures = measure(load(str(path)), rounds=1 if quick else 7)
        note = f"{figures['ours'] / 1e6:.2f} against {figures['mitsuba'] / 1e6:.2f} M paths/s, depth 16, medians"
        rows.append(at_least(what, 0.8, figures["ratio"], "ratio", f"{note}; the same estimator, without light rays"))
        gain = f"transport: variance of plain paths over that of bakes, in the same time, {name}"
        rows.append(without_bar(gain, figures["gain"], "ratio", "light rays joined to every vertex"))
    return rows


def training(quick: bool) -> list[Row]:
    """Our training step over the faster of NumPy/BLAS and JAX."""
    from training_rate import measure

    figures = measure(rounds=1 if quick else 9)
    note = ", ".join(f"{k} {v:.2f} ms" for k, v in figures["milliseconds"].items()) + " per step of 4,096 samples"
    if "jax" not in figures["milliseconds"]:
        note += "; JAX is not installed here"
    return [at_most("training: time of a step over the faster of NumPy and JAX", 1.3, figures["ratio"], "ratio", note)]


def inference(quick: bool) -> list[Row]:
    """The 64-wide network in Dr.Jit over this machine's matrix product."""
    from inference_rate import measure

    figures = measure(1 << 16 if quick else 1 << 20)
    ratio = figures["ratio"]
    note = ", ".join(f"{k} {v:.4g}" for k, v in figures.items() if isinstance(v, (int, float)) and k != "ratio")
    return [at_least("inference: 64-64-64-64-3 in Dr.Jit over sgemm", 0.7, ratio, "ratio", note)]


def demo(quick: bool) -> list[Row]:
    """Seconds of `make demo` in a fresh clone, installation excluded."""
    what = "make demo after the installation, to the open page, report included"
    if quick:
        return [at_most(what, 180, None, "s", "not part of --quick")]
    with tempfile.TemporaryDirectory() as folder:
        clone, wheels = Path(folder) / "lightwell", Path(folder) / "wheels"
        subprocess.run(["git", "clone", "-q", str(ROOT), str(clone)], check=True)
        pip = [sys.executable, "-m", "pip", "-q", "--disable-pip-version-check"]
        subprocess.run([*pip, "download", "-d", str(wheels), str(clone), "setuptools>=77"], check=True)
        environment = os.environ | {"PIP_NO_INDEX": "1", "PIP_FIND_LINKS": str(wheels)}
        subprocess.run(["make", "setup"], cwd=clone, env=environment, check=True, stdout=subprocess.DEVNULL)
        start = time.perf_counter()
        subprocess.run(["make", "demo"], cwd=clone, env=environment, check=True, stdout=subprocess.DEVNULL)
        seconds = time.perf_counter() - start
        report = json.loads((clone / "demo/report.json").read_text())
    note = f"error {report['relative_error']:.1%} (noise of the truth {report['noise_floor']:.1%}), courtyard"
    return [at_most(what, 180, seconds, "s", note)]


def parity(quick: bool) -> list[Row]:
    """Largest disagreement of the evaluators on the test vectors."""
    rows = [at_most("parity NumPy / Dr.Jit on the test vectors", 1e-4, _drjit_parity(), "abs error")]
    path = ROOT / "web/test-results/parity.json"
    if not path.exists():
        note = "run 'make test' first: Chromium measures it"
        return [*rows, at_most("parity NumPy / WebGL2, WebGPU", 1e-4, None, "abs error", note)]
    for entry in _modes(json.loads(path.read_text())):
        rows.append(at_most(f"parity NumPy / {entry[0]} in Chromium", 1e-4, entry[1], "abs error"))
    return rows


def _drjit_parity() -> float:
    import numpy as np

    from lightwell.backend import mi
    from lightwell.graph import compile, evaluate

    sys.path.insert(0, str(ROOT / "tools"))
    from format_vectors import cases

    worst = 0.0
    for graph, inputs in cases().values():
        expected = evaluate(graph, inputs)
        columns = {k: [mi.Float(np.ascontiguousarray(c, np.float32)) for c in v.T] for k, v in inputs.items()}
        for name, channels in compile(graph)(columns).items():
            found = np.stack([np.broadcast_to(np.array(c), len(expected[name])) for c in channels], axis=1)
            error = np.abs(found - expected[name]) / np.maximum(1, np.abs(expected[name]))
            worst = max(worst, float(error.max()))
    return worst


def _modes(results: dict) -> list[tuple[str, float]]:
    """(mode, largest error) of the browser's parity test."""
    modes = results.get("modes", results)
    return [(name, float(entry["max"] if isinstance(entry, dict) else entry)) for name, entry in modes.items()]


PARTS = {"transport": transport, "training": training, "inference": inference, "parity": parity, "demo": demo}


def main() -> None:
    """Measure the chosen parts and publish their rows."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a smoke run; writes nothing")
    parser.add_argument("--only", help=f"comma-separated parts of: {', '.join(PARTS)}")
    arguments = parser.parse_args()
    for name in chosen("--only", arguments.only, PARTS):
        publish("main_job", PARTS[name](arguments.quick), arguments.quick)


if __name__ == "__main__":
    main()
