"""Depth layers: a soft split by signed circle of confusion, filling of hidden content, and compositing front to back.

Within a layer light is added without order; between layers the front one covers the back one by its blurred coverage.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_erosion, distance_transform_edt

from lightwell.lens.mixed_pixels import Divided, divide
from lightwell.lens.pyramid import fill

# Width of the soft border between two layers, pixels of circle of confusion.
SOFT = 1.5
# Difference of the circle of confusion between neighbours that counts as a discontinuity, pixels.
JUMP = 2.0
# Weight of a pixel of a surface that is cut through, relative to a pixel of a discontinuity.
THROUGH = 0.05
# Width of the surroundings from which a hidden region is extrapolated, pixels.
CONTEXT = 64
# Distance over which copied pixels fade into a smooth membrane, pixels.
FADE = 40.0
# Number of candidate cuts.
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


def lit(rgba: np.ndarray) -> np.ndarray:
    """Find the pixels that have light or coverage; channel by channel, which is faster than ``any`` over four values.

    Args:
        rgba: Light [..., 4], premultiplied.

    Returns:
        [...] bool.
    """
    found = rgba[..., 0] != 0
    for channel in range(1, rgba.shape[-1]):
        found |= rgba[..., channel] != 0
    return found


def thresholds(s: np.ndarray, count: int) -> list[float]:
    """Choose where to cut the signed circle of confusion into layers: at depth discontinuities, not through surfaces.

    The score of a cut is the number of neighbouring pixels on its two sides that lie ``JUMP`` apart or more, less a
    share of the pixels of surfaces that it would cut through; cuts are taken greedily while their score is above 0.

    Args:
        s: Signed circle of confusion [height, width], pixels.
        count: Largest number of layers.

    Returns:
        Up to ``count`` − 1 values of s, ascending.
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
    rgba: np.ndarray,
    s: np.ndarray,
    motion: np.ndarray | None,
    count: int,
    reach: float,
    peel: Layer | None = None,
    antialiased: bool = False,
) -> list[Layer]:
    """Split a frame into depth layers, and fill what a front layer hides.

    Hidden content comes from ``peel``, the second surfaces, where they are given and lie behind the cut; elsewhere it
    is extrapolated from the visible part of the layer that is seen nearest.

    Args:
        rgba: Light [height, width, 4], premultiplied.
        s: Signed circle of confusion [height, width], pixels.
        motion: Displacement while the shutter is open [height, width, 2], pixels; None for none.
        count: Largest number of layers, ≥ 1.
        reach: Distance up to which hidden content can become visible, pixels.
        peel: Second surface behind every pixel; coverage 0 where there is none.
        antialiased: Divide the light of pixels at the edges of front layers, see ``mixed_pixels``.

    Returns:
        Layers, front to back.
    """
    cuts = thresholds(s, count)
    if not cuts:
        return [Layer(rgba, s, motion)]
    # Share of each pixel that lies in front of each cut, then between neighbouring cuts.
    front = [np.clip((cut - s) / SOFT + 0.5, 0, 1).astype(np.float32) for cut in cuts]
    divided = [divide(rgba, s, cut) if antialiased else None for cut in cuts]
    mixed, before = _light_before(rgba, front, divided)
    for i, (one, share) in enumerate(zip(divided, front)):
        if one is not None:
            share[one.mixed] = one.share[one.mixed]
        if i:
            # What lies in front of a cut lies in front of all deeper ones.
            np.maximum(share, front[i - 1], out=share)
    bounds = [np.zeros_like(s, np.float32), *front, np.ones_like(s, np.float32)]
    made = []
    for i in range(len(bounds) - 1):
        weight = bounds[i + 1] - bounds[i]
        if weight.max() <= 0:
            continue
        hidden = bounds[i]
        light = rgba * weight[..., None]
        if mixed is not None:
            light = np.where(mixed[..., None], before[i + 1] - before[i], light)
        sides = divided[i - 1] if i else None, divided[i] if i < len(cuts) else None
        layer = Layer(light.astype(np.float32, copy=False), _depth_of_mixed(s, *sides), motion)
        made.append(
            layer if hidden.max() <= 0 else _filled(layer, weight, hidden, bounds[i + 1], reach, peel, cuts[i - 1])
        )
    return made


def _light_before(
    rgba: np.ndarray, front: list[np.ndarray], divided: list[Divided | None]
) -> tuple[np.ndarray | None, list[np.ndarray]]:
    """Return which pixels any cut divides, and the light [height, width, 4] in front of each cut and of none and all.

    A pixel may be divided by several cuts. What lies in front of one lies in front of all deeper ones too, so that the
    differences of neighbours, which are the layers' light, are not negative and sum to the pixel's. None and an empty
    list where nothing is divided.
    """
    masks = [one.mixed for one in divided if one is not None]
    if not masks:
        return None, []
    found = [np.zeros_like(rgba)]
    for share, one in zip(front, divided):
        light = rgba * share[..., None]
        if one is not None:
            light = np.where(one.mixed[..., None], one.light, light)
        found.append(np.maximum(light, found[-1]))
    return np.any(masks, axis=0), [*found, rgba]


