"""Rendering paths, which end in the cache, and what they share with training paths.

Notation: x1 is the primary hit, x2, x3 ... those behind it; β the throughput from the eye, τ that of one bounce.
"""

from __future__ import annotations

from typing import Any

from lightwell.backend import dr, mi
from lightwell.cache.bounces import Bounce, bounce_at
from lightwell.cache.features import Vertex
from lightwell.cache.materials import lookup
from lightwell.transport.radiance import RR_MAX, interaction_at, power_heuristic

# Reflectances beyond this are those of a fallback, not of a material.
MAX_REFLECTANCE = 1.0


class Surroundings:
    """What paths need beside the scene: the box, the materials, and the limits. Opaque, so that kernels are reused."""

    DRJIT_STRUCT = {  # noqa: RUF012
        "low": mi.Point3f, "inverse": mi.Vector3f, "roughness": mi.Float, "albedo": mi.Float, "c": mi.Float,
        "max_depth": mi.UInt32, "rr_depth": mi.UInt32, "spike": mi.Float,
    }  # fmt: skip

    def __init__(self):
        self.low, self.inverse = mi.Point3f(0), mi.Vector3f(1)
        """Smallest corner of the scene's box and one over its edges."""
        self.roughness, self.albedo = mi.Float(0), mi.Float(0)
        """``materials.MaterialTable``."""
        self.c = mi.Float(0.01)
        """Termination threshold in the paper's units."""
        self.max_depth, self.rr_depth = mi.UInt32(0xFFFFFFFF), mi.UInt32(5)
        self.spike = mi.Float(dr.inf)
        """Largest luminance that one sample may gather by a caustic, where paths may end in the cache."""

    def vertex(self, si: mi.SurfaceInteraction3f, bsdf: Any, active: mi.Bool) -> Vertex:
        """The network's inputs at a surface, seen along ``si.wi``."""
        w = si.to_world(si.wi)
        n = mi.Vector3f(si.sh_frame.n)
        n = dr.select(dr.dot(n, w) < 0, -n, n)
        r, b = lookup(self.roughness, self.albedo, bsdf, si.wi.z, active)
        a = bsdf.eval_diffuse_reflectance(si, active)
        # Plugins without a diffuse lobe answer with their value at normal incidence, which is no reflectance.
        diffuse = mi.has_flag(bsdf.flags(), mi.BSDFFlags.Diffuse)
        a = dr.select(diffuse & dr.isfinite(a), dr.clip(a, 0, MAX_REFLECTANCE), 0)
        return Vertex((si.p - self.low) * self.inverse, n, w, r, a, b)

    def inside(self, p: mi.Point3f) -> mi.Bool:
        """Whether a point lies in the scene's box: outside nothing was learned."""
        q = (p - self.low) * self.inverse
        return dr.all((q >= 0) & (q <= 1))


def footprint(t: mi.Float, cosine: mi.Float) -> mi.Float:
    """Area that a pixel-independent camera ray stands for at its hit: t^2 / (4 pi |cos|)."""
    return dr.square(t) * dr.inv_four_pi / dr.abs(cosine)


def spread(t: mi.Float, pdf: mi.Float, cosine: mi.Float) -> mi.Float:
    """Root of the area that a scattered ray stands for at its hit; infinite (the path ends) where undefined."""
    density = pdf * dr.abs(cosine)
    return dr.select(density > 0, t * dr.rsqrt(density), dr.inf)


