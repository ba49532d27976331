"""The two kinds of light paths: rendering paths, which end in the cache, and training paths, which leave records.

Notation: x1 is the primary hit, x2, x3 ... those behind it; β the throughput from the eye, τ that of one bounce.
"""

from __future__ import annotations

from typing import Any

from lightwell.backend import dr, mi
from lightwell.cache.features import Vertex
from lightwell.cache.materials import lookup

# Largest survival probability of the roulette; Mitsuba's path integrator.
RR_MAX = 0.95
# Reflectances beyond this are those of a fallback, not of a material.
MAX_REFLECTANCE = 1.0


class Surroundings:
    """What paths need beside the scene: the box, the materials, and the limits. Opaque, so that kernels are reused."""

    DRJIT_STRUCT = {  # noqa: RUF012
        "low": mi.Point3f, "inverse": mi.Vector3f, "roughness": mi.Float, "albedo": mi.Float, "c": mi.Float,
        "max_depth": mi.UInt32, "rr_depth": mi.UInt32,
    }  # fmt: skip

    def __init__(self):
        self.low, self.inverse = mi.Point3f(0), mi.Vector3f(1)
        """Smallest corner of the scene's box and one over its edges."""
        self.roughness, self.albedo = mi.Float(0), mi.Float(0)
        """``materials.MaterialTable``."""
        self.c = mi.Float(0.01)
        """Termination threshold in the paper's units."""
        self.max_depth, self.rr_depth = mi.UInt32(0xFFFFFFFF), mi.UInt32(5)

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


def power(a: mi.Float, b: mi.Float) -> mi.Float:
    """Power heuristic of two densities: the weight of the first."""
    a2 = dr.square(a)
    w = a2 / dr.fma(b, b, a2)
    return dr.detach(dr.select(dr.isfinite(w), w, 0))


