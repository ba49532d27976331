"""Sampling at a path vertex: light sampling and the next direction, from the BSDF alone or mixed with the guide."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from lightwell.backend import dr, mi
from lightwell.cache.guide import Guide, GuidedVertex
from lightwell.transport.path_state import aim_at_light, is_delta
from lightwell.transport.sources import Emitters


@dataclass
class Bounce:
    """Result of light sampling and direction sampling at a vertex. It is not a loop variable."""

    light: Any
    """[N] contribution of light sampling: BSDF * emitter weight * MIS weight."""
    wo: Any
    """[N] next direction in the local frame, unit."""
    pdf: Any
    """[N] its density per steradian."""
    weight: Any
    """[N] BSDF * cosine / density."""
    eta: Any
    """[N] relative index of refraction along the direction."""
    delta: Any
    """[N] whether it was sampled from a delta component."""
    null: Any
    """[N] whether the path passes straight through."""


def bounce_at(
    scene: Any, source: Emitters, sampler: Any, si: Any, bsdf: Any, smooth: mi.Bool, active: mi.Bool,
    guide: Guide | None = None, visit: GuidedVertex | None = None,
) -> Bounce:  # fmt: skip
    """Sample an emitter and the next direction at a vertex.

    Random numbers are drawn in the order of Mitsuba's ``path``. With a guide, directions come from the mixture of guide
    and BSDF, and both densities enter the weights.

    Args:
        scene: Mitsuba scene.
        source: Its emitters.
        sampler: Source of random numbers.
        si: Surface interactions, one per lane.
        bsdf: BSDFs of the interactions.
        smooth: Mask of the BSDFs with a component that is not a delta function.
        active: Mask of the active lanes.
        guide: ``Guide``; None: sample the BSDF alone.
        visit: The guide's ``GuidedVertex`` at this vertex; needed with a guide.

    Returns:
        Contribution of light sampling, the next direction, its density and its weight.
    """
    aimed = aim_at_light(scene, si, source, sampler.next_2d(), active & smooth)
    sample1, sample2 = sampler.next_1d(), sampler.next_2d()
    picks = mi.Bool(False)
    if guide is not None and visit is not None:
        # The same number chooses between guide and BSDF and then, rescaled, the BSDF's lobe.
        picks = sample1 < visit.share
        sample1 = dr.select(picks, sample1 / visit.share, (sample1 - visit.share) / (1 - visit.share))
    value, pdf, sample, weight = bsdf.eval_pdf_sample(
        mi.BSDFContext(), si, si.to_local(aimed.direction), sample1, sample2, active
    )  # fmt: skip
    # Most lights behind a surface, or whose back faces it, need no shadow ray.
    light = aimed.traced(scene, active & smooth & (dr.max(value) > 0))
    if guide is not None and visit is not None:
        pdf = dr.lerp(pdf, guide.pdf(visit.row, light.direction, light.seen), visit.share)
    lit = dr.select(light.seen, value * light.weight * light.mis(pdf), 0)
    null = mi.has_flag(sample.sampled_type, mi.BSDFFlags.Null)
    out = Bounce(lit, sample.wo, sample.pdf, weight, sample.eta, is_delta(sample), null)
    return out if guide is None or visit is None else _mixed(out, si, bsdf, guide, visit, sample2, picks, active)


def _mixed(
    own: Bounce, si: Any, bsdf: Any, guide: Guide, visit: GuidedVertex, u: mi.Point2f, picks: mi.Bool, active: mi.Bool
) -> Bounce:  # fmt: skip
    """Replace the BSDF's direction by the guide's where ``picks``, with the density of the mixture.

    Delta components are sampled by the BSDF alone, so their weight is divided by the probability of the BSDF.
    """
    picks = picks & active
    delta, null = own.delta & ~picks, own.null & ~picks
    d, _ = guide.sample(visit.row, u, picks)
    wo = dr.select(picks, si.to_local(d), own.wo)
    mixes = active & (visit.share > 0) & ~delta & ~null
    f, p = bsdf.eval_pdf(mi.BSDFContext(), si, wo, mixes)
    total = dr.lerp(p, guide.pdf(visit.row, si.to_world(wo), mixes), visit.share)
    # The BSDF's sampling marks an invalid sample with density 0; its direction must not be used.
    sound = (total > 0) & (picks | (own.pdf > 0))
    weight = dr.select(mixes, dr.select(sound, f / total, 0), own.weight / (1 - visit.share))
    pdf = dr.select(mixes, dr.select(sound, total, 0), own.pdf)
    return Bounce(own.light, wo, pdf, weight, dr.select(picks, 1, own.eta), delta, null)
