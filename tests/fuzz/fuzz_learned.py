"""Small sound files of what lightwell itself writes: assets, probes, libraries, caches, checkpoints, shards."""

from __future__ import annotations

import contextlib
import functools
import io
import json
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))

from fuzz_seeds import Case, _import, _written, png, single

VARIABLE = {
    "name": "light",
    "kind": "point",
    "low": [-0.5, 0.2, -0.5],
    "high": [0.5, 0.8, 0.5],
    "clearance": 0.1,
    "radius": 0,
    "initial": [0, 0.5, 0],
    "intensity": 20.0,
    "color": [1, 1, 1],
}
# What the fits of checkpoints are: the field and its preset.
FITS = {
    "mlp": "small",
    "factored": "small",
    "tree": "default",
    "kdtree": "default",
    "experts": "report",
    "hard-mixture": "default",
    "balanced": "default",
}
# Fits whose checkpoint holds arrays only once they have begun.
GROWN = ("tree", "kdtree")
CACHE = {"levels": 2, "entries_log2": 8, "batch": 512, "steps": 1, "hidden": 16}


# ------------------------------------------------------------------ assets


def _scene():
    from lightwell.scenes.scene import Camera, Image, Light, Material, Mesh, Scene, Texture

    wood = Image("wood", png(), "image/png")
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]], np.float32)
    uv = np.float32([[0, 0], [1, 0], [1, 1], [0, 1]])
    floor = Mesh("floor", corners, np.array([[0, 2, 1], [0, 3, 2]], np.uint32), 0, uv0=uv, uv1=uv)
    lights = [Light("point", "bulb", (0.0, 1.0, 0.0))]
    return Scene(
        "room",
        [floor],
        [Material("wood", base_color_texture=Texture(wood))],
        None,
        lights,
        [Camera((0, 1, 3), (0, 0, 0))],
    )


def _graph():
    """A small network with buffers of every type."""
    from lightwell.graph import Builder, pack

    rng = np.random.default_rng(1)
    b = Builder(position=3, light=3)
    h = b.frequency(b.concat("position", "light"), octaves=1)
    for kind, width in (("int8", 12), ("float16", 5), ("uint8", 5)):
        h = b.linear(h, pack(rng.normal(size=(5, width)), kind), pack(rng.normal(size=5), "float32"))
        h = b.activate(h, "silu")
    return b.build(radiance=b.linear(h, rng.normal(size=(3, 5)), rng.normal(size=3)))


def assets() -> list[Case]:
    """Baked assets: a network, graphs of the test vectors, a light map in pictures."""
    from format_vectors import cases

    from lightwell.asset import FieldEntry, write_glb

    graphs = [_graph(), cases()["network_factored"][0]]
    found = []
    for graph in graphs:
        entries = [FieldEntry("indirect", "indirect", graph, 0)]
        found.append(
            single(
                "room.glb", _written(lambda path, e=entries: write_glb(path, _scene(), e, [dict(VARIABLE)]), "room.glb")
            )
        )
    return [*found, _lightmap()]


def _lightmap() -> Case:
    """The example of format/LIGHTMAP.md."""
    import importlib.util

    path = Path(__file__).parents[2] / "tools" / "lightmap_example.py"
    spec = importlib.util.spec_from_file_location("lightmap_example", path)
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    with contextlib.redirect_stdout(io.StringIO()):
        return single("room.glb", _written(module.main, "room.glb"))


# ------------------------------------------------------------------ probes and spreadlets


def probes() -> list[Case]:
    """Probe volumes in both codings, with bricks, and with distance moments."""
    from lightwell.probes.file import encode_volume
    from lightwell.probes.lattice import ProbeLattice

    made = _import("probes", "test_lattice_and_query")
    small = made.made_up(lattice=ProbeLattice(np.array([-1.0, 0.3, 2.0]), 0.7, (2, 2, 3)))
    volumes = [(small, "l2", None), (made.bricked(), "zh3", None), (small, "zh3", _moments(small))]
    return [single("room.lwp", encode_volume(volume, coding, 1.0, moments)[0]) for volume, coding, moments in volumes]


