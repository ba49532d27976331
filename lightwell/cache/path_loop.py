"""The loop that rendering and training paths share.

It follows Mitsuba's ``path``: emission reached by BSDF sampling, light sampling, the next direction, Russian roulette.
What differs, and where a path ends in the cache, is the task of a visitor: ``render_paths`` adds up radiance,
``training_paths`` keeps records. The loop of ``transport.radiance`` stays apart: its paths start on surfaces, have one
light each and are connected to rays from it, and footprint and guide would be state of its kernels for nothing. Both
loops take their steps from ``transport.path_state``, and tests hold both to Mitsuba's ``path``.

Notation: N lanes; β the throughput from the camera.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

from lightwell.backend import dr, mi
from lightwell.cache.bounces import Bounce, bounce_at
from lightwell.cache.footprint import PathSpread
from lightwell.cache.guide import Guide, GuidedVertex
from lightwell.cache.path_context import PathContext
from lightwell.transport.path_state import PathState

State = TypeVar("State", contravariant=True)


class CachePath(PathState):
    """Loop variables of rendering and training paths."""

    DRJIT_STRUCT = PathState.DRJIT_STRUCT | {"foot": PathSpread, "first": mi.Float}

    def __init__(self, ray: mi.Ray3f | None = None) -> None:
        """Start paths; in training paths throughput, depth and spread restart at the query vertex.

        Args:
            ray: [N] rays; None: to be set later.
        """
        super().__init__(ray)
        self.foot = PathSpread()
        self.first = mi.Float(0)
        """Contribution expected at the first vertex where the guide had data, see ``GuidedVertex.survival``."""


@dataclass
class Arrival:
    """What a visitor decides at a vertex. It is not a loop variable."""

    goes: mi.Bool
    """[N] paths that continue."""
    added: mi.Float | None = None
    """[N] length that the vertex adds to the spread of the path, metres; None: footprints are not followed."""
    went: mi.Bool | None = None
    """[N] those that continued before the guide's roulette; None: without a guide."""
    opens: mi.Bool | None = None
    """[N] training: vertices that may leave a record."""
    vertex: Any = None
    """[N] training: the network's inputs there."""


class Visitor(Protocol[State]):
    """What a kind of path does at its vertices; ``state`` holds its loop variables."""

    def meet(self, state: State, path: CachePath, Le: mi.Spectrum, weight: mi.Float) -> None:
        """Add emission that the rays found.

        Args:
            state: Loop variables of the visitor.
            path: The paths.
            Le: [N] radiance.
            weight: [N] weight against light sampling.
        """

    def arrive(self, state: State, path: CachePath, sampler: Any, si: Any, bsdf: Any, smooth: mi.Bool) -> Arrival:
        """Decide which paths continue from the vertices that they have reached.

        Args:
            state: Loop variables of the visitor.
            path: The paths.
            sampler: Source of random numbers.
            si: [N] surface interactions.
            bsdf: [N] their BSDFs.
            smooth: [N] whether a BSDF has a component that is not a delta function.

        Returns:
            Which paths continue.
        """
        ...

    def open(self, state: State, path: CachePath, at: Arrival, alive: mi.Float) -> None:
        """Begin at vertices that paths will leave, after the guide's roulette.

        Args:
            state: Loop variables of the visitor.
            path: The paths; the roulette is compensated in their throughput.
            at: Which paths continue.
            alive: [N] probability with which the roulette kept them.
        """

    def bounce(self, state: State, path: CachePath, at: Arrival, si: Any, bounce: Bounce, smooth: mi.Bool) -> None:
        """Add the light sampled at vertices.

        Args:
            state: Loop variables of the visitor.
            path: The paths.
            at: Which paths continue.
            si: [N] surface interactions.
            bounce: Sampled light and directions.
            smooth: [N] whether a BSDF has a component that is not a delta function.
        """

    def leave(self, state: State, path: CachePath, at: Arrival, left: mi.Bool, factor: mi.Float) -> None:
        """Note that paths have left a vertex.

        Args:
            state: Loop variables of the visitor.
            path: The paths.
            at: Which paths continue.
            left: [N] whether a vertex was left.
            factor: [N] factor that compensates Russian roulette in the throughput; it is applied afterwards.
        """


@dr.syntax
def follow(
    scene: mi.Scene, sampler: Any, path: CachePath, state: Any, visitor: Visitor[Any], context: PathContext,
    guide: Guide | None = None,
) -> tuple[CachePath, Any]:  # fmt: skip
    """Follow paths until all have ended.

    Args:
        scene: Mitsuba scene.
        sampler: Source of random numbers.
        path: State of the paths.
        state: Further loop variables, those of the visitor.
        visitor: What happens at the vertices.
        context: Parameters of the paths.
        guide: ``Guide`` that directions are sampled from beside the BSDF; None: the BSDF alone.

    Returns:
        ``path`` and ``state`` at the end.
    """
    while dr.hint(path.active, label="lightwell nrc"):
        si = scene.ray_intersect(path.ray, mi.RayFlags.All, path.depth == 0, path.active)
        bsdf = si.bsdf(path.ray)
        smooth = mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)

        # -------------------- Emission, reached by BSDF sampling --------------------

        Le, mis = path.meet(scene, si, context.emitters)
        visitor.meet(state, path, Le, mis)

        # ------------------- End in the cache, or begin a vertex -------------------

        at = visitor.arrive(state, path, sampler, si, bsdf, smooth)
        visit, alive = _visit(path, guide, context, sampler, si, bsdf, at)
        visitor.open(state, path, at, alive)

        # ------------------- Light sampling and the next direction -------------------

        bounce = bounce_at(scene, context.emitters, sampler, si, bsdf, smooth, at.goes, guide, visit)
        visitor.bounce(state, path, at, si, bounce, smooth)
        path.leave(si, bounce.wo, bounce.pdf, bounce.weight, bounce.eta, bounce.delta)
        if dr.hint(at.added is not None, mode="scalar"):
            path.foot.leave(at.added, bounce, at.goes)

        # --------------------------- Stopping criterion ---------------------------

        left = si.is_valid() & path.active
        path.depth = dr.select(left, path.depth + 1, path.depth)
        factor, survives = _roulette(path, sampler, context, guide is None)
        visitor.leave(state, path, at, left, factor)
        path.β *= factor
        path.active = at.goes & survives
    return path, state


def _roulette(path: CachePath, sampler: Any, context: PathContext, plain: bool) -> tuple[mi.Float, mi.Bool]:
    """Russian roulette by the throughput; paths with a guide use the guide's instead."""
    if not plain:
        return mi.Float(1), dr.max(path.β) != 0
    return path.roulette(context.rr_depth, sampler.next_1d())


def _visit(
    path: CachePath, guide: Guide | None, context: PathContext, sampler: Any, si: Any, bsdf: Any, at: Arrival
) -> tuple[GuidedVertex | None, mi.Float]:
    """Look up the guide at a vertex and play its Russian roulette. Without a guide no random number is drawn.

    Returns the visit (None without a guide) and the survival probability [N].
    """
    if guide is None:
        return None, mi.Float(1)
    visit = guide.visit(context, si, bsdf.flags(), sampler.next_1d(), at.goes)
    alive, path.first = visit.survival(path.β, path.first, path.depth)
    path.β = dr.select(at.goes, path.β * dr.rcp(alive), path.β)
    at.went, at.goes = at.goes, at.goes & (visit.chance < alive)
    return visit, alive
