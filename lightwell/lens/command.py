"""The verb ``lens`` on files."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lightwell.core.color import srgb
from lightwell.core.store import user_store
from lightwell.exr.header import Window
from lightwell.files import check_writable, whole_file
from lightwell.lens import aperture, conventions, exr, frames, prescription
from lightwell.lens.arguments import NEAR
from lightwell.lens.camera import LensCamera, distance
from lightwell.lens.errors import LensError
from lightwell.lens.kept import check_inputs_are_kept
from lightwell.lens.library_cache import LibraryCache
from lightwell.lens.pipeline import Lens
from lightwell.lens.progress import bars
from lightwell.lens.report import Report
from lightwell.lens.settings import LensSettings
from lightwell.limits import Limits


class Job(NamedTuple):
    """One frame to blur."""

    number: int
    """Frame number; 0 for a single frame."""
    source: Path
    target: Path
    depth_file: Path | None
    """File with the depth; None: the frame itself."""
    following: Path | None
    """The following frame, where there is one."""


def run(arguments: argparse.Namespace) -> int:
    """Blur frames, or bake or check a library, depending on the first argument.

    Args:
        arguments: Parsed options of the verb ``lens``.

    Returns:
        Exit code.
    """
    if arguments.frame == "bake":
        from lightwell.lens.bake_command import run_bake

        return run_bake(arguments)
    if arguments.frame == "check":
        from lightwell.lens.check import run_check

        return run_check(arguments)
    return _blur(arguments)


def _blur(arguments: argparse.Namespace) -> int:
    if not arguments.out:
        raise LensError("lens: no picture to write; name it with -o OUT.exr or -o OUT.png")
    settings = _settings(arguments)
    if arguments.focus is not None and arguments.focus_at is not None:
        raise LensError("lens: --focus and --focus-at both say what is in focus; leave out one of them")
    jobs = list(_jobs(arguments))
    _check_targets([job.target for job in jobs])
    check_inputs_are_kept("lens", (("-o", job.target) for job in jobs), _read(arguments, jobs))
    lines = []
    with bars(arguments.json) as bar:
        lens = Lens(settings, LibraryCache(bar, store=user_store(arguments.store)))
        advance = bar("frames", len(jobs)) if bar and len(jobs) > 1 else None
        convention = None
        for job in jobs:
            facts, convention = _one(arguments, lens, job, convention)
            lines.append(facts)
            if not arguments.json:
                print(f"{job.target}: {facts['line']}")
            if advance:
                advance(1)
    if arguments.json:
        print(json.dumps(lines if len(lines) > 1 else lines[0], indent=1))
    return 0


def _settings(arguments: argparse.Namespace) -> LensSettings:
    shape = aperture.parse(arguments.aperture, arguments.blades, arguments.blade_angle)
    extra = {} if arguments.largest is None else {"largest": arguments.largest}
    if arguments.overscan < 0:
        raise LensError(f"lens: overscan {arguments.overscan}; give the width of the band in pixels, 0 or more")
    return LensSettings(
        aperture=shape,
        layers=arguments.layers,
        preset=arguments.preset,
        antialiased=arguments.antialiased,
        edges=arguments.edges,
        solver=arguments.solver,
        choice=arguments.choice,
        cats_eye=arguments.cats_eye,
        prescription=None if arguments.prescription is None else prescription.read(arguments.prescription),
        deterministic=arguments.deterministic,
        **extra,
    )


def _jobs(arguments: argparse.Namespace) -> Iterator[Job]:
    """Yield the frames in their order."""
    source, target, depth = arguments.frame, arguments.out, arguments.depth_file
    if arguments.frames is None:
        if "#" in source and not Path(source).exists():
            raise LensError(f"lens: {source} names a sequence; give the frames, for example --frames 1-48")
        yield Job(0, Path(source), Path(target), Path(depth) if depth else None, None)
        return
    first, last = _pair(arguments.frames, "-", "--frames", int)
    if last < first or last - first >= 1_000_000:
        raise LensError(f"lens: --frames {arguments.frames}; the last frame comes before the first, or is too far away")
    for name in (source, target):
        if "#" not in name:
            raise LensError(f"lens: {name} needs #### where the frame's number goes, for --frames {arguments.frames}")
    for number in range(first, last + 1):
        following = _numbered(source, number + 1)
        yield Job(
            number,
            _numbered(source, number),
            _numbered(target, number),
            (Path(depth) if Path(depth).exists() else _numbered(depth, number)) if depth else None,
            following if following.exists() else None,
        )


def _numbered(pattern: str, number: int) -> Path:
    """Put a frame's number in the place of the last #### of a name; one without is the same for all frames."""
    end = pattern.rfind("#") + 1
    start = len(pattern[:end].rstrip("#"))
    return Path(pattern[:start] + str(number).zfill(end - start) + pattern[end:] if end else pattern)


