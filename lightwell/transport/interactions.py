"""Points on the surfaces of a scene: rebuilt exactly from (mesh, triangle, barycentric, view), without a ray."""

from __future__ import annotations

import numpy as np

from lightwell.backend import dr, mi
from lightwell.scenes.scene import Scene
from lightwell.transport.samples import SurfacePoints
from lightwell.transport.tables import tables


def gather_interaction(scene: Scene, points: DevicePoints, row: mi.UInt32) -> mi.SurfaceInteraction3f:
    """The surface interactions of some rows of points that already live on the device."""
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
    """``SurfacePoints`` uploaded to the device, from which kernels gather their rows."""

    def __init__(self, points: SurfacePoints):
        self.shape = mi.UInt32(np.asarray(points.shape, np.uint32))
        self.triangle = mi.UInt32(np.asarray(points.triangle, np.uint32))
        self.barycentric = upload(mi.Point2f, points.barycentric)
        self.view = upload(mi.Vector3f, points.view)


def upload(kind, array: np.ndarray):
    """A Dr.Jit vector of type ``kind`` from [N, C] rows."""
    return kind(np.ascontiguousarray(np.asarray(array, np.float32).T))


def interaction(scene: Scene, points: SurfacePoints) -> mi.SurfaceInteraction3f:
    """The surface interactions of points, exact from triangle and barycentric weights; no ray is traced.

    A view on the back of a triangle gives ``si.wi.z < 0``, which is what two-sided BSDFs expect.
    """
    tables(scene)
    return gather_interaction(scene, DevicePoints(points), dr.arange(mi.UInt32, len(points)))
