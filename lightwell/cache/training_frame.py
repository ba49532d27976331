"""Device side of one training frame: paths, their targets and the bias estimate, recorded once and replayed.

Tracing the Python code of a path takes longer than running a small frame of it, so ``dr.freeze`` keeps the recording.
Constants of a recording (sizes, film, choice of paths) are part of its key.

Notation: P paths, V slots per path, R = P V slots in all.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from lightwell.backend import dr, mi
from lightwell.cache.batches import compacted, usable
from lightwell.cache.features import stored
from lightwell.cache.guide import Guide, key_of
from lightwell.cache.model import Model
from lightwell.cache.path_context import PathContext
from lightwell.cache.predictor import PackedWeights
from lightwell.cache.recorded import Recorded
from lightwell.cache.sobol_sampler import GOLDEN, draws, mixed
from lightwell.cache.training_paths import query_vertex, resolve, trace_records

# Stream of random numbers that training paths draw from, apart from those of pixels.
TRAINING_STREAM = 0x5EED


@dataclass(frozen=True)
class FrameShape:
    """Constants of a recorded training frame."""

    P: int
    """Training paths."""
    V: int
    """Record slots per path."""
    crop: tuple[int, int]
    """Width and height of the film, pixels."""
    shutter: tuple[float, float]
    """Time at which the shutter opens, and exposure time."""
    choice: str
    """Paths that only roulette ends: 'all', 'none', 'sixteenth' (one of every 4 x 4 tiles), 'hashed'."""
    film: str
    """Class of the sensor, size and offset of its film."""
    teaches: bool = False
    """Whether the records are used to train a guide, too."""
    guided: bool = False
    """Whether directions are sampled from a guide."""
    predicts: bool = True
    """Whether predictions of the network may end paths and are compared with them."""


class FrameParameters:
    """Scalars of a training frame, opaque so that the recording is reused."""

    DRJIT_STRUCT = {  # noqa: RUF012
        "seed": mi.UInt32, "frame": mi.UInt32, "columns": mi.UInt32, "tile": mi.Vector2f, "u": mi.Float,
        "attenuation": mi.Float, "shortest": mi.UInt32, "replay": mi.Float, "held": mi.UInt32,
    }  # fmt: skip

    def __init__(
        self, seed: int = 0, frame: int = 0, columns: int = 1, tile: tuple[float, float] = (1.0, 1.0), u: float = 0.0,
        attenuation: float = 1.0, shortest: int = 1, replay: float = 0.0, held: int = 0,
    ) -> None:  # fmt: skip
        """Make the scalars opaque.

        Args:
            seed: Seed of the image.
            frame: Number of the frame.
            columns: Tiles per row.
            tile: Width and height of a tile, pixels.
            u: Share of the paths that only Russian roulette ends, [0, 1].
            attenuation: Factor of cache values that end training paths, [0, 1].
            shortest: Records from the query vertex before a cache value may end a path, ≥ 1.
            replay: Share of the paths that start with a ray of the pool, [0, 1].
            held: Rays in the pool.
        """
        whole: Callable[[int], mi.UInt32] = lambda x: dr.opaque(mi.UInt32, x & 0xFFFFFFFF)  # noqa: E731
        real: Callable[[float], mi.Float] = lambda x: dr.opaque(mi.Float, x)  # noqa: E731
        self.seed, self.frame, self.columns = whole(seed), whole(frame), whole(columns)
        self.tile = mi.Vector2f(real(tile[0]), real(tile[1]))
        """Width and height of a tile, pixels."""
        self.u, self.attenuation = real(u), real(attenuation)
        self.shortest = whole(shortest)
        self.replay, self.held = real(replay), whole(held)
        """Share of paths that start with a ray of the pool, and rays in the pool."""


class GuideRecords:
    """Records of a frame for the training of the guide."""

    DRJIT_STRUCT = {  # noqa: RUF012
        "cell": mi.UInt32, "bin": mi.Float, "met": mi.Float, "reach": mi.Float, "whole": mi.Float,
    }  # fmt: skip

    def __init__(self) -> None:
        self.cell, self.bin = mi.UInt32(0), mi.Float(-1)
        """[R] cell, and bin of the direction (-1: no record)."""
        self.met, self.reach, self.whole = mi.Float(0), mi.Float(0), mi.Float(0)
        """[R] luminance from that direction up to the next record; factor of the luminance that the next record
        scatters; all scattered luminance, light sampling included."""


class TracedRecords:
    """Result of a frame of training paths."""

    DRJIT_STRUCT = {  # noqa: RUF012
        "features": mi.Float, "targets": mi.Float, "rows": mi.UInt32, "count": mi.UInt32, "dropped": mi.UInt32,
        "luminance": mi.Float, "hits": mi.UInt32, "meter": mi.Vector3f, "level": mi.Float, "o": mi.Point3f,
        "d": mi.Vector3f, "guide": GuideRecords,
    }  # fmt: skip

    def __init__(self) -> None:
        self.features, self.targets = mi.Float(0), mi.Float(0)
        """[R * WIDTH] vertices and [R * 4] radiance."""
        self.rows, self.count, self.dropped = mi.UInt32(0), mi.UInt32(0), mi.UInt32(0)
        """[R] rows with a finite record, then zeros; their number; number of records that are not finite."""
        self.luminance = mi.Float(0)
        """[R] of radiance over reflectance, -1 where there is no record."""
        self.hits = mi.UInt32(0)
        """Paths that hit a surface with a record."""
        self.meter = mi.Vector3f(0)
        """Bias estimate: number of unbiased paths, sum and sum of squares of prefix * (traced - cached)."""
        self.level = mi.Float(0)
        """Mean luminance of the cache at the tails that ended paths."""
        self.o, self.d = mi.Point3f(0), mi.Vector3f(0)
        """[P] camera rays."""
        self.guide = GuideRecords()
        """Records of the guide."""


def choice_of(u: float) -> str:
    """Name the way in which a share of the paths is chosen.

    Args:
        u: Share of the paths that only Russian roulette ends.

    Returns:
        'all', 'none', 'sixteenth' or 'hashed', see ``FrameShape.choice``.
    """
    return "all" if u >= 1 else "none" if u <= 0 else "sixteenth" if u == 1 / 16 else "hashed"


def shared_offset(frame: mi.UInt32, seed: mi.UInt32) -> mi.Point2f:
    """Compute the position of a frame's training pixels within their tiles.

    Args:
        frame: Number of the frame.
        seed: Seed of the image.

    Returns:
        Offset in [0, 1)^2 that all tiles share.
    """
    return draws(mi.UInt32(0xFFFFFFFF), frame, mixed(seed + TRAINING_STREAM)).next_2d()


@functools.lru_cache(maxsize=64)
def frozen_frame(model: Model, shape: FrameShape) -> Recorded:
    """Return a training frame as a function that is recorded once.

    Args:
        model: Network of the cache.
        shape: Constants of the recording.

    Returns:
        Function of (scene, sensor, context, tail weights, pixel weights, numbers, pool, cells, guide) with a
        ``TracedRecords``. Weights come with their ``RadianceScaling``; the pool is origins and directions of rays of
        earlier cameras; cells are those of the guide along the axes.
    """

    def run(
        scene: Any, sensor: Any, context: PathContext, tails: PackedWeights, pixels: PackedWeights,
        numbers: FrameParameters, pool: tuple[mi.Point3f, mi.Vector3f], cells: mi.Vector3f, guide: Guide | None,
    ) -> TracedRecords:  # fmt: skip
        P, V = shape.P, shape.V
        sampler = draws(dr.arange(mi.UInt32, P), numbers.frame, mixed(numbers.seed + TRAINING_STREAM))
        ray, replayed = _replayed(_rays(sensor, shape, numbers, sampler), numbers, pool, P)
        unbiased = _unbiased(shape, numbers)
        records = trace_records(scene, sampler, ray, context, unbiased, numbers.shortest, V, P, guide)
        dr.eval(records)
        tail = model.radiance(tails[0], records.tail, tails[1]) if shape.predicts else mi.Color3f(0)
        targets, at_query = resolve(records, tail * numbers.attenuation, V, P)
        dr.eval(targets, at_query)
        out = TracedRecords()
        out.features, out.targets = records.features, targets
        ok, bad = usable(targets)
        out.rows, out.count = compacted(ok)
        out.dropped = dr.sum(dr.select(bad, mi.UInt32(1), 0))
        out.luminance = _luminances(model, records.features, targets, ok)
        out.hits = dr.sum(dr.select(records.count > 0, mi.UInt32(1), 0))
        if shape.predicts:
            out.meter = _meter(model, records, at_query, pixels, ~replayed, V, P)
        ended = dr.select(records.ended, mi.Float(1), 0)
        out.level = dr.sum(ended * mi.luminance(tail)) / dr.maximum(dr.sum(ended), 1)
        out.o, out.d = ray.o, ray.d
        if shape.teaches:
            out.guide = _guide_records(records, targets, ok, cells, V)
        dr.eval(out)
        return out

    return Recorded(run)


def _rays(sensor: Any, shape: FrameShape, numbers: FrameParameters, sampler: Any) -> Any:
    """One camera ray per tile, at an offset that all tiles share."""
    tile = dr.arange(mi.UInt32, shape.P)
    at = mi.Point2f(tile % numbers.columns, tile // numbers.columns)
    pixel = dr.floor((at + shared_offset(numbers.frame, numbers.seed)) * numbers.tile)
    position = (pixel + sampler.next_2d()) / mi.Vector2f(*shape.crop)
    aperture = sampler.next_2d() if sensor.needs_aperture_sample() else mi.Point2f(0.5)
    time = shape.shutter[0] + sampler.next_1d() * shape.shutter[1]
    return sensor.sample_ray_differential(time, 0.0, position, aperture)[0]


def _replayed(ray: Any, numbers: FrameParameters, pool: Any, P: int) -> tuple[Any, mi.Bool]:
    """Replace some of the rays by ones of the pool; returns the rays and the mask of the replaced ones."""
    lane = mixed(dr.arange(mi.UInt32, P) * mi.UInt32(GOLDEN) ^ mixed(numbers.frame + 77))
    chosen = (mi.Float(lane) * 2.0**-32 < numbers.replay) & (numbers.held > 0)
    row = mixed(lane + 5) % dr.maximum(numbers.held, 1)
    o, d = dr.gather(mi.Point3f, pool[0], row, chosen), dr.gather(mi.Vector3f, pool[1], row, chosen)
    out = mi.Ray3f(ray)
    out.o, out.d = dr.select(chosen, o, ray.o), dr.select(chosen, d, ray.d)
    return out, chosen


def _unbiased(shape: FrameShape, numbers: FrameParameters) -> mi.Bool:
    """Mask of the paths that only roulette ends: one in 1/u tiles, at an offset that changes with the frame."""
    tile = dr.arange(mi.UInt32, shape.P)
    if shape.choice in ("all", "none"):
        return mi.Bool(shape.choice == "all") & (tile >= 0)
    if shape.choice == "sixteenth":
        x, y = tile % numbers.columns, tile // numbers.columns
        pick = mixed(numbers.frame * mi.UInt32(GOLDEN) + 1) & 15
        return ((x & 3) == (pick & 3)) & ((y & 3) == (pick >> 2))
    return mi.Float(mixed(tile * mi.UInt32(GOLDEN) + mixed(numbers.frame))) * 2.0**-32 < numbers.u


def _luminances(model: Model, features: mi.Float, targets: mi.Float, ok: mi.Bool) -> mi.Float:
    row = dr.arange(mi.UInt32, dr.width(ok))
    v = stored(features, row, ok)
    t = dr.gather(mi.Vector4f, targets, row, ok)
    y, _ = model.target(mi.Color3f(t.x, t.y, t.z), v, mi.Float(1))
    return dr.select(ok, dr.maximum(mi.luminance(y), 0), -1)


def _guide_records(records: Any, targets: mi.Float, ok: mi.Bool, cells: mi.Vector3f, V: int) -> GuideRecords:
    """Compute the guide's training data: radiance scattered by each vertex, by incident direction."""
    out, row = GuideRecords(), dr.arange(mi.UInt32, dr.width(ok))
    v = stored(records.features, row, ok)
    out.cell = key_of(mi.Vector3f(v.p) * cells, v.n, cells)
    colour: Callable[..., mi.Vector4f] = lambda table, at, active: dr.gather(mi.Vector4f, table, at, active)  # noqa: E731
    luminance: Callable[[mi.Vector4f], mi.Float] = lambda four: mi.luminance(mi.Color3f(four.x, four.y, four.z))  # noqa: E731
    C, T = colour(records.gathered, row, ok), colour(records.through, row, ok)
    out.whole, out.bin = luminance(colour(targets, row, ok)), dr.select(ok, T.w, -1)
    # The next record of the same path is in the next slot.
    follows = ok & (row % V + 1 < V) & (dr.gather(mi.Vector4f, targets, row + 1, ok & (row % V + 1 < V)).w > 0)
    out.reach = dr.select(follows, luminance(T), 0)
    out.met = dr.maximum(dr.select(follows, luminance(C), out.whole) - C.w, 0)
    return out


def _meter(
    model: Model, records: Any, at_query: mi.Color3f, pixels: Any, counts: mi.Bool, V: int, P: int
) -> mi.Vector3f:
    """Bias estimate; unbiased paths without a query vertex count with a difference of 0."""
    v, found = query_vertex(records, V, P)
    counts = counts & records.unbiased
    found &= counts & dr.all(dr.isfinite(at_query))
    cached = dr.select(found, model.radiance(pixels[0], v, pixels[1]), 0)
    difference = dr.mean(dr.select(found, records.prefix * (at_query - cached), 0))
    one = dr.select(counts, mi.Float(1), 0)
    return mi.Vector3f(dr.sum(one), dr.sum(difference), dr.sum(dr.square(difference)))
