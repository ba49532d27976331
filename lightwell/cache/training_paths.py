"""Training paths: each vertex leaves a record, and targets are computed backwards along the path.

A record is an open segment: the radiance gathered between its vertex and the next one (C) and the throughput between
both (T). Then L_s[k] = C[k] + T[k] L_s[k + 1]. Delta vertices leave no record; the path passes through them.

Notation: P paths, V slots per path, row = path * V + slot.
"""

from __future__ import annotations

from typing import Any

from lightwell.backend import dr, mi
from lightwell.cache.bounces import Bounce, bounce_at
from lightwell.cache.features import WIDTH, Vertex, stored
from lightwell.cache.guide import Guide, bin_of
from lightwell.cache.render_paths import PathContext, PathState, guided_visit


class TrainingRecords:
    """Record slots of all training paths."""

    DRJIT_STRUCT = {  # noqa: RUF012
        "features": mi.Float, "gathered": mi.Float, "through": mi.Float, "count": mi.UInt32, "query": mi.Int32,
        "prefix": mi.Color3f, "tail": Vertex, "ended": mi.Bool, "unbiased": mi.Bool,
    }  # fmt: skip

    def __init__(self) -> None:
        self.features = mi.Float(0)
        """[P * V * WIDTH] vertices."""
        self.gathered, self.through = mi.Float(0), mi.Float(0)
        """[P * V * 4] C and T of each slot; the fourth numbers are for the guide: luminance of light sampling at the
        vertex, and bin of the next direction (-1: sampled from a delta component)."""
        self.count = mi.UInt32(0)
        """[P] slots in use."""
        self.query = mi.Int32(-1)
        """[P] slot at which a rendering path would have ended, -1: nowhere."""
        self.prefix = mi.Color3f(0)
        """[P] throughput from the camera to that slot."""
        self.tail, self.ended = Vertex(), mi.Bool(False)
        """[P] vertex at which the path ended in the cache, and whether it did."""
        self.unbiased = mi.Bool(False)
        """[P] paths that only roulette ends."""


class PathSuffix:
    """Loop variables of training paths beside ``PathState``."""

    DRJIT_STRUCT = {  # noqa: RUF012
        "C": mi.Color3f, "T": mi.Color3f, "count": mi.UInt32, "query": mi.Int32, "prefix": mi.Color3f, "tail": Vertex,
        "ended": mi.Bool, "bounces": mi.UInt32, "late": mi.UInt32, "sampled": mi.Float, "bin": mi.Float,
    }  # fmt: skip

    def __init__(self) -> None:
        self.C, self.T = mi.Color3f(0), mi.Color3f(1)
        """Gathered radiance and throughput of the open segment."""
        self.sampled, self.bin = mi.Float(0), mi.Float(-1)
        """For the guide: luminance of light sampling at the start of the segment, and bin of its direction."""
        self.count = mi.UInt32(0)
        """Slots in use."""
        self.query, self.prefix = mi.Int32(-1), mi.Color3f(0)
        """As in ``TrainingRecords``."""
        self.tail, self.ended = Vertex(), mi.Bool(False)
        """As in ``TrainingRecords``."""
        self.bounces = mi.UInt32(0)
        """Vertices left behind since the camera."""
        self.late = mi.UInt32(0)
        """Records from the query vertex on, inclusive."""


