"""Training paths: they leave a record at every vertex, from which targets are worked out backwards.

A record is an open segment: what was gathered between its vertex and the next one (C) and the throughput between
the two (T). Then L_s[k] = C[k] + T[k] L_s[k + 1]. Delta vertices are passed through and leave no record.

Notation: P paths, V slots per path, row = path * V + slot.
"""

from __future__ import annotations

from typing import Any

from lightwell.backend import dr, mi
from lightwell.cache.bounces import Bounce, bounce_at
from lightwell.cache.features import WIDTH, Vertex, stored
from lightwell.cache.guide import bin_of
from lightwell.cache.paths import Surroundings, Walk, guided_visit


class Records:
    """Slots of all training paths."""

    DRJIT_STRUCT = {  # noqa: RUF012
        "features": mi.Float, "gathered": mi.Float, "through": mi.Float, "count": mi.UInt32, "query": mi.Int32,
        "prefix": mi.Color3f, "tail": Vertex, "ended": mi.Bool, "unbiased": mi.Bool,
    }  # fmt: skip

    def __init__(self):
        self.features = mi.Float(0)
        """[P * V * WIDTH] vertices."""
        self.gathered, self.through = mi.Float(0), mi.Float(0)
        """[P * V * 4] C and T of each slot; the fourth numbers are for the guide: luminance of the light sampled at the
        vertex, and the bin of the direction that it bounced to (-1: a mirror's)."""
        self.count = mi.UInt32(0)
        """[P] slots in use."""
        self.query = mi.Int32(-1)
        """[P] slot at which a rendering path would have ended, -1: nowhere."""
        self.prefix = mi.Color3f(0)
        """[P] throughput from the eye to it."""
        self.tail, self.ended = Vertex(), mi.Bool(False)
        """[P] where the path ended in the cache, and whether it did."""
        self.unbiased = mi.Bool(False)
        """[P] paths that end by roulette alone."""


class Suffix:
    """What a training path carries along beside ``Walk``."""

    DRJIT_STRUCT = {  # noqa: RUF012
        "C": mi.Color3f, "T": mi.Color3f, "count": mi.UInt32, "query": mi.Int32, "prefix": mi.Color3f, "tail": Vertex,
        "ended": mi.Bool, "bounces": mi.UInt32, "late": mi.UInt32, "sampled": mi.Float, "bin": mi.Float,
    }  # fmt: skip

    def __init__(self):
        self.C, self.T = mi.Color3f(0), mi.Color3f(1)
        """The open segment."""
        self.sampled, self.bin = mi.Float(0), mi.Float(-1)
        """Likewise, what the guide learns from: light sampled where it begins, and where the path went from there."""
        self.count = mi.UInt32(0)
        """Slots in use."""
        self.query, self.prefix = mi.Int32(-1), mi.Color3f(0)
        self.tail, self.ended = Vertex(), mi.Bool(False)
        self.bounces = mi.UInt32(0)
        """Vertices left behind in all."""
        self.late = mi.UInt32(0)
        """Records since the query vertex, it included."""


@dr.syntax
def trace_records(scene, sampler, ray, around: Surroundings, unbiased, shortest, V: int, P: int, guide: Any = None):
    """Trace P training paths, one per lane, and leave their records.

    unbiased  mask of the paths that no cache value ends; they may be longer than V vertices.
    guide     None, or the ``Guide`` that directions are sampled from beside the BSDF.
    shortest  records from the query vertex on before a cache value may end a path; the paper: 1.
    """
    out = Records()
    out.features = dr.zeros(mi.Float, P * V * WIDTH)
    out.gathered, out.through = dr.zeros(mi.Float, P * V * 4), dr.zeros(mi.Float, P * V * 4)
    features, gathered, through = out.features, out.gathered, out.through
    path = dr.arange(mi.UInt32, P)
    walk = Walk(ray)
    kept = Suffix()

    while dr.hint(walk.active, label="lightwell nrc training"):
        si = scene.ray_intersect(walk.ray, mi.RayFlags.All, walk.depth == 0, walk.active)
        bsdf = si.bsdf(walk.ray)
        smooth = mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)

        # ---------------------- Emission, met by BSDF sampling ----------------------

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

    # A path that ended closes its last segment; nothing but a tail lies behind it.
    closes = kept.count > 0
    dr.scatter(gathered, mi.Vector4f(*kept.C, kept.sampled), path * V + kept.count - 1, closes)
    dr.scatter(through, mi.Vector4f(*dr.select(kept.ended, kept.T, 0), kept.bin), path * V + kept.count - 1, closes)
    out.count, out.query, out.prefix, out.tail, out.ended = kept.count, kept.query, kept.prefix, kept.tail, kept.ended
    out.unbiased = mi.Bool(unbiased)
    return out


def _begin(walk: Walk, kept: Suffix, added: mi.Float, begins: mi.Bool) -> mi.Float:
    """The suffix begins at the query vertex: throughput, depth and spread count from there."""
    kept.query = dr.select(begins, mi.Int32(kept.count), kept.query)
    kept.prefix = dr.select(begins, mi.Color3f(walk.β), kept.prefix)
    walk.β = dr.select(begins, mi.Spectrum(1), walk.β)
    walk.η = dr.select(begins, 1, walk.η)
    walk.depth = dr.select(begins, 0, walk.depth)
    walk.first = dr.select(begins, 0, walk.first)
    walk.foot.s = dr.select(begins, 0, walk.foot.s)
    return dr.select(begins, 0, added)


def _open(kept: Suffix, opens: mi.Bool) -> None:
    """A new segment."""
    kept.C = dr.select(opens, mi.Color3f(0), kept.C)
    kept.T = dr.select(opens, mi.Color3f(1), kept.T)
    kept.count = dr.select(opens, kept.count + 1, kept.count)
    kept.late = dr.select(opens & (kept.query >= 0), kept.late + 1, kept.late)


def _roulette(
    walk: Walk, kept: Suffix, si: Any, sampler: Any, around: Surroundings, goes: mi.Bool, plain: bool
) -> None:
    """Stopping criterion: roulette, compensated in T; a guide has its own."""
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


def _note(kept: Suffix, si: Any, bounce: Bounce, opens: mi.Bool) -> None:
    """What the guide learns from."""
    kept.sampled = dr.select(opens, mi.luminance(mi.Color3f(bounce.light)), kept.sampled)
    to = mi.Float(bin_of(si.to_world(bounce.wo)))
    kept.bin = dr.select(opens, dr.select(bounce.delta | bounce.null, -1, to), kept.bin)


@dr.syntax
def resolve(records: Records, tail_value: Any, V: int, P: int) -> tuple[mi.Float, mi.Color3f]:
    """Targets by the backward walk: ([P * V * 4] L_s per slot, 0 beyond; L_s at the query vertex [P]).

    tail_value  [P] radiance that the cache gives for the tails, already attenuated.
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
        # A factor of zero ends the sum even where the rest is infinite.
        rest = mi.Color3f(T.x, T.y, T.z) * L
        L = mi.Color3f(C.x, C.y, C.z) + dr.select(mi.Color3f(T.x, T.y, T.z) == 0, 0, rest)
        dr.scatter(targets, mi.Vector4f(*L, 1), row)
        at_query[k == records.query] = L
        k -= 1
    return targets, at_query


def query_vertex(records: Records, V: int, P: int) -> tuple[Vertex, mi.Bool]:
    """[P] vertices at which rendering paths would have ended, and whether there is one."""
    found = records.query >= 0
    row = dr.arange(mi.UInt32, P) * V + mi.UInt32(dr.maximum(records.query, 0))
    return stored(records.features, row, found), found
