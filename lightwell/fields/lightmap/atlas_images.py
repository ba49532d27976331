"""Images over an atlas. Texels between charts are filled, so that a bilinear read near a chart never mixes in another
one.

Notation: n texels along each edge, C channels.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.ndimage import distance_transform_edt, gaussian_filter

from lightwell.core.denoise import denoise, missing

# Charts of fewer texels than this along an edge are averaged over so many texels (standard deviation), because the
# denoiser has too little context.
SMALLEST, AVERAGED = 4, 3.0
# Charts of fewer texels than SMALL along an edge are denoised with so many texels of their mirror image around them.
SMALL, MIRRORED = 8, 16
# Edge of the sheets that small charts share while they are denoised, and of the largest patch on them, texels.
SHEET, ON_SHEET = 1024, 128
# Standard deviation of the window in which noise and the changes of the denoiser are compared, texels; the changes are
# left alone up to so many times the noise, by squares and by squares of roots. PSNR of displayed irradiance of eight
# scenes against the denoised image: modern-house +4.2 dB, needle-lightmap-house +1.6, drake-living-room +1.1, courtyard
# +0.3, three others 0.0; -1.1 in bakedgi-building, which few paths light at all (-2.9 with 1 and 2, -7.1 with roots
# alone).
WINDOW, MORE_THAN_NOISE, MORE_THAN_ROOTS = 3.0, 1.5, 2.0
# Charts are continued by so many texels at least: about what the filter looks at.
CONTINUED = 12


def dilated(image: np.ndarray, covered: np.ndarray, reach: int) -> np.ndarray:
    """Fill the texels that no chart covers: those near a chart copy the nearest covered texel, or the mean of two that
    are as near, the others are smooth.

    Args:
        image: [n, n, C] image.
        covered: [n, n] bool, True for texels with a value.
        reach: Distance up to which texels are copies, in texels.

    Returns:
        [n, n, C] float32 image.
    """
    distance, index = distance_transform_edt(~covered, return_indices=True)
    near = distance <= reach
    # Backwards, the transform finds the other one of two texels that are as near, such as those on both sides of a body
    # that touches a wall: their mean is wrong by half of their difference on each side, not by all of it on one.
    other = distance_transform_edt(~covered[::-1, ::-1], return_indices=True)[1][:, ::-1, ::-1]
    other = np.reshape(covered.shape, (2, 1, 1)) - 1 - other
    filled = 0.5 * (image[tuple(index)] + image[tuple(other)])
    return push_pull(np.where(near[..., None], filled, 0).astype(np.float32), near)


def mirrored(image: np.ndarray, covered: np.ndarray, reach: int) -> np.ndarray:
    """Continue the covered texels by their mirror image, where it is covered too, else as ``dilated``.

    Copies of the nearest texel would be streaks of its noise, which a denoiser takes for edges.

    Args:
        image: [n, n, C] image.
        covered: [n, n] bool, True for texels with a value.
        reach: Distance up to which the image is continued, in texels.

    Returns:
        [n, n, C] float32 image.
    """
    distance, index = distance_transform_edt(~covered, return_indices=True)
    place = np.stack(np.indices(covered.shape))
    other = 2 * index - place
    inside = ((other >= 0) & (other < np.reshape(covered.shape, (2, 1, 1)))).all(axis=0)
    other = np.where(inside, other, index)
    source = np.where(covered[tuple(other)], other, index)
    near = distance <= reach
    return push_pull(np.where(near[..., None], image[tuple(source)], 0).astype(np.float32), near)


def push_pull(image: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Fill unknown texels with means of ever larger neighbourhoods (Gortler et al. 1996).

    Args:
        image: [n, n, C] image.
        known: [n, n] bool, True for texels that keep their value.

    Returns:
        [n, n, C] float32 image.
    """
    weight = known.astype(np.float32)[..., None]
    if weight.all() or image.shape[0] == 1 or image.shape[1] == 1:
        return image
    total, count = _halved(image * weight), _halved(weight)
    coarse = push_pull((total / np.maximum(count, 1e-6)).astype(np.float32), count[..., 0] > 0)
    fine = np.repeat(np.repeat(coarse, 2, axis=0), 2, axis=1)[: image.shape[0], : image.shape[1]]
    return np.where(known[..., None], image, fine).astype(np.float32)


