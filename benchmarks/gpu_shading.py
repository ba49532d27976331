"""How long a field takes on a GPU at 1920x1080: the WGSL that the browser runs, as a full-screen pass through wgpu.

    python benchmarks/gpu_shading.py                        report-20 and the default field, on the Cornell box
    python benchmarks/gpu_shading.py out/factored out/mlp   bakes (or folders of a comparison) instead
    python benchmarks/gpu_shading.py --quick                a smoke run on 320x180 pixels; writes nothing

Needs `pip install -e ".[gpu]"` (wgpu), Node and the web's packages (`make web/node_modules/.installed`), and a Vulkan,
Metal or D3D12 driver. Without a GPU `apt-get install mesa-vulkan-drivers` brings lavapipe, a software rasteriser:
the program, its agreement with NumPy and the ratio to a plain textured pass are measured there as well, but
milliseconds of a processor say nothing about a GPU, so that their rows stay unmeasured.

Every field is timed in turns with the textured pass: reading the same G-buffer and showing its texture. Times are those
of the GPU's own clock around the pass where it has timestamp queries, else wall time between two fences.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from rows import Row, at_most, publish, without_bar
from wgsl import available, wgsl

from lightwell.graph import Graph, evaluate

SIZE, QUICK_SIZE = (1920, 1080), (320, 180)
# Timed passes, in turns: field, textured, field … A software rasteriser takes seconds for one.
TURNS, ROUNDS = 9, 15
SOFTWARE_TURNS, SOFTWARE_ROUNDS = 2, 3
# Milliseconds asked on a GPU of the H200's class: of one 20-10 network, and of the default field.
SMALL_BAR, DEFAULT_BAR = 0.2, 0.5
PARITY_BAR = 1e-4
# Weights as literals of the shader text are tried up to this many multiply-adds; longer texts compile for minutes.
MOST_LITERALS = 10_000
# Pixels that are compared with NumPy, at random: NumPy is slower than a GPU.
COMPARED = 1 << 17


@dataclass(frozen=True)
class Candidate:
    """A graph to time."""

    name: str
    graph: Graph
    bar: float | None
    """Milliseconds asked, None: only reported."""


def adapter():
    """The fastest adapter, or None and why there is none."""
    try:
        import wgpu
    except ImportError:
        return None, "wgpu is not installed; pip install -e '.[gpu]'"
    try:
        found = wgpu.gpu.request_adapter_sync(power_preference="high-performance")
        found = found or wgpu.gpu.request_adapter_sync(force_fallback_adapter=True)
    except Exception as error:  # the libraries of a driver raise what they like
        return None, f"no adapter: {' '.join(str(error).split())[:120]}"
    return found, "" if found else "no adapter; apt-get install mesa-vulkan-drivers"


def is_software(info: dict) -> bool:
    """Whether an adapter is a rasteriser on the processor."""
    return info.get("adapter_type") == "CPU" or "llvmpipe" in info.get("device", "").lower()


def untrained(field: str, preset: str) -> Graph:
    """The graph of a field that has seen a few samples of the Cornell box: its cost is that of a trained one."""
    from lightwell.fields.base import FieldSetup, radiance_unit
    from lightwell.fields.registry import find_field
    from lightwell.fields.surface.tracing import validation_samples
    from lightwell.scenes import load
    from lightwell.scenes.variables import declare

    scene = load("cornell")
    samples = validation_samples(scene, declare((), scene), 0)
    fit = find_field(field).start(FieldSetup.of(scene, radiance_unit(samples), "point"), preset, 0)
    fit.learn_from(samples)
    fit.validate_on(samples)
    fit.train(20, 20)
    return fit.lower()


def candidates(folders: list[str]) -> list[Candidate]:
    """What to time: bakes that are named, else the bars' two fields."""
    if folders:
        from lightwell.asset.read import read_fields

        graphs = [(Path(f).name, read_fields(Path(f) / "scene.glb")[0][0].graph) for f in folders]
        return [Candidate(name, graph, _bar(name)) for name, graph in graphs]
    from radiance_fields import ours

    field, preset = ours()
    return [
        Candidate("mlp:report-20", untrained("mlp", "report-20"), SMALL_BAR),
        Candidate(f"{field}:{preset} (default field)", untrained(field, preset), DEFAULT_BAR),
    ]


