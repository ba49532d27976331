"""Read frames from files: colour, depth and motion by the channel names that renderers use."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from lightwell.core.color import linear
from lightwell.exr.header import Window
from lightwell.lens import exr
from lightwell.lens.camera import LensCamera
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
    """One frame as read; all arrays have the same size."""

    rgba: np.ndarray
    """[height, width, 4] linear, premultiplied"""
    depth: np.ndarray
    """[height, width] raw values"""
    motion: np.ndarray | None
    """[height, width, 2] raw values"""
    depth_kind: str = "planar"
    """Convention of the depth, as its name implies."""
    motion_kind: Motion = field(default_factory=Motion)
    """Convention of the motion, as its name implies."""
    window: tuple[int, int, int, int] = (0, 0, 0, 0)
    """x0, y0, width, height of the arrays."""
    display: tuple[int, int, int, int] = (0, 0, 0, 0)
    """x0, y0, width, height of the picture shown."""
    behind: list[tuple[np.ndarray, np.ndarray]] = field(default_factory=list)
    """Further layers from deep files: (rgba, depth), front to back."""
    notes: list[str] = field(default_factory=list)
    """Channels that were used, and pixels without usable values."""

    def planar(self, camera: LensCamera, kind: str, near: float) -> np.ndarray:
        """Convert the depth to depth along the camera axis.

        Args:
            camera: Camera, for depth along rays.
            kind: One of ``DEPTHS``; ``auto`` uses the convention that the channel's name implies.
            near: Distance of the near plane, scene units.

        Returns:
            Depth [height, width], scene units.
        """
        return self._planar(self.depth, camera, kind, near)

    def _planar(self, depth: np.ndarray, camera: LensCamera, kind: str, near: float) -> np.ndarray:
        if kind not in DEPTHS:
            raise LensError(f"lens: depth convention {kind!r}; choose {', '.join(DEPTHS)}")
        kind = self.depth_kind if kind == "auto" else kind
        dx, dy, dw, dh = self.display
        centre = dx + dw / 2 - self.window[0], dy + dh / 2 - self.window[1]
        return planar_depth(depth, kind, camera, dw, centre, near)

    def planar_behind(self, camera: LensCamera, kind: str, near: float) -> list[tuple[np.ndarray, np.ndarray]]:
        """Convert the depth of the further layers to depth along the camera axis.

        Args:
            camera: Camera, for depth along rays.
            kind: One of ``DEPTHS``.
            near: Distance of the near plane, scene units.

        Returns:
            (rgba [height, width, 4], depth [height, width]) of every layer, front to back.
        """
        return [(rgba, self._planar(depth, camera, kind, near)) for rgba, depth in self.behind]


def _split(name: str) -> tuple[str, str]:
    """Split ``View.Layer.X`` into layer and channel."""
    layer, _, leaf = name.rpartition(".")
    return layer, leaf


def _colour(names: dict[str, np.ndarray], where: Path) -> tuple[np.ndarray, str]:
    layers: dict[str, dict[str, str]] = {}
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

    def rank(layer: str) -> tuple[int, int, str]:
        last = layer.split(".")[-1].lower()
        return (COLOURS.index(last) if last in COLOURS else len(COLOURS), layer.count("."), layer)

    best = min(layers, key=rank)
    leaves = layers[best]
    alpha = names[leaves["A"]] if "A" in leaves else _other_alpha(layers, names, best)
    return np.stack([names[leaves["R"]], names[leaves["G"]], names[leaves["B"]], alpha], -1), best or "R, G, B"


def _other_alpha(layers: dict[str, dict[str, str]], names: dict[str, np.ndarray], best: str) -> np.ndarray:
    return np.ones_like(names[layers[best]["R"]])


def _depth(names: dict[str, np.ndarray], where: str | Path, asked: str | None) -> tuple[np.ndarray, str]:
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


def _motion(names: dict[str, np.ndarray], where: Path, asked: str | None) -> tuple[np.ndarray | None, str]:
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
                pair = [name, f"{layer}.{leaves[1]}"]
                return np.stack([names[pair[0]], names[pair[1]]], -1), ", ".join(pair)
    return None, ""


def _depth_of(
    path: Path,
    names: dict[str, np.ndarray],
    depth_file: str | Path | None,
    view: str | None,
    channel: str | None,
    range_: tuple[float, float] | None,
    limits: Limits | None,
) -> tuple[np.ndarray, str, str]:
    """Depth [height, width] of a frame with channels ``names``, its name and its kind; of ``depth_file`` if given."""
    if range_ is not None and (depth_file is None or Path(depth_file).suffix.lower() == ".exr"):
        raise LensError(
            "lens: --depth-range is for a PNG of --depth-file; an EXR holds the depths themselves; leave it out, or "
            "give their unit with --scene-unit"
        )
    if depth_file is not None:
        # The views of a picture such as PNG can only be those of its depth file.
        return _depth_file(depth_file, channel, range_, limits, view, path.suffix.lower() == ".exr")
    if not names:
        raise LensError(f"lens: {path} holds no depth; give one with --depth-file DEPTH.exr or DEPTH.png")
    depth, name = _depth(names, path, channel)
    return depth, name, _kind(name)


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
    """Read a frame from an EXR (flat, multi-layer, multi-part or deep) or from a picture with a separate depth file.

    Args:
        path: EXR, or a picture in sRGB such as PNG.
        view: View of a stereo file, and of a depth file that has views; None for the first.
        depth_channel: Channel of depth; None to find it by name.
        motion_channels: Two channels of motion, joined by a comma; None to find them by name.
        depth_file: File with the depth; None for the frame itself.
        depth_range: Depths of black and white in a PNG depth file, scene units.
        layers: Number of layers into which deep samples are sorted, ≥ 1.
        limits: Limits on what each EXR may request; None for ``Limits()``.

    Returns:
        The frame.

    Raises:
        LensError: A file is missing or damaged, a channel is missing, or sizes differ.
    """
    path = Path(path)
    if path.suffix.lower() == ".exr":
        found = exr.read(path, view, limits)
        if found.deep:
            if depth_channel or motion_channels or depth_file:
                raise LensError(
                    f"lens: {path} is deep: its depth is the channel Z of its samples, and they have no motion; leave "
                    "out --depth-channel, --depth-file and --motion-channels"
                )
            return _deep_frame(found, layers)
        rgba, colour_name = _colour(found.names, path)
        window, display, names = found.window, found.display, found.names
        motion, motion_name = _motion(names, path, motion_channels)
    else:
        rgba = _png(path)
        if view is not None and Path(depth_file or "").suffix.lower() != ".exr":
            raise LensError(f"lens: {path} is no EXR and has no view {view!r}; leave out --view")
        if motion_channels is not None:
            raise LensError(f"lens: {path} is no EXR and has no channels of motion; leave out --motion-channels")
        height, width = rgba.shape[:2]
        window = display = (0, 0, width, height)
        names, motion, motion_name, colour_name = {}, None, "", path.name
    depth, depth_name, kind = _depth_of(path, names, depth_file, view, depth_channel, depth_range, limits)
    if depth.shape != rgba.shape[:2]:
        raise LensError(
            f"lens: depth is {depth.shape[1]}x{depth.shape[0]}, the picture {rgba.shape[1]}x{rgba.shape[0]}"
        )
    notes = [f"colour {colour_name}", f"depth {depth_name} ({kind})"]
    motion_kind = _motion_kind(motion_name)
    if motion is not None:
        notes.append(f"motion {motion_name} ({motion_kind})")
    notes += _not_finite(rgba, depth, motion)
    return _on_display(FrameFile(rgba, depth, motion, kind, motion_kind, window, display, notes=notes))


def read_colour(path: str | Path, view: str | None = None, limits: Limits | None = None) -> tuple[np.ndarray, Window]:
    """Read the colour of a frame alone, which need not have depth.

    Args:
        path: EXR that is not deep.
        view: View of a stereo file; None for the first.
        limits: Limits on what the EXR may request; None for ``Limits()``.

    Returns:
        Colour [height, width, 4] linear, premultiplied, and its window: x0, y0, width, height.

    Raises:
        LensError: The file is missing or damaged, or has no colour.
    """
    found = exr.read(path, view, limits)
    return _colour(found.names, Path(path))[0], found.window


def _not_finite(rgba: np.ndarray, depth: np.ndarray, motion: np.ndarray | None) -> list[str]:
    """Return a note on pixels that ``apply`` replaces by their neighbours; a depth of infinity is the sky."""
    bad = ~np.isfinite(rgba).all(-1) | np.isnan(depth)
    if motion is not None:
        bad |= ~np.isfinite(motion).all(-1)
    count = int(bad.sum())
    return [f"{count} pixels with NaN or infinite colour or motion, or NaN depth, are replaced"] if count else []


def _kind(name: str) -> str:
    """Return the depth convention that a channel's name implies; Mitsuba's AOV ``.T`` is a distance along rays."""
    return "ray-from-near" if name.endswith(".T") else "planar"


def _motion_kind(name: str) -> Motion:
    """Return the convention of a layer name.

    Blender's ``Vector``: X, Y to the previous frame, in pixels, y up. Nuke's ``forward``: to the next one, y up.
    """
    last = name.split(",")[0].rpartition(".")[0].split(".")[-1].lower()
    if last == "vector":
        return Motion("pixels", backward=True, y_up=True)
    return Motion("pixels", y_up=last == "forward")


def _on_display(frame: FrameFile) -> FrameFile:
    """Pad arrays that cover less than the displayed picture with empty pixels, into which blur can spread."""
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
    """Convert an sRGB picture to linear premultiplied RGBA."""
    pixels = _open_image(path, "RGBA").astype(np.float64) / 255
    alpha = pixels[..., 3:]
    c = pixels[..., :3]
    return np.concatenate([linear(c) * alpha, alpha], -1).astype(np.float32)


def _open_image(path: Path, mode: str) -> np.ndarray:
    from PIL import Image

    from lightwell.core.image_io import eight_bits
    from lightwell.lens.pictures import levels

    try:
        with Image.open(path) as image:
            return np.asarray(eight_bits(image).convert(mode) if mode else levels(image))
    except FileNotFoundError:
        raise LensError(f"lens: no file {path}; name an EXR or PNG picture") from None
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise LensError(f"lens: cannot read {path} ({' '.join(str(error).split())}); use EXR or PNG") from None


def _depth_file(
    path: str | Path,
    channel: str | None,
    range_: tuple[float, float] | None,
    limits: Limits | None,
    view: str | None,
    one_of_all: bool,
) -> tuple[np.ndarray, str, str]:
    """Read depth from a separate file; a PNG holds shares of the range ``near,far``, the depths of black and white.

    A file without views may be ``one_of_all``: the depth of every view.
    """
    path = Path(path)
    if path.suffix.lower() == ".exr":
        found = exr.read(path, view, limits, without_views=one_of_all)
        names = found.names
        if channel is None and len(names) == 1:
            channel = next(iter(names))
        if channel is None and {"R", "G", "B"} <= set(names) and not any(_split(n)[1] in "ZT" for n in names):
            channel = "R"
        values, name = _depth(names, path, channel)
        return values, f"{path.name}:{name}", _kind(name)
    if range_ is None:
        raise LensError(
            f"lens: {path} has no depth range; give the depths of black and white, for example --depth-range 1,20"
        )
    if channel is not None:
        raise LensError(f"lens: {path} is no EXR and has no channel {channel!r}; leave out --depth-channel")
    raw = _open_image(path, "")
    if raw.ndim == 3:
        raw = raw[..., 0]
    full = 65535.0 if raw.dtype in (np.uint16, np.int32) else 255.0
    low, high = range_
    return (low + (high - low) * raw.astype(np.float64) / full).astype(np.float32), path.name, "planar"


def focus_at(depth: np.ndarray, x: float, y: float) -> float:
    """Find the depth at a pixel: the median of the 5 × 5 pixels around it that have a depth.

    Args:
        depth: Depth [height, width], scene units; infinity is the sky.
        x: Position x, pixels.
        y: Position y, pixels, downwards.

    Returns:
        Depth, scene units.

    Raises:
        LensError: The position is outside the frame or shows the sky.
    """
    height, width = depth.shape
    if not (0 <= x < width and 0 <= y < height):
        raise LensError(f"lens: --focus-at {x:g},{y:g} lies outside the frame of {width}x{height} pixels")
    column, row = int(x), int(y)
    near = depth[max(row - 2, 0) : row + 3, max(column - 2, 0) : column + 3]
    near = near[np.isfinite(near) & (near > 0)]
    if not near.size:
        raise LensError(f"lens: --focus-at {x:g},{y:g} points at the sky; choose a point on a surface, or --focus 100m")
    return float(np.median(near))
