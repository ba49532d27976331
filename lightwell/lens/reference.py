"""Reference implementations for tests: scatter in NumPy, and splatting with dense kernels."""

from __future__ import annotations

import numpy as np

from lightwell.lens.splat import Frame, Planes, Points, Sources


def splat(frame: Frame, points: Points, sources: Sources) -> Planes:
    """Scatter one source after the other in float64; otherwise like ``lightwell.lens.splat.splat``.

    Args:
        frame: Size of the picture and its guard band.
        points: Points of all records.
        sources: What is scattered.

    Returns:
        Picture and charges [H, W, 4] float64.
    """
    image = np.zeros((2, *frame.padded, 4))
    for i in range(len(sources.x)):
        record = sources.record[i]
        mine = slice(points.first[record], points.first[record] + points.count[record])
        dx, dy, value = (a[mine].astype(np.float64) for a in (points.x, points.y, points.value))
        c, s = float(sources.cosine[i]), 0.0 if sources.sine is None else float(sources.sine[i])
        x = sources.x[i] + frame.guard + c * dx - s * dy
        y = sources.y[i] + frame.guard + s * dx + c * dy
        ix, iy = np.floor(x).astype(int), np.floor(y).astype(int)
        fx, fy = x - ix, y - iy
        plane = image[points.plane[record]]
        for ox, wx in ((0, 1 - fx), (1, fx)):
            for oy, wy in ((0, 1 - fy), (1, fy)):
                light = (value * wx * wy)[:, None] * sources.rgba[i].astype(np.float64)
                inside = (wx * wy) != 0
                np.add.at(plane, (iy[inside] + oy, ix[inside] + ox), light[inside])
    return Planes(image[0], image[1])


def dense(rgba: np.ndarray, kernels: list[np.ndarray], which: np.ndarray) -> np.ndarray:
    """Blur by brute force: I(x) = Σ_i L_i K_i(x − x_i), float64; light beyond the frame is dropped.

    Args:
        rgba: Light [height, width, channels].
        kernels: Point spread functions [2·hy+1, 2·hx+1].
        which: Index of each pixel's kernel [height, width].

    Returns:
        Picture [height, width, channels].
    """
    height, width, channels = rgba.shape
    reach = max(max(k.shape) // 2 for k in kernels)
    image = np.zeros((height + 2 * reach, width + 2 * reach, channels))
    for index in np.unique(which):
        kernel = kernels[index]
        light = np.where((which == index)[..., None], rgba, 0.0)
        hy, hx = kernel.shape[0] // 2, kernel.shape[1] // 2
        for row, column in zip(*np.nonzero(kernel)):
            oy, ox = reach + row - hy, reach + column - hx
            image[oy : oy + height, ox : ox + width] += kernel[row, column] * light
    return image[reach : reach + height, reach : reach + width]