def _check_targets(targets: Sequence[Path]) -> None:
    """Refuse pictures that cannot be written, before the work for them begins."""
    folders: set[Path] = set()
    for target in targets:
        if target.suffix.lower() not in (".exr", ".png"):
            raise LensError(f"lens: cannot write {target}; its name must end in .exr or .png")
        if target.is_dir() or target.parent not in folders:
            check_writable(target)
        folders.add(target.parent)


def _read(arguments: argparse.Namespace, jobs: Sequence[Job]) -> Iterator[tuple[str, str | Path]]:
    """Yield the option and path of every file that is read."""
    for job in jobs:
        frames_read = (("FRAME", job.source), ("FRAME", job.following), ("--depth-file", job.depth_file))
        yield from ((name, path) for name, path in frames_read if path is not None)
    yield from aperture.picture_of(arguments.aperture)
    if arguments.prescription is not None:
        yield "--prescription", arguments.prescription


def _pair(text: str, joint: str, option: str, kind: Callable[[str], Any] = float) -> tuple[Any, Any]:
    try:
        first, second = text.split(joint, 1)
        return kind(first), kind(second)
    except ValueError:
        raise LensError(f"lens: {option} {text!r}; expected two numbers joined by {joint!r}") from None


def _one(
    arguments: argparse.Namespace,
    lens: Lens,
    job: Job,
    convention: conventions.Motion | None,
) -> tuple[dict[str, Any], conventions.Motion | None]:
    """Read, blur and write one frame; return a summary and the convention of its motion vectors."""
    frame = frames.read(
        job.source,
        arguments.view,
        arguments.depth_channel,
        arguments.motion_channels,
        job.depth_file,
        _pair(arguments.depth_range, ",", "--depth-range") if arguments.depth_range else None,
        arguments.layers,
        _limits(arguments),
    )
    shown = replace(frame, display=_shown(frame, arguments.overscan))
    camera, depth, behind = _camera(arguments, shown, frame.display)
    motion, convention = _motion(arguments, frame, job.following, convention)
    width = shown.display[2]
    out, report = lens.apply(frame.rgba, depth, motion, camera, job.number, behind=behind, full_width=width)
    _write(job.target, *_cropped(out, shown, arguments.overscan, frame.display))
    return _summary(job.target, camera, frame, report), convention


def _shown(frame: frames.FrameFile, crop: int) -> Window:
    """Return the part of the displayed picture that is left when a band is cropped from the frame."""
    (x0, y0, width, height), (dx, dy, dw, dh) = frame.window, frame.display
    left, top = max(dx, x0 + crop), max(dy, y0 + crop)
    right, bottom = min(dx + dw, x0 + width - crop), min(dy + dh, y0 + height - crop)
    if right <= left or bottom <= top:
        raise LensError(f"lens: overscan {crop} leaves nothing of {width}x{height} pixels")
    return left, top, right - left, bottom - top


def _cropped(
    out: np.ndarray, shown: frames.FrameFile, crop: int, before: Window
) -> tuple[np.ndarray, Window, Window]:  # fmt: skip
    """Crop a blurred frame; return it, its window and that of the picture, which begins where it did ``before``."""
    height, width = out.shape[:2]
    (x0, y0, _, _), (left, top, dw, dh) = shown.window, shown.display
    window = x0 + crop + before[0] - left, y0 + crop + before[1] - top, width - 2 * crop, height - 2 * crop
    return out[crop : height - crop, crop : width - crop], window, (before[0], before[1], dw, dh)


def _summary(target: Path, camera: LensCamera, frame: frames.FrameFile, report: Report) -> dict[str, Any]:
    """Return what was done with one frame, for ``--json``."""
    return {
        "out": str(target),
        "line": report.line(),
        "focus_m": round(camera.focus, 6),
        "largest_px": round(report.largest, 3),
        "longest_px": round(report.longest, 3),
        "layers": report.layers,
        "nodes": report.nodes,
        "points_per_pixel": round(report.points, 2),
        "clamped": report.clamped,
        "bad": report.bad,
        "channels": frame.notes,
        "seconds": {k: round(v, 4) for k, v in report.seconds.items()},
    }


def _camera(
    arguments: argparse.Namespace, frame: frames.FrameFile, whole: Window
) -> tuple[LensCamera, np.ndarray, Any]:
    """Return camera, planar depth and the layers behind; ray depth depends on the focus distance.

    The sensor is as wide as the picture that is shown; ``--focus-at`` counts pixels of the ``whole`` one, as rendered.
    """
    unit = distance(arguments.scene_unit, "--scene-unit", "m")
    lengths = {
        "focal": distance(arguments.focal, "--focal", "mm"),
        "sensor": distance(arguments.sensor, "--sensor", "mm"),
        "fstop": arguments.fstop,
        "shutter": arguments.shutter,
        "scene_unit": unit,
    }
    focus, near = distance(arguments.focus, "--focus", "m") if arguments.focus else None, _near(arguments, frame)
    if arguments.focus_at is not None:
        far = LensCamera(**lengths, focus=max(1e4 * lengths["focal"], 1.0))
        x, y = _pair(arguments.focus_at, ",", "--focus-at")
        at_x, at_y = x + whole[0] - frame.window[0], y + whole[1] - frame.window[1]
        focus = frames.focus_at(frame.planar(far, arguments.depth_kind, near), at_x, at_y) * unit
    if focus is None:
        raise LensError("lens: no focus distance; give --focus 2.5m or --focus-at X,Y")
    camera = LensCamera(**lengths, focus=focus)
    depth = frame.planar(camera, arguments.depth_kind, near)
    finite = depth[np.isfinite(depth) & (depth > 0)]
    if finite.size and finite.min() == finite.max() and np.isfinite(depth).all():
        print(f"lens: all of depth is {finite.min():g}; is this the right channel?", file=sys.stderr)
    return camera, depth, frame.planar_behind(camera, arguments.depth_kind, near)


