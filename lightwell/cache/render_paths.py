"""Rendering paths, which end in the cache, and the parts that they share with training paths.

Notation: N lanes; x1 is the primary hit, x2, x3 ... the following vertices; β the throughput from the camera, τ that of
one bounce.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from lightwell.backend import dr, mi
from lightwell.cache.bounces import Bounce, bounce_at
from lightwell.cache.features import Vertex
from lightwell.cache.guide import Guide, GuidedVertex
from lightwell.cache.materials import lookup
from lightwell.transport.radiance import RR_MAX, interaction_at, power_heuristic

# Larger reflectances come from a fallback of the plugin, not from a material.
MAX_REFLECTANCE = 1.0


class PathContext:
    """Parameters of paths beside the scene: box, materials and limits. Opaque numbers, so that kernels are reused."""

    DRJIT_STRUCT = {  # noqa: RUF012
        "low": mi.Point3f, "inverse": mi.Vector3f, "roughness": mi.Float, "albedo": mi.Float, "c": mi.Float,
        "max_depth": mi.UInt32, "rr_depth": mi.UInt32, "spike": mi.Float,
    }  # fmt: skip

    def __init__(self) -> None:
        self.low, self.inverse = mi.Point3f(0), mi.Vector3f(1)
        """Smallest corner of the scene's box and one over its edges."""
        self.roughness, self.albedo = mi.Float(0), mi.Float(0)
        """Arrays of ``materials.MaterialTable``."""
        self.c = mi.Float(0.01)
        """Termination threshold c of Müller et al. 2021."""
        self.max_depth, self.rr_depth = mi.UInt32(0xFFFFFFFF), mi.UInt32(5)
        """Largest path length, and depth from which Russian roulette may end a path."""
        self.spike = mi.Float(dr.inf)
        """Largest luminance of a caustic in one sample, where paths may end in the cache."""

    def vertex(self, si: mi.SurfaceInteraction3f, bsdf: Any, active: mi.Bool) -> Vertex:
        """Compute the network's inputs at surface points seen along ``si.wi``.

        Args:
            si: Surface interactions.
            bsdf: Their BSDFs.
            active: [N] mask of the active lanes.

        Returns:
            Vertices.
        """
        w = si.to_world(si.wi)
        n = mi.Vector3f(si.sh_frame.n)
        n = dr.select(dr.dot(n, w) < 0, -n, n)
        r, b = lookup(self.roughness, self.albedo, bsdf, si.wi.z, active)
        a = bsdf.eval_diffuse_reflectance(si, active)
        # Plugins without a diffuse lobe return their value at normal incidence, which is not a reflectance.
        diffuse = mi.has_flag(bsdf.flags(), mi.BSDFFlags.Diffuse)
        a = dr.select(diffuse & dr.isfinite(a), dr.clip(a, 0, MAX_REFLECTANCE), 0)
        return Vertex((si.p - self.low) * self.inverse, n, w, r, a, b)

    def inside(self, p: mi.Point3f) -> mi.Bool:
        """Test whether points lie in the scene's box; nothing is learned outside.

        Args:
            p: [N] points, metres.

        Returns:
            [N] mask.
        """
        q = (p - self.low) * self.inverse
        return dr.all((q >= 0) & (q <= 1))


def footprint(t: mi.Float, cosine: mi.Float) -> mi.Float:
    """Compute the footprint of a camera ray at its hit, independent of the pixel size: t² / (4π |cos|).

    Args:
        t: [N] distance from the camera, metres.
        cosine: [N] cosine between ray and normal.

    Returns:
        [N] areas, m².
    """
    return dr.square(t) * dr.inv_four_pi / dr.abs(cosine)


def spread(t: mi.Float, pdf: mi.Float, cosine: mi.Float) -> mi.Float:
    """Compute the square root of the footprint of a scattered ray at its hit.

    Args:
        t: [N] distance, metres.
        pdf: [N] density of the direction per steradian.
        cosine: [N] cosine between ray and normal.

    Returns:
        [N] lengths, metres; infinity, which ends the path, where the footprint is undefined.
    """
    density = pdf * dr.abs(cosine)
    return dr.select(density > 0, t * dr.rsqrt(density), dr.inf)


