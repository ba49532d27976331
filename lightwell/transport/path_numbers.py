"""Random numbers of paths: one stream per path, and evenly distributed numbers for the first bounce.

Notation: N lanes, one path each.
"""

from __future__ import annotations

from lightwell.backend import dr, mi

# Number of the random stream that shifts the lattice of first bounces; paths have lower ones.
LATTICE_STREAM = 1 << 31
ONE_MINUS_EPSILON = 1 - 2.0**-24


def check_halves(count: int, name: str = "paths") -> None:
    """Refuse a number of paths that does not make two independent halves.

    Args:
        count: Paths, or rays, of a point.
        name: What they are called.

    Raises:
        ValueError: The number is odd or below 2.
    """
    if count < 2 or count % 2:
        raise ValueError(f"transport: {name} = {count}, expected an even number >= 2 (two independent halves)")


def random_streams(seed: mi.UInt32, point: mi.UInt32, path: mi.UInt32) -> mi.PCG32:
    """Make one random number stream per (seed, point, path); a path's numbers do not depend on how work is divided.

    Args:
        seed: Seed, 32 bits.
        point: Number of the point of each lane.
        path: Number of the path of each lane.

    Returns:
        PCG32 with one stream per lane.
    """
    a, b = mi.sample_tea_32(point, seed)
    c, d = mi.sample_tea_32(a ^ path, b)
    return mi.PCG32(1, mi.UInt64(c), mi.UInt64(d))


def independent(rng: mi.PCG32) -> tuple[mi.Float, mi.Point2f, mi.Point2f]:
    """Draw the random numbers of the first bounce independently for every path.

    Args:
        rng: PCG32, one stream per lane.

    Returns:
        (number, 2D point, 2D point) in [0, 1), as ``trace`` takes them.
    """
    return rng.next_float32(), next_2d(rng), next_2d(rng)


# Steps of the lattice: powers of the root of x⁴ = x + 1 (Roberts 2018), which distribute every pair of axes evenly; for
# the lobe, the plastic number.
STEPS, LOBE_STEP = tuple(1.2207440846057596**-k for k in (1, 2, 3)), 0.7548776662466927


def stratified(rng: mi.PCG32, k: mi.UInt32, count: mi.UInt32) -> tuple[mi.Float, mi.Point2f, mi.Point2f]:
    """Draw the random numbers of the first bounce of one of several paths, evenly distributed over all of them.

    The numbers are points of a lattice that is shifted as a whole (Cranley & Patterson 1976). Each path alone is
    uniform, so the mean stays unbiased.

    Args:
        rng: PCG32 that draws the same numbers for all ``count`` paths.
        k: Number of the path, in [0, count).
        count: Number of paths.

    Returns:
        (number, 2D point, 2D point) in [0, 1), as ``trace`` takes them.
    """
    lobe, direction, light = rng.next_float32(), next_2d(rng), next_2d(rng)
    # k times a step, modulo 1, in integers: exact for every k.
    first, second, third, of_lobe = (
        mi.Float((k * mi.UInt32(int(step * 2**32))) >> 8) * 2.0**-24 for step in (*STEPS, LOBE_STEP)
    )
    return (
        _wrapped(lobe + of_lobe),
        mi.Point2f(_wrapped(direction.x + mi.Float(k) / mi.Float(count)), _wrapped(direction.y + first)),
        mi.Point2f(_wrapped(light.x + second), _wrapped(light.y + third)),
    )


def _wrapped(v: mi.Float) -> mi.Float:
    return dr.minimum(v - dr.floor(v), ONE_MINUS_EPSILON)


def next_2d(rng: mi.PCG32) -> mi.Point2f:
    """Draw two numbers.

    Args:
        rng: PCG32, one stream per lane.

    Returns:
        [N] points in [0, 1)².
    """
    x = rng.next_float32()
    return mi.Point2f(x, rng.next_float32())
