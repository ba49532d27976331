"""Training samples on disk: light-major shards; an interrupted run resumes, and ends with the same bytes.

A folder holds ``manifest.json`` (the request) and a store of shards (``core.store``). The name of a shard is a hash of
the manifest and its number: one that was made for another request is never read. In a shard, ``points_per_light``
consecutive rows share a light, so that a network of the light is evaluated once per light.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from lightwell.core import formats
from lightwell.core.keys import Key, key
from lightwell.core.store import Store
from lightwell.files import write_atomically
from lightwell.scenes.movers import MOST_MOVERS
from lightwell.scenes.scene import Scene
from lightwell.scenes.scene_cache import Derived
from lightwell.scenes.variables import Variable
from lightwell.transport.collect import collect
from lightwell.transport.paths import MAX_DEPTH, RR_DEPTH
from lightwell.transport.point_rejection import Rejection
from lightwell.transport.queries import frames
from lightwell.transport.radiance import PathReport
from lightwell.transport.samples import Query, Samples, SurfacePoints, columns_of
from lightwell.transport.seen import draw_seen
from lightwell.transport.surface import SurfaceDraw

# Layout of the folder; readers refuse others.
VERSION = 10
# Finding points that border on air takes as long as tracing their light, so that this many shards draw their points
# from one pool of POOL_SIZE shards' points. Every shard has its own lights and paths.
POOL_SHARDS, POOL_SIZE = 8, 2
# Pools that a scene keeps: those of area-uniform and of adaptive shards.
POOLS = Derived[SurfaceDraw]("transport.surface_pools", most=4)

# Columns that make samples: shape of a row and type.
COLUMNS: dict[str, tuple[tuple[int, ...], type]] = {
    **{name: ((3,), np.float32) for name in ("position", "normal", "shading_normal", "view", "light", "reflectance")},
    **{name: ((1,), np.float32) for name in ("roughness", "metallic")},
    **{name: ((3,), np.float32) for name in ("half_a", "half_b")},
    "weight": ((), np.float32),
    "shape": ((), np.uint32),
}
# Those that only samples of a scene with movers have; a pose is as wide as there are movers.
MOVER_COLUMNS: dict[str, tuple[tuple[int, ...], type]] = {
    "pose": ((MOST_MOVERS,), np.float32),
    "rest_position": ((3,), np.float32),
    "rest_normal": ((3,), np.float32),
}
# NaN where none of a sample's paths is finite; fits drop those rows and count them.
MAY_BE_NAN = ("half_a", "half_b")

LightsFn = Callable[[int, int], np.ndarray]
"""(count, seed) -> [count, 3] positions of the light (directions of the sun)."""

Make = Callable[..., tuple[dict[str, np.ndarray], dict]]
"""(scene, variable, lights_fn, settings, index) -> columns and counts of one shard: ``make_shard`` or one like it."""


@dataclass(frozen=True)
class ShardSettings:
    """Settings that, with the scene and the variable, determine the bytes of a shard."""

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
    """Make the shards that a folder lacks; ``load_samples`` reads them. Same scene and settings: same bytes.

    Args:
        scene: Scene to sample.
        variable: The declared light.
        lights_fn: Takes (count, seed) and returns positions of the light [count, 3]; None: ``sample_lights`` of the
            variable.
        folder: Folder of the shards, made if it does not exist.
        shards: Number of shards that the folder holds afterwards.
        paths: Paths per sample, even, ≥ 2.
        seed: Seed of points, lights and paths.
        progress: Called with (shards ready, shards) after each.
        settings: Sizes and depths; ``paths`` and ``seed`` replace its own.
        make: Makes one shard; None: ``make_shard`` (area-uniform).

    Returns:
        Path counts of all shards, those written earlier included.
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
    # A shard is written while the next one is traced.
    with ThreadPoolExecutor(1) as writer:
        written: Future | None = None
        for index in range(shards):
            at = shard_key(wanted, index)
            found = store.find(at, formats.COLUMNS)
            if found is None:
                found = _stored(*(make or make_shard)(scene, variable, lights_fn, settings, index))
                if written is not None:
                    written.result()
                written = writer.submit(store.put, at, found, formats.COLUMNS)
            counts = json.loads(found["counts"].tobytes())
            for name in asdict(total):
                setattr(total, name, getattr(total, name) + counts["paths"][name])
            if progress is not None:
                progress(index + 1, shards)
        if written is not None:
            written.result()
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
    """Make the columns of one shard and its counts; the result depends on the arguments alone.

    Args:
        scene: Scene to sample.
        variable: The declared light.
        lights_fn: Takes (count, seed) and returns positions of the light [count, 3]; None: ``sample_lights`` of the
            variable.
        settings: Sizes, depths and seed.
        index: Number of the shard, ≥ 0.
        own_light: Gather the light of the scene's own emitters instead of the declared light's.

    Returns:
        Columns by name, [settings.size, ...] each, and counts of paths and of dropped points.
    """
    seed, light_seed, path_seed = shard_seeds(settings, index)
    pool = surface_pool(scene, variable, settings, index // POOL_SHARDS)
    rows = np.random.default_rng(seed).permutation(len(pool.points))[: settings.size]
    lights = (lights_fn or default_lights(scene, variable))(settings.lights, light_seed)
    light = np.repeat(np.asarray(lights, np.float32), settings.points_per_light, axis=0)
    points, weight = pool.points[rows], pool.weight[rows]
    return shard_columns(
        scene, variable, points, light, weight, settings, path_seed, pool.rejection, own_light=own_light
    )


def surface_pool(scene: Scene, variable: Variable, settings: ShardSettings, number: int) -> SurfaceDraw:
    """Draw a pool of points where people look, shared by all kinds of shards; the scene keeps it.

    Args:
        scene: Scene to sample.
        variable: The declared light; people look where it may be.
        settings: Sizes and seed.
        number: Number of the pool, ≥ 0.

    Returns:
        POOL_SIZE times the points of a shard.
    """

    def draw() -> SurfaceDraw:
        seed = int(np.random.SeedSequence([settings.seed, number, 1]).generate_state(1)[0])
        return draw_seen(scene, variable, POOL_SIZE * settings.size, seed, floor=POOL_SIZE * settings.floor, shown=True)

    return scene.cache.get(POOLS, draw, (number, variable, settings))


def shard_seeds(settings: ShardSettings, index: int) -> tuple[int, int, int]:
    """Derive the seeds of the points, the lights and the paths of one shard.

    Args:
        settings: Settings with the seed of all shards.
        index: Number of the shard, ≥ 0.

    Returns:
        Three seeds of 32 bits.
    """
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
    """Trace the points of a shard.

    Args:
        scene: Scene to trace.
        variable: The declared light.
        points: N points.
        light: [N, 3] positions of the light, metres (directions of a sun).
        weight: [N] weights of the points.
        settings: Paths and depths.
        seed: Seed of the paths.
        rejection: Counts of the points that were dropped.
        own_light: Gather the light of the scene's own emitters instead of the declared light's.

    Returns:
        Columns by name, [N, ...] each, and counts of paths and of dropped points.
    """
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
    columns = columns_of(samples.query)
    columns |= {name: getattr(samples, name) for name in ("half_a", "half_b", "weight", "shape")}
    columns |= {"triangle": points.triangle, "barycentric": points.barycentric}
    columns["flat"] = frames(scene, points)[2]
    return columns, {"paths": asdict(report), "rejection": asdict(rejection)}


def load_samples(folder: str | Path, scene: Scene | None = None, *, shards: int | None = None) -> Samples:
    """Read the samples of a folder, shard by shard.

    Args:
        folder: Folder that ``generate`` has written.
        scene: Scene that the shards must have been made for; None: not checked.
        shards: Number of shards to read, from the first; None: all.

    Returns:
        The samples, in the order of the shards.

    Raises:
        ValueError: The folder holds fewer shards, is damaged or was made for another scene.
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
    names = [name for name in (*COLUMNS, *MOVER_COLUMNS) if name in parts[0]]
    columns = {name: np.concatenate([part[name] for part in parts]) for name in names}
    query = Query(**{name: columns[name] for name in Query.__dataclass_fields__ if name in columns})
    return Samples(query, *(columns[name] for name in ("half_a", "half_b", "weight", "shape")))


def shard_key(manifest: dict, index: int) -> Key:
    """Compute the key of a shard in the store of its folder.

    Args:
        manifest: Manifest of the folder.
        index: Number of the shard, ≥ 0.

    Returns:
        The key.
    """
    return key("samples.shard", VERSION, manifest=manifest, index=index)


def _stored(columns: dict[str, np.ndarray], counts: dict) -> dict[str, np.ndarray]:
    """Convert columns and counts of a shard to the arrays that are stored."""
    kinds = {name: np.uint32 if values.dtype.kind in "ui" else np.float32 for name, values in columns.items()}
    found = {name: np.ascontiguousarray(values, kinds[name]) for name, values in columns.items()}
    return found | {"counts": np.frombuffer(json.dumps(counts, sort_keys=True).encode(), np.uint8)}


def _checked(columns: dict[str, np.ndarray], folder: Path) -> dict[str, np.ndarray]:
    """Check the columns that make samples; a ``ValueError`` names the defect and the cure."""
    rows = None
    more = {name: form for name, form in MOVER_COLUMNS.items() if name in columns}
    for name, (shape, kind) in (COLUMNS | more).items():
        values = columns.get(name, np.zeros(()))
        if name == "pose" and values.ndim == 2 and 1 <= values.shape[1] <= MOST_MOVERS:
            shape = values.shape[1:]
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
    """Describe the request that shards are made for.

    Args:
        scene: Scene to sample.
        variable: The declared light.
        settings: Sizes, depths and seed.

    Returns:
        JSON-compatible object, written beside the shards.
    """
    body = {"variable": asdict(variable), "settings": asdict(settings)}
    digest = hashlib.sha256(json.dumps(body, sort_keys=True).encode()).hexdigest()
    return {"version": VERSION, "scene": scene.name, "digest": scene_digest(scene), "settings_hash": digest, **body}


def check_manifest(folder: Path, wanted: dict) -> None:
    """Check that the shards in a folder were made for a request.

    Args:
        folder: Folder with a manifest.
        wanted: Manifest of the request.

    Raises:
        ValueError: The scene, the variable or the settings differ, or the manifest is damaged.
    """
    found = _read_manifest(folder, wanted["digest"])
    if found["settings_hash"] != wanted["settings_hash"]:
        old, new = ({**m["settings"], **m["variable"]} for m in (found, wanted))
        changed = ", ".join(k for k in new if json.dumps(new[k]) != json.dumps(old.get(k))) or "settings"
        raise ValueError(
            f"samples: '{folder}' was made with other settings ({changed}); choose another folder or delete this one"
        )


def scene_digest(scene: Scene) -> str:
    """Identify a scene by its content.

    Args:
        scene: Scene to identify.

    Returns:
        ``Scene.digest``, or a SHA-256 of name and geometry for a scene made in memory.
    """
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
    """Make the function that samples positions of a declared light.

    Args:
        scene: Scene that the light stands in.
        variable: The declared light.

    Returns:
        ``sample_lights`` of the variable, as a function of (count, seed).
    """
    from lightwell.scenes.placing import sample_lights

    return lambda count, seed: sample_lights(scene, variable, count, seed)