def _moments(volume):
    from lightwell.probes import ddgi

    rng, count = np.random.default_rng(3), len(volume.lattice)
    mean = rng.random((count, ddgi.SIDE, ddgi.SIDE)) * 0.7
    maps = np.stack([mean, mean**2 + 0.05], axis=-1).astype(np.float32)
    return ddgi.Moments(
        volume.lattice, np.zeros((count, 3), np.float32), rng.random(count) > 0.2, maps, volume.light, 0.0
    )


def libraries() -> list[Case]:
    """Libraries of spreadlets: small offsets, and one node of large ones."""
    from lightwell.lens import families
    from lightwell.lens.library import Library
    from lightwell.lens.recipes import Recipe, lossless

    near, far = families.depth(4.0, noise=0.5), families.depth(140.0, noise=0.5)
    small = Library(near, Recipe(), {(i, 0): lossless(near.kernel(i)) for i in range(min(near.size, 6))})
    large = Library(far, Recipe(), {(far.size - 1, 0): lossless(far.kernel(far.size - 1))})
    return [single("kernels.lwsp", library.tobytes()) for library in (small, large)]


# ------------------------------------------------------------------ arrays


def caches() -> list[Case]:
    """Radiance caches that have not learned anything yet."""
    from lightwell.cache import RadianceCache, settings_of

    box = np.array([[-1.0, -1, -1], [1, 1, 1]])
    found = []
    for settings in (CACHE, {**CACHE, "encoding": "frequency"}):
        cache = RadianceCache(settings_of(settings), box)
        found.append(single("cache.npz", _written(lambda path, c=cache: c.save(path), "cache.npz")))
    return found


@functools.cache
def fit_of(name: str):
    """A fit of a field that has samples and has not been trained."""
    from lightwell.fields.registry import find_field

    made_up = _import("fields", "made_up")
    fit = find_field(name).start(made_up.SETUP, FITS[name], 0)
    fit.learn_from(made_up.make_samples(600, 1))
    fit.validate_on(made_up.make_samples(64, 2))
    return fit


def checkpoints() -> list[Case]:
    """Checkpoints of fits; the name of the file says of which field."""
    from lightwell.core.formats import ARRAYS

    found = []
    for name in FITS:
        fit = fit_of(name)
        if name in GROWN:
            fit.train(1, 4)
        data = _written(lambda path, f=fit: ARRAYS.write(path, f.arrays()), "fit.npz")
        found.append(single(f"{name}.npz", data))
    return found


def shards() -> list[Case]:
    """Folders of two shards of samples; each case changes another of its files."""
    from lightwell.core.formats import COLUMNS
    from lightwell.core.store import Store
    from lightwell.transport.shards import VERSION, ShardSettings, shard_key

    samples = _import("fields", "made_up").make_samples(64, 5)
    settings = ShardSettings(lights=4, points_per_light=8)
    manifest = {
        "version": VERSION,
        "scene": "room",
        "digest": "0" * 64,
        "settings_hash": "1" * 64,
        "settings": asdict(settings),
        "variable": {},
    }
    files = {"manifest.json": json.dumps(manifest).encode()}
    with tempfile.TemporaryDirectory() as folder:
        for index in range(2):
            part = slice(32 * index, 32 * index + 32)
            columns = {name: getattr(samples.query, name) for name in type(samples.query).__dataclass_fields__}
            columns |= {name: getattr(samples, name) for name in ("half_a", "half_b", "weight", "shape")}
            columns = {name: values[part] for name, values in columns.items() if values is not None}
            columns["counts"] = np.frombuffer(b'{"paths": {}, "rejection": {}}', np.uint8)
            Store(folder).put(shard_key(manifest, index), columns, COLUMNS)
        files |= {p.relative_to(folder).as_posix(): p.read_bytes() for p in Path(folder).rglob("*") if p.is_file()}
    columns = ("position.npy", "half_a.npy", "weight.npy", "shape.npy", "columns.json")
    second = f"samples.shard/{shard_key(manifest, 1).digest}.columns"
    changed = ["manifest.json", *(f"{second}/{name}" for name in columns)]
    return [Case(files, ".", name) for name in changed]