class Spread:
    """How far a path has spread since the primary hit (Bekaert et al. 2003; Müller et al. 2021)."""

    DRJIT_STRUCT = {  # noqa: RUF012
        "a0": mi.Float, "s": mi.Float, "run": mi.Float, "run_pdf": mi.Float, "scattered": mi.Bool,
    }  # fmt: skip

    def __init__(self):
        self.a0 = mi.Float(0)
        """Footprint of the primary hit."""
        self.s = mi.Float(0)
        """Root of the area that the path stands for."""
        self.run, self.run_pdf = mi.Float(0), mi.Float(0)
        """Distance since the last vertex that scattered (null surfaces are none), and the density of the direction
        there; 0 after delta bounces."""
        self.scattered = mi.Bool(False)
        """There was such a vertex behind the camera."""

    def arrive(self, si: Any, ray: Any) -> mi.Float:
        """Take in the segment that ends at ``si``; returns what the vertex would add to ``s``."""
        cosine = dr.dot(si.n, ray.d)
        self.run += si.t
        self.a0 = dr.select(self.scattered, self.a0, footprint(self.run, cosine))
        return dr.select(self.scattered & (self.run_pdf > 0), spread(self.run, self.run_pdf, cosine), 0)

    def leave(self, added: mi.Float, bounce: Bounce, active: mi.Bool) -> None:
        """Go on behind a vertex."""
        self.s += dr.select(active & ~bounce.null, added, 0)
        self.run = dr.select(bounce.null, self.run, 0)
        self.run_pdf = dr.select(bounce.null, self.run_pdf, dr.select(bounce.delta, 0, bounce.pdf))
        self.scattered |= active & ~bounce.null

    def ratio(self) -> mi.Float:
        """a / a0."""
        return dr.square(self.s) / self.a0


class Walk:
    """The variables of a path that both kinds of loops carry along."""

    DRJIT_STRUCT = {  # noqa: RUF012
        "ray": mi.Ray3f, "β": mi.Spectrum, "η": mi.Float, "depth": mi.UInt32, "prev": mi.Interaction3f,
        "prev_pdf": mi.Float, "prev_delta": mi.Bool, "foot": Spread, "first": mi.Float, "active": mi.Bool,
    }  # fmt: skip

    def __init__(self, ray=None):
        self.ray = mi.Ray3f() if ray is None else mi.Ray3f(dr.detach(ray))
        self.β, self.η = mi.Spectrum(1), mi.Float(1)
        """Throughput from the eye and product of the indices of refraction; training paths count from the query on."""
        self.depth = mi.UInt32(0)
        """Vertices left behind; likewise."""
        self.prev = dr.zeros(mi.Interaction3f)
        """Vertex that the ray comes from."""
        self.prev_pdf, self.prev_delta = mi.Float(1), mi.Bool(True)
        """Density of the ray's direction there; it came from a delta lobe."""
        self.foot = Spread()
        self.first = mi.Float(0)
        """What the path was expected to bring when the guide first knew."""
        self.active = mi.Bool(True)

    def emission(self, scene: Any, si: Any) -> mi.Spectrum:
        """Light of an emitter that BSDF sampling met, with its MIS weight against light sampling."""
        ds = mi.DirectionSample3f(scene, si, self.prev)
        em_pdf = scene.pdf_emitter_direction(self.prev, ds, self.active & ~self.prev_delta)
        weight = dr.detach(power_heuristic(self.prev_pdf, em_pdf))
        return weight * ds.emitter.eval(si, self.active & (self.prev_pdf > 0))

    def leave(self, si: Any, bounce: Bounce) -> None:
        """Step behind the vertex."""
        self.ray = si.spawn_ray(si.to_world(bounce.wo))
        self.β *= bounce.weight
        self.η *= bounce.eta
        self.prev = interaction_at(si)
        self.prev_pdf, self.prev_delta = bounce.pdf, bounce.delta

    def survival(self) -> mi.Float:
        """Probability that roulette lets the path go on."""
        return dr.minimum(dr.max(self.β) * dr.square(self.η), RR_MAX)


class Ending:
    """Where the cache comes into a rendering path."""

    DRJIT_STRUCT = {"vertex": Vertex, "β": mi.Spectrum, "differs": mi.Bool}  # noqa: RUF012

    def __init__(self):
        self.vertex, self.β = Vertex(), mi.Spectrum(0)
        """biased: the query vertex and the throughput there; the value is added behind the loop."""
        self.differs = mi.Bool(False)
        """difference: the path has met its query vertex."""


