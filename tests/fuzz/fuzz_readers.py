"""What opens a file of each format, as the command line and Python do; returns what was loaded."""

from __future__ import annotations

import importlib
import os
import signal
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from lightwell.limits import Limits

# What readers import when they are called.
MODULES = {
    "scene": ("lightwell.scenes.gltf", "lightwell.scenes.mitsuba_xml"),
    "frame": ("lightwell.scenes.mitsuba_xml", "lightwell.lens.frames"),
    "asset": ("lightwell.asset", "lightwell.graph"),
    "export": ("lightwell.asset.export",),
    "probes": ("lightwell.probes.file", "lightwell.probes.volume"),
    "library": ("lightwell.lens.library",),
    "cache": ("lightwell.cache",),
    "checkpoint": ("lightwell.fields", "sklearn.tree"),
    "shards": ("lightwell.transport.shards",),
}
Reader = Callable[[Path], Any]


# What is a tenth of its default, so that a small file is enough to ask for too much.
SCALED = ("file_bytes", "decoded_bytes", "texels", "picture_texels", "vertices", "indices", "nodes", "depth", "lights")
LIMITS = replace(Limits(), **{name: getattr(Limits(), name) // 10 for name in (*SCALED, "instances")})


def prepare(reader: str) -> None:
    """Import what a reader needs, so that its first file is not charged for it."""
    for name in MODULES.get(reader, ()):
        importlib.import_module(name)


def scene(path: Path) -> Any:
    """A scene: its records, without the objects of Mitsuba."""
    from lightwell.scenes import load

    found = load(path, limits=LIMITS)
    return {
        "warnings": found.warnings,
        "meshes": found.meshes,
        "materials": [_material(material) for material in found.materials],
        "lights": found.lights,
        "cameras": found.cameras,
        "bounds": found.bounds,
    }


def _material(material: Any) -> dict[str, Any]:
    """Numbers of a material; pictures are bytes."""
    return {k: v for k, v in vars(material).items() if not hasattr(v, "image")}


def asset(path: Path) -> Any:
    """A baked asset: what ``info`` says, its graphs, and what they compute."""
    from lightwell.asset import info, read_fields
    from lightwell.graph import evaluate

    facts = info(path)
    fields, variables = read_fields(path, LIMITS)
    for field in fields:
        graph = field.graph
        inputs = {name: np.full((2, width), 0.25, np.float32) for name, width in graph.inputs.items()}
        with np.errstate(all="ignore"):
            evaluate(graph, inputs)
    return [facts, variables, [field.graph.buffers for field in fields]]


def export(path: Path) -> Any:
    """The shader text of a baked asset, as the verb ``export`` prints it."""
    from lightwell.asset.export import export_field

    return str(export_field(path, "glsl"))


def probes(path: Path) -> Any:
    """A probe volume, its baselines, and its answer to a query."""
    from lightwell.probes.file import read, read_baselines
    from lightwell.probes.volume import query

    volume, baselines = read(path, LIMITS), read_baselines(path)
    place = np.tile(volume.lattice.origin + 0.5 * volume.lattice.spacing, (3, 1))
    answer = query(volume, place, np.float32([[0, 0, 1]] * 3))
    return [volume, baselines, answer]


def library(path: Path) -> Any:
    """A library of spreadlets."""
    from lightwell.lens.library import load

    found = load(path, limits=LIMITS)
    found.key()
    return [found.recipe, list(found.nodes.values())]


def frame(path: Path) -> Any:
    """A frame of the lens; a depth of infinity is a background."""
    from lightwell.lens.frames import read

    if path.suffix != ".exr":
        return scene(path)
    found = read(path)
    return {"warnings": found.notes, "rgba": found.rgba, "depth": np.where(np.isinf(found.depth), 0, found.depth)}


def cache(path: Path) -> Any:
    """A radiance cache."""
    from lightwell.cache import RadianceCache

    found = RadianceCache.load(path)
    return [found.region.box, {k: np.array(v) for k, v in found.predictor.learner.values.items()}]


def checkpoint(path: Path) -> Any:
    """A checkpoint, taken up by a fit of the field that its name says, which goes on and predicts."""
    from fuzz_learned import fit_of

    from lightwell.core.formats import ARRAYS
    from lightwell.networks.checkpoint import restore

    fit, arrays = fit_of(path.stem), ARRAYS.read(path)
    try:
        restore(fit, arrays)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    return [fit.state.best_error if fit.state.best_step else 0.0, vars(fit).get("_values", [])]


def shards(path: Path) -> Any:
    """Samples of a folder."""
    from lightwell.transport.shards import load_samples

    samples = load_samples(path)
    # Targets may be NaN: fits drop those samples and count them.
    return [samples.query, samples.weight, samples.shape]


# ------------------------------------------------------------------ readers that fail on purpose


def planted(path: Path) -> Any:
    """What the first byte of a file asks for: one of every outcome."""
    data = path.read_bytes()
    acts: dict[str, Callable[[], Any]] = {
        "A": lambda: [np.ones(3)],
        "R": lambda: _raise(ValueError(f"file '{path.name}': is refused; write it again")),
        "N": lambda: _raise(ValueError("is refused, but which file?")),
        "L": lambda: _raise(ValueError(f"file '{path.name}':\nis refused in two lines")),
        "K": lambda: _raise(KeyError("planted")),
        "S": lambda: os.kill(os.getpid(), signal.SIGSEGV),
        "E": lambda: os._exit(3),
        "H": lambda: time.sleep(3600),
        "B": _busy,
        "M": lambda: np.ones(1 << 40, np.uint8),
        "P": lambda: [np.ones(1 << 28, np.uint8)],
        "W": lambda: {"warnings": ["'a' holds numbers that are not finite"], "a": np.array([np.nan])},
        "F": lambda: {"warnings": ["the sky is ignored"], "a": np.array([1.0, np.inf])},
        "G": lambda: [1.0, {"a": (2.0, float("nan"))}],
    }
    return acts[data[:1].decode()]()


def _raise(error: Exception) -> None:
    raise error


def _busy() -> None:
    while True:
        pass
