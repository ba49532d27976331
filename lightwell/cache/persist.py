"""Radiance caches on disk: one .npz file without pickled objects.

It holds weights, averages, moments, step counters, box, settings and versions.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lightwell.backend import dr, mi
from lightwell.cache.brightness_correction import CELLS, MOST
from lightwell.cache.guide import BINS
from lightwell.cache.guide_table import SUMS, GuideTable
from lightwell.cache.scene_region import fingerprint
from lightwell.cache.settings import settings_of
from lightwell.files import load_arrays, save_arrays
from lightwell.limits import Limits
from lightwell.networks.device import tensors

if TYPE_CHECKING:
    from lightwell.cache.radiance_cache import RadianceCache

VERSION = 3
# Versions that can be read: 1 had no guide, 2 one level for all places, which is ignored.
READS = (1, 2, 3)
PARTS = ("value", "average", "first", "second")


def save(cache: RadianceCache, path: str | Path, more: Mapping[str, np.ndarray] | None = None) -> None:
    """Write a cache to a file, atomically.

    Args:
        cache: Cache to store.
        path: File, ``.npz``.
        more: Further arrays [...] of the caller, which ``load`` ignores.
    """
    predictor, table = cache.predictor, cache.guiding.table
    learner, scale, schedule = predictor.learner, predictor.scale, cache.schedule
    about = {
        "version": VERSION,
        "settings": cache.settings.to_json(),
        "scene": cache.region.fingerprint,
        "mitsuba": mi.__version__,
        "drjit": dr.__version__,
    }
    arrays: dict[str, np.ndarray] = {
        "about": np.frombuffer(json.dumps(about).encode(), np.uint8),
        "clocks": np.array([learner.step, learner.averaged, schedule.frame, schedule.since_change], np.int64),
        "scale": np.array([scale.value, scale.mean], np.float64),
        "box": np.asarray(cache.region.box, np.float64),
    }
    if predictor.level is not None:
        arrays["level"] = np.array(predictor.level)
    for part, held in zip(PARTS, (learner.values, learner.average, *learner.moments)):
        arrays |= {f"{part}.{name}": np.array(value) for name, value in held.items()}
    if table is not None and len(table.keys):
        arrays |= {"guide.keys": table.keys, "guide.bins": table.bins.astype(np.float32), "guide.sums": table.sums,
                   "guide.frames": np.array([table.frames], np.int64)}  # fmt: skip
    save_arrays(Path(path), arrays | dict(more or {}))


def load(
    path: str | Path, make: type[RadianceCache], scene: Any | None = None, limits: Limits | None = None
) -> RadianceCache:
    """Read a file that ``save`` wrote and check everything in it.

    Args:
        path: File.
        make: ``RadianceCache``, which imports this module.
        scene: Mitsuba scene that the cache must belong to; None: any.
        limits: Limits of the file's size; None: the default ones.

    Returns:
        The cache.

    Raises:
        ValueError: The file is damaged, of an unknown version, or of another scene; one line with the cure.
    """
    path = Path(path)
    arrays = _checked(path, limits or Limits())
    try:
        about = json.loads(arrays["about"].tobytes())
        settings = settings_of(about["settings"])
    except (ValueError, LookupError, TypeError, ArithmeticError, RecursionError) as error:
        reason = " ".join(str(error).split())[:120]
        raise ValueError(f"{path}: not a radiance cache ({reason}); write it again with cache.save()") from None
    if about.get("version") not in READS:
        found = about.get("version")
        raise ValueError(f"{path}: version {found} of the format, this lightwell reads {READS}; train again")
    if scene is not None and about.get("scene") and fingerprint(scene) != about["scene"]:
        raise ValueError(f"{path}: was learned on another scene; train a new cache, or load without naming a scene")
    cache = make(settings, arrays["box"])
    _fill(cache, arrays, path)
    if settings.guided and "guide.keys" in arrays:
        _fill_guide(cache, arrays, path)
    cache.region.fingerprint = about.get("scene", "")
    return cache


def _checked(path: Path, limits: Limits) -> dict[str, np.ndarray]:
    arrays = load_arrays(path, "not a radiance cache; give a file written by cache.save()", limits)
    wanted = {"about": (1, np.uint8), "clocks": (1, np.int64), "scale": (1, np.float64), "box": (2, np.float64)}
    for name, (rank, kind) in wanted.items():
        found = arrays.get(name)
        if found is None or found.ndim != rank or found.dtype != kind:
            raise ValueError(f"{path}: not a radiance cache ('{name}' is missing or of another kind)")
    box = arrays["box"]
    if box.shape != (2, 3) or not np.isfinite(box).all() or not (box[1] > box[0]).all():
        raise ValueError(f"{path}: the box is not two corners, the second larger; write the cache again")
    if arrays["clocks"].shape != (4,) or (arrays["clocks"] < 0).any() or not _sound_scale(arrays["scale"]):
        raise ValueError(f"{path}: clocks or scale are out of range; write the cache again")
    return arrays


def _sound_scale(numbers: np.ndarray) -> bool:
    """Test that scale and mean radiance are positive and finite."""
    return len(numbers) >= 2 and bool(np.isfinite(numbers).all() and (numbers[:2] > 0).all())


def _fill(cache: RadianceCache, arrays: dict[str, np.ndarray], path: Path) -> None:
    learner, scale = cache.predictor.learner, cache.predictor.scale
    parts = []
    for part in PARTS:
        held = {}
        for name, value in learner.values.items():
            found = arrays.get(f"{part}.{name}")
            if found is None or found.shape != tuple(value.shape) or found.dtype != np.float32:
                shape = None if found is None else found.shape
                raise ValueError(f"{path}: '{part}.{name}' is {shape}, its settings need {tuple(value.shape)}")
            if not np.isfinite(found).all():
                raise ValueError(f"{path}: '{part}.{name}' holds numbers that are not finite; train again")
            held[name] = found
        parts.append(tensors(held))
    learner.values, learner.average, learner.moments = parts[0], parts[1], (parts[2], parts[3])
    learner.step, learner.averaged, cache.schedule.frame, cache.schedule.since_change = map(int, arrays["clocks"])
    scale.value, scale.mean = (float(x) for x in arrays["scale"][:2])
    cache.predictor.correct(_level(arrays.get("level"), path))
    scale.started = True


def _fill_guide(cache: RadianceCache, arrays: dict[str, np.ndarray], path: Path) -> None:
    """Restore the guide's sums: each cell once and inside the table, all numbers finite and not negative."""
    table = GuideTable(arrays["box"], cache.settings.guiding.guide_share)
    keys = np.atleast_1d(arrays["guide.keys"])
    shapes = {"keys": (np.int64, (len(keys),)), "bins": (np.float32, (len(keys), BINS)),
              "sums": (np.float64, (len(keys), SUMS)), "frames": (np.int64, (1,))}  # fmt: skip
    for name, (kind, shape) in shapes.items():
        found = arrays.get(f"guide.{name}")
        if found is None or found.dtype != kind or found.shape != shape:
            raise ValueError(f"{path}: 'guide.{name}' is missing or of another shape; write the cache again")
        if not np.isfinite(found).all() or (found < 0).any():
            raise ValueError(f"{path}: 'guide.{name}' holds numbers that are out of range; train again")
    if len(np.unique(keys)) != len(keys) or (keys >= len(table.row_of)).any():
        raise ValueError(f"{path}: 'guide.keys' names cells that do not exist, or twice; write the cache again")
    table.restore(keys, arrays["guide.bins"], arrays["guide.sums"], int(arrays["guide.frames"][0]))
    cache.guiding.table = table


def _level(found: np.ndarray | None, path: Path) -> Any:
    """Check the factors of the local gain; None where there are none."""
    if found is None:
        return None
    if found.shape != (CELLS,) or found.dtype != np.float32 or not ((found > 0) & (found <= MOST**2)).all():
        raise ValueError(f"{path}: 'level' is not {CELLS} factors up to {MOST**2:g}; write the cache again")
    return mi.Float(found)
