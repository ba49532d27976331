"""Frames from files: colour, depth and motion by the names that renderers give them."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from lightwell.lens import exr
from lightwell.lens.camera import Camera
from lightwell.lens.conventions import DEPTHS, Motion, planar_depth
from lightwell.lens.errors import LensError
from lightwell.limits import Limits

# Layers of colour, best first; compared without case, by the last part of the name.
COLOURS = ("", "combined", "rgba", "rgb", "beauty", "image", "img", "color", "colour", "c")
DEPTH_LEAVES = ("z", "t", "v", "depth", "d")
DEPTH_LAYERS = ("", "depth", "z", "zdepth", "dd", "distance")
# (layer's last part, channels) of motion, best first.
MOTIONS = (
    ("vector", ("Z", "W")),
    ("forward", ("u", "v")),
    ("motion", ("u", "v")),
    ("motion", ("X", "Y")),
    ("motion", ("R", "G")),
    ("motionvector", ("X", "Y")),
    ("velocity", ("X", "Y")),
    ("mv", ("X", "Y")),
    ("vector", ("X", "Y")),
)


@dataclass
class FrameFile:
    """One frame as read; arrays share a size."""

    rgba: np.ndarray
    """[height, width, 4] linear, premultiplied"""
    depth: np.ndarray
    """[height, width] raw values"""
    motion: np.ndarray | None
    """[height, width, 2] raw values"""
    depth_kind: str = "planar"
    """How depth is to be read, as far as the names tell."""
    motion_kind: Motion = field(default_factory=Motion)
    """How motion is to be read, as far as the names tell."""
    window: tuple[int, int, int, int] = (0, 0, 0, 0)
    """x0, y0, width, height of the arrays."""
    display: tuple[int, int, int, int] = (0, 0, 0, 0)
    """x0, y0, width, height of the picture shown."""
    behind: list = field(default_factory=list)
    """Further layers from deep files: (rgba, depth), front to back."""
    notes: list[str] = field(default_factory=list)
    """Which channels were taken."""

    def planar(self, camera: Camera, kind: str, near: float) -> np.ndarray:
        """Camera-axis depth."""
        return self._planar(self.depth, camera, kind, near)

    def _planar(self, depth, camera: Camera, kind: str, near: float) -> np.ndarray:
        if kind not in DEPTHS:
            raise LensError(f"lens: depth convention {kind!r}; choose {', '.join(DEPTHS)}")
        kind = self.depth_kind if kind == "auto" else kind
        dx, dy, dw, dh = self.display
        centre = dx + dw / 2 - self.window[0], dy + dh / 2 - self.window[1]
        return planar_depth(depth, kind, camera, dw, centre, near)

    def planar_behind(self, camera: Camera, kind: str, near: float) -> list:
        """(rgba, camera-axis depth) of the further layers."""
        return [(rgba, self._planar(depth, camera, kind, near)) for rgba, depth in self.behind]


def _split(name: str) -> tuple[str, str]:
    """Layer and channel of ``View.Layer.X``."""
    layer, _, leaf = name.rpartition(".")
    return layer, leaf


def _colour(names: dict[str, np.ndarray], where) -> tuple[np.ndarray, str]:
    layers = {}
    for name in names:
        layer, leaf = _split(name)
        if leaf.upper() in ("R", "G", "B", "A"):
            layers.setdefault(layer, {})[leaf.upper()] = name
    layers = {layer: leaves for layer, leaves in layers.items() if {"R", "G", "B"} <= set(leaves)}
    if not layers:
        if "Y" in names:
            plane = names["Y"]
            alpha = names.get("A", np.ones_like(plane))
            return np.stack([plane, plane, plane, alpha], -1), "Y"
        raise LensError(f"lens: {where} has no colour (channels R, G, B); it has {', '.join(sorted(names)) or 'none'}")

    def rank(layer: str) -> tuple:
        last = layer.split(".")[-1].lower()
        return (COLOURS.index(last) if last in COLOURS else len(COLOURS), layer.count("."), layer)

    best = min(layers, key=rank)
    leaves = layers[best]
    alpha = names[leaves["A"]] if "A" in leaves else _other_alpha(layers, names, best)
    return np.stack([names[leaves["R"]], names[leaves["G"]], names[leaves["B"]], alpha], -1), best or "R, G, B"


def _other_alpha(layers, names, best) -> np.ndarray:
    return np.ones_like(names[layers[best]["R"]])


def _depth(names: dict[str, np.ndarray], where, asked: str | None) -> tuple[np.ndarray, str]:
    if asked is not None:
        if asked not in names:
            raise LensError(f"lens: {where} has no channel {asked!r}; it has {', '.join(sorted(names))}")
        return names[asked], asked
    options = []
    for name in names:
        layer, leaf = _split(name)
        last = layer.split(".")[-1].lower()
        known = last in DEPTH_LAYERS or last.startswith("depth")
        if (
            leaf.lower() in DEPTH_LEAVES
            and known
            and not (last == "" and leaf.lower() != "z" and leaf.lower() != "depth")
        ):
            options.append(((layer.count("."), DEPTH_LEAVES.index(leaf.lower())), name))
    if not options:
        mitsuba = [n for n in names if n.endswith(".T")]
        options = [((0, 0), mitsuba[0])] if len(mitsuba) == 1 else []
    if not options:
        raise LensError(
            f"lens: {where} has no depth (Z, depth.Z, Depth.V, dd.T …); it has {', '.join(sorted(names))}; name one "
            "with --depth-channel or give a file with --depth-file"
        )
    name = min(options)[1]
    return names[name], name


def _motion(names: dict[str, np.ndarray], where, asked: str | None) -> tuple[np.ndarray | None, str]:
    if asked is not None:
        pair = [part.strip() for part in asked.split(",")]
        if len(pair) != 2 or any(part not in names for part in pair):
            known = ", ".join(sorted(names))
            raise LensError(f"lens: {where} has no channels {asked!r}; name two of {known}, joined by a comma")
        return np.stack([names[pair[0]], names[pair[1]]], -1), asked
    for last, leaves in MOTIONS:
        for name in sorted(names):
            layer, leaf = _split(name)
            if layer.split(".")[-1].lower().startswith(last) and leaf == leaves[0] and f"{layer}.{leaves[1]}" in names:
                pair = name, f"{layer}.{leaves[1]}"
                return np.stack([names[pair[0]], names[pair[1]]], -1), ", ".join(pair)
    return None, ""


def read(
    path: str | Path,
    view: str | None = None,
    depth_channel: str | None = None,
    motion_channels: str | None = None,
    depth_file: str | Path | None = None,
    depth_range: tuple[float, float] | None = None,
    layers: int = 2,
    limits: Limits | None = None,
) -> FrameFile:
    """A frame from an EXR (flat, multi-layer, multi-part or deep) or from a PNG with a separate depth file.

    ``limits`` bound what each EXR may ask for.
    """
    path = Path(path)
    if path.suffix.lower() == ".exr":
        found = exr.read(path, view, limits)
        if found.deep:
            return _deep_frame(found, layers)
        rgba, colour_name = _colour(found.names, path)
        window, display, names = found.window, found.display, found.names
        motion, motion_name = _motion(names, path, motion_channels)
    else:
        rgba = _png(path)
        height, width = rgba.shape[:2]
        window = display = (0, 0, width, height)
        names, motion, motion_name, colour_name = {}, None, "", path.name
    if depth_file is not None:
        depth, depth_name, kind = _depth_file(depth_file, depth_channel, depth_range, limits)
    elif not names:
        raise LensError(f"lens: {path} holds no depth; give one with --depth-file DEPTH.exr or DEPTH.png")
    else:
        depth, depth_name = _depth(names, path, depth_channel)
        kind = _kind(depth_name)
    if depth.shape != rgba.shape[:2]:
        raise LensError(
            f"lens: depth is {depth.shape[1]}x{depth.shape[0]}, the picture {rgba.shape[1]}x{rgba.shape[0]}"
        )
    notes = [f"colour {colour_name}", f"depth {depth_name} ({kind})"]
    notes += _not_finite(rgba, depth)
    motion_kind = _motion_kind(motion_name)
    if motion is not None:
        notes.append(f"motion {motion_name} ({motion_kind})")
    bad = ~np.isfinite(rgba).all(-1) | np.isnan(depth)
    if motion is not None:
        bad |= ~np.isfinite(motion).all(-1)
    if bad.any():
        notes.append(f"{int(bad.sum())} pixels have numbers that are not finite")
    return _on_display(FrameFile(rgba, depth, motion, kind, motion_kind, window, display, notes=notes))


def _not_finite(rgba: np.ndarray, depth: np.ndarray) -> list[str]:
    """A note on pixels that ``apply`` leaves out; a depth of infinity is the sky."""
    count = int((~np.isfinite(rgba).all(-1) | np.isnan(depth)).sum())
    return [f"{count} pixels with NaN or infinite colour or NaN depth are left out"] if count else []


def _kind(name: str) -> str:
    """Mitsuba's depth AOV ends in .T and runs along the ray from the near plane; others are planar."""
    return "ray-from-near" if name.endswith(".T") else "planar"


