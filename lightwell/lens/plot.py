"""Pictures of a spreadlet: kernel, points, reconstruction and difference, side by side on fixed scales."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lightwell.files import whole_file
from lightwell.lens.library import Library
from lightwell.lens.spreadlet import response_of

# Side of a panel, pixels; factor by which differences are amplified.
PANEL, DIFFERENCE = 320, 10.0


def _grey(image: np.ndarray, top: float) -> np.ndarray:
    return np.repeat((np.clip(image / top, 0, 1) * 255).astype(np.uint8)[..., None], 3, -1)


def _signed(image: np.ndarray, top: float) -> np.ndarray:
    """Map values to colours: red above zero, blue below, white at zero."""
    v = np.clip(image / top, -1, 1)
    up, down = np.maximum(v, 0), np.maximum(-v, 0)
    return ((1 - np.stack([down, up + down - np.minimum(up, down), up], -1)) * 255).astype(np.uint8)


def _large(image: np.ndarray) -> np.ndarray:
    """Enlarge or reduce by a whole number into a square panel."""
    shrink = -(-max(image.shape[:2]) // PANEL)
    if shrink > 1:
        pads = [(0, -n % shrink) for n in image.shape[:2]]
        whole = np.pad(image, (*pads, (0, 0)), mode="edge").astype(np.float64)
        blocks = whole.reshape(whole.shape[0] // shrink, shrink, whole.shape[1] // shrink, shrink, 3)
        image = np.rint(blocks.mean((1, 3))).astype(np.uint8)
    factor = max(PANEL // max(image.shape[:2]), 1)
    big = image.repeat(factor, 0).repeat(factor, 1)[:PANEL, :PANEL]
    panel = np.full((PANEL, PANEL, 3), 40, np.uint8)
    y, x = (PANEL - big.shape[0]) // 2, (PANEL - big.shape[1]) // 2
    panel[y : y + big.shape[0], x : x + big.shape[1]] = big
    return panel


def panels(kernel: np.ndarray, response: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Draw the four panels of a spreadlet, with one scale for kernel and reconstruction.

    Args:
        kernel: Point spread function [h, w].
        response: Reconstruction [h, w].
        points: Charges [h, w], 0 where there is no point.

    Returns:
        Picture [PANEL, 4·PANEL, 3] uint8.
    """
    top = float(kernel.max())
    charge = max(float(np.abs(points).max()), 1e-12)
    parts = [
        _grey(kernel, top),
        _signed(np.sign(points) * np.sqrt(np.abs(points) / charge), 1),
        _grey(response, top),
        _signed(DIFFERENCE * (response - kernel), top),
    ]
    return np.concatenate([_large(part) for part in parts], 1)


def picture(library: Library, node: int, tier: int, path: Path) -> None:
    """Write the panels of one spreadlet as PNG: kernel, points, reconstruction, 10 × difference.

    Args:
        library: The library.
        node: Index of a baked node.
        tier: ``MAIN`` or ``FINE``.
        path: File to write.
    """
    from PIL import Image

    spreadlet, kernel = library.nodes[node, tier], library.family.kernel(node)
    margin = max(max(kernel.shape) // 4, 4)
    half = max(kernel.shape) // 2 + margin
    image = np.zeros((2 * half + 1, 2 * half + 1))
    hy, hx = kernel.shape[0] // 2, kernel.shape[1] // 2
    image[half - hy : half + hy + 1, half - hx : half + hx + 1] = kernel
    points = np.zeros_like(image)
    np.add.at(points, (spreadlet.y + half, spreadlet.x + half), spreadlet.values)
    with whole_file(path) as temporary:
        Image.fromarray(panels(image, response_of(spreadlet, (half, half)), points)).save(temporary, format="PNG")