def _depth_of_mixed(s: np.ndarray, before: Divided | None, after: Divided | None) -> np.ndarray:
    """Return s with that of the layer's own surfaces at mixed pixels: behind a cut, and in front of the next one."""
    for one, is_front in ((before, False), (after, True)):
        if one is not None:
            s = np.where(one.mixed, one.front if is_front else one.back, s)
    return s.astype(np.float32, copy=False)


def _filled(
    layer: Layer,
    weight: np.ndarray,
    hidden: np.ndarray,
    before: np.ndarray,
    reach: float,
    peel: Layer | None,
    cut: float,
) -> Layer:
    """Extrapolate a layer under what hides it, as far as it can become visible: colour, blur and motion.

    A hidden pixel is guessed to be of the layer that is seen nearest to it; ``before`` is the share of each pixel that
    lies in this layer or in front of it.
    """
    known, wanted = weight > 0.5, hidden > 0
    # What is known within reach of a hidden pixel lies within reach of the box of all.
    near = _around(wanted, int(np.ceil(reach)) + 3)
    away = distance_transform_edt(~known[near])
    wanted[near] &= away <= reach + 2
    deeper = before[near] < 0.5
    if peel is None and deeper.any():
        wanted[near] &= away <= distance_transform_edt(~deeper)
    if not wanted.any() or not known[near].any():
        return layer
    box = _around(wanted, CONTEXT)
    part = Layer(layer.rgba[box], layer.s[box], None if layer.motion is None else layer.motion[box])
    second = None
    if peel is not None:
        second = Layer(peel.rgba[box], peel.s[box], None if peel.motion is None else peel.motion[box])
    made = _filled_part(part, weight[box], hidden[box], known[box], wanted[box], second, cut)
    # The light is this layer's own product with its share; blur may be that of the whole frame.
    rgba, s = layer.rgba, layer.s.copy()
    rgba[box], s[box] = made.rgba, made.s
    motion = layer.motion
    if motion is not None:
        motion = motion.copy()
        motion[box] = made.motion
    return Layer(rgba, s, motion)


def _around(mask: np.ndarray, margin: int) -> tuple[slice, slice]:
    """Return the box around a mask that is not empty, with so many pixels of surroundings."""
    spans = []
    for axis in (1, 0):
        where = np.flatnonzero(mask.any(axis))
        spans.append(slice(max(int(where[0]) - margin, 0), int(where[-1]) + 1 + margin))
    rows, columns = spans
    return rows, columns


def _filled_part(
    layer: Layer,
    weight: np.ndarray,
    hidden: np.ndarray,
    known: np.ndarray,
    wanted: np.ndarray,
    peel: Layer | None,
    cut: float,
) -> Layer:
    """Fill the box of a layer that changes."""
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
    """Extrapolate values [height, width, channels] beyond the known pixels.

    Near the border the nearest known pixel is copied, which continues structure; farther away a smooth membrane is
    used. A pixel on the very border may hold light of what hides the rest: its inner neighbour is taken where there is
    one.
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
    """Clamp a blurred layer: light ≥ 0, coverage in [0, 1]; the light is divided by coverage above 1.

    Args:
        image: Blurred layer [..., 4], premultiplied.

    Returns:
        Clamped layer [..., 4].
    """
    out = np.maximum(image, 0)
    over = out[..., 3] > 1
    out[over] /= out[over][:, 3:]
    return out


def composite(images: list[np.ndarray]) -> np.ndarray:
    """Composite blurred layers: C = Σ C_l Π_{k<l} (1 − α_k).

    Args:
        images: Layers [height, width, 4], premultiplied, front to back.

    Returns:
        Picture [height, width, 4], premultiplied.
    """
    out = np.zeros_like(images[0])
    open_ = np.ones_like(images[0][..., :1])
    for image in images:
        out += open_ * image
        open_ = open_ * (1 - image[..., 3:])
    return out


def over_coverage(image: np.ndarray) -> np.ndarray:
    """Divide an opaque picture by its coverage, where light is missing at a hole or at the edge of the frame.

    Args:
        image: Picture [height, width, 4], premultiplied.

    Returns:
        Picture [height, width, 4] with coverage 1, or 0 where there was none.
    """
    alpha = image[..., 3:]
    scale = np.where(alpha > 1e-4, 1 / np.maximum(alpha, 1e-4), 0)
    return np.concatenate([image[..., :3] * scale, (alpha > 1e-4).astype(image.dtype)], -1)


def extend(image: np.ndarray, pad: int, white: float) -> np.ndarray:
    """Repeat the border of a picture outwards, with its highlights clamped to twice its median.

    Light from outside the frame is unknown; the nearest pixels are the best estimate, but a lamp on the border would
    become a streak.

    Args:
        image: Picture [height, width, 4], premultiplied.
        pad: Width of the new border, pixels, ≥ 1.
        white: Value below which nothing is clamped.

    Returns:
        Picture [height + 2·pad, width + 2·pad, 4].
    """
    out = np.pad(image, ((pad, pad), (pad, pad), (0, 0)), mode="edge")
    border = np.concatenate([image[0], image[-1], image[:, 0], image[:, -1]])[:, :3].max(1)
    most = max(white, 2 * float(np.median(border)))
    for strip in (out[:pad], out[-pad:], out[pad:-pad, :pad], out[pad:-pad, -pad:]):
        np.minimum(strip[..., :3], most, out=strip[..., :3])
    return out
