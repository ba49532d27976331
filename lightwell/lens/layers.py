"""Depth layers: a soft split by signed circle of confusion, hidden content, and compositing front to back.

Within a layer light is added without order; between layers the front one covers the back one by its blurred coverage.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_erosion, distance_transform_edt

from lightwell.lens.pyramid import fill

# Width of the soft border between two layers, pixels of circle of confusion.
SOFT = 1.5
# Jumps of the circle of confusion between neighbours that count as an edge, pixels.
JUMP = 2.0
# A pixel of a surface that is cut through weighs this much against an edge; cuts are soft and filled behind.
THROUGH = 0.05
# Surroundings that a hidden region is continued from, pixels.
CONTEXT = 64
# Distance over which what lies nearest gives way to a smooth membrane, pixels.
FADE = 40.0
# Places where a split may be tried.
CANDIDATES = 64


@dataclass(frozen=True)
class Layer:
    """Light that is blurred together."""

    rgba: np.ndarray
    """[height, width, 4] float32, premultiplied by coverage."""
    s: np.ndarray
    """[height, width] float32: signed circle of confusion, pixels."""
    motion: np.ndarray | None
    """[height, width, 2] float32: displacement while the shutter is open, pixels; None is at rest."""


def thresholds(s: np.ndarray, count: int) -> list[float]:
    """Where to cut the signed circle of confusion into ``count`` layers: through many edges and few surfaces.

    The score of a cut is the number of neighbouring pixels on its two sides that lie ``JUMP`` apart or more, less the
    pixels of surfaces that it would cut through; cuts are taken greedily while they gain.
    """
    pairs = []
    for a, b in ((s[:, 1:], s[:, :-1]), (s[1:], s[:-1])):
        jump = np.abs(a - b) >= JUMP
        pairs.append(np.stack([np.minimum(a, b)[jump], np.maximum(a, b)[jump]], 1))
    edges = np.concatenate(pairs)
    if count < 2 or not len(edges):
        return []
    low, high = np.percentile(s, 0.5), np.percentile(s, 99.5)
    places = np.linspace(low, high, CANDIDATES + 2)[1:-1]
    histogram = np.sort(s.ravel())
    alive = np.ones(len(edges), bool)
    cuts: list[float] = []
    for _ in range(count - 1):
        best, best_score = None, 0.0
        for place in places:
            crossed = int(((edges[:, 0] < place - SOFT / 2) & (edges[:, 1] > place + SOFT / 2) & alive).sum())
            cut = np.subtract(*np.searchsorted(histogram, [place + SOFT, place - SOFT]))
            score = crossed - THROUGH * float(cut)
            if score > best_score and all(abs(place - other) > 2 * SOFT for other in cuts):
                best, best_score = float(place), score
        if best is None:
            break
        cuts.append(best)
        alive &= ~((edges[:, 0] < best) & (edges[:, 1] > best))
    return sorted(cuts)


def split(
    rgba: np.ndarray, s: np.ndarray, motion: np.ndarray | None, count: int, reach: float, peel: Layer | None = None
) -> list[Layer]:
    """Layers front to back. What a front layer hides comes from ``peel``, the second surfaces, where those are given
    and lie behind it; elsewhere it is continued from the uncovered side, up to ``reach``.
    """
    cuts = thresholds(s, count)
    if not cuts:
        return [Layer(rgba, s, motion)]
    # Share of each pixel that lies in front of each cut, then between neighbouring cuts.
    front = [np.clip((cut - s) / SOFT + 0.5, 0, 1).astype(np.float32) for cut in cuts]
    bounds = [np.zeros_like(s, np.float32), *front, np.ones_like(s, np.float32)]
    made = []
    for i in range(len(bounds) - 1):
        weight = bounds[i + 1] - bounds[i]
        if weight.max() <= 0:
            continue
        hidden = bounds[i]
        layer = Layer(rgba * weight[..., None], s, motion)
        made.append(layer if hidden.max() <= 0 else _filled(layer, weight, hidden, reach, peel, cuts[i - 1]))
    return made


def _filled(
    layer: Layer, weight: np.ndarray, hidden: np.ndarray, reach: float, peel: Layer | None, cut: float
) -> Layer:
    """Continue a layer under what hides it: colour, blur and motion, as far as it can be seen."""
    known = weight > 0.5
    wanted = (hidden > 0) & (distance_transform_edt(~known) <= reach + 2)
    if not wanted.any() or not known.any():
        return layer
    box = _around(wanted)
    part = Layer(layer.rgba[box], layer.s[box], None if layer.motion is None else layer.motion[box])
    second = None
    if peel is not None:
        second = Layer(peel.rgba[box], peel.s[box], None if peel.motion is None else peel.motion[box])
    made = _filled_part(part, weight[box], hidden[box], known[box], wanted[box], second, cut)
    whole = [array.copy() for array in (layer.rgba, layer.s)]
    whole[0][box], whole[1][box] = made.rgba, made.s
    motion = layer.motion
    if motion is not None:
        motion = motion.copy()
        motion[box] = made.motion
    return Layer(*whole, motion)


def _around(mask: np.ndarray) -> tuple[slice, slice]:
    """The box around a mask, with ``CONTEXT`` pixels of surroundings to continue from."""
    spans = []
    for axis in (1, 0):
        where = np.flatnonzero(mask.any(axis))
        spans.append(slice(max(int(where[0]) - CONTEXT, 0), int(where[-1]) + 1 + CONTEXT))
    return tuple(spans)


def _filled_part(layer: Layer, weight, hidden, known, wanted, peel: Layer | None, cut: float) -> Layer:
    """The part of a layer that is worked on."""
    parts = [np.where(known[..., None], layer.rgba / np.maximum(weight, 1e-6)[..., None], 0), layer.s[..., None]]
    if layer.motion is not None:
        parts.append(layer.motion)
    stack = np.concatenate(parts, -1).astype(np.float32)
    smooth = _continued(stack, known)
    if peel is not None:
        real = wanted & (peel.rgba[..., 3] > 0) & (peel.s > cut)
        given = [peel.rgba, peel.s[..., None]]
        if layer.motion is not None:
            given.append(np.zeros_like(layer.motion) if peel.motion is None else peel.motion)
        smooth = np.where(real[..., None], np.concatenate(given, -1), smooth)
    # Where a surface lies partly in front, the part behind is as far away as the layer, not as the surface.
    share = np.where(wanted, hidden, 0)[..., None]
    replace = wanted & (weight < 0.5)
    rgba = layer.rgba + share * np.maximum(smooth[..., :4], 0)
    s = np.where(replace, smooth[..., 4], layer.s)
    motion = None if layer.motion is None else np.where(replace[..., None], smooth[..., 5:7], layer.motion)
    return Layer(rgba.astype(np.float32), s.astype(np.float32), motion)


def _continued(stack: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Values [height, width, channels] beyond the known pixels: of the nearest one, so that structure goes on, and of a
    membrane farther in. A pixel on the very border may hold light of what hides the rest: its inner neighbour is
    taken where there is one.
    """
    away, nearest = distance_transform_edt(~known, return_indices=True)
    inner = binary_erosion(known, np.ones((3, 3)), border_value=1)
    if inner.any():
        farther, place = distance_transform_edt(~inner, return_indices=True)
        nearest = np.where(farther <= away + 1.1, place, nearest)
    copied = np.where(known[..., None], stack, stack[nearest[0], nearest[1]])
    smooth = fill(np.ascontiguousarray(stack.transpose(2, 0, 1)), known.astype(np.float32)).transpose(1, 2, 0)
    share = np.exp(-np.square(away / FADE))[..., None].astype(np.float32)
    return copied * share + smooth * (1 - share)


