"""Paths: the kernel that estimates the radiance leaving surface points, one path per lane.

Notation: N points, P paths per half. One lane is one path; two independent halves of P paths belong to each point.

Algorithm: next-event estimation, BSDF sampling and (point lights) light rays of one segment, combined by the power
heuristic. Without light rays it is Mitsuba's ``path``, except that paths start on a surface and that the light is not
part of the scene. Without panes its value is that of ``path`` minus ``direct``.

Light of a point light or the sun passes holes, blended surfaces and clear glass in a straight line (``panes``).

Not supported: light of a point light or the sun by a mirror, or bent by glass (zero-measure paths: caustics are
missing; give the light a radius); participating media; polarisation.

Papers: Kajiya 1986 (path tracing); Veach 1997 (multiple importance sampling, bidirectional path tracing).
"""

from __future__ import annotations

from lightwell.backend import dr, mi
from lightwell.transport.gather_rays import PASSED, goes_straight
from lightwell.transport.interactions import own_eval_pdf, own_sample
from lightwell.transport.path_numbers import next_2d
from lightwell.transport.path_state import PathState, aim_at_light, is_delta, power_heuristic
from lightwell.transport.sources import Source

# Longest path, counted as Mitsuba does (2 = direct light). In a closed room of albedo 0.8 longer ones hold 0.1 %.
MAX_DEPTH = 32
# Paths of direct light alone.
DIRECT_DEPTH = 2
# Paths of light that was reflected once before it reaches the query point.
FIRST_DEPTH = 3
# Depth from which Russian roulette may end a path; Mitsuba's default.
RR_DEPTH = 5
# Vertices of a path, from the query point on, that are connected to the end of a light ray: all of them. Compared with
# emitter sampling alone it takes 1.5 times as long and has a third of the variance (Cornell box, light anywhere).
CONNECTIONS = MAX_DEPTH


def trace(
    scene: mi.Scene,
    si: mi.SurfaceInteraction3f,
    source: Source,
    rng: mi.PCG32,
    first: tuple[mi.Float, mi.Point2f, mi.Point2f],
    max_depth: mi.UInt32,
    rr_depth: mi.UInt32,
    include_direct: bool,
    connections: int = CONNECTIONS,
    see_through: bool = True,
    one_bounce: bool = False,
    past_mirrors: bool = False,
) -> mi.Spectrum:
    """Estimate the radiance leaving ``si`` towards ``si.wi`` that comes from ``source``; one path per lane.

    Args:
        scene: Mitsuba scene: the geometry and BSDFs.
        si: Surface interactions where the paths start.
        source: Declared light (per lane) or the scene's emitters.
        rng: PCG32, one stream per lane.
        first: (number, 2D point, 2D point) in [0, 1) that choose the lobe and the direction of the first bounce and the
            direction of the light ray: see ``path_numbers``.
        max_depth: Longest path in Mitsuba's count (2 = direct light only); opaque.
        rr_depth: Depth from which Russian roulette may end a path; opaque.
        include_direct: Count light that reaches ``si`` from the source in a straight line. Otherwise paths that find
            the source at their first bounce are dropped, and emitter sampling starts at the second vertex.
        connections: Number of vertices, from the query point on, that are connected to the surface that one ray from a
            point light meets: it samples the bright spot next to a light near a wall. 0: as Mitsuba's ``path``.
        see_through: Where ``si`` lies on a blended surface (alpha) or on glass, include what is seen through it.
            Off: the light of the surface alone, as if its coverage were 1; a rasteriser draws what is behind itself.
        one_bounce: ``max_depth`` is 2: where no ray can find the source, the kernel has no loop over further bounces.
        past_mirrors: Directions that ``gather_rays.goes_straight`` calls so do not count as vertices behind the first.

    Returns:
        One estimate of the radiance per lane.
    """
    ends = one_bounce and not source.hits
    connections = 0 if one_bounce else connections
    L, z, path = _first_vertex(scene, si, source, rng, first, max_depth, include_direct, connections, see_through)
    if ends:
        return L
    limits = (max_depth, rr_depth)
    return _follow(scene, path, L, z, source, rng, limits, include_direct, connections, past_mirrors)


@dr.syntax
def _follow(scene, path, L, z, source, rng, limits, include_direct, connections, past_mirrors):
    """Follow paths from their first bounce; returns the radiance L with what they find."""
    max_depth, rr_depth = limits
    passed = mi.UInt32(0)
    while dr.hint(path.active, label="lightwell radiance"):
        si = scene.ray_intersect(path.ray, mi.RayFlags.All, False, path.active)
        bsdf = si.bsdf(path.ray)

        # ------------------ The source, met by BSDF sampling ------------------

        if dr.hint(source.hits, mode="scalar"):
            Le, mis = path.meet(scene, si, source)
            reflected = mi.Bool(include_direct or source.first_hit) | (path.depth > 1) | (passed > 0)
            L += dr.select(reflected, path.β * mis * Le, 0)

        # ------------------ Emitter sampling, and next direction ------------------

        goes = path.active & si.is_valid() & (path.depth + 1 < max_depth)
        rays = _ray_densities(path, si, connections, passed) if source.emits and connections > 0 else None
        light, sample, weight = _next_vertex(scene, si, bsdf, source, rng, goes, rays)
        L += path.β * light
        if dr.hint(source.emits and connections > 1, mode="scalar"):
            joined = goes & (path.depth < connections) & (path.depth + 2 < max_depth)
            L += path.β * _connect(scene, si, bsdf, source, z, joined)

        # ------------------- Loop variables and stopping criterion -------------------

        path.leave(si, sample.wo, sample.pdf, weight, sample.eta, is_delta(sample))
        factor, alive = path.roulette(rr_depth, rng.next_float32())
        path.β *= factor
        path.active = goes & alive
        path.depth += 1
        if dr.hint(past_mirrors, mode="scalar"):
            straight = goes_straight(sample) & (passed < PASSED)
            passed += dr.select(straight, 1, 0)
            path.depth -= dr.select(straight, 1, 0)
        if dr.hint(not source.hits, mode="scalar"):
            # The ray of a longest path would find nothing: the source cannot be met.
            path.active &= path.depth + 1 < max_depth
    return L