@dr.syntax
def trace_records(
    scene: Any, sampler: Any, ray: Any, around: PathContext, unbiased: mi.Bool, shortest: mi.UInt32, V: int, P: int,
    guide: Guide | None = None,
) -> TrainingRecords:  # fmt: skip
    """Trace P training paths, one per lane, and store their records.

    Args:
        scene: Mitsuba scene.
        sampler: Source of random numbers.
        ray: [P] camera rays.
        around: Parameters of the paths.
        unbiased: [P] mask of the paths that no cache value ends; they may be longer than V vertices.
        shortest: Records from the query vertex before a cache value may end a path; 1 in Müller et al. 2021.
        V: Slots per path.
        P: Number of paths.
        guide: ``Guide`` that directions are sampled from beside the BSDF; None: the BSDF alone.

    Returns:
        The records.
    """
    out = TrainingRecords()
    out.features = dr.zeros(mi.Float, P * V * WIDTH)
    out.gathered, out.through = dr.zeros(mi.Float, P * V * 4), dr.zeros(mi.Float, P * V * 4)
    features, gathered, through = out.features, out.gathered, out.through
    path = dr.arange(mi.UInt32, P)
    walk = PathState(ray)
    kept = PathSuffix()

    while dr.hint(walk.active, label="lightwell nrc training"):
        si = scene.ray_intersect(walk.ray, mi.RayFlags.All, walk.depth == 0, walk.active)
        bsdf = si.bsdf(walk.ray)
        smooth = mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)

        # -------------------- Emission, reached by BSDF sampling --------------------

        kept.C += dr.select(kept.count > 0, kept.T * walk.emission(scene, si), 0)
        goes = walk.active & si.is_valid() & (kept.bounces + 1 < around.max_depth)

        # --------------- Footprint: the query vertex, and the cache's tail ---------------

        added = walk.foot.arrive(si, walk.ray)
        recordable = goes & smooth & around.inside(si.p)
        wide = recordable & walk.foot.scattered & (dr.square(walk.foot.s + added) > around.c * walk.foot.a0)
        v = around.vertex(si, bsdf, recordable)
        full = kept.count >= V
        ends = ~unbiased & ((wide & (kept.query >= 0) & (kept.late >= shortest)) | (recordable & full))
        kept.tail = dr.select(ends, v, kept.tail)
        kept.ended |= ends
        goes &= ~ends
        added = _begin(walk, kept, added, goes & wide & (kept.query < 0) & ~full)

        # -------------------------------- A record --------------------------------

        visit, goes = _guided_roulette(walk, kept, guide, around, sampler, si, bsdf, goes)
        opens = goes & recordable & ~full
        closes = opens & (kept.count > 0)
        before = path * V + kept.count - 1
        dr.scatter(gathered, mi.Vector4f(*kept.C, kept.sampled), before, closes)
        dr.scatter(through, mi.Vector4f(*kept.T, kept.bin), before, closes)
        v.store(features, path * V + kept.count, opens)
        _open(kept, opens)

        # ------------------- Light sampling and the next direction -------------------

        bounce = bounce_at(scene, sampler, si, bsdf, smooth, goes, guide, visit)
        _note(kept, si, bounce, opens)
        kept.C += dr.select(kept.count > 0, kept.T * bounce.light, 0)
        kept.T = dr.select(goes, kept.T * bounce.weight, kept.T)
        walk.leave(si, bounce)
        walk.foot.leave(added, bounce, goes)
        _roulette(walk, kept, si, sampler, around, goes, guide is None)

    # Close the last segment of each path; only a tail can follow it.
    closes = kept.count > 0
    dr.scatter(gathered, mi.Vector4f(*kept.C, kept.sampled), path * V + kept.count - 1, closes)
    dr.scatter(through, mi.Vector4f(*dr.select(kept.ended, kept.T, 0), kept.bin), path * V + kept.count - 1, closes)
    out.count, out.query, out.prefix, out.tail, out.ended = kept.count, kept.query, kept.prefix, kept.tail, kept.ended
    out.unbiased = mi.Bool(unbiased)
    return out


def _begin(walk: PathState, kept: PathSuffix, added: mi.Float, begins: mi.Bool) -> mi.Float:
    """Begin the suffix at the query vertex: throughput, depth and spread restart there."""
    kept.query = dr.select(begins, mi.Int32(kept.count), kept.query)
    kept.prefix = dr.select(begins, mi.Color3f(walk.β), kept.prefix)
    walk.β = dr.select(begins, mi.Spectrum(1), walk.β)
    walk.η = dr.select(begins, 1, walk.η)
    walk.depth = dr.select(begins, 0, walk.depth)
    walk.first = dr.select(begins, 0, walk.first)
    walk.foot.s = dr.select(begins, 0, walk.foot.s)
    return dr.select(begins, 0, added)


