"""The shader programs that the GPU benchmark runs: printed by Node from the web runtime, or read from a folder.

A machine without Node or the web's packages reads what ``python benchmarks/gpu.py --prepare FOLDER`` has printed on
another one; tools/gpu_bundle.py packs that folder.
"""

from __future__ import annotations

import base64
import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from wgsl import Bound, Program, available, wgsl

from lightwell.graph import Graph, graph_from_json, graph_to_json

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "out/gpu-programs"
# Weights as literals of the shader text are tried up to this many multiply-adds; longer texts compile for minutes.
MOST_LITERALS = 10_000
# Planned seconds of the light map: its cost does not depend on how well it is trained.
LIGHTMAP_BUDGET = "8s"


@dataclass(frozen=True)
class Candidate:
    """A field to time."""

    name: str
    """As in gpu_figures.py."""
    graph: Graph
    light: np.ndarray
    """[3] of the frame."""
    programs: dict[str, Program]
    """By where the weights are: 'storage', and 'inline' for small networks."""


def candidates() -> list[Candidate]:
    """The fields that have bars; printed here where Node is, else those that were prepared."""
    if not available():
        return _made()
    path = FOLDER / "fields.json"
    if not path.exists():
        raise RuntimeError(f"{available()}, and {path} was not prepared (python benchmarks/gpu.py --prepare)")
    return [_read(entry) for entry in json.loads(path.read_text())]


def lens_plan(job: dict[str, Any], size: int, software: bool) -> dict[str, Any]:
    """The plan of the lens for a job of tools/print-lens.mjs; printed where Node is, else the prepared one."""
    if available():
        path = FOLDER / _lens_name(size, software)
        if not path.exists():
            raise RuntimeError(f"{available()}, and {path} was not prepared (python benchmarks/gpu.py --prepare)")
        return json.loads(path.read_text())
    script = ["node", str(ROOT / "tools/print-lens.mjs")]
    done = subprocess.run(script, input=json.dumps(job), capture_output=True, text=True)
    if done.returncode:
        said = [line for line in done.stderr.splitlines() if "Error" in line] or ["it said nothing"]
        raise RuntimeError(f"print-lens: {said[0]}")
    return json.loads(done.stdout)


def prepare(folder: Path) -> None:
    """Print all programs to a folder."""
    from gpu_lens import SIMULATED_SIZE, SIZE, frame, job_of

    if why := available():
        raise SystemExit(f"error: gpu: {why}")
    folder.mkdir(parents=True, exist_ok=True)
    for size, software in ((SIZE, False), (SIMULATED_SIZE, True)):
        plan = lens_plan(job_of(size, frame(size)[2], software), size, software)
        (folder / _lens_name(size, software)).write_text(json.dumps(plan))
    (folder / "fields.json").write_text(json.dumps([_written(one) for one in _made()]))


def _lens_name(size: int, software: bool) -> str:
    return f"lens-{size}{'-software' if software else ''}.json"


# ------------------------------------------------------------------ fields


def _made() -> list[Candidate]:
    from radiance_fields import ours

    from lightwell.scenes import load
    from lightwell.scenes.placing import initial_light
    from lightwell.scenes.variables import declare

    scene = load("cornell")
    light = np.asarray(initial_light(scene, declare((), scene), scene.cameras[0]), np.float32)
    graphs = {
        "mlp:report-20": untrained("mlp", "report-20"),
        "default field": untrained(*ours()),
        "light map": light_map(),
    }
    return [_candidate(name, graph, light) for name, graph in graphs.items()]


def _candidate(name: str, graph: Graph, light: np.ndarray) -> Candidate:
    kinds = ("inline", "storage") if graph.macs <= MOST_LITERALS else ("storage",)
    return Candidate(name, graph, light, {kind: wgsl(graph, light, kind) for kind in kinds})


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


def light_map() -> Graph:
    """The graph of the default light map of the Cornell box, hardly trained."""
    from lightwell.asset.read import read_fields

    with tempfile.TemporaryDirectory() as folder:
        words = ["bake", "cornell", "--field", "lightmap", "--budget", LIGHTMAP_BUDGET, "--views", "1", "-o", folder]
        command = [sys.executable, "-m", "lightwell.cli", *words, "--force"]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            raise RuntimeError(f"light map: {done.stderr.strip().splitlines()[-1]}")
        return read_fields(Path(folder) / "scene.glb")[0][0].graph


# ------------------------------------------------------------------ files


def _written(one: Candidate) -> dict[str, Any]:
    document, arrays = graph_to_json(one.graph)
    return {
        "name": one.name,
        "light": one.light.tolist(),
        "graph": document,
        "arrays": {name: _packed(array) for name, array in arrays.items()},
        "programs": {
            kind: {
                "code": program.code,
                "parameters": program.parameters,
                "weights": _bound_json(program.weights),
                "frame": _bound_json(program.frame),
            }
            for kind, program in one.programs.items()
        },
    }


def _read(entry: dict[str, Any]) -> Candidate:
    arrays = {name: _unpacked(array) for name, array in entry["arrays"].items()}
    programs = {
        kind: Program(p["code"], tuple(p["parameters"]), *(_bound(p[key]) for key in ("weights", "frame")))
        for kind, p in entry["programs"].items()
    }
    graph = graph_from_json(entry["graph"], arrays)
    return Candidate(entry["name"], graph, np.float32(entry["light"]), programs)


def _packed(array: np.ndarray) -> dict[str, Any]:
    data = base64.b64encode(np.ascontiguousarray(array)).decode()
    return {"type": str(array.dtype), "shape": array.shape, "data": data}


def _unpacked(entry: dict[str, Any]) -> np.ndarray:
    return np.frombuffer(base64.b64decode(entry["data"]), entry["type"]).reshape(entry["shape"])


def _bound_json(bound: Bound | None) -> dict[str, Any] | None:
    return None if bound is None else {"binding": bound.binding, "array": _packed(bound.data)}


def _bound(entry: dict[str, Any] | None) -> Bound | None:
    return None if entry is None else Bound(entry["binding"], _unpacked(entry["array"]))