class PathSpread:
    """Footprint of a path since the primary hit (Bekaert et al. 2003; Müller et al. 2021)."""

    DRJIT_STRUCT = {  # noqa: RUF012
        "a0": mi.Float, "s": mi.Float, "run": mi.Float, "run_pdf": mi.Float, "scattered": mi.Bool,
    }  # fmt: skip

    def __init__(self) -> None:
        self.a0 = mi.Float(0)
        """Footprint of the primary hit."""
        self.s = mi.Float(0)
        """Square root of the footprint of the path."""
        self.run, self.run_pdf = mi.Float(0), mi.Float(0)
        """Distance since the last vertex that scattered (null interfaces do not) and density of the direction there;
        0 after delta bounces."""
        self.scattered = mi.Bool(False)
        """Whether there was such a vertex after the camera."""

    def arrive(self, si: Any, ray: Any) -> mi.Float:
        """Add the segment that ends at ``si``.

        Args:
            si: Surface interactions at the end of the segment.
            ray: Rays of the segment.

        Returns:
            [N] length that the vertex would add to ``s``, metres.
        """
        cosine = dr.dot(si.n, ray.d)
        self.run += si.t
        self.a0 = dr.select(self.scattered, self.a0, footprint(self.run, cosine))
        return dr.select(self.scattered & (self.run_pdf > 0), spread(self.run, self.run_pdf, cosine), 0)

    def leave(self, added: mi.Float, bounce: Bounce, active: mi.Bool) -> None:
        """Continue after a vertex.

        Args:
            added: [N] result of ``arrive``.
            bounce: Sampled directions at the vertex.
            active: [N] mask of the paths that continue.
        """
        self.s += dr.select(active & ~bounce.null, added, 0)
        self.run = dr.select(bounce.null, self.run, 0)
        self.run_pdf = dr.select(bounce.null, self.run_pdf, dr.select(bounce.delta, 0, bounce.pdf))
        self.scattered |= active & ~bounce.null

    def ratio(self) -> mi.Float:
        """Compute the footprint of the path over that of the primary hit.

        Returns:
            [N] ratio a / a0.
        """
        return dr.square(self.s) / self.a0


class PathState:
    """Loop variables that rendering and training paths share."""

    DRJIT_STRUCT = {  # noqa: RUF012
        "ray": mi.Ray3f, "β": mi.Spectrum, "η": mi.Float, "depth": mi.UInt32, "prev": mi.Interaction3f,
        "prev_pdf": mi.Float, "prev_delta": mi.Bool, "foot": PathSpread, "first": mi.Float, "active": mi.Bool,
    }  # fmt: skip

    def __init__(self, ray: Any = None) -> None:
        """Start paths.

        Args:
            ray: Rays [N]; None: to be set later.
        """
        self.ray = mi.Ray3f() if ray is None else mi.Ray3f(dr.detach(ray))
        self.β, self.η = mi.Spectrum(1), mi.Float(1)
        """Throughput and product of refractive indices, from the camera; in training paths from the query vertex."""
        self.depth = mi.UInt32(0)
        """Vertices left behind; in training paths since the query vertex."""
        self.prev = dr.zeros(mi.Interaction3f)
        """Vertex that the ray comes from."""
        self.prev_pdf, self.prev_delta = mi.Float(1), mi.Bool(True)
        """Density of the ray's direction there, and whether it was sampled from a delta component."""
        self.foot = PathSpread()
        self.first = mi.Float(0)
        """Contribution expected at the first vertex where the guide had data, see ``GuidedVertex.survival``."""
        self.active = mi.Bool(True)
        """Whether the path continues."""

    def emission(self, scene: Any, si: Any) -> mi.Spectrum:
        """Evaluate an emitter reached by BSDF sampling, with its MIS weight against light sampling.

        Args:
            scene: Mitsuba scene.
            si: Surface interactions at the end of the rays.

        Returns:
            [N] weighted radiance.
        """
        ds = mi.DirectionSample3f(scene, si, self.prev)
        em_pdf = scene.pdf_emitter_direction(self.prev, ds, self.active & ~self.prev_delta)
        weight = dr.detach(power_heuristic(self.prev_pdf, em_pdf))
        return weight * ds.emitter.eval(si, self.active & (self.prev_pdf > 0))

    def leave(self, si: Any, bounce: Bounce) -> None:
        """Continue in the sampled direction.

        Args:
            si: Surface interactions at the vertex.
            bounce: Sampled directions and their weights.
        """
        self.ray = si.spawn_ray(si.to_world(bounce.wo))
        self.β *= bounce.weight
        self.η *= bounce.eta
        self.prev = interaction_at(si)
        self.prev_pdf, self.prev_delta = bounce.pdf, bounce.delta

    def survival(self) -> mi.Float:
        """Compute the survival probability of Russian roulette from throughput and refraction.

        Returns:
            [N] probabilities up to ``RR_MAX``.
        """
        return dr.minimum(dr.max(self.β) * dr.square(self.η), RR_MAX)


