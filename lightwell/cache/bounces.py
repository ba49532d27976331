"""What happens at a vertex: light sampled there, and the next direction; by the BSDF alone or beside the guide."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from lightwell.backend import dr, mi
from lightwell.cache.guide import Guide, Visit
from lightwell.transport.radiance import power_heuristic


@dataclass
class Bounce:
    """Light sampling, and the next direction. No loop carries it."""

    light: Any
    """Light sampling: BSDF * weight * MIS weight."""
    wo: Any
    pdf: Any
    weight: Any
    eta: Any
    delta: Any
    null: Any


def bounce_at(
    scene: Any, sampler: Any, si: Any, bsdf: Any, smooth: Any, active: Any, guide: Any = None, visit: Any = None
) -> Bounce:  # fmt: skip
    """Light sampling and BSDF sampling, drawing numbers as Mitsuba's ``path`` does; with a guide, both mixed."""
    active_em = active & smooth
    ds, em_weight = scene.sample_emitter_direction(si, sampler.next_2d(), True, active_em)
    active_em &= ds.pdf != 0
    sample1, sample2 = sampler.next_1d(), sampler.next_2d()
    picks = mi.Bool(False)
    if guide is not None:
        # One number chooses between guide and BSDF, and the BSDF's lobe.
        picks = sample1 < visit.share
        sample1 = dr.select(picks, sample1 / visit.share, (sample1 - visit.share) / (1 - visit.share))
    value, pdf, sample, weight = bsdf.eval_pdf_sample(
        mi.BSDFContext(), si, si.to_local(ds.d), sample1, sample2, active
    )  # fmt: skip
    if guide is not None:
        pdf = dr.lerp(pdf, guide.pdf(visit.row, ds.d, active_em), visit.share)
    mis = dr.select(ds.delta, 1, dr.detach(power_heuristic(ds.pdf, pdf)))
    light = dr.select(active_em, value * em_weight * mis, 0)
    has = lambda flag: mi.has_flag(sample.sampled_type, flag)  # noqa: E731
    delta, null = has(mi.BSDFFlags.Delta), has(mi.BSDFFlags.Null)
    out = Bounce(light, sample.wo, sample.pdf, weight, sample.eta, delta, null)
    return out if guide is None else _mixed(out, si, bsdf, guide, visit, sample2, picks, active)


def _mixed(
    own: Bounce, si: Any, bsdf: Any, guide: Guide, visit: Visit, u: mi.Point2f, picks: mi.Bool, active: mi.Bool
) -> Bounce:  # fmt: skip
    """The BSDF's direction, or the guide's where it ``picks``, with the density of both. Mirrors stay the BSDF's own,
    chosen so much more seldom."""
    picks = picks & active
    delta, null = own.delta & ~picks, own.null & ~picks
    d, _ = guide.sample(visit.row, u, picks)
    wo = dr.select(picks, si.to_local(d), own.wo)
    mixes = active & (visit.share > 0) & ~delta & ~null
    f, p = bsdf.eval_pdf(mi.BSDFContext(), si, wo, mixes)
    total = dr.lerp(p, guide.pdf(visit.row, si.to_world(wo), mixes), visit.share)
    # A direction that the BSDF's sampling refused is no direction, whatever its density.
    sound = (total > 0) & (picks | (own.pdf > 0))
    weight = dr.select(mixes, dr.select(sound, f / total, 0), own.weight / (1 - visit.share))
    pdf = dr.select(mixes, dr.select(sound, total, 0), own.pdf)
    return Bounce(own.light, wo, pdf, weight, dr.select(picks, 1, own.eta), delta, null)
