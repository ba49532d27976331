"""Pictures of a comparison as data URIs: prediction, reference, log-difference, regions, and places enlarged.

f is the prediction and y the reference, [height, width, 3] radiance in the exposure unit of the view.
"""

from __future__ import annotations

import base64

import numpy as np

from lightwell.core.color import display
from lightwell.core.image_io import encoded, jpeg
from lightwell.report.records import ViewComparison

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
# A place is shown with its surroundings, so many times as wide, and its pixels are enlarged.
CONTEXT, ENLARGEMENT = 4, 2
# Without visible blocks, at a fifth of the size of PNG.
JPEG_QUALITY = 92
# Period of the hatching of blend bands, pixels.
HATCH = 4


def data_uri(pixels: np.ndarray, lossless: bool = False) -> str:
    """Encode a picture as a data URI.

    Args:
        pixels: Picture [height, width, 3] uint8.
        lossless: PNG instead of JPEG.

    Returns:
        ``data:image/…;base64,…``.
    """
    data = encoded(pixels, "PNG", optimize=True) if lossless else jpeg(pixels, JPEG_QUALITY)
    kind = "png" if lossless else "jpeg"
    return f"data:image/{kind};base64,{base64.b64encode(data).decode()}"


def bytes_of(values: np.ndarray) -> np.ndarray:
    """Convert display values to 8 bits.

    Args:
        values: Display values [...] in [0, 1]; clamped.

    Returns:
        uint8, same shape.
    """
    return np.asarray(np.rint(np.clip(values, 0, 1) * 255), np.uint8)


def shown(radiance: np.ndarray) -> np.ndarray:
    """Tone-map radiance to 8 bits.

    Args:
        radiance: Radiance in the exposure unit [..., 3].

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
    relative: np.ndarray = (difference + DIFFERENCE_FLOOR) / (np.maximum(y, 0).mean(axis=-1) + SHADOW)
    return np.asarray(np.log10(relative))


def colour_map(values: np.ndarray) -> np.ndarray:
    """Map values to colours from black (0) to pale yellow (1).

    Args:
        values: Values [...] in [0, 1]; clamped.

    Returns:
        Colours [..., 3] uint8.
    """
    steps = np.linspace(0, 1, len(INFERNO))
    channels = [np.interp(values, steps, [c[k] for c in INFERNO]) for k in range(3)]
    return np.asarray(np.rint(np.stack(channels, axis=-1)), np.uint8)


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


def framed(pixels: np.ndarray, row: int, column: int, size: int) -> np.ndarray:
    """Draw a frame around a tile: white, two pixels wide, with a black line inside and outside.

    Args:
        pixels: Picture [height, width, 3] uint8.
        row: First row of the tile.
        column: First column of the tile.
        size: Side of the tile, pixels.

    Returns:
        Copy of the picture with the frame.
    """
    copy = pixels.copy()
    for grow, value in ((3, 0), (2, 255), (1, 255), (0, 0)):
        top, left = max(row - grow, 0), max(column - grow, 0)
        bottom, right = min(row + size + grow, copy.shape[0]) - 1, min(column + size + grow, copy.shape[1]) - 1
        copy[[top, bottom], left : right + 1] = value
        copy[top : bottom + 1, [left, right]] = value
    return copy


def view_pictures(view: ViewComparison, unit: float) -> dict[str, str]:
    """Draw the pictures of a view: prediction, reference, difference, and regions if there are any.

    Args:
        view: The view.
        unit: Its exposure unit.

    Returns:
        Name → data URI.
    """
    f, y = (np.asarray(x, np.float64) / unit for x in (view.shown.prediction, view.shown.reference))
    pictures = {name: data_uri(shown(x)) for name, x in (("prediction", f), ("reference", y))}
    pictures["difference"] = data_uri(difference(f, y))
    if view.regions is not None:
        pictures["regions"] = data_uri(enlarged(region_colours(view.regions, view.blend), magnification(view)), True)
    return pictures


def magnification(view: ViewComparison) -> int:
    """Return how many times as large as the scored view its pictures are.

    Args:
        view: The view.

    Returns:
        Pixels of a picture per scored pixel.
    """
    return int(view.shown.reference.shape[0] // view.half_a.shape[0])


def place_pictures(view: ViewComparison, unit: float, row: int, column: int, size: int) -> dict[str, str]:
    """Draw a tile of a view with its surroundings, the tile in a frame: prediction and reference.

    Args:
        view: The view.
        unit: Its exposure unit.
        row: First row of the tile, in pixels of the scored view.
        column: First column of the tile.
        size: Side of the tile, pixels.

    Returns:
        Name → data URI.
    """
    times = magnification(view)
    height, width = view.half_a.shape[:2]
    side = min(CONTEXT * size, height, width)
    top = min(max(row - (side - size) // 2, 0), height - side) * times
    left = min(max(column - (side - size) // 2, 0), width - side) * times
    window = np.s_[top : top + side * times, left : left + side * times]
    pictures = {}
    for name, x in (("prediction", view.shown.prediction), ("reference", view.shown.reference)):
        pixels = enlarged(shown(np.asarray(x, np.float64)[window] / unit), ENLARGEMENT)
        at = ENLARGEMENT * (row * times - top), ENLARGEMENT * (column * times - left)
        pictures[name] = data_uri(framed(pixels, *at, ENLARGEMENT * size * times))
    return pictures


def enlarged(pixels: np.ndarray, times: int) -> np.ndarray:
    """Enlarge a picture by repeating pixels.

    Args:
        pixels: Picture [height, width, 3].
        times: Size of a pixel in the result.

    Returns:
        Picture [height · times, width · times, 3].
    """
    return pixels.repeat(times, axis=0).repeat(times, axis=1)