def _motion_kind(name: str) -> Motion:
    """Blender's vectors: X, Y to the previous frame, Z, W from the next; pixels, y up."""
    last = name.split(",")[0].rpartition(".")[0].split(".")[-1].lower()
    if last == "vector":
        return Motion("pixels", backward=True, y_up=True)
    return Motion()


def _on_display(frame: FrameFile) -> FrameFile:
    """Arrays that cover less than the picture are laid into it, with nothing around them, for blur to spread into."""
    x0, y0, width, height = frame.window
    dx, dy, dw, dh = frame.display
    left, top = max(x0 - dx, 0), max(y0 - dy, 0)
    right, bottom = max(dx + dw - x0 - width, 0), max(dy + dh - y0 - height, 0)
    if not (left or top or right or bottom):
        return frame
    pads = ((top, bottom), (left, right))
    frame.rgba = np.pad(frame.rgba, (*pads, (0, 0)))
    frame.depth = np.pad(frame.depth, pads, constant_values=np.inf if frame.depth_kind != "inverse" else 0)
    frame.motion = None if frame.motion is None else np.pad(frame.motion, (*pads, (0, 0)))
    frame.behind = [
        (np.pad(rgba, (*pads, (0, 0))), np.pad(z, pads, constant_values=np.inf)) for rgba, z in frame.behind
    ]
    frame.window = x0 - left, y0 - top, width + left + right, height + top + bottom
    return frame


