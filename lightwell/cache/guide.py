"""The guide: the distribution of incident light by position and orientation, learned from training records.

A table of cells (subdivisions of the scene's box, times six orientations of the surface). Each cell has a distribution
over directions, piecewise constant on a grid of equal solid angles, and the mean radiance that its surfaces scatter.
Paths sample the distribution beside the BSDF, and the means control Russian roulette. Both are unbiased for any content
of the table, as long as it does not change while an image is rendered.

The cell of a vertex is that of its position displaced by up to half a cell at random, which turns the borders of cells
into noise.

Papers: Müller, Gross, Novák 2017, *Practical Path Guiding* (learning from paths, mixture with BSDF sampling); Vorba,
Křivánek 2016, *Adjoint-Driven Russian Roulette and Splitting*; Clarberg et al. 2005 (hierarchical sample warping).
"""

from __future__ import annotations

from typing import Any

from lightwell.backend import dr, mi
from lightwell.cache.features import side
from lightwell.cache.sobol_sampler import mixed

# Directions: a grid of SIDE x SIDE bins, columns by azimuth, rows by cosine: all of one solid angle.
LOG2 = 4
SIDE = 1 << LOG2
BINS = SIDE * SIDE
# The tree above the bins: level k has 4^k nodes of four children's probabilities, and starts at OFFSETS[k].
OFFSETS = tuple((4**k - 1) // 3 for k in range(LOG2 + 1))
NODES = OFFSETS[LOG2]
# Orientations of a cell: the axis that the normal is nearest to, and its sign.
FACES = 6
# Smallest survival probability of the guide's roulette; depth from which the largest one is MOST and not one.
LEAST, LONG, MOST = 0.1, 32, 0.9


class Guide:
    """Table of the guide as kernels read it. Row 0 means no data: uniform directions, level 0."""

    DRJIT_STRUCT = {  # noqa: RUF012
        "cells": mi.Vector3f, "rows": mi.UInt32, "tree": mi.Float, "density": mi.Float, "level": mi.Float,
        "share": mi.Float,
    }  # fmt: skip

    def __init__(self) -> None:
        """Make a table with one row, without data."""
        self.cells = mi.Vector3f(1)
        """Cells along the axes, whole numbers."""
        self.rows = mi.UInt32(0)
        """[x y z * FACES] row of each cell."""
        self.tree = mi.Float(0)
        """[R * NODES * 4] probabilities of the children of a node, given the node."""
        self.density = mi.Float(0)
        """[R * BINS] probability density per steradian."""
        self.level = mi.Float(0)
        """[R] mean scattered luminance."""
        self.share = mi.Float(0)
        """Probability that a vertex samples the guide and not its BSDF."""

    def row(self, p: mi.Point3f, n: mi.Vector3f, active: mi.Bool) -> mi.UInt32:
        """Find the row of a surface point.

        Args:
            p: [N] positions relative to the scene's box, [0, 1]^3.
            n: [N] unit normals.
            active: [N] mask of the active lanes.

        Returns:
            [N] rows.
        """
        return dr.gather(mi.UInt32, self.rows, key_of(mi.Vector3f(p) * self.cells, n, self.cells), active)

    def sample(self, row: mi.UInt32, u: mi.Point2f, active: mi.Bool) -> tuple[mi.Vector3f, mi.Float]:
        """Sample directions by hierarchical sample warping, which preserves the stratification of ``u`` within bins.

        Args:
            row: [N] rows of the table.
            u: [N] random points in [0, 1)^2.
            active: [N] mask of the active lanes.

        Returns:
            Unit directions in world space and their densities per steradian, [N] each.
        """
        x, y = mi.UInt32(0), mi.UInt32(0)
        a, b = mi.Float(u.x), mi.Float(u.y)
        pdf = mi.Float(dr.inv_four_pi)
        for k in range(LOG2):
            node = row * NODES + OFFSETS[k] + y * (1 << k) + x
            m = dr.gather(mi.Vector4f, self.tree, node, active)
            right, a, side = _halved(a, m.x + m.z)
            upper, b, part = _halved(b, dr.select(right, m.y, m.x) / side)
            pdf *= 4 * side * part
            x, y = 2 * x + dr.select(right, mi.UInt32(1), 0), 2 * y + dr.select(upper, mi.UInt32(1), 0)
        return direction_of((mi.Float(x) + a) / SIDE, (mi.Float(y) + b) / SIDE), pdf

    def pdf(self, row: mi.UInt32, d: mi.Vector3f, active: mi.Bool) -> mi.Float:
        """Evaluate the density of directions.

        Args:
            row: [N] rows of the table.
            d: [N] unit directions in world space.
            active: [N] mask of the active lanes.

        Returns:
            [N] densities per steradian.
        """
        return dr.gather(mi.Float, self.density, row * BINS + bin_of(d), active)

    def visit(self, context: Any, si: Any, flags: Any, number: mi.Float, active: mi.Bool) -> GuidedVertex:
        """Look up the guide at path vertices.

        Args:
            context: ``PathContext`` of the paths.
            si: Surface interactions.
            flags: Flags of the BSDFs.
            number: [N] random numbers in [0, 1), for the displacement of the position and for ``GuidedVertex.chance``.
            active: [N] mask of the active lanes.

        Returns:
            Row, sampling probability and level at the vertices.
        """
        bits = mixed(dr.reinterpret_array(mi.UInt32, number))
        shift = mi.Vector3f(bits & 1023, (bits >> 10) & 1023, (bits >> 20) & 1023) / 1024 - (0.5 - 0.5 / 1024)
        n = mi.Vector3f(si.sh_frame.n)
        n = dr.select(si.wi.z < 0, -n, n)
        p = (si.p - context.low) * context.inverse + shift / self.cells
        active = active & mi.has_flag(flags, mi.BSDFFlags.Smooth)
        row = self.row(p, n, active)
        level = dr.gather(mi.Float, self.level, row, active)
        # Transmitted light leaves on the other side of the surface, whose directions belong to another cell.
        mixes = active & (row > 0) & ~mi.has_flag(flags, mi.BSDFFlags.Transmission)
        chance = mi.Float(mixed(bits + 0x9E3779B9) >> 8) * 2.0**-24
        return GuidedVertex(row, dr.select(mixes, self.share, 0), level, chance, active & (row > 0))


class GuidedVertex:
    """The guide at one path vertex. It is not a loop variable."""

    def __init__(self, row: mi.UInt32, share: mi.Float, level: mi.Float, chance: mi.Float, known: mi.Bool) -> None:
        """Set the fields.

        Args:
            row: [N] rows of the table.
            share: [N] probability that the guide is sampled and not the BSDF.
            level: [N] mean scattered luminance.
            chance: [N] random numbers in [0, 1).
            known: [N] mask of the vertices whose cell has data.
        """
        self.row, self.share = row, share
        """Row of the table, and the probability that the guide is sampled here."""
        self.level, self.known = level, known
        """Mean scattered luminance, and whether the cell has data."""
        self.chance = chance
        """Random number for roulette, [0, 1)."""

    def survival(self, β: mi.Spectrum, first: mi.Float, depth: mi.UInt32) -> tuple[mi.Float, mi.Float]:
        """Compute the survival probability of Russian roulette from the expected contribution of the path.

        Without an expectation, at mirrors for example, paths survive until they are ``LONG``: no path must be endless.

        Args:
            β: [N] throughput of the path.
            first: [N] contribution that was expected at the first vertex with data; 0: no such vertex yet.
            depth: [N] vertices left behind.

        Returns:
            Survival probability [N], and ``first`` [N] for the next vertex.
        """
        worth = dr.max(β) * self.level
        most = dr.select(depth >= LONG, MOST, 1)
        alive = dr.select(self.known & (first > 0), dr.clip(worth / first, LEAST, most), most)
        return alive, dr.select(self.known & (first == 0), worth, first)


def _halved(u: mi.Float, low: mi.Float) -> tuple[mi.Bool, mi.Float, mi.Float]:
    """(u is in the upper part, u within the part, probability of the part); ``low``: that of the lower one."""
    upper = u >= low
    part = dr.select(upper, 1 - low, low)
    return upper, dr.clip(dr.select(upper, u - low, u) / part, 0, 1), part


def key_of(q: mi.Vector3f, n: mi.Vector3f, cells: mi.Vector3f) -> mi.UInt32:
    """Compute the number of the cell of a surface point.

    Args:
        q: [N] positions in units of cells; positions outside of the table are clamped.
        n: [N] unit normals.
        cells: Cells along the axes, whole numbers.

    Returns:
        [N] numbers of cells, orientation included.
    """
    c = mi.Vector3u(dr.clip(q, 0, cells - 0.5))
    return ((c.z * mi.UInt32(cells.y) + c.y) * mi.UInt32(cells.x) + c.x) * FACES + side(n)


def direction_of(u: mi.Float, v: mi.Float) -> mi.Vector3f:
    """Map the unit square to the sphere with equal areas (Archimedes).

    Args:
        u: [N] azimuth over 2π, in [0, 1].
        v: [N] coordinate along the polar axis, in [0, 1].

    Returns:
        [N] unit directions.
    """
    z = 1 - 2 * v
    r = dr.safe_sqrt(1 - z * z)
    sine, cosine = dr.sincos((2 * dr.pi) * u - dr.pi)
    return mi.Vector3f(r * cosine, r * sine, z)


def bin_of(d: mi.Vector3f) -> mi.UInt32:
    """Find the bin of a direction.

    Args:
        d: [N] unit directions.

    Returns:
        [N] numbers below ``BINS``.
    """
    u = (dr.atan2(d.y, d.x) + dr.pi) * (0.5 * SIDE / dr.pi)
    v = (1 - d.z) * (0.5 * SIDE)
    return mi.UInt32(dr.clip(v, 0, SIDE - 0.5)) * SIDE + mi.UInt32(dr.clip(u, 0, SIDE - 0.5))
