"""How long a field takes on a GPU at 1920x1080: the WGSL that the browser runs, as a full-screen pass through wgpu.

A stage of gpu.py (``--only shading``). Needs ``pip install -e ".[gpu]"`` (wgpu) and a Vulkan, Metal or D3D12 driver;
Node and the web's packages, or programs that were prepared. With ``--simulate`` a software rasteriser runs the same
program, small; without, it is refused: its figures say nothing about a GPU.

Every field is timed in turns with the textured pass: reading the same G-buffer and showing its texture. Times are those
of the GPU's own clock around the pass where it has timestamp queries, else wall time between two fences.
"""

from __future__ import annotations

from statistics import median
from typing import Any

import numpy as np
from gpu_figures import Record
from gpu_programs import Candidate, candidates

from lightwell.graph import Graph, evaluate

SIZE, SIMULATED_SIZE = (1920, 1080), (320, 180)
# Timed passes, in turns: field, textured, field … A software rasteriser takes seconds for one.
TURNS, ROUNDS = 9, 15
SIMULATED_TURNS, SIMULATED_ROUNDS = 1, 3
# Pixels that are compared with NumPy, at random: NumPy is slower than a GPU.
COMPARED = 1 << 17


def adapter(software: bool) -> Any:
    """The fastest adapter that is a GPU, or a software one.

    Raises:
        RuntimeError: There is none; the message says why.
    """
    try:
        import wgpu
    except ImportError as error:
        raise RuntimeError("wgpu is not installed; pip install -e '.[gpu]'") from error
    try:
        found = None if software else wgpu.gpu.request_adapter_sync(power_preference="high-performance")
        found = found or wgpu.gpu.request_adapter_sync(force_fallback_adapter=True)
    except Exception as error:  # the libraries of a driver raise what they like
        raise RuntimeError(f"no adapter: {' '.join(str(error).split())[:120]}") from error
    if found is None:
        raise RuntimeError("no adapter; apt-get install mesa-vulkan-drivers for --simulate")
    if is_software(dict(found.info)) and not software:
        raise RuntimeError(f"no GPU on this machine: the adapter is {found.info['device']}")
    return found


def is_software(info: dict) -> bool:
    """Whether an adapter is a rasteriser on the processor."""
    return info.get("adapter_type") == "CPU" or "llvmpipe" in info.get("device", "").lower()


def parity(picture: np.ndarray, graph: Graph, inputs: dict[str, np.ndarray]) -> float:
    """Largest difference between the GPU's [H, W, 3] and NumPy, relative to max(1, |value|)."""
    found = picture.reshape(-1, 3)
    rows = np.random.default_rng(0).permutation(len(found))[:COMPARED]
    named = {name: inputs[name] for name in graph.inputs}
    chosen = {name: values if len(values) == 1 else values[rows] for name, values in named.items()}
    expected = evaluate(graph, chosen)["radiance"] * np.broadcast_to(inputs["reflectance"], found.shape)[rows]
    return float((np.abs(found[rows] - expected) / np.maximum(1, np.abs(expected))).max())


def measure(record: Record, simulate: bool) -> None:
    """Time all fields on one G-buffer of the Cornell box."""
    from gpu_pass import Gpu, make_gbuffer

    from lightwell.scenes import load

    found = adapter(simulate)
    chosen, scene = candidates(), load("cornell")
    size = SIMULATED_SIZE if simulate else SIZE
    buffer = make_gbuffer(scene, scene.cameras[0], chosen[0].light, size)
    gpu, inputs = Gpu(found, buffer), buffer.inputs
    for one in chosen:
        _time(record, one, gpu, inputs, dict(found.info), simulate)


def _time(record: Record, one: Candidate, gpu: Any, inputs: dict, info: dict, simulate: bool) -> None:
    """Time one field in turns with the textured pass, and compare it with NumPy."""
    turns, rounds = (SIMULATED_TURNS, SIMULATED_ROUNDS) if simulate else (TURNS, ROUNDS)
    stages = ("fragment", "compute")
    timed = {(stage, weights): gpu.prepare(p, stage) for weights, p in one.programs.items() for stage in stages}
    worst = max(parity(each.picture(), one.graph, inputs) for each in timed.values())
    passes = {**timed, **{(stage, "textured"): gpu.prepare(None, stage) for stage in stages}}
    samples: dict[tuple[str, str], list[float]] = {name: [] for name in passes}
    for _ in range(turns):
        for name, each in passes.items():
            samples[name].append(each.seconds(rounds))
    seconds = {name: median(values) for name, values in samples.items()}
    best = min(timed, key=lambda name: seconds[name])
    clock = "GPU timestamps" if gpu.timestamps else "wall clock"
    note = f"{info['device']} ({info['backend_type']}), {gpu.width}x{gpu.height}, {clock}, best {' '.join(best)}: "
    note += ", ".join(f"{' '.join(name)} {1e3 * value:.4g} ms" for name, value in seconds.items())
    note += f"; compiled in {timed[best].compile_seconds:.2f} s; {one.graph.macs} MAC, {one.graph.fetches} fetches"
    record(one.name, 1e3 * seconds[best], note)
    record(f"{one.name}, ratio", seconds[best] / seconds[best[0], "textured"], note)
    record(f"{one.name}, parity", worst, str(info["device"]))