def _deep_frame(found: exr.Channels, layers: int) -> FrameFile:
    parts = exr.flatten_deep(found, max(layers, 1))
    parts = [p for p in parts if p[0].any()] or parts[:1]
    rgba, depth = parts[0]
    notes = [f"deep, {len(parts)} layers of about as many samples"]
    return _on_display(FrameFile(rgba, depth, None, "planar", Motion(), found.window, found.display, parts[1:], notes))


def _png(path: Path) -> np.ndarray:
    """sRGB picture as linear premultiplied RGBA."""
    pixels = _open_image(path, "RGBA").astype(np.float64) / 255
    alpha = pixels[..., 3:]
    c = pixels[..., :3]
    linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    return np.concatenate([linear * alpha, alpha], -1).astype(np.float32)


def _open_image(path: Path, mode: str) -> np.ndarray:
    from PIL import Image

    try:
        with Image.open(path) as image:
            return np.asarray(image.convert(mode) if mode else image)
    except FileNotFoundError:
        raise LensError(f"lens: no file {path}; name an EXR or PNG picture") from None
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise LensError(f"lens: cannot read {path} ({' '.join(str(error).split())}); use EXR or PNG") from None


def _depth_file(path, channel, range_, limits) -> tuple[np.ndarray, str, str]:
    """Depth from a file of its own. A PNG holds shares of a range: ``near,far`` are the depths of black and white."""
    path = Path(path)
    if path.suffix.lower() == ".exr":
        found = exr.read(path, limits=limits)
        names = found.names
        if channel is None and len(names) == 1:
            channel = next(iter(names))
        if channel is None and {"R", "G", "B"} <= set(names) and not any(_split(n)[1] in "ZT" for n in names):
            channel = "R"
        values, name = _depth(names, path, channel)
        return values, f"{path.name}:{name}", _kind(name)
    if range_ is None:
        raise LensError(
            f"lens: {path} holds shares of a range; say which depths black and white are: --depth-range 1,20"
        )
    raw = _open_image(path, "")
    if raw.ndim == 3:
        raw = raw[..., 0]
    full = 65535.0 if raw.dtype in (np.uint16, np.int32) else 255.0
    low, high = range_
    return (low + (high - low) * raw.astype(np.float64) / full).astype(np.float32), path.name, "planar"


def focus_at(depth: np.ndarray, x: float, y: float) -> float:
    """Depth under a point in pixels: the median of the 5×5 pixels around it that have one."""
    height, width = depth.shape
    if not (0 <= x < width and 0 <= y < height):
        raise LensError(f"lens: --focus-at {x:g},{y:g} lies outside the frame of {width}x{height} pixels")
    column, row = int(x), int(y)
    near = depth[max(row - 2, 0) : row + 3, max(column - 2, 0) : column + 3]
    near = near[np.isfinite(near) & (near > 0)]
    if not near.size:
        raise LensError(f"lens: --focus-at {x:g},{y:g} points at the sky; choose a point on a surface, or --focus 100m")
    return float(np.median(near))