class CacheQuery:
    """State of the query of the cache in a rendering path."""

    DRJIT_STRUCT = {"vertex": Vertex, "β": mi.Spectrum, "differs": mi.Bool}  # noqa: RUF012

    def __init__(self) -> None:
        self.vertex, self.β = Vertex(), mi.Spectrum(0)
        """biased: the query vertex and the throughput there; the value is added after the loop."""
        self.differs = mi.Bool(False)
        """difference: whether the path has reached its query vertex."""


@dr.syntax
def render_path(
    scene: Any, sampler: Any, ray: Any, around: PathContext, cache: Callable[[Any, Any], Any], q: mi.Float,
    caching: bool, estimator: str, first_direct: bool, guide: Guide | None = None,
) -> tuple[Any, mi.Bool, mi.UInt32, mi.Float]:  # fmt: skip
    """Estimate the radiance along one camera ray per lane.

    Args:
        scene: Mitsuba scene.
        sampler: Source of random numbers.
        ray: Camera rays, or a ``PathState`` in progress.
        around: Parameters of the paths.
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
    walk = ray if isinstance(ray, PathState) else PathState(ray)
    end = CacheQuery()
    L = mi.Spectrum(0)  # Radiance gathered
    valid = mi.Bool(False)  # A surface was hit
    supplied = mi.Bool(False)  # The ray left a primary hit whose direct light comes from elsewhere

    while dr.hint(walk.active, label="lightwell nrc"):
        si = scene.ray_intersect(walk.ray, mi.RayFlags.All, walk.depth == 0, walk.active)
        bsdf = si.bsdf(walk.ray)
        smooth = mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)

        # -------------------- Emission, reached by BSDF sampling --------------------

        met = walk.β * walk.emission(scene, si)
        if dr.hint(caching and estimator == "biased", mode="scalar"):
            met *= _uncut(walk, around, met)
        L += dr.select(supplied, 0, met)
        valid |= si.is_valid() & walk.active
        goes = walk.active & si.is_valid() & (walk.depth + 1 < around.max_depth)

        # --------------------- Footprint and termination into the cache -----------------

        added = mi.Float(0)
        if dr.hint(caching, mode="scalar"):
            added = walk.foot.arrive(si, walk.ray)
            L, goes = _query(walk, end, sampler, around, cache, si, bsdf, smooth, added, L, goes, q, estimator)

        # ------------------- Light sampling and the next direction -------------------

        visit, goes, _ = guided_visit(walk, guide, around, sampler, si, bsdf, goes)
        bounce = bounce_at(scene, sampler, si, bsdf, smooth, goes, guide, visit)
        here = mi.Bool(False)
        if dr.hint(not first_direct, mode="scalar"):
            here = (walk.depth == 0) & smooth
        L += dr.select(here, 0, walk.β * bounce.light)
        supplied = here & ~bounce.delta
        walk.leave(si, bounce)
        if dr.hint(caching, mode="scalar"):
            walk.foot.leave(added, bounce, goes)

        # --------------------------- Stopping criterion ---------------------------

        _go_on(walk, sampler, around, si, goes, guide is None)

    if dr.hint(caching and estimator == "difference", mode="scalar"):
        L = dr.select(end.differs, L, 0)
    if dr.hint(caching and estimator == "biased", mode="scalar"):
        ended = dr.any(end.β != 0)
        L += dr.select(ended, end.β * cache(end.vertex, ended), 0)
    return L, valid, walk.depth, walk.foot.ratio()


def guided_visit(
    walk: PathState, guide: Guide | None, around: PathContext, sampler: Any, si: Any, bsdf: Any, goes: mi.Bool
) -> tuple[GuidedVertex | None, mi.Bool, mi.Float]:  # fmt: skip
    """Look up the guide at a vertex and play its Russian roulette. Without a guide no random number is drawn.

    Args:
        walk: Path state; throughput and ``first`` are updated.
        guide: ``Guide`` or None.
        around: Parameters of the paths.
        sampler: Source of random numbers.
        si: Surface interactions.
        bsdf: Their BSDFs.
        goes: [N] mask of the active paths.

    Returns:
        Visit (None without a guide), mask of the paths that continue [N], and their survival probability [N].
    """
    if guide is None:
        return None, goes, mi.Float(1)
    visit = guide.visit(around, si, bsdf.flags(), sampler.next_1d(), goes)
    alive, walk.first = visit.survival(walk.β, walk.first, walk.depth)
    walk.β = dr.select(goes, walk.β * dr.rcp(alive), walk.β)
    return visit, goes & (visit.chance < alive), alive


def _go_on(walk, sampler, around, si, goes, plain: bool) -> None:
    """Russian roulette by the throughput; paths with a guide use the guide's instead."""
    walk.depth[si.is_valid() & walk.active] += 1
    β_max = dr.max(walk.β)
    walk.active = goes & (β_max != 0)
    if plain:
        survival = walk.survival()
        roulette = walk.depth >= around.rr_depth
        go_on = sampler.next_1d() < survival
        walk.β[roulette] *= dr.rcp(survival)
        walk.active &= ~roulette | go_on


