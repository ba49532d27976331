"""EXR files for the lens: read every channel of every part by its full name, and deep pixels; write the result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from lightwell.exr import DecodedPart, ExrError, ExrPart, decode_parts, read_header
from lightwell.exr.header import Window
from lightwell.files import whole_file
from lightwell.lens.errors import LensError
from lightwell.limits import Limits


@dataclass
class Channels:
    """All channels of a file, on one window."""

    names: dict[str, np.ndarray]
    """Channel name → [height, width] float32. Names without a layer are prefixed by the part: ``depth_left.Z``."""
    window: Window
    """x0, y0, width and height of the arrays within the display window's coordinates."""
    display: Window
    """x0, y0, width and height of the displayed picture."""
    deep: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    """Deep channel name to the number of samples of each pixel [height, width] and all samples in their order."""


def read(
    path: str | Path, view: str | None = None, limits: Limits | None = None, without_views: bool = False
) -> Channels:
    """Read all channels of one view on the union of their data windows; pixels outside a part's own window are 0.

    Args:
        path: An EXR file: scan lines, tiles, several parts, or deep.
        view: Name of a view; None for the first one of the file.
        limits: Limits on what the file may request; None for ``Limits()``.
        without_views: Whether a file that has no views is of every view.

    Returns:
        The channels.

    Raises:
        LensError: The file is missing, damaged or not EXR, exceeds a limit, or lacks the view.
    """
    path = Path(path)
    if not path.is_file():
        raise LensError(f"lens: no file {path}; name an EXR or PNG picture")
    limits = limits or Limits()
    budget = limits.budget(f"lens: {path}", LensError)
    try:
        headers = read_header(path, budget)
        chosen = _chosen(path, headers, view, without_views)
        window = _union([headers[i].window for i in chosen])
        display = headers[chosen[0]].display
        _, _, width, height = _union([window, display])
        together = "data windows and display window together"
        budget.check("picture_edge", max(width, height), together)
        budget.check("picture_texels", width * height, together)
        channels = sum(len(headers[i].channels) for i in chosen)
        budget.check("decoded_bytes", 4 * width * height * channels, together)
        parts = decode_parts(path, headers, chosen, limits.seconds)
    except ExrError as error:
        raise LensError(f"lens: cannot read {path} as EXR ({error}); render or export it again") from None
    found = Channels({}, window, display)
    for part in parts:
        _collect(found, part, len(chosen) > 1)
    return found


def _chosen(path: Path, headers: Sequence[ExrPart], view: str | None, without_views: bool) -> list[int]:
    """Return the indices of the parts of a view, and of those that belong to no view."""
    known = list(dict.fromkeys(part.view for part in headers if part.view))
    if view is not None and view not in known and (known or not without_views):
        raise LensError(f"lens: {path} has no view {view!r}; it has {', '.join(known) or 'none'}")
    wanted = view or (known[0] if known else None)
    return [i for i, part in enumerate(headers) if not part.view or part.view == wanted]


def _union(windows: Sequence[Window]) -> Window:
    """Return the smallest window around several: x0, y0, width, height."""
    x0, y0 = min(w[0] for w in windows), min(w[1] for w in windows)
    return x0, y0, max(w[0] + w[2] for w in windows) - x0, max(w[1] + w[3] for w in windows) - y0


def _collect(found: Channels, part: DecodedPart, several: bool) -> None:
    """Add the channels of one part."""
    x0, y0, width, height = found.window
    left, top, across, down = part.header.window
    at = slice(top - y0, top - y0 + down), slice(left - x0, left - x0 + across)
    prefix = part.header.name
    every: dict[str, Any] = {**part.flat, **part.deep}
    for name, pixels in every.items():
        full = f"{prefix}.{name}" if several and prefix and "." not in name and name not in "RGBA" else name
        full = full if full not in found.names else f"{prefix}.{name}"
        if isinstance(pixels, tuple):
            counts = np.zeros((height, width), np.int32)
            counts[at] = pixels[0]
            found.deep[full] = counts, pixels[1]
        else:
            plane = np.zeros((height, width), np.float32)
            plane[at] = pixels
            found.names[full] = plane


def write(path: str | Path, image: np.ndarray, window: Window | None = None, display: Window | None = None) -> None:
    """Write a picture as half float (float where half cannot hold it); the file is either complete or absent.

    Args:
        path: File to write.
        image: RGBA [height, width, 4], linear, premultiplied.
        window: x0, y0, width, height of the image within the display window's coordinates; None: at 0, 0.
        display: x0, y0, width, height of the displayed picture; None: that of the image at 0, 0.

    Raises:
        LensError: The file cannot be written.
    """
    import OpenEXR

    path = Path(path)
    height, width = image.shape[:2]
    x0, y0 = window[:2] if window else (0, 0)
    dx, dy, dw, dh = display or (0, 0, width, height)
    header = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "dataWindow": (np.array([x0, y0], np.int32), np.array([x0 + width - 1, y0 + height - 1], np.int32)),
        "displayWindow": (np.array([dx, dy], np.int32), np.array([dx + dw - 1, dy + dh - 1], np.int32)),
    }
    kind = np.float16 if np.abs(image).max(initial=0) < 65000 else np.float32
    channels = {name: np.ascontiguousarray(image[..., i].astype(kind)) for i, name in enumerate("RGBA")}
    try:
        with whole_file(path, ".part.exr") as temporary:
            OpenEXR.File(header, channels).write(str(temporary))
    except Exception as error:
        reason = " ".join(str(error).split())
        raise LensError(f"lens: cannot write {path} ({reason}); does its folder exist?") from None


