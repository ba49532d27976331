"""Checkpoint of a sequence: the cache file with everything else that the next frame depends on.

``persist`` stores what was learned: weights, averages, moments, scale, guide. To continue a sequence with identical
bytes, a checkpoint also holds the tile controllers, the change detectors, the pool of earlier rays, the last guide
table that was built, the last copy of finite weights, the reservoirs of the last pass, and the average of denoised
frames, as arrays ``sequence.…``.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lightwell.backend import mi
from lightwell.cache import persist, restir
from lightwell.cache.guide import Guide
from lightwell.cache.radiance_cache import RadianceCache
from lightwell.files import Arrays, load_arrays, prefixed, under
from lightwell.networks.device import tensors

if TYPE_CHECKING:
    from lightwell.cache.integrator import NrcIntegrator

VERSION = 1
GUIDE = ("rows", "tree", "density", "level")
PARTS = ("values", "average", "first", "second")


@dataclass(frozen=True)
class Progress:
    """Position in a sequence."""

    frames: int
    """Finished frames, ≥ 1."""
    exposure: float
    """Exposure factor of the images, chosen for the first one; > 0."""


def save(path: Path, integrator: NrcIntegrator, progress: Progress) -> None:
    """Write the cache of an integrator and everything that its next frame depends on, atomically.

    Args:
        path: File to write, ``.npz``.
        integrator: Integrator that has rendered at least one frame.
        progress: Position in the sequence.

    Raises:
        RuntimeError: The integrator has no cache yet.
    """
    cache = integrator.cache
    if cache is None:
        raise RuntimeError("nrc: a checkpoint needs a cache; render a frame first")
    trainer, learner, table = cache.trainer, cache.predictor.learner, cache.guiding.table
    more = prefixed("replay", trainer.replay.state()[1])
    if learner.copy is not None:
        values, average, (first, second) = learner.copy
        for part, held in zip(PARTS, (values, average, first, second)):
            more |= prefixed(f"snapshot.{part}", {name: np.array(value) for name, value in held.items()})
    if table is not None:
        more["guide.bins"] = table.bins
        if table.made is not None:
            more |= {f"guide.{name}": np.array(getattr(table.made, name)) for name in GUIDE}
    if integrator.reservoirs.held is not None:
        more |= prefixed("reservoirs", _reservoir_arrays(integrator.reservoirs.held))
    more |= prefixed("temporal", integrator.temporal.arrays())
    about: dict[str, Any] = {
        "version": VERSION,
        "progress": asdict(progress),
        "detector": trainer.detector.state(),
        "growth": trainer.growth.state(),
        "scale": cache.predictor.scale.state(),
        "replay": trainer.replay.state()[0],
    }
    about |= cache.schedule.state()
    about["counters"] |= {"changes": cache.changes, "rollbacks": learner.rollbacks}
    more["about"] = np.frombuffer(json.dumps(about).encode(), np.uint8)
    persist.save(cache, path, prefixed("sequence", more))


def load(path: Path, integrator: NrcIntegrator, scene: Any) -> Progress:
    """Restore the cache and the sequence state of an integrator from a checkpoint.

    Args:
        path: File that ``save`` wrote.
        integrator: Integrator that receives the cache and the reservoirs.
        scene: Mitsuba scene of the sequence.

    Returns:
        Position in the sequence.

    Raises:
        ValueError: The file is damaged, of another version or scene, or holds no sequence; one line.
    """
    cache = RadianceCache.load(path, scene)
    more = under("sequence", load_arrays(path))
    try:
        about = json.loads(more["about"].tobytes())
        if about["version"] != VERSION:
            raise ValueError(f"version {about['version']} of the checkpoint, expected {VERSION}")
        _restore(cache, about, more)
        reservoirs = _reservoirs(under("reservoirs", more))
        progress = Progress(int(about["progress"]["frames"]), float(about["progress"]["exposure"]))
        if progress.frames < 1 or not progress.exposure > 0:
            raise ValueError("no finished frame")
        integrator.temporal.restore(under("temporal", more))
    except (ValueError, KeyError, TypeError, AttributeError, IndexError) as error:
        raise ValueError(f"{path}: holds no state of a sequence ({' '.join(str(error).split())[:100]})") from error
    integrator.cache, integrator.reservoirs.held = cache, reservoirs
    return progress


def _restore(cache: RadianceCache, about: dict[str, Any], more: Arrays) -> None:
    trainer, learner, table = cache.trainer, cache.predictor.learner, cache.guiding.table
    cache.schedule.restore(about)
    cache.changes, learner.rollbacks = (int(about["counters"][name]) for name in ("changes", "rollbacks"))
    trainer.detector.restore(about["detector"])
    trainer.growth.restore(about["growth"])
    cache.predictor.scale.restore(about["scale"])
    trainer.replay.restore(about["replay"], under("replay", more))
    parts = [tensors(under(f"snapshot.{part}", more)) for part in PARTS]
    learner.copy = (parts[0], parts[1], (parts[2], parts[3])) if parts[0] else None
    if table is not None:
        table.restore(table.keys, more["guide.bins"], table.sums, table.frames)
        if "guide.rows" in more:
            table.made = Guide()
            table.made.cells, table.made.share = table.opaque_cells, table.opaque_share
            for name in GUIDE:
                kind = mi.UInt32 if name == "rows" else mi.Float
                setattr(table.made, name, kind(more[f"guide.{name}"]))


def _reservoir_arrays(held: restir.Reservoirs) -> Arrays:
    return {name: np.array(getattr(held, name)) for name in restir.Reservoirs.DRJIT_STRUCT}


def _reservoirs(arrays: Arrays) -> restir.Reservoirs | None:
    if not arrays:
        return None
    held = restir.Reservoirs()
    for name, kind in restir.Reservoirs.DRJIT_STRUCT.items():
        setattr(held, name, kind(arrays[name]))
    return held