def tidy(image: np.ndarray) -> np.ndarray:
    """A blurred layer [..., 4] within its bounds: light >= 0, coverage in [0, 1]; excess coverage divides the light."""
    rgb, alpha = np.maximum(image[..., :3], 0), np.maximum(image[..., 3:], 0)
    over = np.maximum(alpha, 1)
    return np.concatenate([rgb / over, alpha / over], -1)


def composite(images: list[np.ndarray]) -> np.ndarray:
    """Blurred layers [height, width, 4] front to back: C = Σ C_l Π_{k<l} (1 − α_k)."""
    out = np.zeros_like(images[0])
    open_ = np.ones_like(images[0][..., :1])
    for image in images:
        out += open_ * image
        open_ = open_ * (1 - image[..., 3:])
    return out


def over_coverage(image: np.ndarray) -> np.ndarray:
    """Divide by total coverage: an opaque picture that lost light at a hole or at the edge of the frame."""
    alpha = image[..., 3:]
    scale = np.where(alpha > 1e-4, 1 / np.maximum(alpha, 1e-4), 0)
    return np.concatenate([image[..., :3] * scale, (alpha > 1e-4).astype(image.dtype)], -1)


def extend(image: np.ndarray, pad: int, white: float) -> np.ndarray:
    """Repeat the border outwards by ``pad`` pixels [height, width, 4], its highlights held to twice its median.

    Light from outside the frame is not in the picture; its nearest pixels are the best guess, but a lamp on the border
    would become a streak.
    """
    out = np.pad(image, ((pad, pad), (pad, pad), (0, 0)), mode="edge")
    border = np.concatenate([image[0], image[-1], image[:, 0], image[:, -1]])[:, :3].max(1)
    inner = out[pad:-pad, pad:-pad].copy()
    out[..., :3] = np.minimum(out[..., :3], max(white, 2 * float(np.median(border))))
    out[pad:-pad, pad:-pad] = inner
    return out