@dr.syntax
def render_path(
    scene, sampler, ray, around, cache, q, caching: bool, estimator: str, first_direct: bool, guide: Any = None
):  # fmt: skip
    """Radiance along one camera ray per lane.

    Parameters
      ray           Camera ray, or a ``Walk`` that is under way.
      cache         Vertex, mask -> radiance; called at the query vertex.
      q             Probability that a path goes on behind a query, where the estimator lets it.
      caching       Whether paths may end in the cache at all; without it this is Mitsuba's ``path``.
      estimator     'biased': paths end in the cache. 'residual': the cache is a control variate at every vertex that
                    could end the path. 'difference': what a residual path adds to a biased one.
      first_direct  Whether direct light at the primary hit is counted (False: reservoirs supply it).
      guide         None, or the ``Guide`` that directions are sampled from beside the BSDF.
    returns         (L, valid, depth, a / a0 at the end): radiance, whether anything was hit, vertices.

    Papers: Müller et al. 2021 (termination, query), Bekaert et al. 2003 (footprints).
    """
    walk = ray if isinstance(ray, Walk) else Walk(ray)
    end = Ending()
    L = mi.Spectrum(0)  # Radiance gathered
    valid = mi.Bool(False)  # Something was met
    supplied = mi.Bool(False)  # The ray left a primary hit whose direct light comes from elsewhere

    while dr.hint(walk.active, label="lightwell nrc"):
        si = scene.ray_intersect(walk.ray, mi.RayFlags.All, walk.depth == 0, walk.active)
        bsdf = si.bsdf(walk.ray)
        smooth = mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)

        # ---------------------- Emission, met by BSDF sampling ----------------------

        met = walk.β * walk.emission(scene, si)
        if dr.hint(caching and estimator == "biased", mode="scalar"):
            met *= _uncut(walk, around, met)
        L += dr.select(supplied, 0, met)
        valid |= si.is_valid() & walk.active
        goes = walk.active & si.is_valid() & (walk.depth + 1 < around.max_depth)

        # --------------------- Footprint, and the end in the cache ---------------------

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


def guided_visit(walk, guide, around, sampler, si, bsdf, goes):
    """The guide's view of a vertex, and its roulette: (visit, which lanes go on, with what probability). Draws no
    number without a guide."""
    if guide is None:
        return None, goes, mi.Float(1)
    visit = guide.visit(around, si, bsdf.flags(), sampler.next_1d(), goes)
    alive, walk.first = visit.survival(walk.β, walk.first, walk.depth)
    walk.β = dr.select(goes, walk.β * dr.rcp(alive), walk.β)
    return visit, goes & (visit.chance < alive), alive


def _go_on(walk, sampler, around, si, goes, plain: bool) -> None:
    """Roulette by the throughput; a guide has its own."""
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
    """Where the footprint is wide, the path ends in the cache, or takes it for a control variate: (L, who goes on)."""
    wide = walk.foot.scattered & (dr.square(walk.foot.s + added) > around.c * walk.foot.a0)
    ends = goes & wide & smooth & around.inside(si.p)
    if estimator == "biased":
        end.vertex = dr.select(ends, around.vertex(si, bsdf, ends), end.vertex)
        end.β = dr.select(ends, walk.β, end.β)
        return L, goes & ~ends
    value = cache(around.vertex(si, bsdf, ends), ends)
    return _residual(walk, end, sampler, L, value, goes, ends, q, estimator)


def _uncut(walk: Walk, around: Surroundings, met: mi.Spectrum) -> mi.Float:
    """The share that is kept of an emitter met through mirrors or glass from a surface that scatters (only behind one
    has a path any spread): no light sampling helps there, and one such sample would outweigh all others of its
    pixel."""
    caustic = walk.prev_delta & (walk.foot.s > 0)
    return dr.select(caustic, dr.minimum(1, around.spike / dr.maximum(mi.luminance(met), 1e-20)), 1)


def _residual(walk, end, sampler, L, value, goes, ends, q, estimator: str):
    """L_s = L̂ + (L_s - L̂), the bracket by roulette; of a difference, the first L̂ is left out and all before it."""
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
