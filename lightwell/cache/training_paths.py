"""Training paths: they leave a record at every vertex, from which targets are worked out backwards.

A record is an open segment: what was gathered between its vertex and the next one (C) and the throughput between
the two (T). Then L_s[k] = C[k] + T[k] L_s[k + 1]. Delta vertices are passed through and leave no record.

Notation: P paths, V slots per path, row = path * V + slot.
"""

from __future__ import annotations

from typing import Any

from lightwell.backend import dr, mi
from lightwell.cache.features import WIDTH, Vertex, stored
from lightwell.cache.paths import RR_MAX, Surroundings, footprint, power, spread


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
        """[P * V * 4] C and T of each slot; the fourth number is unused."""
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


@dr.syntax
def trace_records(scene, sampler, ray, around: Surroundings, unbiased, V: int, P: int) -> Records:
    """Trace P training paths, one per lane, and leave their records.

    unbiased  mask of the paths that no cache value ends; they may be longer than V vertices.
    """
    ctx = mi.BSDFContext()
    out = Records()
    out.features = dr.zeros(mi.Float, P * V * WIDTH)
    out.gathered, out.through = dr.zeros(mi.Float, P * V * 4), dr.zeros(mi.Float, P * V * 4)
    features, gathered, through = out.features, out.gathered, out.through
    path = dr.arange(mi.UInt32, P)

    ray = mi.Ray3f(dr.detach(ray))
    β = mi.Spectrum(1)  # Throughput from the eye, from the query vertex on from there
    η = mi.Float(1)  # Product of the indices of refraction, likewise
    C, T = mi.Color3f(0), mi.Color3f(1)  # The open segment
    count = mi.UInt32(0)  # Slots in use
    query, prefix = mi.Int32(-1), mi.Color3f(0)
    tail, ended = Vertex(), mi.Bool(False)
    depth = mi.UInt32(0)  # Vertices left behind, from the query vertex on from there
    bounces = mi.UInt32(0)  # ... in all
    prev_si = dr.zeros(mi.Interaction3f)
    prev_pdf, prev_delta = mi.Float(1), mi.Bool(True)
    a0, s, run, run_pdf = mi.Float(0), mi.Float(0), mi.Float(0), mi.Float(0)
    scattered = mi.Bool(False)
    active = mi.Bool(True)

    while dr.hint(active, label="lightwell nrc training"):
        si = scene.ray_intersect(ray, mi.RayFlags.All, depth == 0, active)
        bsdf = si.bsdf(ray)

        # ---------------------- Emission, met by BSDF sampling ----------------------

        ds = mi.DirectionSample3f(scene, si, prev_si)
        em_pdf = scene.pdf_emitter_direction(prev_si, ds, active & ~prev_delta)
        Le = power(prev_pdf, em_pdf) * ds.emitter.eval(si, active & (prev_pdf > 0))
        C += dr.select(count > 0, T * Le, 0)
        active_next = active & si.is_valid() & (bounces + 1 < around.max_depth)

        # ------------------------------- Footprint -------------------------------

        smooth = mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
        cosine = dr.dot(si.n, ray.d)
        run += si.t
        a0 = dr.select(scattered, a0, footprint(run, cosine))
        added = dr.select(scattered & (run_pdf > 0), spread(run, run_pdf, cosine), 0)
        recordable = active_next & smooth & around.inside(si.p)
        wide = recordable & scattered & (dr.square(s + added) > around.c * a0)
        v = around.vertex(si, bsdf, recordable)

        # ------------------- The tail: the cache ends the suffix -------------------

        full = count >= V
        ends = ~unbiased & ((wide & (query >= 0)) | (recordable & full))
        tail = dr.select(ends, v, tail)
        ended |= ends
        active_next &= ~ends

        # ----------------- The query vertex: the suffix begins here -----------------

        begins = active_next & wide & (query < 0) & ~full
        query[begins] = mi.Int32(count)
        prefix[begins] = β
        β[begins] = mi.Spectrum(1)
        η[begins] = mi.Float(1)
        depth[begins] = mi.UInt32(0)
        s[begins] = mi.Float(0)
        added[begins] = mi.Float(0)

        # -------------------------------- A record --------------------------------

        opens = active_next & recordable & ~full
        closes = opens & (count > 0)
        before = path * V + count - 1
        dr.scatter(gathered, mi.Vector4f(*C, 0), before, closes)
        dr.scatter(through, mi.Vector4f(*T, 0), before, closes)
        v.store(features, path * V + count, opens)
        C[opens] = mi.Color3f(0)
        T[opens] = mi.Color3f(1)
        count[opens] += 1

        # ------------- Emitter sampling, BSDF value, and the next direction -------------

        active_em = active_next & smooth
        ds, em_weight = scene.sample_emitter_direction(si, sampler.next_2d(), True, active_em)
        active_em &= ds.pdf != 0
        sample1, sample2 = sampler.next_1d(), sampler.next_2d()
        bsdf_val, bsdf_pdf, bsdf_sample, bsdf_weight = bsdf.eval_pdf_sample(
            ctx, si, si.to_local(ds.d), sample1, sample2, active_next
        )
        mis_em = dr.select(ds.delta, 1, power(ds.pdf, bsdf_pdf))
        C += dr.select(active_em & (count > 0), T * bsdf_val * em_weight * mis_em, 0)

        # --------------------- Update of the loop variables ---------------------

        ray = si.spawn_ray(si.to_world(bsdf_sample.wo))
        delta = mi.has_flag(bsdf_sample.sampled_type, mi.BSDFFlags.Delta)
        null = mi.has_flag(bsdf_sample.sampled_type, mi.BSDFFlags.Null)
        s += dr.select(active_next & ~null, added, 0)
        run = dr.select(null, run, 0)
        run_pdf = dr.select(null, run_pdf, dr.select(delta, 0, bsdf_sample.pdf))
        scattered |= active_next & ~null
        β *= bsdf_weight
        T = dr.select(active_next, T * bsdf_weight, T)
        η *= bsdf_sample.eta
        prev_si = mi.Interaction3f(si.t, si.time, si.wavelengths, si.p, si.n)
        prev_pdf, prev_delta = bsdf_sample.pdf, delta

        # ---------------- Stopping criterion: roulette, compensated in T ----------------

        depth[si.is_valid() & active] += 1
        bounces[si.is_valid() & active] += 1
        β_max = dr.max(β)
        rr_prob = dr.minimum(β_max * dr.square(η), RR_MAX)
        rr_active = active_next & (depth >= around.rr_depth)
        go_on = sampler.next_1d() < rr_prob
        β[rr_active] *= dr.rcp(rr_prob)
        T[rr_active] *= dr.rcp(rr_prob)
        died = active_next & ((rr_active & ~go_on) | ~(β_max > 0))
        T[died] = mi.Color3f(0)
        active = active_next & ~died

    # A path that ended closes its last segment; nothing but a tail lies behind it.
    closes = count > 0
    dr.scatter(gathered, mi.Vector4f(*C, 0), path * V + count - 1, closes)
    dr.scatter(through, mi.Vector4f(*dr.select(ended, T, 0), 0), path * V + count - 1, closes)
    out.count, out.query, out.prefix, out.tail, out.ended = count, query, prefix, tail, ended
    out.unbiased = mi.Bool(unbiased)
    return out


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