@dr.syntax
def render_path(scene, sampler, ray, around, cache, q, caching: bool, estimator: str, first_direct: bool):
    """Radiance along one camera ray per lane.

    Parameters
      cache         Vertex, mask -> radiance; called at the query vertex.
      q             Probability that a path goes on behind a query, where the estimator lets it.
      caching       Whether paths may end in the cache at all; without it this is Mitsuba's ``path``.
      estimator     'biased': paths end in the cache. 'residual': the cache is a control variate at every vertex that
                    could end the path. 'difference': what a residual path adds to a biased one.
      first_direct  Whether direct light at the primary hit is counted (False: reservoirs supply it).
    returns         (L, valid, depth, a / a0 at the end): radiance, whether anything was hit, vertices.

    Papers: Müller et al. 2021 (termination, query), Bekaert et al. 2003 (footprints).
    """
    ctx = mi.BSDFContext()
    ray = mi.Ray3f(dr.detach(ray))
    L = mi.Spectrum(0)  # Radiance gathered
    β = mi.Spectrum(1)  # Throughput from the eye
    η = mi.Float(1)  # Product of the indices of refraction
    depth = mi.UInt32(0)  # Vertices left behind
    valid = mi.Bool(False)  # Something was met
    prev_si = dr.zeros(mi.Interaction3f)  # Vertex the ray comes from
    prev_pdf = mi.Float(1)  # Density of the ray's direction there
    prev_delta = mi.Bool(True)  # It came from a delta lobe
    a0 = mi.Float(0)  # Footprint of the primary hit
    s = mi.Float(0)  # Spread of the path
    run = mi.Float(0)  # Distance since the last vertex that scattered: null surfaces are none
    run_pdf = mi.Float(0)  # Density of the direction there; 0 after delta bounces
    scattered = mi.Bool(False)  # There was such a vertex behind the camera
    primary_direct = mi.Bool(False)  # The ray left a primary hit whose direct light comes from elsewhere
    active = mi.Bool(True)
    query = Vertex()  # Where the path ends in the cache
    query_β = mi.Spectrum(0)  # Throughput there
    differs = mi.Bool(False)  # difference: the path has met its query vertex

    while dr.hint(active, label="lightwell nrc"):
        si = scene.ray_intersect(ray, mi.RayFlags.All, depth == 0, active)
        bsdf = si.bsdf(ray)

        # ---------------------- Emission, met by BSDF sampling ----------------------

        ds = mi.DirectionSample3f(scene, si, prev_si)
        em_pdf = scene.pdf_emitter_direction(prev_si, ds, active & ~prev_delta)
        Le = β * power(prev_pdf, em_pdf) * ds.emitter.eval(si, active & (prev_pdf > 0))
        L += dr.select(primary_direct, 0, Le)
        valid |= si.is_valid() & active
        active_next = active & si.is_valid() & (depth + 1 < around.max_depth)

        # --------------------- Footprint, and the end in the cache ---------------------

        bsdf_flags = bsdf.flags()
        smooth = mi.has_flag(bsdf_flags, mi.BSDFFlags.Smooth)
        if dr.hint(caching, mode="scalar"):
            cosine = dr.dot(si.n, ray.d)
            run += si.t
            a0 = dr.select(scattered, a0, footprint(run, cosine))
            added = dr.select(scattered & (run_pdf > 0), spread(run, run_pdf, cosine), 0)
            wide = dr.square(s + added) > around.c * a0
            ends = active_next & scattered & wide & smooth & around.inside(si.p)
            if dr.hint(estimator != "biased", mode="scalar"):
                # L_s = L̂ + (L_s - L̂), the bracket by roulette; of a difference, the first L̂ is left out.
                go = sampler.next_1d(active_next) < q
                first = mi.Bool(False)
                if dr.hint(estimator == "difference", mode="scalar"):
                    first = ends & ~differs
                    L[first] = mi.Spectrum(0)
                    go |= first
                    differs |= first
                value = cache(around.vertex(si, bsdf, ends), ends)
                kept = dr.select(first, -1, dr.select(go, 1 - dr.rcp(q), 1))
                L += dr.select(ends, β * value * kept, 0)
                β[ends & go & ~first] *= dr.rcp(q)
                active_next &= ~ends | go
            else:
                query = dr.select(ends, around.vertex(si, bsdf, ends), query)
                query_β[ends] = β
                active_next &= ~ends

        # --------------------------- Emitter sampling ---------------------------

        active_em = active_next & smooth
        ds, em_weight = scene.sample_emitter_direction(si, sampler.next_2d(), True, active_em)
        active_em &= ds.pdf != 0
        wo = si.to_local(ds.d)

        # ------------------ BSDF value towards the light, and next direction ------------------

        sample1, sample2 = sampler.next_1d(), sampler.next_2d()
        bsdf_val, bsdf_pdf, bsdf_sample, bsdf_weight = bsdf.eval_pdf_sample(ctx, si, wo, sample1, sample2, active_next)
        mis_em = dr.select(ds.delta, 1, power(ds.pdf, bsdf_pdf))
        supplied = mi.Bool(False)
        if dr.hint(not first_direct, mode="scalar"):
            supplied = (depth == 0) & smooth
        L += dr.select(active_em & ~supplied, β * bsdf_val * em_weight * mis_em, 0)

        # --------------------- Update of the loop variables ---------------------

        ray = si.spawn_ray(si.to_world(bsdf_sample.wo))
        delta = mi.has_flag(bsdf_sample.sampled_type, mi.BSDFFlags.Delta)
        null = mi.has_flag(bsdf_sample.sampled_type, mi.BSDFFlags.Null)
        if dr.hint(caching, mode="scalar"):
            s += dr.select(active_next & ~null, added, 0)
            run = dr.select(null, run, 0)
            run_pdf = dr.select(null, run_pdf, dr.select(delta, 0, bsdf_sample.pdf))
            scattered |= active_next & ~null
        primary_direct = supplied & ~delta
        β *= bsdf_weight
        η *= bsdf_sample.eta
        prev_si = mi.Interaction3f(si.t, si.time, si.wavelengths, si.p, si.n)
        prev_pdf = bsdf_sample.pdf
        prev_delta = delta

        # --------------------------- Stopping criterion ---------------------------

        depth[si.is_valid() & active] += 1
        β_max = dr.max(β)
        rr_prob = dr.minimum(β_max * dr.square(η), RR_MAX)
        rr_active = depth >= around.rr_depth
        go_on = sampler.next_1d() < rr_prob
        β[rr_active] *= dr.rcp(rr_prob)
        active = active_next & (~rr_active | go_on) & (β_max != 0)

    if dr.hint(caching and estimator == "difference", mode="scalar"):
        L = dr.select(differs, L, 0)
    if dr.hint(caching and estimator == "biased", mode="scalar"):
        ended = dr.any(query_β != 0)
        L += dr.select(ended, query_β * cache(query, ended), 0)
    return L, valid, depth, dr.square(s) / a0