def _near(arguments: argparse.Namespace, frame: frames.FrameFile) -> float:
    """Return the distance of the near plane; one that the frame's depth has no use for is refused."""
    kind = frame.depth_kind if arguments.depth_kind == "auto" else arguments.depth_kind
    if arguments.near is not None and kind != "ray-from-near":
        raise LensError(
            f"lens: --near is for depth of the kind ray-from-near, and this is {kind}; leave it out, or give --depth "
            "ray-from-near"
        )
    return NEAR if arguments.near is None else arguments.near


def _motion(
    arguments: argparse.Namespace,
    frame: frames.FrameFile,
    following: Path | None,
    convention: conventions.Motion | None,
) -> tuple[np.ndarray | None, conventions.Motion | None]:
    """Return motion in pixels per frame, forward, y down, and its convention; or None."""
    words = (arguments.motion_kind or "").replace(",", " ").split()
    if words == ["none"] or frame.motion is None:
        if frame.motion is None and arguments.motion_kind not in (None, "none"):
            raise LensError(
                "lens: --motion is given, but the frame has no motion vectors; name them with --motion-channels"
            )
        return None, None
    dw, dh = frame.display[2:]
    if words == ["auto"]:
        # Of a frame in which nothing moves no convention can be told, and none is needed.
        if not np.any(frame.motion[np.isfinite(frame.motion)]):
            return None, convention
        if convention is None:
            if following is None:
                raise LensError("lens: --motion auto compares two frames; give a sequence with --frames A-B")
            convention, _ = conventions.guess_motion(
                frame.motion,
                frame.rgba,
                _aligned(frame, *frames.read_colour(following, arguments.view, _limits(arguments))),
            )
        return convention.pixels(frame.motion, dw, dh), convention
    if words:
        unknown = set(words) - {"pixels", "ndc", "uv", "backward", "forward", "y-up", "y-down"}
        if unknown:
            raise LensError(f"lens: --motion {arguments.motion_kind!r}; use auto, none, or pixels|ndc|uv backward y-up")
        for one_of in (conventions.UNITS, ("backward", "forward"), ("y-up", "y-down")):
            if len(both := [word for word in one_of if word in words]) > 1:
                raise LensError(f"lens: --motion says {' and '.join(both)}; leave out one of them")
        unit = next((w for w in words if w in conventions.UNITS), "pixels")
        convention = conventions.Motion(unit, "backward" in words, "y-up" in words)
    else:
        convention = frame.motion_kind
    return convention.pixels(frame.motion, dw, dh), convention


def _limits(arguments: argparse.Namespace) -> Limits:
    """The limits that ``--limit`` gives."""
    return Limits.parse(getattr(arguments, "limits", ()))


def _aligned(frame: frames.FrameFile, other: np.ndarray, window: Window) -> np.ndarray:
    """Return the colour of another frame, shifted from its data window to this frame's."""
    out = np.zeros_like(frame.rgba)
    dx, dy = window[0] - frame.window[0], window[1] - frame.window[1]
    h, w = out.shape[:2]
    rows = slice(max(dy, 0), max(min(dy + other.shape[0], h), 0))
    columns = slice(max(dx, 0), max(min(dx + other.shape[1], w), 0))
    if rows.start < rows.stop and columns.start < columns.stop:
        out[rows, columns] = other[rows.start - dy : rows.stop - dy, columns.start - dx : columns.stop - dx]
    return out


def _write(path: Path, image: np.ndarray, window: Window, display: Window) -> None:
    if path.suffix.lower() == ".exr":
        exr.write(path, image, window, display)
        return
    from PIL import Image

    alpha = np.clip(image[..., 3:], 0, 1)
    rgb = np.clip(image[..., :3] / np.maximum(alpha, 1e-6), 0, 1)
    pixels = np.rint(np.concatenate([srgb(rgb), alpha], -1) * 255).astype(np.uint8)
    opaque = bool((alpha > 0.999).all())
    with whole_file(path) as temporary:
        Image.fromarray(pixels[..., :3] if opaque else pixels).save(temporary, format="PNG")
