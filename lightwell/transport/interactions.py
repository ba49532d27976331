"""Surface interactions of given points: rebuilt exactly from (mesh, triangle, barycentric, view), without a ray."""

from __future__ import annotations

from typing import Any

import numpy as np

from lightwell.backend import dr, mi, upload_floats, upload_integers
from lightwell.scenes.scene import Scene
from lightwell.transport.samples import SurfacePoints
from lightwell.transport.tables import tables


def gather_interaction(scene: Scene, points: DevicePoints, row: mi.UInt32) -> mi.SurfaceInteraction3f:
    """Rebuild the surface interactions of points that are on the device.

    Args:
        scene: Scene of the points.
        points: N points on the device.
        row: Rows to gather, in [0, N).

    Returns:
        One interaction per row.
    """
    pi = dr.zeros(mi.PreliminaryIntersection3f, dr.width(row))
    pi.valid, pi.t = mi.Bool(True), mi.Float(0)
    shape = dr.gather(mi.UInt32, points.shape, row)
    pi.shape = dr.gather(mi.ShapePtr, scene.mi.shapes_dr(), shape)
    pi.shape_index = shape
    pi.prim_index = dr.gather(mi.UInt32, points.triangle, row)
    pi.prim_uv = dr.gather(mi.Point2f, points.barycentric, row)
    view = dr.gather(mi.Vector3f, points.view, row)
    ray = mi.Ray3f(mi.Point3f(0), -view)
    si = pi.compute_surface_interaction(ray, mi.RayFlags.All)
    ray.o = si.p + view
    return si


class DevicePoints:
    """``SurfacePoints`` on the device, from which kernels gather rows."""

    def __init__(self, points: SurfacePoints):
        """Upload points.

        Args:
            points: N points.
        """
        self.shape = upload_integers(points.shape)
        self.triangle = upload_integers(points.triangle)
        self.barycentric = upload(mi.Point2f, points.barycentric)
        self.view = upload(mi.Vector3f, points.view)


def upload(kind: Any, array: np.ndarray) -> Any:
    """Make a Dr.Jit vector of NumPy rows.

    Args:
        kind: Dr.Jit or Mitsuba vector type with C components, e.g. ``mi.Vector3f``.
        array: [N, C] numbers.

    Returns:
        A vector of type ``kind`` with N lanes, single precision.
    """
    # Columns of their own: as parts of one array, their offsets would be constants in the kernels that read them, each
    # of which would be compiled anew for every N.
    return kind(*map(upload_floats, np.asarray(array).T))


def interaction(scene: Scene, points: SurfacePoints) -> mi.SurfaceInteraction3f:
    """Rebuild the surface interactions of points from triangle and barycentric weights; no ray is traced.

    A view on the back of a triangle gives ``si.wi.z < 0``, which is what two-sided BSDFs expect.

    Args:
        scene: Scene of the points.
        points: N points.

    Returns:
        N interactions.
    """
    tables(scene)
    return gather_interaction(scene, DevicePoints(points), dr.arange(mi.UInt32, len(points)))


def coverage(si: mi.SurfaceInteraction3f, bsdf: mi.BSDFPtr) -> mi.Float:
    """Compute the share of light that a surface stops: its alpha where it is blended, else 1.

    Args:
        si: [N] surface interactions.
        bsdf: [N] their BSDFs.

    Returns:
        [N] shares in (0, 1].
    """
    blended = mi.has_flag(bsdf.flags(), mi.BSDFFlags.Null) & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
    alpha = 1 - bsdf.eval_null_transmission(si, blended).x
    return dr.select(blended & (alpha > 0), alpha, 1)


def reflects(si: mi.SurfaceInteraction3f, bsdf: mi.BSDFPtr, wo: mi.Vector3f) -> mi.Bool:
    """Test whether light from a direction belongs to a surface, and not to what is seen through it.

    Rasterisers draw what lies behind glass themselves, so that the light of the glass is what it reflects.

    Args:
        si: [N] surface interactions.
        bsdf: [N] their BSDFs.
        wo: [N] directions towards the light, local frame.

    Returns:
        [N] False where a BSDF that transmits light, sharply or blurred, has the direction on the far side.
    """
    flags = bsdf.flags()
    transmits = mi.has_flag(flags, mi.BSDFFlags.GlossyTransmission) | mi.has_flag(flags, mi.BSDFFlags.DeltaTransmission)
    # Thin panes of Mitsuba's have a lobe of their own for what goes straight through.
    transmits |= mi.has_flag(flags, mi.BSDFFlags.Null)
    return ~transmits | (mi.Frame3f.cos_theta(si.wi) * mi.Frame3f.cos_theta(wo) > 0)


def own_eval_pdf(
    si: mi.SurfaceInteraction3f, bsdf: mi.BSDFPtr, wo: mi.Vector3f, active: mi.Bool
) -> tuple[mi.Spectrum, mi.Float]:
    """Evaluate the BSDF of surfaces as if they covered all that is behind them, without what is seen through them.

    Args:
        si: [N] surface interactions.
        bsdf: [N] their BSDFs.
        wo: [N] directions towards the light, local frame.
        active: [N] lanes.

    Returns:
        [N] BSDF times cosine, and the density per steradian with which ``own_sample`` chooses the direction.
    """
    stopped = coverage(si, bsdf)
    value, pdf = bsdf.eval_pdf(mi.BSDFContext(), si, wo, active)
    return dr.select(reflects(si, bsdf, wo), value / stopped, 0), pdf / stopped


def own_sample(
    si: mi.SurfaceInteraction3f, bsdf: mi.BSDFPtr, lobe: mi.Float, u: mi.Point2f
) -> tuple[mi.BSDFSample3f, mi.Spectrum]:
    """Sample the BSDF of surfaces as if they covered all that is behind them, without what is seen through them.

    Args:
        si: [N] surface interactions.
        bsdf: [N] their BSDFs.
        lobe: [N] numbers in [0, 1) that choose the lobe.
        u: [N] points in [0, 1)² that choose the direction.

    Returns:
        [N] samples, with their density, and BSDF times cosine over density: 0 where a ray would go through.
    """
    stopped = coverage(si, bsdf)
    # Lobes come in the order covered, seen through.
    sample, weight = bsdf.sample(mi.BSDFContext(), si, lobe * stopped, u)
    sample.pdf /= stopped
    return sample, dr.select(reflects(si, bsdf, sample.wo), weight, 0)