def _ray_densities(path, si, connections, passed):
    """Lanes that light rays could have found, if the vertex before was connected to them, and their density by area."""
    both = (path.depth <= connections) & ~path.prev_delta & (passed == 0)
    return both, path.prev_pdf * dr.abs(dr.dot(si.n, path.ray.d)) / dr.square(si.t)


def _first_vertex(scene, si, source, rng, first, max_depth, include_direct, connections, see_through):
    """Sample the light at the query point, and the direction in which the path leaves.

    Returns radiance, the end of the light ray (None without), and the path.
    """
    bsdf, (lobe, direction, light) = si.bsdf(), first
    L, z = mi.Spectrum(0), None
    if include_direct or source.first_hit:
        L += _direct(scene, si, bsdf, source, rng, see_through, include_direct)
    if source.emits and connections > 0:
        z, factor = source.vertex(scene, si, light, rng)
        L += factor * _connect(scene, si, bsdf, source, z, mi.Bool(max_depth > 2), see_through)
    if see_through:
        sample, β = bsdf.sample(mi.BSDFContext(), si, lobe, direction)
    else:
        sample, β = own_sample(si, bsdf, lobe, direction)
    path = PathState()
    path.leave(si, sample.wo, mi.Float(sample.pdf), β, mi.Float(sample.eta), is_delta(sample))
    path.depth, path.active = mi.UInt32(1), dr.max(path.β) != 0
    return L, z, path


def _next_vertex(scene, si, bsdf, source, rng, active, rays):
    """Sample the source at a later vertex, and the direction in which the path continues.

    ``rays``: lanes that light rays could have found, and their density per area by the BSDF; None without light rays.

    Returns radiance (without the throughput up to here), the BSDF sample and its weight.
    """
    smooth = active & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
    aimed = aim_at_light(scene, si, source, next_2d(rng), smooth)
    value, pdf, sample, weight = bsdf.eval_pdf_sample(
        mi.BSDFContext(), si, si.to_local(aimed.direction), rng.next_float32(), next_2d(rng), active
    )
    light = aimed.traced(scene, smooth & (dr.max(value) > 0))
    mis = light.mis(pdf)
    if rays is not None:
        both, by_bsdf = rays
        stops = light.chance if source.panes is None else light.chance * (1 - source.panes.passes(si, active)[1])
        mis = dr.select(both, power_heuristic(by_bsdf, source.often * _light_density(source, si) * stops), 1)
    return dr.select(light.seen, mis * value * light.weight, 0), sample, weight


def _light_density(source, si) -> mi.Float:
    """Compute the density per area at which light rays meet the surface at ``si``."""
    offset = source.position - si.p
    distance2 = dr.squared_norm(offset)
    return dr.inv_four_pi * dr.abs(dr.dot(si.n, offset)) * dr.rsqrt(distance2) / distance2


def _connect(scene, si, bsdf, source, z, active, see_through=True) -> mi.Spectrum:
    """Connect ``si`` to the light vertex ``z``, with the MIS weight against BSDF sampling, which could find z too."""
    ctx = mi.BSDFContext()
    z, T, chance = z
    offset = z.p - si.p
    distance2 = dr.squared_norm(offset)
    direction = offset * dr.rsqrt(distance2)
    z = mi.SurfaceInteraction3f(z)
    to_light = dr.normalize(source.position - z.p)
    z.wi = z.to_local(-direction)
    cosine = dr.abs(dr.dot(z.n, direction))
    density = _light_density(source, z) * chance
    active &= z.is_valid() & (distance2 > 0) & (cosine > 0) & (density > 0)
    active &= ~scene.ray_test(si.spawn_ray_to(z.p), active)
    value, pdf = _value(si, bsdf, direction, active, see_through)
    reflected = z.bsdf().eval(ctx, z, z.to_local(to_light), active) / dr.squared_norm(source.position - z.p)
    mis = power_heuristic(source.often * density, pdf * cosine / distance2)
    return dr.select(active, mis * value * reflected * T * cosine / (distance2 * density), 0)


def _direct(scene, si, bsdf, source, rng, see_through, whole) -> mi.Spectrum:
    """Estimate direct light of the source at ``si``: one emitter sample with its MIS weight; all of it, or no sun."""
    smooth = mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
    aimed = aim_at_light(scene, si, source, next_2d(rng), smooth)
    value, pdf = _value(si, bsdf, aimed.direction, smooth, see_through)
    light = aimed.traced(scene, smooth & (dr.max(value) > 0))
    return dr.select(light.seen & (mi.Bool(whole) | ~light.delta), light.mis(pdf) * value * light.weight, 0)


def _value(si, bsdf, direction, active, see_through) -> tuple[mi.Spectrum, mi.Float]:
    """BSDF times cosine and its density towards a light; without ``see_through`` those of the surface alone."""
    wo = si.to_local(direction)
    if see_through:
        value, pdf = bsdf.eval_pdf(mi.BSDFContext(), si, wo, active)
        return value, pdf
    return own_eval_pdf(si, bsdf, wo, active)
