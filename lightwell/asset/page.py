"""The page: the built viewer with an asset, its views and its report inside, in one file that opens anywhere."""

from __future__ import annotations

import base64
import gzip
import html
import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lightwell.files import write_atomically

if TYPE_CHECKING:
    from lightwell.scenes.scene import Camera

PLACEHOLDER = "<!--lightwell-data-->"
# Largest finite half float; brighter reference pixels are clipped to it.
MAX_HALF = 65504.0


@dataclass(frozen=True)
class PageView:
    """A held-out view that the page offers for comparison."""

    name: str
    camera: Camera
    light: tuple[float, float, float]
    """Value of the variable: position (metres) or unit direction to the sun."""
    reference: np.ndarray
    """[height, width, 3] path-traced total radiance for the variable's intensity and colour, first row at the top."""


def write_page(
    path: str | Path,
    *,
    title: str,
    glb: bytes,
    home: Camera,
    views: Sequence[PageView] = (),
    exposure: float = 1.0,
    report: Mapping[str, Any] | None = None,
    viewer: str | None = None,
) -> int:
    """Write the self-contained page; return the number of bytes written.

    ``exposure`` multiplies radiance before tone mapping; ``report`` is the content of report.json; ``viewer`` replaces
    the HTML of the built viewer.
    """
    shell = viewer_html() if viewer is None else viewer
    if shell.count(PLACEHOLDER) != 1:
        raise RuntimeError(f"page: the viewer must contain {PLACEHOLDER} once, found {shell.count(PLACEHOLDER)}")
    if not (math.isfinite(exposure) and exposure > 0):
        raise ValueError(f"page: exposure is {exposure}, expected a positive number")
    page = {
        "title": title,
        "exposure": float(exposure),
        "home": camera_json(home),
        "views": [view_json(view) for view in views],
        "report": dict(report or {}),
    }
    before, after = _titled(shell, title).split(PLACEHOLDER)
    return write_atomically(path, (before + _scripts(glb, page) + after).encode())


def viewer_html() -> str:
    """The viewer that was built into the package."""
    try:
        return resources.files("lightwell").joinpath("viewer/index.html").read_text("utf-8")
    except (FileNotFoundError, ModuleNotFoundError) as error:
        raise RuntimeError(
            "page: the built viewer 'lightwell/viewer/index.html' is missing from this installation; "
            "run 'npm ci && npm run build' in web/, or install a released wheel"
        ) from error


def _titled(shell: str, title: str) -> str:
    """The viewer with its first <title> replaced."""
    element = f"<title>{html.escape(title)}</title>"
    return re.sub(r"<title>[^<]*</title>", lambda _: element, shell, count=1)


def _scripts(glb: bytes, page: dict[str, Any]) -> str:
    asset = base64.b64encode(glb).decode()
    try:
        text = script_json(page)
    except ValueError as error:
        raise ValueError("page: its data contains NaN or infinity; find the number that is not finite") from error
    return (
        f'<script type="application/octet-stream;base64" id="lightwell-asset">{asset}</script>\n'
        f'<script type="application/json" id="lightwell-page">{text}</script>'
    )


def script_json(value: Any) -> str:
    """JSON that may stand inside a <script>: no '<' remains, so neither '</script' nor '<!--' can occur."""
    text = json.dumps(value, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def camera_json(camera: Camera) -> dict[str, Any]:
    """A camera as the page reads it; ``fov_y`` in degrees."""
    document = {key: value for key, value in asdict(camera).items() if key != "name"}
    return {k: float(v) if k == "fov_y" else [float(c) for c in v] for k, v in document.items()}


def view_json(view: PageView) -> dict[str, Any]:
    """A view as the page reads it; the reference as gzip-compressed little-endian half floats."""
    height, width, channels = view.reference.shape
    if channels != 3 or not np.isfinite(view.reference).all():
        raise ValueError(f"page: the reference of view '{view.name}' must be finite and have 3 channels")
    halves = np.clip(view.reference, 0, MAX_HALF).astype("<f2")
    # mtime=0: the same picture gives the same bytes.
    packed = gzip.compress(halves.tobytes(), compresslevel=9, mtime=0)
    return {
        "name": view.name,
        "camera": camera_json(view.camera),
        "light": [float(c) for c in view.light],
        "width": width,
        "height": height,
        "reference": base64.b64encode(packed).decode(),
    }
