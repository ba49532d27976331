"""A path-traced picture of a scene: the truth, for looking at."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from PIL import Image

from lightwell.backend import mi
from lightwell.baking.settings import MIDDLE_GREY
from lightwell.files import write_atomically
from lightwell.limits import Limits
from lightwell.report.tonemap import srgb
from lightwell.scenes import load
from lightwell.scenes.placing import initial_light, sample_cameras
from lightwell.scenes.scene import Camera, Scene
from lightwell.scenes.variables import declare
from lightwell.transport.camera import total_image

# Largest picture, pixels: beyond it the sums no longer fit into the memory of a small machine.
MOST_PIXELS = 1 << 26


def render_picture(
    scene: str,
    out: Path,
    *,
    size: str = "640x400",
    spp: int = 128,
    camera: int = 0,
    light: Sequence[str] | None = None,
    intensity: float | None = None,
    seed: int = 0,
    limits: Limits | None = None,
    unit: float = 1.0,
    allow_paths: Sequence[str] = (),
) -> dict[str, Any]:
    """Path-trace and write ``out``; returns what was rendered. Without ``intensity`` the exposure is automatic.

    ``limits``, ``unit`` and ``allow_paths`` are those of ``lightwell.scenes.load``.
    """
    width, height = parse_size(size)
    if out.suffix.lower() not in (".png", ".exr"):
        raise ValueError(f"render: '{out}' is neither .png nor .exr; choose one of them")
    if intensity is not None and not intensity > 0:
        raise ValueError(f"render: --intensity {intensity} is not a light; give a positive number of candela")
    if spp < 1:
        raise ValueError(f"render: --spp {spp} is not a positive number of paths")
    loaded = load(scene, limits=limits, unit=unit, allow_paths=allow_paths)
    view = _camera(loaded, camera)
    variable = declare((), loaded)
    place = parse_point(light) if light else initial_light(loaded, variable, view)
    start = perf_counter()
    picture = total_image(
        loaded,
        view,
        place,
        variable,
        width,
        height,
        spp,
        seed,
        intensity=1.0 if intensity is None else intensity,
        with_static=True,
    )
    seconds = perf_counter() - start
    _write(out, picture, intensity is None)
    return {
        "scene": loaded.name,
        "width": width,
        "height": height,
        "spp": spp,
        "light": [float(c) for c in place],
        "mean_radiance": float(picture.mean()),
        "seconds": seconds,
        "warnings": loaded.warnings,
    }


def parse_size(text: str) -> tuple[int, int]:
    """``640x400`` → (640, 400)."""
    match = re.fullmatch(r"(\d{1,6})x(\d{1,6})", text)
    width, height = (int(v) for v in match.groups()) if match else (0, 0)
    if not 0 < width * height <= MOST_PIXELS:
        raise ValueError(f"render: --size '{text}' is not a picture; write width x height such as 640x400")
    return width, height


def parse_point(texts: Sequence[str]) -> np.ndarray:
    """Three words → [3] float32."""
    try:
        point = np.array([float(v) for v in texts], np.float32)
    except ValueError:
        point = np.array([], np.float32)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise ValueError(f"render: --light {' '.join(texts)} is not a place; write three numbers such as 0 1.5 0")
    return point


def _camera(scene: Scene, index: int) -> Camera:
    if not scene.cameras and index == 0:
        return sample_cameras(scene, declare((), scene), 1, 0)[0]
    if not 0 <= index < len(scene.cameras):
        raise ValueError(f"render: the scene has {len(scene.cameras)} cameras, --camera {index} is none of them")
    return scene.cameras[index]


def _write(out: Path, picture: np.ndarray, automatic: bool) -> None:
    if out.suffix.lower() == ".exr":
        stream = mi.MemoryStream()
        mi.Bitmap(picture).write(stream, mi.Bitmap.FileFormat.OpenEXR)
        stream.seek(0)
        write_atomically(out, stream.read(stream.size()))
        return
    lit = picture.mean(axis=-1)
    scale = MIDDLE_GREY / np.exp(np.mean(np.log(lit[lit > 1e-6]))) if automatic and (lit > 1e-6).any() else 1.0
    exposed = picture * scale
    # Extended Reinhard curve with a white point of 4: keeps the middle tones of the linear picture.
    shown = exposed * (1 + exposed / 16) / (1 + exposed)
    stream = io.BytesIO()
    Image.fromarray((np.clip(srgb(shown), 0, 1) * 255 + 0.5).astype(np.uint8)).save(stream, "PNG")
    write_atomically(out, stream.getvalue())
