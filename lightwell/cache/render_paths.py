"""Rendering paths, which end in the cache.

Notation: N lanes; β the throughput from the camera.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from lightwell.backend import dr, mi
from lightwell.cache.bounces import Bounce
from lightwell.cache.features import Vertex
from lightwell.cache.guide import Guide
from lightwell.cache.path_context import PathContext
from lightwell.cache.path_loop import Arrival, CachePath, follow


class RadianceState:
    """Loop variables of rendering paths beside ``CachePath``."""

    DRJIT_STRUCT = {  # noqa: RUF012
        "L": mi.Spectrum, "valid": mi.Bool, "supplied": mi.Bool, "vertex": Vertex, "β": mi.Spectrum,
        "differs": mi.Bool,
    }  # fmt: skip

    def __init__(self) -> None:
        """Start without radiance."""
        self.L, self.valid = mi.Spectrum(0), mi.Bool(False)
        """Radiance gathered, and whether a surface was hit."""
        self.supplied = mi.Bool(False)
        """Whether the ray left a primary hit whose direct light comes from elsewhere."""
        self.vertex, self.β = Vertex(), mi.Spectrum(0)
        """biased: the query vertex and the throughput there; the cache is added after the loop."""
        self.differs = mi.Bool(False)
        """difference: whether the path has reached its query vertex."""


@dataclass
class RadianceVisitor:
    """Adds up the radiance along paths, and ends them in the cache."""

    context: PathContext
    cache: Callable[[Any, Any], Any]
    """Radiance [N] of vertices where a mask is true."""
    q: mi.Float
    """Probability that a path continues behind a query, for the estimators with a control variate."""
    caching: bool
    """Whether paths may end in the cache at all."""
    estimator: str
    """See ``render_path``."""
    first_direct: bool
    """Whether direct light at the primary hit is counted."""

    def meet(self, state: RadianceState, path: CachePath, Le: mi.Spectrum, weight: mi.Float) -> None:
        """Add emission, see ``Visitor``.

        Args:
            state: Radiance so far.
            path: The paths.
            Le: [N] radiance.
            weight: [N] weight against light sampling.
        """
        met = path.β * (weight * Le)
        if self.caching and self.estimator == "biased":
            met *= _limited(path, self.context, met)
        state.L += dr.select(state.supplied, 0, met)

    def arrive(
        self, state: RadianceState, path: CachePath, sampler: Any, si: Any, bsdf: Any, smooth: mi.Bool
    ) -> Arrival:  # fmt: skip
        """End paths whose footprint is wide, see ``Visitor``.

        Args:
            state: Radiance so far.
            path: The paths.
            sampler: Source of random numbers.
            si: [N] surface interactions.
            bsdf: [N] their BSDFs.
            smooth: [N] whether a BSDF has a component that is not a delta function.

        Returns:
            Which paths continue.
        """
        state.valid |= si.is_valid() & path.active
        goes = path.active & si.is_valid() & (path.depth + 1 < self.context.max_depth)
        if not self.caching:
            return Arrival(goes)
        added = path.foot.arrive(si, path.ray)
        wide = path.foot.wide(added, self.context.c)
        ends = goes & wide & smooth & self.context.inside(si.p)
        vertex = self.context.vertex(si, bsdf, ends)
        if self.estimator == "biased":
            state.vertex = dr.select(ends, vertex, state.vertex)
            state.β = dr.select(ends, path.β, state.β)
            return Arrival(goes & ~ends, added)
        return Arrival(self._continues(state, path, sampler, self.cache(vertex, ends), goes, ends), added)

    def _continues(
        self, state: RadianceState, path: CachePath, sampler: Any, value: Any, goes: mi.Bool, ends: mi.Bool
    ) -> mi.Bool:  # fmt: skip
        """Control variate: L_s = L̂ + (L_s - L̂), where the bracket is estimated by roulette with probability q.

        The estimator 'difference' omits the first L̂ and all radiance before it.
        """
        q, go, first = self.q, sampler.next_1d(goes) < self.q, mi.Bool(False)
        if self.estimator == "difference":
            first = ends & ~state.differs
            state.L = dr.select(first, 0, state.L)
            go |= first
            state.differs |= first
        kept = dr.select(first, -1, dr.select(go, 1 - dr.rcp(q), 1))
        state.L = state.L + dr.select(ends, path.β * value * kept, 0)
        path.β = dr.select(ends & go & ~first, path.β * dr.rcp(q), path.β)
        return goes & (~ends | go)

    def open(self, state: RadianceState, path: CachePath, at: Arrival, alive: mi.Float) -> None:
        """Do nothing: the guide's roulette is compensated in the throughput, see ``Visitor``.

        Args:
            state: Radiance so far.
            path: The paths.
            at: Which paths continue.
            alive: [N] their probability.
        """

    def bounce(
        self, state: RadianceState, path: CachePath, at: Arrival, si: Any, bounce: Bounce, smooth: mi.Bool
    ) -> None:  # fmt: skip
        """Add sampled light, see ``Visitor``.

        Args:
            state: Radiance so far.
            path: The paths.
            at: Which paths continue.
            si: [N] surface interactions.
            bounce: Sampled light and directions.
            smooth: [N] whether a BSDF has a component that is not a delta function.
        """
        here = mi.Bool(False) if self.first_direct else (path.depth == 0) & smooth
        state.L += dr.select(here, 0, path.β * bounce.light)
        state.supplied = here & ~bounce.delta

    def leave(self, state: RadianceState, path: CachePath, at: Arrival, left: mi.Bool, factor: mi.Float) -> None:
        """Do nothing: roulette is compensated in the throughput, see ``Visitor``.

        Args:
            state: Radiance so far.
            path: The paths.
            at: Which paths continue.
            left: [N] whether a vertex was left.
            factor: [N] factor of the throughput.
        """


def render_path(
    scene: Any, sampler: Any, ray: Any, context: PathContext, cache: Callable[[Any, Any], Any], q: mi.Float,
    caching: bool, estimator: str, first_direct: bool, guide: Guide | None = None,
) -> tuple[Any, mi.Bool, mi.UInt32, mi.Float]:  # fmt: skip
    """Estimate the radiance along one camera ray per lane.

    Args:
        scene: Mitsuba scene.
        sampler: Source of random numbers.
        ray: Camera rays, or a ``CachePath`` in progress.
        context: Parameters of the paths.
        cache: Function of vertices and a mask, with radiance [N]; called at query vertices.
        q: Probability that a path continues behind a query, for the estimators with a control variate.
        caching: Whether paths may end in the cache at all; if not, this is Mitsuba's ``path``.
        estimator: 'biased': paths end in the cache. 'residual': the cache is a control variate at every vertex that
            could end the path. 'difference': the difference of a residual path and a biased one.
        first_direct: Whether direct light at the primary hit is counted (False: it comes from reservoirs).
        guide: ``Guide`` that directions are sampled from beside the BSDF; None: the BSDF alone.

    Returns:
        Radiance [N], mask of rays that hit a surface [N], number of vertices [N], and footprint over that of the
        primary hit at the end [N].

    Papers: Müller et al. 2021 (termination, query), Bekaert et al. 2003 (footprints).
    """
    path = ray if isinstance(ray, CachePath) else CachePath(ray)
    visitor = RadianceVisitor(context, cache, q, caching, estimator, first_direct)
    path, state = follow(scene, sampler, path, RadianceState(), visitor, context, guide)
    L = state.L
    if caching and estimator == "difference":
        L = dr.select(state.differs, L, 0)
    if caching and estimator == "biased":
        ended = dr.any(state.β != 0)
        L += dr.select(ended, state.β * cache(state.vertex, ended), 0)
    return L, state.valid, path.depth, path.foot.ratio()


def _limited(path: CachePath, context: PathContext, met: mi.Spectrum) -> mi.Float:
    """Factor that limits caustics: emission reached from a scattering surface through mirrors or glass.

    Light sampling cannot find these paths, and one such sample would outweigh all others of its pixel. A path has a
    spread above 0 only after a surface that scatters.
    """
    caustic = path.prev_delta & (path.foot.s > 0)
    return dr.select(caustic, dr.minimum(1, context.spike / dr.maximum(mi.luminance(met), 1e-20)), 1)
