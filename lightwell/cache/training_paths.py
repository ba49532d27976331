"""Training paths: each vertex leaves a record, and targets are computed backwards along the path.

A record is an open segment: the radiance gathered between its vertex and the next one (C) and the throughput between
both (T). Then L_s[k] = C[k] + T[k] L_s[k + 1]. Delta vertices leave no record; the path passes through them.

Notation: P paths, V slots per path, row = path * V + slot.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from lightwell.backend import dr, mi
from lightwell.cache.bounces import Bounce
from lightwell.cache.features import WIDTH, Vertex, stored
from lightwell.cache.guide import Guide, bin_of
from lightwell.cache.path_context import PathContext
from lightwell.cache.path_loop import Arrival, CachePath, follow


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
    """Loop variables of training paths beside ``CachePath``."""

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

    def begin(self, path: CachePath, added: mi.Float, begins: mi.Bool) -> mi.Float:
        """Begin the suffix at the query vertex: throughput, depth and spread restart there.

        Args:
            path: The paths.
            added: [P] length that the vertex adds to the spread, metres.
            begins: [P] paths at their query vertex.

        Returns:
            [P] length that the vertex adds to the spread of the suffix.
        """
        self.query = dr.select(begins, mi.Int32(self.count), self.query)
        self.prefix = dr.select(begins, mi.Color3f(path.β), self.prefix)
        path.β = dr.select(begins, mi.Spectrum(1), path.β)
        path.η = dr.select(begins, 1, path.η)
        path.depth = dr.select(begins, 0, path.depth)
        path.first = dr.select(begins, 0, path.first)
        path.foot.s = dr.select(begins, 0, path.foot.s)
        return dr.select(begins, 0, added)

    def open(self, opens: mi.Bool) -> None:
        """Begin a new segment.

        Args:
            opens: [P] paths that do.
        """
        self.C = dr.select(opens, mi.Color3f(0), self.C)
        self.T = dr.select(opens, mi.Color3f(1), self.T)
        self.count = dr.select(opens, self.count + 1, self.count)
        self.late = dr.select(opens & (self.query >= 0), self.late + 1, self.late)


@dataclass
class RecordVisitor:
    """Keeps records of the vertices of paths."""

    context: PathContext
    records: TrainingRecords
    """Receives the records; its tables are allocated."""
    unbiased: mi.Bool
    """[P] paths that no cache value ends."""
    shortest: mi.UInt32
    """Records from the query vertex before a cache value may end a path."""
    V: int
    """Slots per path."""
    path: mi.UInt32
    """[P] number of each path."""

    def meet(self, state: PathSuffix, path: CachePath, Le: mi.Spectrum, weight: mi.Float) -> None:
        """Add emission to the open segment, see ``Visitor``.

        Args:
            state: The open segments.
            path: The paths.
            Le: [P] radiance.
            weight: [P] weight against light sampling.
        """
        state.C += dr.select(state.count > 0, state.T * (weight * Le), 0)

    def arrive(
        self, state: PathSuffix, path: CachePath, sampler: Any, si: Any, bsdf: Any, smooth: mi.Bool
    ) -> Arrival:  # fmt: skip
        """Find the query vertex, and the vertex at which a prediction ends the path, see ``Visitor``.

        Args:
            state: The open segments.
            path: The paths; throughput, depth and spread restart at the query vertex.
            sampler: Not used.
            si: [P] surface interactions.
            bsdf: [P] their BSDFs.
            smooth: [P] whether a BSDF has a component that is not a delta function.

        Returns:
            Which paths continue, and which vertices may leave a record.
        """
        goes = path.active & si.is_valid() & (state.bounces + 1 < self.context.max_depth)
        added = path.foot.arrive(si, path.ray)
        recordable = goes & smooth & self.context.inside(si.p)
        wide = recordable & path.foot.wide(added, self.context.c)
        v = self.context.vertex(si, bsdf, recordable)
        full = state.count >= self.V
        ends = ~self.unbiased & ((wide & (state.query >= 0) & (state.late >= self.shortest)) | (recordable & full))
        state.tail = dr.select(ends, v, state.tail)
        state.ended |= ends
        goes &= ~ends
        added = state.begin(path, added, goes & wide & (state.query < 0) & ~full)
        return Arrival(goes, added, opens=recordable & ~full, vertex=v)

    def open(self, state: PathSuffix, path: CachePath, at: Arrival, alive: mi.Float) -> None:
        """Close the open segment and begin the next one, see ``Visitor``.

        Args:
            state: The open segments.
            path: The paths.
            at: Which paths continue, and which vertices may leave a record.
            alive: [P] probability with which the guide's roulette kept the path; it is compensated in T.
        """
        if at.went is not None:
            state.T = dr.select(at.went, dr.select(at.goes, state.T * dr.rcp(alive), 0), state.T)
        at.opens &= at.goes
        self.close(state, at.opens & (state.count > 0), state.T)
        at.vertex.store(self.records.features, self.path * self.V + state.count, at.opens)
        state.open(at.opens)

    def close(self, state: PathSuffix, closes: mi.Bool, T: mi.Color3f) -> None:
        """Store the open segments.

        Args:
            state: The open segments.
            closes: [P] which are stored.
            T: [P] their throughput.
        """
        row = self.path * self.V + state.count - 1
        dr.scatter(self.records.gathered, mi.Vector4f(*state.C, state.sampled), row, closes)
        dr.scatter(self.records.through, mi.Vector4f(*T, state.bin), row, closes)

    def bounce(
        self, state: PathSuffix, path: CachePath, at: Arrival, si: Any, bounce: Bounce, smooth: mi.Bool
    ) -> None:  # fmt: skip
        """Add sampled light, and the guide's training data, to the open segment, see ``Visitor``.

        Args:
            state: The open segments.
            path: The paths.
            at: Which paths continue.
            si: [P] surface interactions.
            bounce: Sampled light and directions.
            smooth: Not used.
        """
        state.sampled = dr.select(at.opens, mi.luminance(mi.Color3f(bounce.light)), state.sampled)
        to = mi.Float(bin_of(si.to_world(bounce.wo)))
        state.bin = dr.select(at.opens, dr.select(bounce.delta | bounce.null, -1, to), state.bin)
        state.C += dr.select(state.count > 0, state.T * bounce.light, 0)
        state.T = dr.select(at.goes, state.T * bounce.weight, state.T)

    def leave(self, state: PathSuffix, path: CachePath, at: Arrival, left: mi.Bool, factor: mi.Float) -> None:
        """Count the vertex, and compensate roulette in T, see ``Visitor``.

        Args:
            state: The open segments.
            path: The paths.
            at: Which paths continue.
            left: [P] whether a vertex was left.
            factor: [P] factor of the throughput.
        """
        state.bounces = dr.select(left, state.bounces + 1, state.bounces)
        state.T = dr.select(at.goes, state.T * factor, state.T)


def trace_records(
    scene: Any, sampler: Any, ray: Any, context: PathContext, unbiased: mi.Bool, shortest: mi.UInt32, V: int, P: int,
    guide: Guide | None = None,
) -> TrainingRecords:  # fmt: skip
    """Trace P training paths, one per lane, and store their records.

    Args:
        scene: Mitsuba scene.
        sampler: Source of random numbers.
        ray: [P] camera rays.
        context: Parameters of the paths.
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
    visitor = RecordVisitor(context, out, unbiased, shortest, V, dr.arange(mi.UInt32, P))
    _, kept = follow(scene, sampler, CachePath(ray), PathSuffix(), visitor, context, guide)
    # Close the last segment of each path; only a tail can follow it.
    visitor.close(kept, kept.count > 0, dr.select(kept.ended, kept.T, 0))
    out.count, out.query, out.prefix, out.tail, out.ended = kept.count, kept.query, kept.prefix, kept.tail, kept.ended
    out.unbiased = mi.Bool(unbiased)
    return out


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
