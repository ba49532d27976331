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
