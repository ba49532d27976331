"""Everything that is asked of a GPU, by one command: stages that end by themselves and write their results at once.

    python benchmarks/gpu.py                     every stage that has not finished, at most 22 minutes; results/gpu.json
    python benchmarks/gpu.py --minutes 8         as many stages as surely fit; the next call goes on
    python benchmarks/gpu.py --only shading,lens some stages, also those that have finished
    python benchmarks/gpu.py --simulate          the same program, small, on the CPU variant and a software adapter;
                                                 writes out/gpu-simulated and nothing else
    python benchmarks/gpu.py --simulate --patience 4   on a busy processor: limits are four times as long
    python benchmarks/gpu.py --prepare FOLDER    print the shader programs, for a machine without Node or network

Every stage is a process of its own with a limit in seconds (gpu_figures.py); at the limit it is stopped and what it has
measured is kept. What a machine cannot measure stays null, with the reason as its note. A machine without network gets
what it needs by tools/gpu_bundle.py.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from gpu_figures import FINISHED, STAGES, Record, Stage, recorded
from rows import RESULTS, chosen, publish

ROOT = Path(__file__).resolve().parents[1]
OUT, SIMULATED = ROOT / "out/gpu", ROOT / "out/gpu-simulated"
PROGRAMS = ROOT / "out/gpu-programs"
# Stages that need no CUDA: any GPU with a Vulkan, Metal or D3D12 driver.
WITHOUT_CUDA = ("shading", "lens")
# Seconds beyond a stage's own limit until its process is gone.
GRACE = 5.0
NO_TIME = "no time left in this call; call again to go on"


def environment(stage: str, simulate: bool) -> dict[str, str]:
    """Variables of a stage's process: the variant that is measured."""
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
    if simulate:
        env["LIGHTWELL_VARIANT"] = "llvm_ad_rgb"
    elif stage not in WITHOUT_CUDA:
        env["LIGHTWELL_VARIANT"] = "cuda_ad_rgb"
    return env


def run_limited(command: list[str], seconds: float, env: dict[str, str], log: Path) -> str:
    """Run a command for at most ``seconds`` and end it with all its children; why it failed, or an empty string."""
    with log.open("w") as out:
        process = subprocess.Popen(command, stdout=out, stderr=subprocess.STDOUT, env=env, start_new_session=True)
        try:
            code = process.wait(seconds)
        except subprocess.TimeoutExpired:
            return f"stopped at its limit of {seconds:.0f} s"
        finally:
            _end(process)
    if code == 0:
        return ""
    lines = [line for line in log.read_text(errors="replace").splitlines() if line.strip()]
    return f"failed: {' '.join(lines[-1].split())[:200]}" if lines else f"failed with code {code}"


def _end(process: subprocess.Popen) -> None:
    """End the process group, so that no child of a stage keeps the GPU."""
    try:
        os.killpg(process.pid, signal.SIGKILL)
    except ProcessLookupError:
        pass
    process.wait(GRACE)


def run_stage(stage: Stage, out: Path, simulate: bool, limit: float) -> str:
    """Run one stage in a process of its own; why it did not finish, or an empty string."""
    command = [sys.executable, str(Path(__file__)), "--stage", stage.name, "--out", str(out)]
    command += ["--simulate"] if simulate else []
    # The figures of an earlier try are none of this one.
    (out / f"{stage.name}.jsonl").unlink(missing_ok=True)
    start = time.perf_counter()
    why = run_limited(command, limit, environment(stage.name, simulate), out / f"{stage.name}.log")
    seconds = time.perf_counter() - start
    print(f"# {stage.name}: {seconds:.0f} s of {limit:.0f} s{', ' + why if why else ''}", flush=True)
    return why


def run_all(names: list[str], out: Path, simulate: bool, minutes: float, again: bool, patience: float = 1) -> None:
    """Run stages one after the other and publish the rows of each as soon as it has ended."""
    folder, without_cuda = out if simulate else RESULTS, ""
    until = time.monotonic() + 60 * minutes * patience
    for stage in STAGES:
        file = out / f"{stage.name}.jsonl"
        if stage.name not in names:
            continue
        if FINISHED in recorded(file) and not again:
            print(f"# {stage.name}: finished before", flush=True)
            continue
        limit = stage.seconds * patience
        if until - time.monotonic() < limit:
            why = NO_TIME
        elif without_cuda and stage.name not in WITHOUT_CUDA:
            why = without_cuda
        else:
            why = run_stage(stage, out, simulate, limit)
        if stage.name == "device" and recorded(file).get("cuda", {}).get("measured") != 1 and not simulate:
            without_cuda = why = f"no CUDA device on this machine ({why or recorded(file)['cuda']['note']})"
        publish("gpu", stage.rows(recorded(file), why or "the stage did not measure it"), folder=folder)


def run_here(name: str, out: Path, simulate: bool) -> None:
    """Measure a stage in this process."""
    import gpu_stages

    record = Record(out / f"{name}.jsonl")
    gpu_stages.MEASURES[name](record, simulate)
    record.finish()


def main() -> None:
    """Run the stages that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", metavar="STAGE,…", help=f"some of {', '.join(s.name for s in STAGES)}")
    parser.add_argument("--minutes", type=float, default=22.0, help="time of this call (default: %(default)g)")
    parser.add_argument("--simulate", action="store_true", help="on the CPU variant and a software adapter, small")
    parser.add_argument("--patience", type=float, default=1.0, help="factor of the limits of a simulation")
    parser.add_argument("--again", action="store_true", help="also stages that have finished")
    parser.add_argument("--out", type=Path, help=f"folder of intermediate results (default: {OUT.relative_to(ROOT)})")
    parser.add_argument("--prepare", type=Path, metavar="FOLDER", help="print the shader programs to a folder and end")
    parser.add_argument("--stage", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    out = (arguments.out or (SIMULATED if arguments.simulate else OUT)).resolve()
    out.mkdir(parents=True, exist_ok=True)
    if arguments.prepare:
        from gpu_programs import prepare

        prepare(arguments.prepare)
    elif arguments.stage:
        run_here(arguments.stage, out, arguments.simulate)
    else:
        names = chosen("--only", arguments.only, (s.name for s in STAGES))
        again, patience = arguments.again or bool(arguments.only), arguments.patience if arguments.simulate else 1
        run_all(names, out, arguments.simulate, arguments.minutes, again, patience)


if __name__ == "__main__":
    main()
