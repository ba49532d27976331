"""Losses of the fits. f: prediction, y: target, both tensors [B, 3] in the radiance unit S; the value is [B, 3].

``relative`` is the loss of the 2013 report on radiance regression with mixtures of experts. On Monte-Carlo targets an
absolute difference converges to the median of the path estimates and 1 / (y + ε) weights low draws more: both darken
the result. ``relative2`` and ``relative1_5`` have a target part that is quadratic, so their minimum is the mean.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from lightwell.backend import dr, mi

# ε of the relative error in unit S (the report's value).
EPSILON = 1e-2

# ε₂ of ``relative2`` on demodulated targets in unit S (measured on the Cornell box).
EPSILON_SQUARED_LOSS = 0.05

# ε of ``relative1_5``.
EPSILON_BETWEEN = 0.02

# Radiance in unit S of a lamp from which a place is white: twelve times what the lamp usually lights. Six scenes, equal
# steps, all lamps on, where people look, error and PSNR of displayed values, a limit of 32 for targets and then this:
# needle-lightmap-house 21 to 20 %, +1.3 dB; loft 14.9 to 13.0 %, +1.6 dB; pyraxia-hallway 48 to 44 %, +0.3 dB;
# living-room-2 42 to 24 %, +0.6 dB; bevy-cornell 6.6 to 5.3 %, +1.3 dB; staircase2 12 to 15 %, -1.2 dB. The first two
# with 5: 21, 13.4 %; with 8: 23, 13.9 %; with 32: 26, 16.3 %.
LAMP_WHITE = 3.0


def l2(f: Any, y: Any) -> Any:
    """Compute (f − y)².

    Args:
        f: [B, 3] prediction in unit S.
        y: [B, 3] target in unit S.

    Returns:
        [B, 3] loss.
    """
    return dr.square(f - y)


def l1(f: Any, y: Any) -> Any:
    """Compute |f − y|.

    Args:
        f: [B, 3] prediction in unit S.
        y: [B, 3] target in unit S.

    Returns:
        [B, 3] loss.
    """
    return dr.abs(f - y)


def relative(f: Any, y: Any) -> Any:
    """Compute |f − y| / (y + ε), whose minimum is darker than the mean of noisy targets; used by the faithful presets
    only.

    Args:
        f: [B, 3] prediction in unit S.
        y: [B, 3] target in unit S.

    Returns:
        [B, 3] loss.
    """
    return dr.abs(f - y) / (y + EPSILON)


def relative_sg(f: Any, y: Any) -> Any:
    """Compute |f − y| / (f + ε) with no gradient through the denominator.

    Args:
        f: [B, 3] prediction in unit S.
        y: [B, 3] target in unit S.

    Returns:
        [B, 3] loss.
    """
    return dr.abs(f - y) / (dr.abs(dr.detach(f)) + EPSILON)


def relative2(f: Any, y: Any) -> Any:
    """Compute (f − y)² / (f² + ε₂²) with no gradient through the denominator (as in Noise2Noise, Lehtinen et al. 2018).

    Args:
        f: [B, 3] prediction in unit S.
        y: [B, 3] target in unit S.

    Returns:
        [B, 3] loss.
    """
    return dr.square(f - y) / (dr.square(dr.detach(f)) + EPSILON_SQUARED_LOSS**2)


def relative1_5(f: Any, y: Any) -> Any:
    """Compute (f − y)² / (|f| + ε)^1.5 with no gradient through the denominator.

    Between ``relative2``, by which a prediction that is far too bright costs no more than 1, and the squared error of
    values displayed with a gamma of 2.2, whose denominator is f^1.09.

    Args:
        f: [B, 3] prediction in unit S.
        y: [B, 3] target in unit S.

    Returns:
        [B, 3] loss.
    """
    below = dr.abs(dr.detach(f)) + EPSILON_BETWEEN
    return dr.square(f - y) / (below * dr.sqrt(below))


def relative1_5_to_white(f: Any, y: Any) -> Any:
    """Compute ``relative1_5`` up to ``LAMP_WHITE``: of a target beyond it, all that is asked is to be as bright.

    A place beside a lamp may be thousands of times brighter than what the lamp usually lights; as a plain target it
    takes the network, and cut off it is too dark where other lamps shine, too.

    Args:
        f: [B, 3] prediction in unit S.
        y: [B, 3] target in unit S.

    Returns:
        [B, 3] loss.
    """
    beyond = y.array >= LAMP_WHITE
    f = mi.TensorXf(dr.select(beyond, dr.minimum(f.array, LAMP_WHITE), f.array), f.shape)
    return relative1_5(f, mi.TensorXf(dr.minimum(y.array, LAMP_WHITE), y.shape))


def expected(z: Any, l: Any) -> Any:
    """Compute p_j l_j with p = softmax(z): the terms of the expected loss when a gate chooses expert j with probability
    p_j.

    The gradient with respect to z of the sum over j, p_j (l_j − Σ_k p_k l_k), is written explicitly, so that no sum has
    an undefined order.

    Args:
        z: [..., M] outputs of the gate.
        l: [..., M] loss of each expert.

    Returns:
        [..., M] terms.
    """
    experts, held, l = z.shape[-1], dr.detach(z).array, dr.detach(l).array
    at = dr.arange(mi.UInt32, dr.width(held)) // experts
    e = dr.exp(held - dr.gather(mi.Float, dr.block_reduce(dr.ReduceOp.Max, held, experts), at))
    p = e / dr.gather(mi.Float, dr.block_sum(e, experts), at)
    slope = p * (l - dr.gather(mi.Float, dr.block_sum(p * l, experts), at))
    return mi.TensorXf(p * l + slope * (z.array - held), z.shape)


LOSSES: dict[str, Callable[[Any, Any], Any]] = {
    "expected": expected,
    "l1": l1,
    "l2": l2,
    "relative": relative,
    "relative1_5": relative1_5,
    "relative1_5_to_white": relative1_5_to_white,
    "relative2": relative2,
    "relative_sg": relative_sg,
}
