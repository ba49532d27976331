"""Parameters of paths beside the scene."""

from __future__ import annotations

from typing import Any

from lightwell.backend import dr, mi
from lightwell.cache.features import Vertex
from lightwell.cache.materials import lookup
from lightwell.transport.sources import Emitters

# Larger reflectances come from a fallback of the plugin, not from a material.
MAX_REFLECTANCE = 1.0


class PathContext:
    """Parameters of paths beside the scene: box, materials and limits. Opaque numbers, so that kernels are reused."""

    DRJIT_STRUCT = {  # noqa: RUF012
        "low": mi.Point3f, "inverse": mi.Vector3f, "roughness": mi.Float, "albedo": mi.Float, "c": mi.Float,
        "max_depth": mi.UInt32, "rr_depth": mi.UInt32, "spike": mi.Float, "emitters": Emitters,
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
        self.emitters = Emitters()
        """All emitters of the scene. Shadow rays stop at panes, as those of Mitsuba do."""

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
