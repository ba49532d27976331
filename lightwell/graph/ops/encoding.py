"""Encodings of low-dimensional inputs: frequency, oneblob, sh."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np

from lightwell.graph.ops.example import Example, coordinates, directions, normals
from lightwell.graph.ops.op import Op, Parameter, Use, expect_width, register

# Octaves beyond this exceed what a 32-bit coordinate in [0, 1] can resolve.
MAX_OCTAVES = 24


def _numpy_frequency(use: Use, a: np.ndarray) -> np.ndarray:
    """sin and cos of 2ᵏ π c: [N, C] -> [N, C * octaves * 2].

    2ᵏ c is exact in binary floating point, and so is its remainder r in [-1, 1] by the period 2, so that high octaves
    lose nothing: the only rounding is that of π r.
    """
    powers = np.exp2(np.arange(use["octaves"], dtype=np.float32))
    turns = a[:, :, None] * powers
    angle = np.float32(math.pi) * (turns - np.float32(2) * np.rint(turns * np.float32(0.5)))
    return np.stack([np.sin(angle), np.cos(angle)], axis=-1).reshape(len(a), -1)


def _drjit_frequency(use: Use, a: Any) -> Any:
    from lightwell.backend import dr

    out: list[Any] = []
    for component in a:
        for octave in range(use["octaves"]):
            turns = component * float(1 << octave)
            out += dr.sincos(dr.pi * (turns - 2 * dr.round(turns * 0.5)))
    return out


def _frequency_examples(rng: np.random.Generator) -> Iterator[Example]:
    for width, octaves in ((1, 1), (3, 5), (2, 12)):
        yield Example(f"{width}_{octaves}", (normals(rng, width, 1.0),), {"octaves": octaves})


FREQUENCY = register(
    Op(
        name="frequency",
        arity=(1, 1),
        parameters={"octaves": Parameter("integer", 1, MAX_OCTAVES)},
        width=lambda use: use.widths[0] * use["octaves"] * 2,
        numpy=_numpy_frequency,
        drjit=_drjit_frequency,
        examples=_frequency_examples,
    )
)

# Abramowitz and Stegun, Handbook of Mathematical Functions, 7.1.26: erf to 1.5e-7.
ERF_P = 0.3275911
ERF_A = (0.254829592, -0.284496736, 1.421413741, -1.453152027, 1.061405429)


def _erf(x: np.ndarray) -> np.ndarray:
    t = 1 / (1 + ERF_P * np.abs(x))
    polynomial = t * (ERF_A[0] + t * (ERF_A[1] + t * (ERF_A[2] + t * (ERF_A[3] + t * ERF_A[4]))))
    return np.copysign(1 - polynomial * np.exp(-x * x), x)


def _numpy_oneblob(use: Use, a: np.ndarray) -> np.ndarray:
    """Share of a Gaussian around c (σ = 1/bins) that falls into each bin of [0, 1]: [N, C] -> [N, C * bins]."""
    bins = use["bins"]
    edges = np.arange(bins + 1) - a.astype(np.float64)[:, :, None] * bins
    below = 0.5 * _erf(edges * math.sqrt(0.5))
    return np.diff(below, axis=-1).reshape(len(a), -1).astype(np.float32)


def _drjit_oneblob(use: Use, a: Any) -> Any:
    from lightwell.backend import dr

    bins, out = use["bins"], []
    for component in a:
        below = [0.5 * dr.erf((edge - component * bins) * math.sqrt(0.5)) for edge in range(bins + 1)]
        out += [high - low for low, high in pairwise(below)]
    return out


def _oneblob_examples(rng: np.random.Generator) -> Iterator[Example]:
    for width, bins in ((1, 2), (3, 8), (2, 16)):
        yield Example(f"{width}_{bins}", (coordinates(rng, width),), {"bins": bins})


ONEBLOB = register(
    Op(
        name="oneblob",
        arity=(1, 1),
        parameters={"bins": Parameter("integer", 2, 256)},
        width=lambda use: use.widths[0] * use["bins"],
        numpy=_numpy_oneblob,
        drjit=_drjit_oneblob,
        examples=_oneblob_examples,
    )
)

# Normalisation of the real spherical harmonics, with the Condon-Shortley sign, in Sloan's order (l, then m = -l … l):
# Sloan, Efficient Spherical Harmonic Evaluation, JCGT 2(2), 2013.
SH_0 = math.sqrt(1 / (4 * math.pi))
SH_1 = math.sqrt(3 / (4 * math.pi))
SH_2 = (math.sqrt(15 / (4 * math.pi)), math.sqrt(5 / (16 * math.pi)), math.sqrt(15 / (16 * math.pi)))
SH_3 = (
    math.sqrt(35 / (32 * math.pi)),
    math.sqrt(105 / (4 * math.pi)),
    math.sqrt(21 / (32 * math.pi)),
    math.sqrt(7 / (16 * math.pi)),
    math.sqrt(105 / (16 * math.pi)),
)


def sh_components(x: Any, y: Any, z: Any, degree: int) -> list[Any]:
    """Evaluate real spherical harmonics in a direction; for NumPy and Dr.Jit arrays alike.

    Args:
        x: [N] first component of unit directions.
        y: [N] second component.
        z: [N] third component.
        degree: Number of bands, 1 to 4.

    Returns:
        degree² arrays [N], band by band.
    """
    out = [0 * x + SH_0]
    if degree > 1:
        out += [-SH_1 * y, SH_1 * z, -SH_1 * x]
    if degree > 2:
        a, b, c = SH_2
        out += [a * (x * y), -a * (y * z), b * (3 * (z * z) - 1), -a * (x * z), c * (x * x - y * y)]
    if degree > 3:
        a, b, c, d, e = SH_3
        out += [-a * (y * (3 * (x * x) - y * y)), b * (x * y * z), -c * (y * (5 * (z * z) - 1))]
        out += [d * (z * (5 * (z * z) - 3)), -c * (x * (5 * (z * z) - 1)), e * (z * (x * x - y * y))]
        out += [-a * (x * (x * x - 3 * (y * y)))]
    return out


def _sh(use: Use, d: Any) -> list[Any]:
    x, y, z = d
    return sh_components(x, y, z, use["degree"])


def _sh_width(use: Use) -> int:
    expect_width(use, 0, 3, "a direction")
    return use["degree"] ** 2


def _sh_examples(rng: np.random.Generator) -> Iterator[Example]:
    for degree in (1, 2, 3, 4):
        yield Example(f"{degree}", (directions(rng),), {"degree": degree})


SH = register(
    Op(
        name="sh",
        arity=(1, 1),
        parameters={"degree": Parameter("integer", 1, 4)},
        width=_sh_width,
        numpy=lambda use, d: np.stack(_sh(use, d.T), axis=1),
        drjit=_sh,
        examples=_sh_examples,
    )
)
