"""Frozen training samples on disk: light-major shards that resume after a kill and end with the same bytes.

A folder holds ``manifest.json`` (what was asked for) and a store of shards (``core.store``). The name of a shard is a
hash of the manifest and its number: one that was made for something else is never read. In a shard,
``points_per_light`` consecutive rows share a light, so that a network of the light runs once per light.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from lightwell.core import formats
from lightwell.core.keys import Key, key
from lightwell.core.store import Store
from lightwell.files import write_atomically
from lightwell.scenes.scene import Scene
from lightwell.scenes.scene_cache import Derived
from lightwell.scenes.variables import Variable
from lightwell.transport.air import Rejection
from lightwell.transport.collect import collect
from lightwell.transport.queries import frames
from lightwell.transport.radiance import MAX_DEPTH, RR_DEPTH, PathReport
from lightwell.transport.samples import Query, Samples, SurfacePoints
from lightwell.transport.surface import SurfaceDraw, draw_surface

# Layout of the folder; readers refuse others.
VERSION = 2
# Finding points that see air costs as much as tracing their light, so that this many shards draw their points from one
# pool of POOL_SIZE shards' points. Lights and paths are fresh in every shard.
POOL_SHARDS, POOL_SIZE = 8, 2
# Pools that a scene keeps: those of both roles, area-uniform and adaptive shards.
POOLS = Derived[SurfaceDraw]("transport.surface_pools", most=4)

# Columns that make samples: shape of a row and type.
COLUMNS: dict[str, tuple[tuple[int, ...], type]] = {
    **{name: ((3,), np.float32) for name in ("position", "normal", "view", "light", "reflectance")},
    **{name: ((1,), np.float32) for name in ("roughness", "metallic")},
    **{name: ((3,), np.float32) for name in ("half_a", "half_b")},
    "weight": ((), np.float32),
    "shape": ((), np.uint32),
}
# NaN where none of a sample's paths gave a number; fits drop those rows and count them.
MAY_BE_NAN = ("half_a", "half_b")

LightsFn = Callable[[int, int], np.ndarray]
"""(count, seed) -> [count, 3] positions of the light (directions of the sun)."""

Make = Callable[..., tuple[dict[str, np.ndarray], dict]]
"""(scene, variable, lights_fn, settings, index) -> columns and counts of one shard: ``make_shard`` or one like it."""


@dataclass(frozen=True)
class ShardSettings:
    """What decides the bytes of a shard, besides the scene and the variable."""

    paths: int = 64
    """Paths per sample, both halves together; even."""
    seed: int = 0
    lights: int = 512
    """Lights per shard."""
    points_per_light: int = 128
    floor: int = 32
    """Points per visible object and shard at least: 512 in a set of a million samples (specification 2.2)."""
    max_depth: int = MAX_DEPTH
    rr_depth: int = RR_DEPTH

    @property
    def size(self) -> int:
        """Samples per shard."""
        return self.lights * self.points_per_light


def generate(
    scene: Scene,
    variable: Variable,
    lights_fn: LightsFn | None,
    folder: str | Path,
    shards: int,
    paths: int = 64,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
    *,
    settings: ShardSettings | None = None,
    make: Make | None = None,
) -> PathReport:
    """Write the shards that ``folder`` lacks; ``load_samples`` reads them. Same scene and settings: same bytes.

    lights_fn   Where the light stands; None: ``sample_lights`` of the variable.
    make        Makes one shard; None: ``make_shard`` (area-uniform).
    progress    Called with (shards ready, shards) after each.
    settings    Sizes and depths; its paths and seed give way to the arguments.
    returns     Path counts of all shards, those written earlier included.
    """
    settings = replace(settings or ShardSettings(), paths=paths, seed=seed)
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    wanted = manifest(scene, variable, settings)
    if (folder / "manifest.json").exists():
        check_manifest(folder, wanted)
    else:
        write_atomically(folder / "manifest.json", json.dumps(wanted, indent=2, sort_keys=True))
    total, store = PathReport(), Store(folder, limit=None)
    for index in range(shards):
        made = lambda k=index: _stored(*(make or make_shard)(scene, variable, lights_fn, settings, k))  # noqa: E731
        found = store.get(shard_key(wanted, index), made, formats.COLUMNS)
        counts = json.loads(found["counts"].tobytes())
        for name in asdict(total):
            setattr(total, name, getattr(total, name) + counts["paths"][name])
        if progress is not None:
            progress(index + 1, shards)
    return total


def make_shard(
    scene: Scene,
    variable: Variable,
    lights_fn: LightsFn | None,
    settings: ShardSettings,
    index: int,
    *,
    own_light: bool = False,
) -> tuple[dict[str, np.ndarray], dict]:
    """The columns of one shard and its counts; depends on nothing but its arguments, so any machine may make it.

    own_light   Gather the light of the scene's own emitters instead of the declared light's.
    """
    seed, light_seed, path_seed = shard_seeds(settings, index)
    pool = surface_pool(scene, settings, index // POOL_SHARDS)
    rows = np.random.default_rng(seed).permutation(len(pool.points))[: settings.size]
    lights = (lights_fn or default_lights(scene, variable))(settings.lights, light_seed)
    light = np.repeat(np.asarray(lights, np.float32), settings.points_per_light, axis=0)
    points, weight = pool.points[rows], pool.weight[rows]
    return shard_columns(
        scene, variable, points, light, weight, settings, path_seed, pool.rejection, own_light=own_light
    )


def surface_pool(scene: Scene, settings: ShardSettings, number: int) -> SurfaceDraw:
    """Pool ``number`` of surface points, shared by area-uniform and adaptive shards; kept with the scene."""

    def draw() -> SurfaceDraw:
        seed = int(np.random.SeedSequence([settings.seed, number, 1]).generate_state(1)[0])
        return draw_surface(scene, POOL_SIZE * settings.size, seed, floor=POOL_SIZE * settings.floor)

    return scene.cache.get(POOLS, draw, (number, settings))


def shard_seeds(settings: ShardSettings, index: int) -> tuple[int, int, int]:
    """Seeds of the points, the lights and the paths of one shard."""
    return tuple(int(s) for s in np.random.SeedSequence([settings.seed, index]).generate_state(3))


def shard_columns(
    scene: Scene,
    variable: Variable,
    points: SurfacePoints,
    light: np.ndarray,
    weight: np.ndarray,
    settings: ShardSettings,
    seed: int,
    rejection: Rejection,
    *,
    own_light: bool = False,
) -> tuple[dict[str, np.ndarray], dict]:
    """Trace the points of a shard; returns its columns and counts."""
    report = PathReport()
    depths = {"max_depth": settings.max_depth, "rr_depth": settings.rr_depth}
    samples = collect(
        scene,
        variable,
        points,
        light,
        settings.paths,
        seed,
        weight=weight,
        own_light=own_light,
        report=report,
        **depths,
    )
    columns = {name: getattr(samples.query, name) for name in Query.__dataclass_fields__}
    columns |= {name: getattr(samples, name) for name in ("half_a", "half_b", "weight", "shape")}
    columns |= {"triangle": points.triangle, "barycentric": points.barycentric}
    columns["flat"] = frames(scene, points)[2]
    return columns, {"paths": asdict(report), "rejection": asdict(rejection)}


def load_samples(folder: str | Path, scene: Scene | None = None, *, shards: int | None = None) -> Samples:
    """The samples of a folder, shard by shard. With a scene, one that was made for another scene is refused.

    shards   Read the first so many; default all.
    """
    folder = Path(folder)
    found = _read_manifest(folder, scene_digest(scene) if scene is not None else None)
    store, parts = Store(folder, limit=None), []
    while shards is None or len(parts) < shards:
        part = store.find(shard_key(found, len(parts)), formats.COLUMNS)
        if part is None:
            break
        parts.append(_checked(part, folder))
    if len(parts) < (shards or 1):
        raise ValueError(
            f"samples: '{folder}' holds {len(parts)} of {shards or 1} shards; run generate() again to resume"
        )
    columns = {name: np.concatenate([part[name] for part in parts]) for name in COLUMNS}
    query = Query(**{name: columns[name] for name in Query.__dataclass_fields__})
    return Samples(query, *(columns[name] for name in ("half_a", "half_b", "weight", "shape")))


def shard_key(manifest: dict, index: int) -> Key:
    """The name of a shard in the store of its folder."""
    return key("samples.shard", VERSION, manifest=manifest, index=index)


def _stored(columns: dict[str, np.ndarray], counts: dict) -> dict[str, np.ndarray]:
    """Columns and counts of a shard as they lie on disk."""
    kinds = {name: np.uint32 if values.dtype.kind in "ui" else np.float32 for name, values in columns.items()}
    found = {name: np.ascontiguousarray(values, kinds[name]) for name, values in columns.items()}
    return found | {"counts": np.frombuffer(json.dumps(counts, sort_keys=True).encode(), np.uint8)}


def _checked(columns: dict[str, np.ndarray], folder: Path) -> dict[str, np.ndarray]:
    """The columns that make samples; ``ValueError`` names what is wrong and the cure."""
    rows = None
    for name, (shape, kind) in COLUMNS.items():
        values = columns.get(name, np.zeros(()))
        rows = len(values) if rows is None and values.ndim else rows
        expected = (rows, *shape)
        if values.shape != expected or values.dtype != kind:
            raise ValueError(
                f"samples: '{name}' of a shard in '{folder}' is {values.dtype} {values.shape}, "
                f"expected {np.dtype(kind)} {expected}; delete the folder and run generate() again"
            )
        if name not in MAY_BE_NAN and not np.isfinite(values).all():
            raise ValueError(
                f"samples: '{name}' of a shard in '{folder}' holds numbers that are not finite; "
                "delete the folder and run generate() again"
            )
    return columns


def manifest(scene: Scene, variable: Variable, settings: ShardSettings) -> dict:
    """What is written beside the shards."""
    body = {"variable": asdict(variable), "settings": asdict(settings)}
    digest = hashlib.sha256(json.dumps(body, sort_keys=True).encode()).hexdigest()
    return {"version": VERSION, "scene": scene.name, "digest": scene_digest(scene), "settings_hash": digest, **body}


def check_manifest(folder: Path, wanted: dict) -> None:
    """Raise when the shards in a folder were not made for this scene, variable and settings."""
    found = _read_manifest(folder, wanted["digest"])
    if found["settings_hash"] != wanted["settings_hash"]:
        old, new = ({**m["settings"], **m["variable"]} for m in (found, wanted))
        changed = ", ".join(k for k in new if json.dumps(new[k]) != json.dumps(old.get(k))) or "settings"
        raise ValueError(
            f"samples: '{folder}' was made with other settings ({changed}); choose another folder or delete this one"
        )


def scene_digest(scene: Scene) -> str:
    """``Scene.digest``, or a hash of the geometry for scenes made in memory."""
    if scene.digest:
        return scene.digest
    digest = hashlib.sha256(scene.name.encode())
    for mesh in scene.meshes:
        digest.update(np.ascontiguousarray(mesh.positions).tobytes() + np.ascontiguousarray(mesh.indices).tobytes())
    return digest.hexdigest()


def _read_manifest(folder: Path, digest: str | None) -> dict:
    try:
        found = json.loads((folder / "manifest.json").read_text())
    except (OSError, ValueError, RecursionError) as error:
        reason = " ".join(str(error).split())[:200]
        raise ValueError(
            f"samples: '{folder}' has no readable manifest.json ({reason}); run generate() first"
        ) from error
    kinds = {"digest": str, "settings_hash": str, "scene": str, "settings": dict, "variable": dict}
    if not isinstance(found, dict) or (
        found.get("version") == VERSION and not all(isinstance(found.get(key), kind) for key, kind in kinds.items())
    ):
        raise ValueError(f"samples: '{folder}' has a damaged manifest.json; delete the folder and generate again")
    if found.get("version") != VERSION:
        raise ValueError(
            f"samples: '{folder}' has version {str(found.get('version'))[:40]}, expected {VERSION}; "
            "delete it and generate again"
        )
    if digest is not None and found["digest"] != digest:
        raise ValueError(
            f"samples: '{folder}' was made for another scene ('{found['scene']}', digest {found['digest'][:12]}, "
            f"expected {digest[:12]}); choose another folder or delete this one"
        )
    return found


def default_lights(scene: Scene, variable: Variable) -> LightsFn:
    """``sample_lights`` of the variable."""
    from lightwell.scenes.placing import sample_lights

    return lambda count, seed: sample_lights(scene, variable, count, seed)