def _bar(name: str) -> float | None:
    return SMALL_BAR if name == "mlp-report-20" else None


def parity(picture: np.ndarray, graph: Graph, inputs: dict[str, np.ndarray]) -> float:
    """Largest difference between the GPU's [H, W, 3] and NumPy, relative to max(1, |value|)."""
    found = picture.reshape(-1, 3)
    rows = np.random.default_rng(0).permutation(len(found))[:COMPARED]
    chosen = {name: values if len(values) == 1 else values[rows] for name, values in inputs.items()}
    expected = evaluate(graph, chosen)["radiance"] * chosen["reflectance"]
    return float((np.abs(found[rows] - expected) / np.maximum(1, np.abs(expected))).max())


def measure(size: tuple[int, int], chosen: list[Candidate], gpu_adapter, turns: int, rounds: int) -> list[Row]:
    """Rows of all candidates on one G-buffer of the Cornell box."""
    from gpu_pass import Gpu, make_gbuffer

    from lightwell.scenes import load
    from lightwell.scenes.placing import initial_light
    from lightwell.scenes.variables import declare

    scene = load("cornell")
    camera = scene.cameras[0]
    light = initial_light(scene, declare((), scene), camera)
    buffer = make_gbuffer(scene, camera, light, size)
    gpu, info = Gpu(gpu_adapter, buffer), dict(gpu_adapter.info)
    textured, inputs, rows = gpu.prepare(None), buffer.inputs, []
    pixels = f"{size[0]}x{size[1]}"
    clock = "GPU timestamps" if gpu.timestamps else "wall clock"
    for one in chosen:
        kinds = ("inline", "storage") if one.graph.macs <= MOST_LITERALS else ("storage",)
        timed = {weights: gpu.prepare(wgsl(one.graph, light, weights)) for weights in kinds}
        worst = max(parity(each.picture(), one.graph, inputs) for each in timed.values())
        samples = {name: [] for name in (*timed, "textured")}
        for _ in range(turns):
            for name, each in (*timed.items(), ("textured", textured)):
                samples[name].append(each.seconds(rounds))
        seconds = {name: median(values) for name, values in samples.items()}
        best = min(timed, key=lambda name: seconds[name])
        note = (
            f"{info['device']} ({info['backend_type']}), {clock}, weights {best}: "
            + ", ".join(f"{name} {1e3 * value:.4g} ms" for name, value in seconds.items())
            + f"; compiled in {timed[best].compile_seconds:.2f} s; {one.graph.macs} MAC, {one.graph.fetches} fetches"
        )
        rows += _rows(one, pixels, 1e3 * seconds[best], seconds[best] / seconds["textured"], worst, info, note)
    return rows


def _rows(one: Candidate, pixels: str, ms: float, ratio: float, worst: float, info: dict, note: str) -> list[Row]:
    """Milliseconds (a bar only where a GPU ran them), the ratio, and the agreement with NumPy."""
    software = is_software(info)
    what = f"GPU shading: {one.name} at {pixels}"
    note = f"no GPU on this machine; {note}" if software else note
    measured, kind = (None, "software rasteriser") if software else (ms, info["device"])
    time = at_most(what, one.bar, measured, "ms", note) if one.bar else without_bar(what, measured, "ms", note)
    over = without_bar(f"{what}, over a textured pass, {kind}", ratio, "ratio", note)
    agree = at_most(f"{what}, GPU against NumPy, {kind}", PARITY_BAR, worst, "of max(1, value)", info["device"])
    return [time, over, agree]


def main() -> None:
    """Time the candidates and publish their rows."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="*", help="baked folders; without: report-20 and the default field")
    parser.add_argument("--quick", action="store_true", help="a smoke run; writes nothing")
    arguments = parser.parse_args()
    found, why = adapter()
    why = why or available()
    if why:
        print(f"gpu_shading: skipped, {why}")
        return
    size, turns, rounds = (QUICK_SIZE, 1, 3) if arguments.quick else (SIZE, TURNS, ROUNDS)
    if is_software(dict(found.info)) and not arguments.quick:
        turns, rounds = SOFTWARE_TURNS, SOFTWARE_ROUNDS
    publish("gpu_shading", measure(size, candidates(arguments.folders), found, turns, rounds), arguments.quick)


if __name__ == "__main__":
    main()
