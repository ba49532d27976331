"""Pictures of a comparison as PNG bytes: prediction, reference, log-difference, regions, and the worst tile enlarged.

f is the prediction and y the reference, [height, width, 3] radiance in the unit S.
"""

from __future__ import annotations

import io

import numpy as np
from PIL import Image

from lightwell.core.color import display
from lightwell.report.metrics import worst_tile

# Added to the difference and to the reference: keep the logarithm finite and limit the relative error of dark pixels.
DIFFERENCE_FLOOR, SHADOW = 1e-4, 1e-2
# The fixed colour scale of the log-difference: log10 of a relative difference of 0.3 % and of 300 %.
DIFFERENCE_LOW, DIFFERENCE_HIGH = -2.5, 0.5
# Ten control points of 'inferno', a colour map of even perceptual steps (Smith and van der Walt 2015, CC0).
INFERNO = (
    (0, 0, 4),
    (27, 12, 65),
    (74, 12, 107),
    (120, 28, 109),
    (165, 44, 96),
    (207, 68, 70),
    (237, 105, 37),
    (251, 155, 6),
    (247, 209, 61),
    (252, 255, 164),
)
# Distance of successive regions on the colour wheel: the golden ratio, so that consecutive numbers differ clearly.
GOLDEN_RATIO = 0.6180339887498949
# Side of the worst tile, pixels, and how many times it is enlarged.
TILE, ENLARGEMENT = 16, 12
# Period of the hatching of blend bands, pixels.
HATCH = 4


def png(pixels: np.ndarray) -> bytes:
    """Encode a picture as PNG.

    Args:
        pixels: Picture [height, width, 3] uint8.

    Returns:
        The file's bytes.
    """
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "PNG", optimize=True)
    return stream.getvalue()


def bytes_of(values: np.ndarray) -> np.ndarray:
    """Convert display values to 8 bits.

    Args:
        values: Display values [...] in [0, 1]; clamped.

    Returns:
        uint8, same shape.
    """
    return np.rint(np.clip(values, 0, 1) * 255).astype(np.uint8)


def shown(radiance: np.ndarray) -> np.ndarray:
    """Tone-map radiance to 8 bits.

    Args:
        radiance: Radiance in the unit S [..., 3].

    Returns:
        Display values, uint8, same shape.
    """
    return bytes_of(display(radiance))


def log_difference(f: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Compute log10((|f − y| + 1e-4) / (y + 1e-2)), both averaged over the channels.

    Args:
        f: Prediction [height, width, 3].
        y: Reference [height, width, 3].

    Returns:
        Log-difference [height, width].
    """
    difference = np.abs(np.asarray(f, np.float64) - y).mean(axis=-1)
    return np.log10((difference + DIFFERENCE_FLOOR) / (np.maximum(y, 0).mean(axis=-1) + SHADOW))


def colour_map(values: np.ndarray) -> np.ndarray:
    """Map values to colours from black (0) to pale yellow (1).

    Args:
        values: Values [...] in [0, 1]; clamped.

    Returns:
        Colours [..., 3] uint8.
    """
    steps = np.linspace(0, 1, len(INFERNO))
    channels = [np.interp(values, steps, [c[k] for c in INFERNO]) for k in range(3)]
    return np.rint(np.stack(channels, axis=-1)).astype(np.uint8)


def difference(f: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Draw the log-difference on its fixed colour scale.

    Args:
        f: Prediction [height, width, 3].
        y: Reference [height, width, 3].

    Returns:
        Picture [height, width, 3] uint8.
    """
    return colour_map((log_difference(f, y) - DIFFERENCE_LOW) / (DIFFERENCE_HIGH - DIFFERENCE_LOW))


def region_colours(regions: np.ndarray, blend: np.ndarray | None = None) -> np.ndarray:
    """Draw a fixed colour for every region, with white hatching where regions are blended.

    Args:
        regions: Region of every pixel [height, width], integers; negative, drawn black, where there is no surface.
        blend: Whether a pixel is blended [height, width]; None for none.

    Returns:
        Picture [height, width, 3] uint8.
    """
    hue = (np.asarray(regions, np.float64) * GOLDEN_RATIO)[..., None] % 1
    wheel = 0.5 + 0.5 * np.cos(2 * np.pi * (hue + np.array([0, 1 / 3, 2 / 3])))
    # Alternating lightness separates the regions for readers who do not see hue.
    lightness = np.where(np.asarray(regions) % 2, 0.95, 0.75)[..., None]
    pixels = bytes_of((0.35 + 0.65 * wheel) * lightness)
    pixels[np.asarray(regions) < 0] = 0
    if blend is not None:
        rows, columns = np.indices(blend.shape)
        pixels[blend & ((rows + columns) % HATCH == 0)] = 255
    return pixels


def outlined(pixels: np.ndarray, row: int, column: int, size: int = TILE) -> np.ndarray:
    """Draw a white frame around a tile.

    Args:
        pixels: Picture [height, width, 3] uint8.
        row: First row of the tile.
        column: First column of the tile.
        size: Side of the tile, pixels.

    Returns:
        Copy of the picture with the frame.
    """
    copy = pixels.copy()
    bottom, right = min(row + size, copy.shape[0]) - 1, min(column + size, copy.shape[1]) - 1
    copy[[row, bottom], column : right + 1] = 255
    copy[row : bottom + 1, [column, right]] = 255
    return copy


def view_pictures(
    f: np.ndarray, y: np.ndarray, regions: np.ndarray | None = None, blend: np.ndarray | None = None
) -> dict[str, bytes]:
    """Draw the pictures of a view: prediction, reference, difference with its worst tile framed, and regions if given.

    Args:
        f: Prediction [height, width, 3].
        y: Reference [height, width, 3].
        regions: Region of every pixel [height, width]; None for none.
        blend: Whether a pixel is blended [height, width]; None for none.

    Returns:
        Name → PNG.
    """
    row, column, _ = worst_tile(f, y, TILE)
    pictures = {
        "prediction": shown(f),
        "reference": shown(y),
        "difference": outlined(difference(f, y), row, column),
    }
    if regions is not None:
        pictures["regions"] = region_colours(regions, blend)
    return {name: png(pixels) for name, pixels in pictures.items()}


def worst_tile_pictures(f: np.ndarray, y: np.ndarray) -> dict[str, bytes]:
    """Draw the worst tile, enlarged: prediction, reference and difference.

    Args:
        f: Prediction [height, width, 3].
        y: Reference [height, width, 3].

    Returns:
        Name → PNG.
    """
    row, column, _ = worst_tile(f, y, TILE)
    window = np.s_[row : row + TILE, column : column + TILE]
    pictures = {"prediction": shown(f[window]), "reference": shown(y[window])}
    pictures["difference"] = difference(f[window], y[window])
    return {name: png(enlarged(pixels)) for name, pixels in pictures.items()}


def enlarged(pixels: np.ndarray, times: int = ENLARGEMENT) -> np.ndarray:
    """Enlarge a picture by repeating pixels.

    Args:
        pixels: Picture [height, width, 3].
        times: Size of a pixel in the result.

    Returns:
        Picture [height · times, width · times, 3].
    """
    return pixels.repeat(times, axis=0).repeat(times, axis=1)
