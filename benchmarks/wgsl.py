"""The WGSL of a shading graph, as the web runtime prints it: through Node, from the runtime's own TypeScript."""

from __future__ import annotations

import base64
import json
import shutil
import subprocess
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from lightwell.graph import Graph, graph_to_json

ROOT = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class Bound:
    """A buffer that the program reads, in bind group 1."""

    binding: int
    data: np.ndarray
    """Float32, whole vec4."""


@dataclass(frozen=True)
class Program:
    """``fn field(…) -> vec3f`` and what it reads."""

    code: str
    parameters: tuple[str, ...]
    """Inputs of the graph in the order of the function's parameters."""
    weights: Bound | None
    """Read-only storage."""
    frame: Bound | None
    """Uniform: what depends on the light alone."""


def available() -> str:
    """Empty when WGSL can be printed here, else what is missing."""
    if not shutil.which("node"):
        return "Node is not installed"
    if not (ROOT / "web/node_modules/vite").exists():
        return "the web's packages are missing; run 'make web/node_modules/.installed'"
    return ""


def wgsl(graph: Graph, light: np.ndarray, weights: Literal["storage", "inline"] = "storage") -> Program:
    """The program of the graph's output ``radiance`` for a frame with the light at ``light`` [3]."""
    document, arrays = graph_to_json(replace(graph, outputs={"radiance": graph.outputs["radiance"]}))
    job = {
        "graph": document,
        "arrays": {name: array.reshape(-1).astype(float).tolist() for name, array in arrays.items()},
        "weights": weights,
        "frame": {"light": [float(c) for c in light]},
    }
    script = ["node", str(ROOT / "tools/print-wgsl.mjs")]
    done = subprocess.run(script, input=json.dumps(job), capture_output=True, text=True)
    if done.returncode:
        said = [line for line in done.stderr.splitlines() if "Error" in line] or done.stderr.splitlines()
        raise RuntimeError(f"print-wgsl: {said[0] if said else 'it said nothing'}")
    printed = json.loads(done.stdout)
    names = tuple(parameter["name"] for parameter in printed["parameters"])
    return Program(printed["code"], names, *(_bound(printed[key]) for key in ("weights", "frame")))


def _bound(entry: dict | None) -> Bound | None:
    if entry is None:
        return None
    return Bound(entry["binding"], np.frombuffer(base64.b64decode(entry["data"]), "<f4"))
