"""EXR files: every channel of every part by its full name, deep pixels, and the picture written back."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from lightwell.files import whole_file
from lightwell.lens.errors import LensError

# Largest window that is read, pixels, and most samples of a deep file.
MOST_PIXELS, MOST_SAMPLES = 1 << 27, 1 << 27


@dataclass
class Channels:
    """What a file holds, all on one window."""

    names: dict[str, np.ndarray]
    """Channel name to [height, width] float32. A part's name goes before names without a layer: ``depth_left.Z``."""
    window: tuple[int, int, int, int]
    """x0, y0, width and height of the arrays within the display window's coordinates."""
    display: tuple[int, int, int, int]
    """x0, y0, width and height of the picture that is shown."""
    deep: dict[str, np.ndarray] = field(default_factory=dict)
    """Deep channel name to an object array [height, width] of samples or None."""


def _open(path: Path, header_only: bool = False):
    try:
        import OpenEXR
    except ImportError:
        raise LensError("lens: EXR files need the package OpenEXR; run: pip install OpenEXR") from None
    if not path.is_file():
        raise LensError(f"lens: no file {path}; name an EXR or PNG picture")
    try:
        return OpenEXR.File(str(path), separate_channels=True, header_only=header_only)
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise LensError(f"lens: cannot read {path} as EXR ({reason}); render or export it again") from None


def _box(window) -> tuple[int, int, int, int]:
    low, high = ([int(v) for v in corner] for corner in window)
    return low[0], low[1], high[0] - low[0] + 1, high[1] - low[1] + 1


def read(path: str | Path, view: str | None = None) -> Channels:
    """All channels of one view on the union of their data windows; pixels outside a part's own window are 0."""
    path = Path(path)
    headers = _open(path, header_only=True).parts
    boxes = [_box(part.header["dataWindow"]) for part in headers]
    for box in boxes:
        if box[2] <= 0 or box[3] <= 0 or box[2] * box[3] > MOST_PIXELS:
            raise LensError(f"lens: {path} has a window of {box[2]}x{box[3]} pixels; at most {MOST_PIXELS} are read")
    views = [_view(part) for part in headers]
    known = list(dict.fromkeys(v for v in views if v))
    if view is not None and view not in known:
        raise LensError(f"lens: {path} has no view {view!r}; it has {', '.join(known) or 'none'}")
    wanted = view or (known[0] if known else None)
    chosen = [i for i, v in enumerate(views) if not v or v == wanted]
    x0, y0 = min(boxes[i][0] for i in chosen), min(boxes[i][1] for i in chosen)
    x1 = max(boxes[i][0] + boxes[i][2] for i in chosen)
    y1 = max(boxes[i][1] + boxes[i][3] for i in chosen)
    if (x1 - x0) * (y1 - y0) > MOST_PIXELS:
        raise LensError(f"lens: {path} has parts that lie far apart; export them with one window")
    display = _box(headers[chosen[0]].header["displayWindow"])
    found = Channels({}, (x0, y0, x1 - x0, y1 - y0), display)
    parts = _open(path).parts
    for i in chosen:
        _collect(found, parts[i], boxes[i], len(chosen) > 1)
    return found


def _view(part) -> str:
    value = part.header.get("view")
    return value if isinstance(value, str) else ""


def _collect(found: Channels, part, box, several: bool) -> None:
    """Put the channels of one part in place."""
    x0, y0, width, height = found.window
    prefix = part.name() if callable(getattr(part, "name", None)) else ""
    at = slice(box[1] - y0, box[1] - y0 + box[3]), slice(box[0] - x0, box[0] - x0 + box[2])
    for name, channel in part.channels.items():
        pixels = channel.pixels
        full = f"{prefix}.{name}" if several and prefix and "." not in name and name not in "RGBA" else name
        full = full if full not in found.names else f"{prefix}.{name}"
        if pixels.dtype == object:
            whole = np.full((height, width), None, object)
            whole[at] = pixels
            found.deep[full] = whole
        elif pixels.shape == (box[3], box[2]):
            plane = np.zeros((height, width), np.float32)
            plane[at] = pixels
            found.names[full] = plane


def write(path: str | Path, image: np.ndarray, window=None, display=None) -> None:
    """RGBA [height, width, 4] as half float (float where half cannot hold it), under a temporary name, then renamed."""
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
    """Deep samples sorted into layers of depth, front to back: (rgba premultiplied [h, w, 4], depth [h, w]) of each.

    Cuts lie where few samples are. A sample near a cut belongs to both layers: weight w in front and, behind, what
    gives its own coverage back when both are composited, so that no surface shows a seam. Within a layer samples are
    composited front to back and their depth is the coverage-weighted mean.
    """
    rgba_name = next((n for n in found.deep if n.endswith("RGBA") or n.endswith("RGB")), None)
    depth_name = next((n for n in found.deep if n.split(".")[-1] == "Z"), None)
    if depth_name is None:
        raise LensError(f"lens: deep file without a channel Z; it has {', '.join(found.deep)}")
    pixel, z, rgba = _deep_samples(found, rgba_name, depth_name)
    height, width = found.deep[depth_name].shape
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


def _deep_samples(found: Channels, rgba_name: str | None, depth_name: str):
    """Pixel index [n], depth [n] and premultiplied colour [n, 4] of all samples, sorted by pixel, then depth."""
    depth = found.deep[depth_name].ravel()
    counts = np.array([0 if d is None else len(d) for d in depth], np.int64)
    if counts.sum() > MOST_SAMPLES:
        raise LensError(f"lens: a deep file of {counts.sum()} samples; at most {MOST_SAMPLES} are read")
    pixel = np.repeat(np.arange(len(depth)), counts)
    z = np.concatenate([np.ravel(d) for d in depth if d is not None and len(d)]).astype(np.float32)
    if rgba_name is not None:
        colours = found.deep[rgba_name].ravel()
        rgba = np.concatenate([c for c in colours if c is not None and len(c)]).astype(np.float32)
        if rgba.shape[1] == 3:
            rgba = np.concatenate([rgba, np.ones((len(rgba), 1), np.float32)], 1)
    else:
        rgba = np.zeros((len(z), 4), np.float32)
        rgba[:, 3] = 1
        for i, name in enumerate("RGBA"):
            key = next((n for n in found.deep if n.split(".")[-1] == name), None)
            if key is not None:
                values = [np.ravel(c) for c in found.deep[key].ravel() if c is not None and len(c)]
                rgba[:, i] = np.concatenate(values)
    good = np.isfinite(z) & (z > 0) & np.isfinite(rgba).all(1)
    order = np.lexsort((z[good], pixel[good]))
    return pixel[good][order], z[good][order], rgba[good][order]


def _composite_samples(pixel, z, rgba, height: int, width: int):
    """Front-to-back compositing of samples that are sorted by pixel and depth."""
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