def _halved(image: np.ndarray) -> np.ndarray:
    """Sums of squares of four texels; an odd edge is repeated."""
    height, width = (-(-s // 2) for s in image.shape[:2])
    even = np.pad(image, [(0, s % 2) for s in image.shape[:2]] + [(0, 0)], mode="edge")
    return even.reshape(height, 2, width, 2, -1).sum(axis=(1, 3))


def denoised(image: np.ndarray, chart: np.ndarray, reach: int) -> np.ndarray:
    """Denoise diffuse light, each chart in a rectangle of its own that continues the chart, so that charts do not mix.

    Unchanged on platforms without Open Image Denoise (``lightwell.core.denoise.missing``).

    Args:
        image: [n, n, 3] linear light.
        chart: [n, n] int chart of each texel, −1 for none.
        reach: Distance up to which a chart is continued at least, in texels.

    Returns:
        [n, n, 3] image.
    """
    if missing():
        return image
    out = image.copy()
    reach, small = max(reach, CONTINUED), []
    for rows, columns, own in _rectangles(chart, reach):
        size = min(np.ptp(found) + 1 for found in np.nonzero(own))
        if size < SMALLEST:
            out[rows, columns][own] = averaged(image[rows, columns], own)[own]
            continue
        patch = mirrored(image[rows, columns], own, reach)
        more = MIRRORED if size < SMALL else 0
        patch = np.pad(patch, ((more, more), (more, more), (0, 0)), mode="symmetric")
        place = (rows, columns, own, more)
        if max(patch.shape) > ON_SHEET:
            _take(out, denoise(patch, filter="RTLightmap"), *place)
        else:
            small.append((patch, place))
    for sheet in _sheets([patch.shape[:2] for patch, _ in small]):
        canvas = np.zeros((max(y + small[k][0].shape[0] for k, y, _ in sheet), SHEET, 3), np.float32)
        for k, y, x in sheet:
            canvas[y : y + small[k][0].shape[0], x : x + small[k][0].shape[1]] = small[k][0]
        clean = denoise(canvas, filter="RTLightmap")
        for k, y, x in sheet:
            patch, place = small[k]
            _take(out, clean[y : y + patch.shape[0], x : x + patch.shape[1]], *place)
    return out


def partly_denoised(half_a: np.ndarray, half_b: np.ndarray, clean: np.ndarray, covered: np.ndarray) -> np.ndarray:
    """Go back towards the noisy image where a denoiser changed more than noise explains, as in narrow shadows.

    The positive-part estimator of James and Stein (1961), R + w (D − R) with w = E(R − T)² / E(D − R)² of a small
    window: what the denoiser removes is noise where these are equal, and light where the second is larger. The noise is
    that of the two halves. Both are compared twice, as they are and as their roots: single bright paths decide the
    first, and the second is biased where most paths find nothing; the denoised image stays where either tells so.

    Args:
        half_a: [n, n, C] image R of the first half of the paths, ≥ 0.
        half_b: [n, n, C] that of the second, independent half.
        clean: [n, n, C] denoised image D of their mean.
        covered: [n, n] bool: texels with a value in all three.

    Returns:
        [n, n, C] float32 image; that of ``clean`` where nothing is covered.
    """
    noisy = 0.5 * (half_a + half_b)
    unit = max(float(noisy[covered].mean()), 1e-30) if covered.any() else 1.0
    weight = np.zeros(covered.shape)
    for factor, power in ((MORE_THAN_NOISE, 1.0), (MORE_THAN_ROOTS, 0.5)):
        a, b, r, d = (np.maximum(v / unit, 0) ** power for v in (half_a, half_b, noisy, clean))
        noise, change = (
            gaussian_filter(np.where(covered, np.square(v).mean(axis=2), 0), WINDOW, mode="constant")
            for v in (0.5 * (a - b), d - r)
        )
        weight = np.maximum(weight, factor * noise / np.maximum(change, 1e-12))
    weight = np.clip(weight, 0, 1)[..., None]
    return np.where(covered[..., None], noisy + weight * (clean - noisy), clean).astype(np.float32)


def _take(out: np.ndarray, clean: np.ndarray, rows: slice, columns: slice, own: np.ndarray, more: int) -> None:
    """Copy the texels of one chart from a clean patch with a margin."""
    out[rows, columns][own] = clean[more : clean.shape[0] - more, more : clean.shape[1] - more][own]


def _sheets(sizes: Sequence[tuple[int, int]]) -> Iterator[list[tuple[int, int, int]]]:
    """Lay patches [(height, width)] out in rows of sheets; (number, y, x) of those of each sheet.

    The denoiser takes longer to begin than to clean a chart of a few texels.
    """
    sheet: list[tuple[int, int, int]] = []
    x = y = height = 0
    for k in sorted(range(len(sizes)), key=lambda k: -sizes[k][0]):
        if x + sizes[k][1] > SHEET:
            x, y, height = 0, y + height, 0
        if y + sizes[k][0] > SHEET:
            yield sheet
            sheet, x, y, height = [], 0, 0, 0
        sheet.append((k, y, x))
        x, height = x + sizes[k][1], max(height, sizes[k][0])
    if sheet:
        yield sheet


def averaged(image: np.ndarray, covered: np.ndarray) -> np.ndarray:
    """Average over the covered texels around each texel.

    Args:
        image: [n, n, C] image.
        covered: [n, n] bool, True for texels that count.

    Returns:
        [n, n, C] image; 0 far from covered texels.
    """
    weight = covered.astype(np.float64)[..., None]
    around = [gaussian_filter(v, AVERAGED, axes=(0, 1), mode="constant") for v in (image * weight, weight)]
    return (around[0] / np.maximum(around[1], 1e-12)).astype(np.float32)


def _rectangles(chart: np.ndarray, reach: int) -> Iterator[tuple[slice, slice, np.ndarray]]:
    """(rows, columns, [h, w] texels of the chart) of every chart."""
    from scipy.ndimage import find_objects

    for number, box in enumerate(find_objects(chart + 1)):
        if box is None:
            continue
        rows, columns = (slice(max(s.start - reach, 0), min(s.stop + reach, n)) for s, n in zip(box, chart.shape))
        yield rows, columns, chart[rows, columns] == number