def _query(walk, end, sampler, around, cache, si, bsdf, smooth, added, L, goes, q, estimator: str):
    """Where the footprint is wide, end the path in the cache or use the cache as a control variate.

    Returns (radiance so far, mask of the paths that continue).
    """
    wide = walk.foot.scattered & (dr.square(walk.foot.s + added) > around.c * walk.foot.a0)
    ends = goes & wide & smooth & around.inside(si.p)
    if estimator == "biased":
        end.vertex = dr.select(ends, around.vertex(si, bsdf, ends), end.vertex)
        end.β = dr.select(ends, walk.β, end.β)
        return L, goes & ~ends
    value = cache(around.vertex(si, bsdf, ends), ends)
    return _residual(walk, end, sampler, L, value, goes, ends, q, estimator)


def _uncut(walk: PathState, around: PathContext, met: mi.Spectrum) -> mi.Float:
    """Factor that limits caustics: emission reached from a scattering surface through mirrors or glass.

    Light sampling cannot find these paths, and one such sample would outweigh all others of its pixel. A path has a
    spread above 0 only after a surface that scatters.
    """
    caustic = walk.prev_delta & (walk.foot.s > 0)
    return dr.select(caustic, dr.minimum(1, around.spike / dr.maximum(mi.luminance(met), 1e-20)), 1)


def _residual(walk, end, sampler, L, value, goes, ends, q, estimator: str):
    """Control variate: L_s = L̂ + (L_s - L̂), where the bracket is estimated by roulette with probability q.

    The estimator 'difference' omits the first L̂ and all radiance before it.
    """
    go = sampler.next_1d(goes) < q
    first = mi.Bool(False)
    if estimator == "difference":
        first = ends & ~end.differs
        L = dr.select(first, 0, L)
        go |= first
        end.differs |= first
    kept = dr.select(first, -1, dr.select(go, 1 - dr.rcp(q), 1))
    L = L + dr.select(ends, walk.β * value * kept, 0)
    walk.β = dr.select(ends & go & ~first, walk.β * dr.rcp(q), walk.β)
    return L, goes & (~ends | go)