def flatten_deep(found: Channels, layers: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Sort deep samples into depth layers and composite each layer.

    Layers are separated at depths with few samples. A sample near such a depth belongs to both layers: with weight w in
    front and, behind, with the weight that gives its own coverage when both are composited, so that no surface shows a
    seam. Within a layer samples are composited front to back; the layer's depth is their coverage-weighted mean.

    Args:
        found: Channels of a deep file, with a deep channel Z.
        layers: Largest number of layers, ≥ 1.

    Returns:
        (rgba [height, width, 4] premultiplied, depth [height, width]) of every layer, front to back.

    Raises:
        LensError: There is no deep channel Z, or all samples are invalid.
    """
    depth_name = next((n for n in found.deep if n.split(".")[-1] == "Z"), None)
    if depth_name is None:
        raise LensError(f"lens: deep file without a channel Z; it has {', '.join(found.deep)}")
    pixel, z, rgba = _deep_samples(found, depth_name)
    height, width = found.deep[depth_name][0].shape
    cuts, soft = _deep_cuts(1 / z, layers)
    made, taken = [], np.zeros_like(z)
    for cut in [*cuts, None]:
        upto = np.ones_like(z) if cut is None else np.clip((1 / z - cut) / soft + 0.5, 0, 1)
        rest = rgba * ((upto - taken) / np.maximum(1 - taken * rgba[:, 3], 1e-6))[:, None]
        mine = rest.any(1)
        made.append(_composite_samples(pixel[mine], z[mine], rest[mine], height, width))
        taken = upto
    return made


def _deep_cuts(inverse: np.ndarray, layers: int) -> tuple[list[float], float]:
    """Cuts in 1/z, near to far, where samples are fewest, and the width over which a cut is soft."""
    if layers < 2 or not len(inverse):
        return [], 1.0
    ordered = np.sort(inverse)
    low, high = ordered[int(0.02 * len(ordered))], ordered[int(0.98 * (len(ordered) - 1))]
    soft = max((high - low) * 0.05, 1e-12)
    places = np.linspace(low + soft, high - soft, 128)
    crowd = np.searchsorted(ordered, places + soft / 2) - np.searchsorted(ordered, places - soft / 2)
    cuts: list[float] = []
    for index in np.argsort(crowd, kind="stable"):
        if len(cuts) < layers - 1 and all(abs(places[index] - other) > 2 * soft for other in cuts):
            cuts.append(float(places[index]))
    return sorted(cuts, reverse=True), soft


def _deep_samples(found: Channels, depth_name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return pixel index [n], depth [n] and premultiplied colour [n, 4] of all samples, sorted by pixel, then depth."""
    counts, z = found.deep[depth_name]
    pixel = np.repeat(np.arange(counts.size), counts.ravel())
    rgba = np.zeros((len(z), 4), np.float32)
    rgba[:, 3] = 1
    for i, name in enumerate("RGBA"):
        key = next((n for n in found.deep if n.split(".")[-1] == name), None)
        if key is None:
            continue
        if not np.array_equal(found.deep[key][0], counts):
            raise LensError(f"lens: deep channels {key} and {depth_name} differ in their samples; use one deep part")
        rgba[:, i] = found.deep[key][1]
    good = np.isfinite(z) & (z > 0) & np.isfinite(rgba).all(1)
    order = np.lexsort((z[good], pixel[good]))
    return pixel[good][order], z[good][order], rgba[good][order]


def _composite_samples(
    pixel: np.ndarray, z: np.ndarray, rgba: np.ndarray, height: int, width: int
) -> tuple[np.ndarray, np.ndarray]:
    """Composite samples that are sorted by pixel and depth, front to back."""
    image = np.zeros((height * width, 4), np.float32)
    depth = np.zeros(height * width, np.float32)
    weight = np.zeros(height * width, np.float32)
    rank = np.arange(len(pixel)) - np.searchsorted(pixel, pixel)
    for step in range(int(rank.max()) + 1 if len(rank) else 0):
        mine = rank == step
        at, colour = pixel[mine], rgba[mine]
        share = (1 - image[at, 3:4]) * colour
        image[at] += share
        depth[at] += share[:, 3] * z[mine]
        weight[at] += share[:, 3]
    far = weight > 0
    depth[far] /= weight[far]
    depth[~far] = np.inf
    return image.reshape(height, width, 4), depth.reshape(height, width)
