"""Local gain of a still: a factor by place that corrects the mean brightness of the network's predictions.

A network trained for a second is blurred: bright places bleed into dark ones, and rare bright records, clamped to keep
the fit stable, are missing. Both are errors of brightness over some distance, and the training paths of a still, which
all end by Russian roulette, measure them. Sums over cells give a factor for each cell; where a cell has few or noisy
records, that of the enclosing larger cell is used. The factor is interpolated, so that cells are not visible.

Notation: N^3 cells in the scene's box for each of six sides, the axis that a normal is nearest to. Cells are summed in
Morton order (the eight children of a cell are neighbours in memory) and read in row-major order.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any

from lightwell.backend import dr, mi
from lightwell.cache.features import WIDTH, Vertex, side, stored

if TYPE_CHECKING:
    from lightwell.cache.model import Model

BITS = 5
N, SIDES = 1 << BITS, 6
CELLS = SIDES * N**3
# Largest ratio of a cell's factor to that of the enclosing cell; the factor itself is limited to its square.
MOST = 4.0
# Frames of a still whose records are used. A record is clamped to CAP, times the square root of their number, times the
# prediction plus the mean: with more records a single bright one has less influence.
FRAMES, CAP = 16, 15.0
# Number of records as which the variance of the enclosing cell counts in the variance of a cell.
PRIOR = 8.0
# Multiple of the noise variance that is subtracted in the shrinkage.
CLEAR = 2.0


class RadianceScaling:
    """Factor from network output to radiance: one over the radiance scale."""

    DRJIT_STRUCT = {"unscale": mi.Float}  # noqa: RUF012

    def __init__(self, unscale: Any = None) -> None:
        """Set the factor.

        Args:
            unscale: One over the radiance scale; None: 1.
        """
        self.unscale = mi.Float(1) if unscale is None else unscale

    def at(self, v: Vertex) -> mi.Float:
        """Return the factor at vertices.

        Args:
            v: Vertices; not used here.

        Returns:
            Factor, the same for all vertices.
        """
        return self.unscale


class CorrectedScaling(RadianceScaling):
    """Factor from network output to radiance that depends on position and orientation."""

    DRJIT_STRUCT = {"unscale": mi.Float, "level": mi.Float}  # noqa: RUF012

    def __init__(self, unscale: Any = None, level: Any = None) -> None:
        """Set the factors.

        Args:
            unscale: One over the radiance scale; None: 1.
            level: [``CELLS``] factors; None: 1 everywhere.
        """
        super().__init__(unscale)
        self.level = mi.Float(1) if level is None else level
        """[CELLS] factors."""

    def at(self, v: Vertex) -> mi.Float:
        """Interpolate the factor between the centres of cells.

        Args:
            v: Vertices.

        Returns:
            [N] factors.
        """
        places = [dr.clip(x * N - 0.5, 0, N - 1) for x in v.p]
        low = [dr.minimum(mi.UInt32(x), N - 2) for x in places]
        high = [x - mi.Float(cell) for x, cell in zip(places, low)]
        first = ((side(v.n) * N + low[2]) * N + low[1]) * N + low[0]
        out = mi.Float(0)
        for corner in range(8):
            bits = [corner >> k & 1 for k in range(3)]
            share = mi.Float(1)
            for bit, x in zip(bits, high):
                share *= x if bit else 1 - x
            out = dr.fma(share, dr.gather(mi.Float, self.level, first + bits[0] + N * (bits[1] + N * bits[2])), out)
        return out * self.unscale


def _spread(x: mi.UInt32) -> mi.UInt32:
    """Bit k to bit 3 k."""
    out = mi.UInt32(0)
    for k in range(BITS):
        out |= (x >> k & 1) << (3 * k)
    return out


def _morton(x: mi.UInt32, y: mi.UInt32, z: mi.UInt32, of: mi.UInt32) -> mi.UInt32:
    return of << (3 * BITS) | _spread(x) | _spread(y) << 1 | _spread(z) << 2


class CellSums:
    """Sums by cell in Morton order: records, traced luminance, predicted luminance, and squared difference."""

    def __init__(self, frames: int = 1) -> None:
        """Start with zeros.

        Args:
            frames: Frames whose records will be added, ≥ 1; sets the clamp of bright records.
        """
        self.cap = dr.opaque(mi.Float, CAP * frames**0.5)
        self.count, self.traced, self.said, self.square = (dr.zeros(mi.Float, CELLS) for _ in range(4))

    def add(self, v: Vertex, traced: mi.Float, said: mi.Float) -> None:
        """Add records; luminances are in units of the network.

        Args:
            v: Vertices.
            traced: [N] traced luminance, ≥ 0.
            said: [N] predicted luminance, ≥ 0.
        """
        traced = dr.minimum(traced, self.cap * (said + 1))
        sound = dr.isfinite(traced) & dr.isfinite(said)
        x, y, z = (dr.minimum(mi.UInt32(dr.clip(c, 0, 1) * N), N - 1) for c in v.p)
        at = _morton(x, y, z, side(v.n))
        one = mi.Float(1)
        for table, value in (
            (self.count, one), (self.traced, traced), (self.said, said), (self.square, dr.square(traced - said)),
        ):  # fmt: skip
            dr.scatter_add(table, value, at, sound)

    def levels(self) -> mi.Float:
        """Compute the factors, from the whole scene down to single cells.

        Returns:
            [``CELLS``] factors in row-major order.
        """
        pyramid = [(self.count, self.traced, self.said, self.square)]
        for _ in range(BITS):
            pyramid.append(tuple(dr.block_sum(s, 8) for s in pyramid[-1]))
        pyramid.append(tuple(dr.sum(s) for s in pyramid[-1]))
        factor, around = mi.Float(1), mi.Float(0)
        for count, traced, said, square in reversed(pyramid):
            repeats = dr.width(traced) // dr.width(factor)
            if repeats > 1:
                factor, around = dr.repeat(factor, repeats), dr.repeat(around, repeats)
            said *= factor
            # A few dark records are weak evidence where the enclosing cell has rare bright ones: its variance counts
            # too.
            own = dr.square(count) * square / dr.maximum(dr.square(said), 1e-24)
            variance = (own + PRIOR * around) / dr.maximum(count + dr.select(around > 0, PRIOR, 0), 1)
            around = variance
            factor = dr.clip(factor * corrected(traced, said, variance / dr.maximum(count, 1)), MOST**-2, MOST**2)
        cell = dr.arange(mi.UInt32, CELLS)
        at = _morton(cell & (N - 1), cell >> BITS & (N - 1), cell >> (2 * BITS) & (N - 1), cell >> (3 * BITS))
        out = dr.gather(mi.Float, factor, at)
        dr.make_opaque(out)
        return out


class RecentRecords:
    """Records of the last training frames of a still, from which the local gain is computed."""

    def __init__(self) -> None:
        """Start without records."""
        self._frames: deque[tuple[mi.Float, mi.Float]] = deque(maxlen=FRAMES)

    def add(self, features: mi.Float, targets: mi.Float, rows: mi.UInt32, count: int) -> None:
        """Copy the records of a frame; only those of the last ``FRAMES`` frames are kept.

        Args:
            features: [R * ``WIDTH``] vertices.
            targets: [R * 4] radiance.
            rows: [R] indices of the records.
            count: Number of records M.
        """
        row = dr.arange(mi.UInt32, count)
        of = dr.gather(mi.UInt32, rows, row)
        vertices, radiance = dr.empty(mi.Float, count * WIDTH), dr.empty(mi.Float, count * 4)
        stored(features, of).store(vertices, row, mi.Bool(True))
        dr.scatter(radiance, dr.gather(mi.Vector4f, targets, of), row)
        dr.eval(vertices, radiance)
        self._frames.append((vertices, radiance))

    def clear(self) -> None:
        """Discard all records."""
        self._frames.clear()

    def levels(self, model: Model, weights: tuple[Any, ...], scale: float) -> mi.Float | None:
        """Compare the records with predictions.

        Args:
            model: Network.
            weights: Packed weights, see ``Model.packed``.
            scale: Radiance scale.

        Returns:
            [``CELLS``] factors, see ``CellSums.levels``; None without records.
        """
        if not self._frames:
            return None
        sums, unit = CellSums(len(self._frames)), dr.opaque(mi.Float, scale)
        for features, targets in self._frames:
            row = dr.arange(mi.UInt32, dr.width(targets) // 4)
            v, t = stored(features, row), dr.gather(mi.Vector4f, targets, row)
            traced, learned = model.target(dr.maximum(mi.Color3f(t.x, t.y, t.z), 0), v, unit)
            predicted = dr.select(learned > 0, dr.maximum(model.evaluate(weights, v), 0), 0)
            sums.add(v, mi.luminance(traced), mi.luminance(predicted))
        return sums.levels()


def corrected(traced: mi.Float, said: mi.Float, noise: mi.Float) -> mi.Float:
    """Compute the ratio of traced to predicted luminance, shrunk towards 1 by the share that noise can explain.

    Positive-part shrinkage: where a single bright record causes the difference, the noise estimate is equally large,
    and the factor stays 1.

    Args:
        traced: [N] sums of traced luminance.
        said: [N] sums of predicted luminance.
        noise: [N] relative variance of the traced sum.

    Returns:
        [N] factors in [1 / ``MOST``, ``MOST``].

    Reference: James and Stein 1961, *Estimation with Quadratic Loss*.
    """
    off = traced / dr.maximum(said, 1e-12) - 1
    share = dr.maximum(1 - CLEAR * noise / dr.maximum(dr.square(off), 1e-12), 0)
    k = 1 + off * share
    return dr.clip(dr.select((said > 0) & dr.isfinite(k), k, 1), 1 / MOST, MOST)