def _open(kept: PathSuffix, opens: mi.Bool) -> None:
    """Begin a new segment."""
    kept.C = dr.select(opens, mi.Color3f(0), kept.C)
    kept.T = dr.select(opens, mi.Color3f(1), kept.T)
    kept.count = dr.select(opens, kept.count + 1, kept.count)
    kept.late = dr.select(opens & (kept.query >= 0), kept.late + 1, kept.late)


def _roulette(
    walk: PathState, kept: PathSuffix, si: Any, sampler: Any, around: PathContext, goes: mi.Bool, plain: bool
) -> None:
    """Stopping criterion: Russian roulette, compensated in T; paths with a guide use the guide's instead."""
    left = si.is_valid() & walk.active
    walk.depth = dr.select(left, walk.depth + 1, walk.depth)
    kept.bounces = dr.select(left, kept.bounces + 1, kept.bounces)
    dead = goes & ~(dr.max(walk.β) > 0)
    if plain:
        survival = walk.survival()
        chance = goes & (walk.depth >= around.rr_depth)
        go_on = sampler.next_1d() < survival
        dead |= chance & ~go_on
        walk.β = dr.select(chance, walk.β * dr.rcp(survival), walk.β)
        kept.T = dr.select(chance, kept.T * dr.rcp(survival), kept.T)
    kept.T = dr.select(dead, 0, kept.T)
    walk.active = goes & ~dead


def _guided_roulette(walk, kept, guide, around, sampler, si, bsdf, goes):
    """The guide's roulette, compensated in T: (visit, which lanes go on)."""
    if guide is None:
        return None, goes
    visit, goes_on, alive = guided_visit(walk, guide, around, sampler, si, bsdf, goes)
    kept.T = dr.select(goes, dr.select(goes_on, kept.T * dr.rcp(alive), 0), kept.T)
    return visit, goes_on


def _note(kept: PathSuffix, si: Any, bounce: Bounce, opens: mi.Bool) -> None:
    """Store the guide's training data of a vertex."""
    kept.sampled = dr.select(opens, mi.luminance(mi.Color3f(bounce.light)), kept.sampled)
    to = mi.Float(bin_of(si.to_world(bounce.wo)))
    kept.bin = dr.select(opens, dr.select(bounce.delta | bounce.null, -1, to), kept.bin)


@dr.syntax
def resolve(records: TrainingRecords, tail_value: Any, V: int, P: int) -> tuple[mi.Float, mi.Color3f]:
    """Compute the targets backwards along each path.

    Args:
        records: Result of ``trace_records``.
        tail_value: [P] radiance of the cache at the tails, attenuated.
        V: Slots per path.
        P: Number of paths.

    Returns:
        Scattered radiance L_s and a flag 1 per slot [P * V * 4], 0 in unused slots; and L_s at the query vertex [P].
    """
    targets = dr.zeros(mi.Float, P * V * 4)
    path = dr.arange(mi.UInt32, P)
    L = dr.select(records.ended, mi.Color3f(tail_value), 0)
    at_query = mi.Color3f(0)
    k = mi.Int32(records.count) - 1
    gathered, through = records.gathered, records.through
    while dr.hint(k >= 0, label="lightwell nrc targets"):
        row = path * V + mi.UInt32(k)
        C = dr.gather(mi.Vector4f, gathered, row)
        T = dr.gather(mi.Vector4f, through, row)
        # A throughput of zero ends the sum even where the rest is infinite.
        rest = mi.Color3f(T.x, T.y, T.z) * L
        L = mi.Color3f(C.x, C.y, C.z) + dr.select(mi.Color3f(T.x, T.y, T.z) == 0, 0, rest)
        dr.scatter(targets, mi.Vector4f(*L, 1), row)
        at_query[k == records.query] = L
        k -= 1
    return targets, at_query


def query_vertex(records: TrainingRecords, V: int, P: int) -> tuple[Vertex, mi.Bool]:
    """Gather the vertices at which rendering paths would have ended.

    Args:
        records: Result of ``trace_records``.
        V: Slots per path.
        P: Number of paths.

    Returns:
        Vertices [P], and mask of the paths with one [P].
    """
    found = records.query >= 0
    row = dr.arange(mi.UInt32, P) * V + mi.UInt32(dr.maximum(records.query, 0))
    return stored(records.features, row, found), found
